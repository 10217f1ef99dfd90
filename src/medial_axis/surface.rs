//! The envelope as triangles, for rendering.
//!
//! The plane with the outward normal `n` touches a convex hull of spheres at `c + r n`, for the sphere (or spheres) with
//! the largest `c . n + r`. So every vertex here is a sphere and a direction, and the envelope consists of three kinds of
//! patches:
//!
//! ```text
//!     .--.___                ball     one sphere, all directions
//!    /       ~~~---._        mantle   two spheres, the ring of directions in which both touch the same plane
//!   |  ball   mantle  )      face     three spheres, either direction in which all touch the same plane
//!    \    ___---~~~""
//!     `--'
//! ```
//!
//! Patches of neighbouring primitives intersect each other; only triangles well inside are omitted.

use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::TAU;

use glam::{DVec3, Vec3};

use crate::geometry::{Primitive, Sphere};

/// Triangles with normals.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Surface {
    /// Vertices, in metres, in the frame of the spheres.
    pub positions: Vec<[f32; 3]>,
    /// Outward unit normal of the envelope at each vertex.
    pub normals: Vec<[f32; 3]>,
    /// Three vertices per triangle, counter-clockwise as seen from outside.
    pub indices: Vec<u32>,
}

#[cfg(feature = "bevy_mesh")]
impl From<Surface> for bevy::mesh::Mesh {
    fn from(surface: Surface) -> Self {
        use bevy::mesh::{Indices, Mesh, PrimitiveTopology};

        Mesh::new(PrimitiveTopology::TriangleList, Default::default())
            .with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, surface.positions)
            .with_inserted_attribute(Mesh::ATTRIBUTE_NORMAL, surface.normals)
            .with_inserted_indices(Indices::U32(surface.indices))
    }
}

/// Triangulates the envelope of `primitives`, with about `segments` (at least 4) vertices around each sphere and cone.
///
/// Each sphere, each cone (also as the side of a slab) and each slab is drawn once. Vertices lie on the true envelope or
/// inside it, and normals are those of the true envelope. Degenerate primitives are simplified first.
///
/// # Panics
/// If an index of a primitive is out of range.
pub fn triangulate(spheres: &[Sphere], primitives: &[Primitive], segments: u32) -> Surface {
    let segments = segments.max(4);
    // Balls and mantles, each with the spheres that share a primitive with it and may therefore hide a part of it.
    let mut balls = BTreeMap::<u32, BTreeSet<u32>>::new();
    let mut mantles = BTreeMap::<[u32; 2], BTreeSet<u32>>::new();
    let mut faces = BTreeSet::<[u32; 3]>::new();
    for primitive in primitives {
        for part in primitive.simplified(spheres).iter() {
            let mut corners = part.indices().to_vec();
            corners.sort_unstable();
            for (at, &i) in corners.iter().enumerate() {
                balls.entry(i).or_default().extend(corners.iter().filter(|&&other| other != i));
                for &j in &corners[at + 1..] {
                    mantles.entry([i, j]).or_default().extend(corners.iter().filter(|&&k| k != i && k != j));
                }
            }
            if let [i, j, k] = corners[..] {
                faces.insert([i, j, k]);
            }
        }
    }

    let mut builder = Builder { spheres, margin: (TAU / f64::from(segments)).sin(), surface: Surface::default() };
    let directions = Patch::directions(segments);
    for (sphere, hiders) in balls {
        builder.add(&directions.on(sphere), &hiders);
    }
    for (edge, hiders) in mantles {
        if let Some(mantle) = Patch::mantle(spheres, edge, segments) {
            builder.add(&mantle, &hiders);
        }
    }
    for corners in faces {
        if let Some(faces) = Patch::faces(spheres, corners) {
            builder.add(&faces, &BTreeSet::new());
        }
    }
    builder.surface
}

/// A piece of the envelope of one sphere, cone or slab.
#[derive(Clone, Default)]
struct Patch {
    /// Index of the sphere, and outward unit direction.
    vertices: Vec<(u32, DVec3)>,
    triangles: Vec<[usize; 3]>,
}

