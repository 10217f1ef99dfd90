//! The generalized medial mesh: shape and broad-phase bound in two flat lists, ready for upload (paper, section 4.2).
//!
//! ```text
//! dynamic    spheres     s0 s1 .. sn-1 | bounding sphere
//!            primitives  [-2 n n] | [-2 i i]  [-1 i j]  [i j k] ..
//!
//! static     spheres     s0 s1 .. sn-1 | (u, o.x) (v, o.y) (w, o.z)
//!            primitives  [n n+1 n+2] | [-2 i i]  [-1 i j]  [i j k] ..
//! ```
//!
//! A sphere is `(x, y, z, radius)`. The first number of a primitive is its kind: -2 for a sphere, -1 for a cone, an index for a slab.
//! The first primitive is the bound: a sphere, or the box `{ o + u t1 + v t2 + w t3, 0 <= t <= 1 }`. The position in the list
//! distinguishes the box from a slab.

use glam::{Mat3, Quat, Vec3, Vec4};
use thiserror::Error;

use super::MedialAxis;
use crate::geometry::{Obb, Pose3, Primitive, Sphere};

const SPHERE: i32 = -2;
const CONE: i32 = -1;

/// Largest allowed cosine between two edges of a box: about a hundred times the rounding error of an f32.
const SKEW: f32 = 1.0e-4;

/// A shape and its bound as flat lists.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PackedMedialMesh {
    /// Spheres as `x y z radius`, then the bound.
    pub spheres: Vec<[f32; 4]>,
    /// The bound, then the primitives.
    pub primitives: Vec<[i32; 3]>,
}

/// A shape and its bound, as returned by [`PackedMedialMesh::unpack`].
#[derive(Clone, Debug, PartialEq)]
pub struct UnpackedMedialMesh {
    /// The broad-phase bound.
    pub bound: Bound,
    /// Spheres in metres.
    pub spheres: Vec<Sphere>,
    /// Primitives; empty for a plain box.
    pub primitives: Vec<Primitive>,
}

/// Bound of a shape in the broad phase.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Bound {
    /// Bound of a dynamic shape.
    Sphere(Sphere),
    /// Bound of a static shape. Packing may reverse the box's own axes; the box is the same.
    Obb(Obb),
}

/// Reasons why lists are not a packed medial mesh.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum PackedError {
    /// There is no primitive, so the bound is missing.
    #[error("the bound is missing: there are no primitives")]
    NoBound,
    /// The first primitive is a cone, or does not refer to the end of the sphere list.
    #[error("the bound {primitive:?} is neither a sphere nor a box at the end of the {spheres} spheres")]
    BadBound {
        /// The first primitive.
        primitive: [i32; 3],
        /// Number of spheres, with those of the bound.
        spheres: usize,
    },
    /// The basis of the bounding box is not orthogonal.
    #[error("the basis vectors of the box are not orthogonal: {0:?}")]
    SkewBox([Vec3; 3]),
    /// A primitive has an unknown kind, or refers to a sphere that does not exist or belongs to the bound.
    #[error("primitive {primitive}: {indices:?} is not a primitive of {spheres} spheres")]
    BadPrimitive {
        /// Index of the primitive in the list.
        primitive: usize,
        /// Its three numbers.
        indices: [i32; 3],
        /// Number of spheres, without those of the bound.
        spheres: usize,
    },
    /// A number is NaN or infinite, or a radius is negative.
    #[error("sphere {sphere}: {values:?} is not finite or has a negative radius")]
    BadSphere {
        /// Index of the sphere in the list.
        sphere: usize,
        /// Its four numbers.
        values: [f32; 4],
    },
}

impl PackedMedialMesh {
    /// A dynamic shape, bounded by its bounding sphere.
    pub fn pack_dynamic(axis: &MedialAxis) -> Self {
        let bound = axis.bounding_sphere();
        let at = axis.spheres().len() as i32;
        Self::pack(Some(axis), &[bound.center.extend(bound.radius)], [SPHERE, at, at])
    }

