//! The generalized medial mesh: a shape in two flat lists, ready for upload (paper, section 4.2).
//!
//! ```text
//! spheres     s0 s1 .. sn-1
//! primitives  [-2 i i]  [-1 i j]  [i j k] ..
//! ```
//!
//! A sphere is `(x, y, z, radius)`. The first number of a primitive is its kind: -2 for a sphere, -1 for a cone, an index for a slab.
//!
//! The paper appends the bound of the broad phase. Here the bounds of bodies and statics lie in their own records, because each body scales its bound, and
//! because the broad phase of the GPU already reads as many buffers as every adapter of WebGPU supports.

use super::MedialAxis;
use crate::geometry::Primitive;

const SPHERE: i32 = -2;
const CONE: i32 = -1;

/// A shape as flat lists.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PackedMedialMesh {
    /// Spheres as `x y z radius`, in metres.
    pub spheres: Vec<[f32; 4]>,
    /// Kind and indices of each primitive.
    pub primitives: Vec<[i32; 3]>,
}

impl PackedMedialMesh {
    /// Packs a shape.
    pub fn new(axis: &MedialAxis) -> Self {
        // The casts are lossless, because no index exceeds `MAX_SPHERES`.
        let pack = |primitive: &Primitive| match *primitive {
            Primitive::Sphere([i]) => [SPHERE, i as i32, i as i32],
            Primitive::Cone([i, j]) => [CONE, i as i32, j as i32],
            Primitive::Slab(slab) => slab.map(|i| i as i32),
        };
        Self {
            spheres: axis.spheres().iter().map(|sphere| sphere.center.extend(sphere.radius).into()).collect(),
            primitives: axis.primitives().iter().map(pack).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::geometry::Sphere;

    #[test]
    fn kinds_and_indices_are_those_of_the_paper() {
        let at = |x: f32, y: f32, radius: f32| Sphere::new(Vec3::new(x, y, 0.5), radius);
        let spheres =
            vec![at(0.0, 0.0, 0.5), at(2.0, 0.0, 0.25), at(0.0, 2.0, 0.0), at(5.0, 5.0, 1.0), at(9.0, 0.0, 1.0)];
        let primitives = vec![Primitive::Slab([0, 1, 2]), Primitive::Cone([1, 3])];
        let packed = PackedMedialMesh::new(&MedialAxis::new(spheres, primitives).unwrap().0);
        assert_eq!(packed.primitives, [[-2, 4, 4], [-1, 1, 3], [0, 1, 2]]);
        assert_eq!((packed.spheres.len(), packed.spheres[1]), (5, [2.0, 0.0, 0.5, 0.25]));
    }
}