impl Patch {
    /// All directions, on sphere 0: an octahedron with divided edges, unfolded to a square.
    fn directions(segments: u32) -> Self {
        let half = segments.div_ceil(4) as usize;
        let side = 2 * half + 1;
        let mut patch = Self::default();
        for at in 0..side * side {
            let [u, v] = [at % side, at / side].map(|i| i as f64 / half as f64 - 1.0);
            let height = 1.0 - u.abs() - v.abs();
            // The corners of the square fold over to the lower half.
            let fold = (-height).max(0.0);
            let direction = DVec3::new(u - fold.copysign(u), v - fold.copysign(v), height);
            patch.vertices.push((0, direction.normalize()));
        }
        for at in (0..side * (side - 1)).filter(|at| at % side + 1 < side) {
            let [a, b, c, d] = [at, at + 1, at + side + 1, at + side];
            // Split along the octahedron's own lines, which never cross the fold.
            let same_sign = (at % side < half) == (at / side < half);
            patch.triangles.extend(if same_sign { [[a, b, d], [b, c, d]] } else { [[a, b, c], [a, c, d]] });
        }
        patch
    }

    /// The same directions on another sphere.
    fn on(&self, sphere: u32) -> Self {
        let mut patch = self.clone();
        patch.vertices.iter_mut().for_each(|vertex| vertex.0 = sphere);
        patch
    }

    /// The conical part of a cone, between the two circles on which it touches its spheres.
    fn mantle(spheres: &[Sphere], [i, j]: [u32; 2], segments: u32) -> Option<Self> {
        let mut patch = Self::default();
        for (segment, direction) in (0..).zip(mantle_directions(spheres, [i, j], segments)?) {
            patch.vertices.extend([(i, direction), (j, direction)]);
            let [from, to] = [segment, (segment + 1) % segments].map(|s| 2 * s as usize);
            patch.triangles.extend([[from, to, to + 1], [from, to + 1, from + 1]]);
        }
        Some(patch)
    }

    /// The two flat faces of a slab.
    fn faces(spheres: &[Sphere], corners: [u32; 3]) -> Option<Self> {
        let vertices = face_normals(spheres, corners)?.iter().flat_map(|&n| corners.map(|i| (i, n))).collect();
        Some(Self { vertices, triangles: vec![[0, 1, 2], [3, 5, 4]] })
    }
}

/// `count` unit normals around a cone, of planes that touch both of its spheres. `None` if the centres coincide.
pub(crate) fn mantle_directions(
    spheres: &[Sphere],
    cone: [u32; 2],
    count: u32,
) -> Option<impl Iterator<Item = DVec3> + use<>> {
    let ([c1, c2], [r1, r2]) = exact(spheres, cone);
    let axis = (c2 - c1).try_normalize()?;
    let cos = (r1 - r2) / c1.distance(c2);
    let sin = (1.0 - cos * cos).max(0.0).sqrt();
    let (side, up) = axis.any_orthonormal_pair();
    Some((0..count).map(move |number| {
        let (y, x) = (TAU * f64::from(number) / f64::from(count)).sin_cos();
        axis * cos + (side * x + up * y) * sin
    }))
}

/// The unit normals of the two planes that touch all spheres of a slab. `None` if the centres are collinear.
pub(crate) fn face_normals(spheres: &[Sphere], slab: [u32; 3]) -> Option<[DVec3; 2]> {
    let ([c1, c2, c3], [r1, r2, r3]) = exact(spheres, slab);
    let (e2, e3) = (c2 - c1, c3 - c1);
    let area = e2.cross(e3);
    let normal = area.try_normalize()?;
    // In-plane gradient of the radius: g . e2 = r2 - r1 and g . e3 = r3 - r1.
    let g = (e3.cross(area) * (r2 - r1) - e2.cross(area) * (r3 - r1)) / area.length_squared();
    let out = normal * (1.0 - g.length_squared()).max(0.0).sqrt();
    Some([out - g, -out - g])
}

/// Centres and radii in f64, because the planes of thin slabs are inaccurate in f32.
fn exact<const N: usize>(spheres: &[Sphere], indices: [u32; N]) -> ([DVec3; N], [f64; N]) {
    let sphere = |i: u32| &spheres[i as usize];
    (indices.map(|i| sphere(i).center.as_dvec3()), indices.map(|i| f64::from(sphere(i).radius)))
}

struct Builder<'a> {
    spheres: &'a [Sphere],
    /// Sine of the angle between two neighbouring directions.
    margin: f64,
    surface: Surface,
}