    /// A static shape, bounded by `obb` in the shape's own frame. Without a shape, the plain box.
    pub fn pack_static(axis: Option<&MedialAxis>, obb: &Obb) -> Self {
        let edges = Mat3::from_quat(obb.pose.rotation) * Mat3::from_diagonal(obb.half_extents * 2.0);
        let corner = obb.pose.transform_point(-obb.half_extents);
        let at = axis.map_or(0, |axis| axis.spheres().len()) as i32;
        let bound = [0, 1, 2].map(|i| edges.col(i).extend(corner[i]));
        Self::pack(axis, &bound, [at, at + 1, at + 2])
    }

    fn pack(axis: Option<&MedialAxis>, bound: &[Vec4], primitive: [i32; 3]) -> Self {
        let (spheres, primitives) = axis.map_or((&[][..], &[][..]), |axis| (axis.spheres(), axis.primitives()));
        let spheres = spheres.iter().map(|s| s.center.extend(s.radius)).chain(bound.iter().copied());
        // The casts are lossless, because no index exceeds `MAX_SPHERES`.
        let primitives = primitives.iter().map(|primitive| match *primitive {
            Primitive::Sphere([i]) => [SPHERE, i as i32, i as i32],
            Primitive::Cone([i, j]) => [CONE, i as i32, j as i32],
            Primitive::Slab(slab) => slab.map(|i| i as i32),
        });
        Self {
            spheres: spheres.map(Into::into).collect(),
            primitives: std::iter::once(primitive).chain(primitives).collect(),
        }
    }

    /// The shape and its bound.
    ///
    /// # Errors
    /// If the bound or a primitive is missing or malformed, if a number is not finite, or if a radius is negative.
    pub fn unpack(&self) -> Result<UnpackedMedialMesh, PackedError> {
        let bad = self.spheres.iter().position(|values| values.iter().any(|v| !v.is_finite()));
        if let Some(sphere) = bad {
            return Err(PackedError::BadSphere { sphere, values: self.spheres[sphere] });
        }
        let (first, rest) = self.primitives.split_first().ok_or(PackedError::NoBound)?;
        let (bound, count) = self.bound(*first)?;
        let spheres = self.spheres[..count].iter().enumerate().map(|(i, values)| sphere(i, *values));
        let primitives = (1..).zip(rest).map(|(number, indices)| {
            primitive(*indices, count).ok_or(PackedError::BadPrimitive {
                primitive: number,
                indices: *indices,
                spheres: count,
            })
        });
        Ok(UnpackedMedialMesh {
            bound,
            spheres: spheres.collect::<Result<_, _>>()?,
            primitives: primitives.collect::<Result<_, _>>()?,
        })
    }

    /// The bound, and the number of spheres before it.
    fn bound(&self, primitive: [i32; 3]) -> Result<(Bound, usize), PackedError> {
        let len = self.spheres.len();
        let index = |i: i32| usize::try_from(i).ok();
        match primitive {
            [SPHERE, i, j] if i == j && index(i).is_some_and(|i| i + 1 == len) => {
                Ok((Bound::Sphere(sphere(len - 1, self.spheres[len - 1])?), len - 1))
            }
            [i, j, k] if len >= 3 && [i, j, k].map(index) == [Some(len - 3), Some(len - 2), Some(len - 1)] => {
                let rows = [len - 3, len - 2, len - 1].map(|i| Vec4::from(self.spheres[i]));
                let obb = obb(rows.map(Vec4::truncate), Vec3::from(rows.map(|row| row.w)))?;
                Ok((Bound::Obb(obb), len - 3))
            }
            _ => Err(PackedError::BadBound { primitive, spheres: len }),
        }
    }
}

fn sphere(number: usize, values: [f32; 4]) -> Result<Sphere, PackedError> {
    let [x, y, z, radius] = values;
    // `unpack` has checked that all values are finite.
    if radius < 0.0 {
        return Err(PackedError::BadSphere { sphere: number, values });
    }
    Ok(Sphere::new(Vec3::new(x, y, z), radius))
}

fn primitive(indices: [i32; 3], spheres: usize) -> Option<Primitive> {
    let index = |i: i32| u32::try_from(i).ok().filter(|&i| (i as usize) < spheres);
    Some(match indices {
        [SPHERE, i, j] if i == j => Primitive::Sphere([index(i)?]),
        [CONE, i, j] => Primitive::Cone([index(i)?, index(j)?]),
        [i, j, k] => Primitive::Slab([index(i)?, index(j)?, index(k)?]),
    })
}