impl Builder<'_> {
    /// Adds the triangles of `patch` that have an area and are not hidden by a sphere of `hiders`, with their vertices.
    fn add(&mut self, patch: &Patch, hiders: &BTreeSet<u32>) {
        let touched = |&(sphere, direction): &(u32, DVec3)| {
            let ([center], [radius]) = exact(self.spheres, [sphere]);
            (center + direction * radius).as_vec3()
        };
        let points: Vec<Vec3> = patch.vertices.iter().map(touched).collect();
        let mut added = vec![None; points.len()];
        for triangle in &patch.triangles {
            let [a, b, c] = triangle.map(|corner| points[corner]);
            let hidden = |&by: &u32| triangle.iter().all(|&corner| self.hides(by, patch.vertices[corner]));
            if a == b || b == c || c == a || hiders.iter().any(hidden) {
                continue;
            }
            for &corner in triangle {
                let Surface { positions, normals, indices } = &mut self.surface;
                indices.push(*added[corner].get_or_insert_with(|| {
                    positions.push(points[corner].to_array());
                    normals.push(patch.vertices[corner].1.as_vec3().to_array());
                    positions.len() as u32 - 1
                }));
            }
        }
    }

    /// True if the hull of sphere `by` and the vertex's own sphere covers the vertex by a segment or more. With this margin the
    /// flat triangles of the covering patches leave no gap.
    fn hides(&self, by: u32, (sphere, direction): (u32, DVec3)) -> bool {
        let ([c1, c2], [r1, r2]) = exact(self.spheres, [sphere, by]);
        direction.dot(c2 - c1) + r2 - r1 > self.margin * c1.distance(c2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    const SLAB: [Primitive; 1] = [Primitive::Slab([0, 1, 2])];

    fn sphere([x, y, z, radius]: [f32; 4]) -> Sphere {
        Sphere::new(Vec3::new(x, y, z), radius)
    }

    /// Random slabs, thick and thin, with their surfaces. Slabs with repeated corners represent cones and spheres.
    fn samples() -> impl Iterator<Item = ([Sphere; 3], Surface)> {
        let mut random = Random(7);
        (0..60).map(move |round| {
            let thickness = [0.02, 0.2, 0.5, 1.0][round % 4];
            let [a, b, c] = [(); 3].map(|()| sphere([2.0, 2.0, 2.0, thickness].map(|size| size * random.unit())));
            let spheres = [[a, b, c], [a, b, b], [a, a, a]][round % 3];
            (spheres, triangulate(&spheres, &SLAB, 16))
        })
    }

    fn vectors(of: &[[f32; 3]]) -> Vec<DVec3> {
        of.iter().map(|&v| Vec3::from_array(v).as_dvec3()).collect()
    }

    /// Signed distance of `point` to the hull of three spheres, by a grid over the weights that is refined around its best node.
    fn distance(point: DVec3, spheres: &[Sphere; 3]) -> f64 {
        let ([c1, c2, c3], [r1, r2, r3]) = exact(spheres, [0, 1, 2]);
        let gap = |[s, t]: [f64; 2]| {
            point.distance(c1 + (c2 - c1) * s + (c3 - c1) * t) - (r1 + (r2 - r1) * s + (r3 - r1) * t)
        };
        let (mut best, mut step) = ([0.3; 2], 0.2);
        for _ in 0..35 {
            let grid = (0..121).map(|n| [n % 11, n / 11].map(|i| f64::from(i - 5) * step));
            let around = grid.map(|d| [best[0] + d[0], best[1] + d[1]]);
            let inside = around.filter(|[s, t]| *s >= 0.0 && *t >= 0.0 && s + t <= 1.0);
            best = inside.chain([best]).min_by(|a, b| gap(*a).total_cmp(&gap(*b))).unwrap();
            step *= 0.6;
        }
        gap(best)
    }

    #[test]
    fn vertices_lie_on_the_envelope_and_triangles_face_outwards() {
        let mut on_envelope = 0;
        for (spheres, surface) in samples() {
            let (positions, normals) = (vectors(&surface.positions), vectors(&surface.normals));
            for (&position, &normal) in positions.iter().zip(&normals) {
                let beyond = |s: &Sphere| normal.dot(s.center.as_dvec3() - position) + f64::from(s.radius) > 1e-5;
                let covered = spheres.iter().any(beyond);
                let distance = distance(position, &spheres);
                assert!(distance < 1e-5 && (covered || distance > -1e-5), "{distance} from {spheres:?}");
                assert!((normal.length() - 1.0).abs() < 1e-6);
                on_envelope += usize::from(!covered);
            }
            for triangle in surface.indices.chunks_exact(3) {
                let [a, b, c] = [0, 1, 2].map(|k| triangle[k] as usize);
                let winding = (positions[b] - positions[a]).cross(positions[c] - positions[a]);
                assert!([a, b, c].iter().all(|&corner| winding.dot(normals[corner]) > 0.0), "{spheres:?}");
            }
        }
        assert!(on_envelope > 4000, "only {on_envelope} vertices on the envelope");
    }

    #[test]
    fn the_surface_has_no_gaps() {
        for (spheres, surface) in samples() {
            let positions = vectors(&surface.positions);
            for (_, n) in Patch::directions(20).vertices {
                let support = |s: &Sphere| n.dot(s.center.as_dvec3()) + f64::from(s.radius);
                let outermost = spheres.iter().max_by(|a, b| support(a).total_cmp(&support(b))).unwrap();
                // The ray deviates slightly from the direction, so that it does not run along an edge of the triangles.
                let (from, ray) = (outermost.center.as_dvec3(), n + DVec3::new(1e-3, 2e-3, -1e-3));
                let hit = surface.indices.chunks_exact(3).any(|triangle| {
                    let [a, b, c] = [0, 1, 2].map(|k| positions[triangle[k] as usize] - from);
                    let normal = (b - a).cross(c - a);
                    let depth = a.dot(normal) / ray.dot(normal);
                    let passes = [a.cross(b), b.cross(c), c.cross(a)].iter().all(|side| side.dot(ray) >= 0.0);
                    passes && ray.dot(normal) > 0.0 && depth > 0.9 * f64::from(outermost.radius)
                });
                assert!(hit, "{spheres:?} is open towards {n}");
            }
        }
    }

    #[test]
    fn degenerate_primitives_are_drawn_without_nan() {
        let [o, x, y, unit] = [[0.0; 4], [1.0, 0.0, 0.0, 0.0], [0.0, 3.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]];
        let cases = [
            ("three points", [o, x, y], 2),
            ("one point", [o; 3], 0),
            ("points on a line", [o, x, [2.0, 0.0, 0.0, 0.0]], 0),
            ("one sphere thrice", [unit; 3], 128),
            ("all in one", [unit, [0.1, 0.0, 0.0, 0.5], [0.0, 0.2, 0.0, 0.1]], 128),
            ("all in one, touching its inside", [unit, [0.5, 0.0, 0.0, 0.5], [0.0, 0.5, 0.0, 0.5]], 128),
        ];
        for (name, spheres, triangles) in cases {
            let surface = triangulate(&spheres.map(sphere), &SLAB, 16);
            assert!(surface.positions.iter().chain(&surface.normals).flatten().all(|x| x.is_finite()), "{name}");
            assert_eq!(surface.indices.len(), 3 * triangles, "{name}");
        }
        let within = [0.0, 1.5, 0.0, 0.1];
        let [tip, slab] = [[unit, y, y], [unit, y, within]].map(|s| triangulate(&s.map(sphere), &SLAB, 16));
        assert_eq!(tip, slab, "a sphere within the cone of the others changes nothing");
        assert!(tip.positions.contains(&[0.0, 3.0, 0.0]) && tip.normals.iter().flatten().all(|x| x.is_finite()));
    }

    #[test]
    fn shared_parts_are_drawn_once() {
        let spheres = [[0.0, 0.0, 0.0, 0.3], [2.0, 0.0, 0.0, 0.2], [0.0, 2.0, 0.0, 0.1]].map(sphere);
        let all = [SLAB[0], Primitive::Sphere([0]), Primitive::Cone([1, 0]), SLAB[0]];
        assert_eq!(triangulate(&spheres, &all, 16), triangulate(&spheres, &SLAB, 16));
        let turned = triangulate(&spheres, &[SLAB[0], Primitive::Slab([2, 1, 0])], 16);
        assert_eq!(turned, triangulate(&spheres, &SLAB, 16));
    }
}