/// The box with the given edges from a corner.
fn obb(edges: [Vec3; 3], corner: Vec3) -> Result<Obb, PackedError> {
    let mut axes = edges.map(Vec3::normalize_or_zero);
    if (0..3).any(|i| axes[i].dot(axes[(i + 1) % 3]).abs() > SKEW) {
        return Err(PackedError::SkewBox(edges));
    }
    for i in 0..3 {
        // A flat box has no direction across it: any direction orthogonal to the other axes is valid.
        let others = [axes[(i + 1) % 3], axes[(i + 2) % 3]];
        if axes[i] == Vec3::ZERO {
            let across = others[0].cross(others[1]).normalize_or_zero();
            let known = (others[0] + others[1]).normalize_or(Vec3::X);
            axes[i] = if across == Vec3::ZERO { known.any_orthonormal_vector() } else { across };
        }
    }
    // Reversing an axis makes a left-handed basis right-handed and keeps the box.
    axes[2] *= axes[0].cross(axes[1]).dot(axes[2]).signum();
    Ok(Obb {
        pose: Pose3::from_parts(
            corner + (edges[0] + edges[1] + edges[2]) * 0.5,
            Quat::from_mat3(&Mat3::from_cols(axes[0], axes[1], axes[2])).normalize(),
        ),
        half_extents: Vec3::from(edges.map(Vec3::length)) * 0.5,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    fn shape() -> MedialAxis {
        let at = |x: f32, y: f32, radius: f32| Sphere::new(Vec3::new(x, y, 0.5), radius);
        let spheres =
            vec![at(0.0, 0.0, 0.5), at(2.0, 0.0, 0.25), at(0.0, 2.0, 0.0), at(5.0, 5.0, 1.0), at(9.0, 0.0, 1.0)];
        let primitives = vec![Primitive::Slab([0, 1, 2]), Primitive::Cone([1, 3])];
        MedialAxis::new(spheres, primitives).unwrap().0
    }

    fn corners(obb: &Obb) -> Vec<Vec3> {
        let signs = |i: i32| Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32) * 2.0 - 1.0;
        (0..8).map(|i| obb.pose.transform_point(obb.half_extents * signs(i))).collect()
    }

    fn assert_same_box(a: &Obb, b: &Obb) {
        let (a_corners, b_corners) = (corners(a), corners(b));
        let tolerance = 1e-5 * (a.half_extents.length() + a.pose.translation.length());
        for a in &a_corners {
            assert!(b_corners.iter().any(|b| a.distance(*b) < tolerance), "{a_corners:?} {b_corners:?}");
        }
    }

    #[test]
    fn layout_is_the_papers() {
        let packed = PackedMedialMesh::pack_dynamic(&shape());
        assert_eq!(packed.primitives, [[-2, 5, 5], [-2, 4, 4], [-1, 1, 3], [0, 1, 2]]);
        assert_eq!((packed.spheres.len(), packed.spheres[1]), (6, [2.0, 0.0, 0.5, 0.25]));
        let obb =
            Obb { pose: Pose3::from_translation(Vec3::new(10.0, 20.0, 30.0)), half_extents: Vec3::new(1.0, 2.0, 3.0) };
        let packed = PackedMedialMesh::pack_static(None, &obb);
        assert_eq!(packed.primitives, [[0, 1, 2]]);
        assert_eq!(packed.spheres, [[2.0, 0.0, 0.0, 9.0], [0.0, 4.0, 0.0, 18.0], [0.0, 0.0, 6.0, 27.0]]);
    }

    #[test]
    fn dynamic_round_trip() {
        let axis = shape();
        let unpacked = PackedMedialMesh::pack_dynamic(&axis).unpack().unwrap();
        assert_eq!(unpacked.bound, Bound::Sphere(axis.bounding_sphere()));
        assert_eq!((&unpacked.spheres[..], &unpacked.primitives[..]), (axis.spheres(), axis.primitives()));
    }

    #[test]
    fn static_round_trip() {
        let mut random = Random(13);
        for case in 0..500 {
            let rotation = Quat::from_scaled_axis(random.in_cube() * 3.0);
            // All eight combinations of flat axes.
            let flat = Vec3::new((case & 1) as f32, (case >> 1 & 1) as f32, (case >> 2 & 1) as f32);
            let half_extents = (random.in_cube() + 1.1) * flat;
            let obb = Obb { pose: Pose3::from_parts(random.in_cube() * 10.0, rotation), half_extents };
            let axis = (case % 3 > 0).then(shape);
            let mut packed = PackedMedialMesh::pack_static(axis.as_ref(), &obb);
            let unpacked = packed.unpack().unwrap();
            assert_eq!(unpacked.spheres, axis.as_ref().map_or(&[][..], |axis| axis.spheres()));
            assert_eq!(unpacked.primitives, axis.as_ref().map_or(&[][..], |axis| axis.primitives()));
            let Bound::Obb(found) = unpacked.bound else { panic!("{unpacked:?}") };
            assert_same_box(&obb, &found);
            assert!(found.pose.rotation.is_normalized());
            // The mirror image of the basis, starting at the opposite corner along the last axis.
            let n = packed.spheres.len();
            let w = Vec4::from(packed.spheres[n - 1]).truncate();
            for (row, shift) in packed.spheres[n - 3..].iter_mut().zip(w.to_array()) {
                row[3] += shift;
            }
            packed.spheres[n - 1][..3].copy_from_slice(&(-w).to_array());
            let Bound::Obb(mirrored) = packed.unpack().unwrap().bound else { panic!() };
            assert_same_box(&obb, &mirrored);
        }
    }

    #[test]
    fn broken_lists_are_refused() {
        let good = PackedMedialMesh::pack_dynamic(&shape());
        let refused = |change: &dyn Fn(&mut PackedMedialMesh)| {
            let mut packed = good.clone();
            change(&mut packed);
            packed.unpack().unwrap_err().to_string()
        };
        assert_eq!(refused(&|p| p.primitives.clear()), "the bound is missing: there are no primitives");
        let bound = "is neither a sphere nor a box at the end of the 6 spheres";
        assert_eq!(refused(&|p| p.primitives[0] = [-2, 4, 4]), format!("the bound [-2, 4, 4] {bound}"));
        assert_eq!(refused(&|p| p.primitives[0] = [-1, 4, 5]), format!("the bound [-1, 4, 5] {bound}"));
        assert_eq!(refused(&|p| p.primitives[0] = [0, 1, 2]), format!("the bound [0, 1, 2] {bound}"));
        let spheres = "is not a primitive of 5 spheres";
        assert_eq!(refused(&|p| p.primitives[2] = [-1, 1, 5]), format!("primitive 2: [-1, 1, 5] {spheres}"));
        assert_eq!(refused(&|p| p.primitives[1] = [-3, 1, 1]), format!("primitive 1: [-3, 1, 1] {spheres}"));
        assert_eq!(refused(&|p| p.primitives[1] = [-2, 1, 2]), format!("primitive 1: [-2, 1, 2] {spheres}"));
        assert_eq!(refused(&|p| p.primitives[3] = [0, -1, 2]), format!("primitive 3: [0, -1, 2] {spheres}"));
        let broken = "is not finite or has a negative radius";
        assert_eq!(refused(&|p| p.spheres[1][3] = -1.0), format!("sphere 1: [2.0, 0.0, 0.5, -1.0] {broken}"));
        assert_eq!(refused(&|p| p.spheres[1][0] = f32::NAN), format!("sphere 1: [NaN, 0.0, 0.5, 0.25] {broken}"));
        assert_eq!(
            refused(&|p| p.spheres.clear()),
            "the bound [-2, 5, 5] is neither a sphere nor a box at the end of the 0 spheres"
        );
        let obb = Obb { pose: Pose3::IDENTITY, half_extents: Vec3::ONE };
        let mut skew = PackedMedialMesh::pack_static(None, &obb);
        skew.spheres[0][1] = 0.1;
        assert!(matches!(skew.unpack(), Err(PackedError::SkewBox(_))));
    }
}
