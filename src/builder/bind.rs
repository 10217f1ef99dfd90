//! The binding of medial spheres to the joints of a skinned triangle mesh.

use std::{collections::BTreeSet, ops::ControlFlow};

use glam::{DVec3, Vec3};

use super::{
    BuildError, FitOptions, MedialLevels, SkinnedTriangleMesh, TriangleMesh, envelope::edges_of, fit, parallel,
    tree::closest_on_triangle,
};
use crate::{
    geometry::{Aabb, Bvh, Primitive, Sphere},
    medial_axis::{JointWeights, MedialAxis, MedialAxisError, Skin, strongest, summed},
};

/// Distance from a sphere's centre up to which it touches the surface, relative to its radius or to the distance of the nearest surface, whichever is
/// larger. So a sphere in a limb takes its weights from a ring of a third of its radius to either side, and errors of the fit do not matter.
const REACH: f64 = 1.05;

/// Largest distance from an edge of a sphere that is not added, in radii, if the joints of the edge turn by one radian. It has two parts: the sphere follows
/// other joints than the blend of the ends does, and the path of a blend is an arc.
const STRAIGHT: f64 = 0.2;

/// Largest number of spheres with those that are added, relative to their number before. Slabs between limbs would have no end of them.
const MOST: usize = 3;

/// Length of the shortest edge that is split, relative to the radius of its larger sphere.
const SHORTEST: f64 = 0.5;

/// Builds medial meshes of a skinned triangle mesh in its bind pose, and [binds](SkinnedTriangleMesh::bind) the spheres of each level. The errors are those
/// in the bind pose.
///
/// # Errors
/// The errors of [`fit`].
pub fn fit_skinned(
    mesh: &SkinnedTriangleMesh,
    options: &FitOptions,
    progress: &(dyn Fn(f32) -> ControlFlow<()> + Sync),
) -> Result<MedialLevels, BuildError> {
    Ok(fit(mesh.mesh(), options, progress)?.bound(mesh)?)
}

impl MedialLevels {
    /// The same levels, each [bound](SkinnedTriangleMesh::bind) to the joints of the mesh that they were built from.
    ///
    /// # Errors
    /// The errors of the binding.
    pub fn bound(mut self, mesh: &SkinnedTriangleMesh) -> Result<Self, MedialAxisError> {
        for level in &mut self.levels {
            level.axis = mesh.bind(&level.axis)?;
        }
        Ok(self)
    }
}

impl SkinnedTriangleMesh {
    /// Binds a medial mesh of this triangle mesh to its joints. Both are in the bind pose.
    ///
    /// The weights of a sphere are the mean of those of the surface that it touches, weighted by area, without all but the four largest. A sphere touches
    /// surface within its radius and 5 % of it, or within the distance of the nearest surface and 5 % of it. Only surface that faces away from the centre
    /// counts, so another limb beside the sphere's own does not.
    ///
    /// Where the weights change between two spheres, as at the joint between them, more spheres are added, so that the limb can bend there. They do not change
    /// the shape in the bind pose.
    ///
    /// # Errors
    /// None for a medial mesh of this triangle mesh. Added spheres count for [`MAX_SPHERES`](crate::medial_axis::MAX_SPHERES).
    pub fn bind(&self, axis: &MedialAxis) -> Result<MedialAxis, MedialAxisError> {
        let surface = Surface::new(self);
        let Parts { spheres, primitives, .. } = Parts::new(&surface, axis).refined(&surface);
        let (axis, _) = MedialAxis::new(spheres, primitives)?;
        let skin = self.skin().with_weights(surface.all_weights(axis.spheres()));
        Ok(axis.bound(skin))
    }
}

/// Spheres with their weights, and the primitives between them.
struct Parts {
    spheres: Vec<Sphere>,
    weights: Vec<JointWeights>,
    primitives: Vec<Primitive>,
}

impl Parts {
    fn new(surface: &Surface, axis: &MedialAxis) -> Self {
        let spheres = axis.spheres().to_vec();
        Self { weights: surface.all_weights(&spheres), spheres, primitives: axis.primitives().to_vec() }
    }

    /// Adds spheres on edges that would not stay straight, the longest bends first.
    fn refined(mut self, surface: &Surface) -> Self {
        let pairs = |primitive: &Primitive| match *primitive {
            Primitive::Sphere(_) => vec![],
            Primitive::Cone(edge) => vec![edge],
            Primitive::Slab(face) => edges_of(face).into(),
        };
        let edges: BTreeSet<[u32; 2]> = self.primitives.iter().flat_map(pairs).collect();
        let mut open: Vec<Bend> = edges.into_iter().filter_map(|edge| self.bend(surface, edge)).collect();
        let most = self.spheres.len() * MOST;
        while self.spheres.len() < most
            && let Some(longest) = (0..open.len()).max_by(|&a, &b| open[a].length.total_cmp(&open[b].length))
        {
            let Bend { edge, sphere, weights, .. } = open.swap_remove(longest);
            self.spheres.push(sphere);
            self.weights.push(weights);
            open.extend(self.split(edge).into_iter().filter_map(|edge| self.bend(surface, edge)));
        }
        self
    }

    /// The sphere on an edge that would bend away most, if that is far enough.
    fn bend(&self, surface: &Surface, edge: [u32; 2]) -> Option<Bend> {
        let [a, b] = edge.map(|i| self.spheres[i as usize]);
        let length = f64::from(a.center.distance(b.center));
        let slenderness = length / f64::from(a.radius.max(b.radius));
        if slenderness < SHORTEST {
            return None;
        }
        let ends = edge.map(|i| self.weights[i as usize]);
        let step = difference(&ends, 0.0, &ends[1]);
        let bends = [0.5, 0.25, 0.75].map(|at: f32| {
            let (sphere, part) = (a.lerp(&b, at), f64::from(at));
            let weights = surface.weights(&sphere);
            (difference(&ends, part, &weights) + part * (1.0 - part) * step * slenderness, sphere, weights)
        });
        let [first, others @ ..] = bends;
        let (bend, sphere, weights) =
            others.into_iter().fold(first, |most, bend| if bend.0 > most.0 { bend } else { most });
        (bend > STRAIGHT).then_some(Bend { length: bend * length, edge, sphere, weights })
    }

    /// Splits the primitives with an edge at the last sphere. Returns the new edges.
    fn split(&mut self, [i, j]: [u32; 2]) -> Vec<[u32; 2]> {
        // The cast is lossless: memory does not suffice for more spheres.
        let k = self.spheres.len() as u32 - 1;
        let (mut edges, mut halves) = (vec![[i, k], [k, j]], vec![]);
        for primitive in &mut self.primitives {
            match *primitive {
                Primitive::Cone(edge) if edge == [i, j] || edge == [j, i] => {
                    *primitive = Primitive::Cone([i, k]);
                    halves.push(Primitive::Cone([k, j]));
                }
                Primitive::Slab(face) if face.contains(&i) && face.contains(&j) => {
                    let Some(apex) = face.into_iter().find(|corner| ![i, j].contains(corner)) else { continue };
                    *primitive = Primitive::Slab([i, k, apex]);
                    halves.push(Primitive::Slab([k, j, apex]));
                    edges.push([k, apex]);
                }
                _ => {}
            }
        }
        self.primitives.extend(halves);
        edges
    }
}

/// A sphere to add on an edge.
struct Bend {
    /// Distance of the sphere from the edge in radii, times the length of the edge.
    length: f64,
    edge: [u32; 2],
    sphere: Sphere,
    weights: JointWeights,
}

/// Half the sum of the differences of weights from the blend of those of two ends: the part of a sphere that follows other joints.
fn difference([a, b]: &[JointWeights; 2], at: f64, weights: &JointWeights) -> f64 {
    let scaled = |weights: &JointWeights, part: f64| weights.map(|(joint, weight)| (joint, part * f64::from(weight)));
    let all = [scaled(a, 1.0 - at), scaled(b, at), scaled(weights, -1.0)];
    0.5 * summed(all.into_iter().flatten()).iter().map(|(_, sum)| sum.abs()).sum::<f64>()
}

/// The triangles of a skinned mesh.
struct Surface<'a> {
    mesh: &'a TriangleMesh,
    skin: &'a Skin,
    bvh: Bvh,
    /// 1 if the triangles are counter-clockwise as seen from outside, -1 otherwise.
    orientation: f64,
}

/// The point of a triangle that is nearest to a sphere's centre.
struct Nearest {
    triangle: u32,
    point: DVec3,
    distance: f64,
    /// True if the triangle faces away from the centre.
    is_own: bool,
}

impl<'a> Surface<'a> {
    fn new(skinned: &'a SkinnedTriangleMesh) -> Self {
        let (mesh, skin) = (skinned.mesh(), skinned.skin());
        let boxes = mesh.triangles.iter().map(|&triangle| {
            let corners = mesh.corners(triangle).map(|corner| Sphere::new(corner, 0.0));
            Aabb::from_spheres(corners)
        });
        let volume = |&triangle: &[u32; 3]| {
            let [a, b, c] = mesh.corners(triangle).map(Vec3::as_dvec3);
            a.dot(b.cross(c))
        };
        let orientation = mesh.triangles.iter().map(volume).sum::<f64>().signum();
        Self { bvh: Bvh::new(&boxes.collect::<Vec<_>>()), mesh, skin, orientation }
    }

    fn corners(&self, triangle: u32) -> [DVec3; 3] {
        self.mesh.corners(self.mesh.triangles[triangle as usize]).map(Vec3::as_dvec3)
    }

    fn nearest(&self, triangle: u32, center: DVec3) -> Nearest {
        let corners = self.corners(triangle);
        let point = closest_on_triangle(center, &corners);
        let outward = area_vector(&corners) * self.orientation;
        Nearest { triangle, point, distance: point.distance(center), is_own: outward.dot(point - center) > 0.0 }
    }

    /// The weights of each sphere.
    fn all_weights(&self, spheres: &[Sphere]) -> Vec<JointWeights> {
        parallel::map(spheres.len(), 4, |sphere| self.weights(&spheres[sphere]))
    }

    /// The weights of a sphere.
    fn weights(&self, sphere: &Sphere) -> JointWeights {
        let center = sphere.center.as_dvec3();
        let of_own = |triangle| {
            let nearest = self.nearest(triangle, center);
            if nearest.is_own { nearest.distance as f32 } else { f32::INFINITY }
        };
        let bound = |aabb: &Aabb| aabb.distance(sphere.center);
        let gap = self.bvh.least(bound, of_own).map_or(f32::INFINITY, |(_, distance)| distance);
        let reach = f64::from(sphere.radius.max(gap)) * REACH;
        let mut sums = vec![0.0; self.skin.joints().len()];
        let own = |aabb: &Aabb| f64::from(aabb.distance(sphere.center)) <= reach;
        self.bvh.visit(own, |triangle| {
            let nearest = self.nearest(triangle, center);
            if nearest.is_own && nearest.distance <= reach {
                self.add(&nearest, &mut sums);
            }
        });
        // The cast is lossless, because joints have indices of 16 bits.
        let sums = (0..).zip(&sums).map(|(joint, &sum)| (joint as u16, sum));
        strongest(sums).unwrap_or_else(|| self.of_nearest(center))
    }

    /// The weights of a vertex of the nearest triangle, for a sphere that no surface encloses.
    fn of_nearest(&self, center: DVec3) -> JointWeights {
        let distance = |triangle| self.nearest(triangle, center).distance as f32;
        let found = self.bvh.least(|aabb| aabb.distance(center.as_vec3()), distance);
        let vertex = found.map_or(0, |(triangle, _)| self.mesh.triangles[triangle as usize][0]);
        self.skin.weights()[vertex as usize]
    }

    /// Adds the weights of the skin at a point of a triangle, times the triangle's area.
    fn add(&self, &Nearest { triangle, point, .. }: &Nearest, sums: &mut [f64]) {
        let corners = self.corners(triangle);
        let [a, b, c] = corners;
        let area = area_vector(&corners);
        // Twice the areas of the triangles between the point and each edge, as parts of the triangle's area.
        let parts = [[b, c], [c, a], [a, b]].map(|[from, to]| area_vector(&[point, from, to]).dot(area));
        let length = area.length().max(f64::MIN_POSITIVE);
        for (vertex, part) in self.mesh.triangles[triangle as usize].into_iter().zip(parts) {
            for &(joint, weight) in &self.skin.weights()[vertex as usize] {
                sums[usize::from(joint)] += part.max(0.0) / length * f64::from(weight);
            }
        }
    }
}

/// The outward normal of a counter-clockwise triangle. Its length is twice the area.
fn area_vector(&[a, b, c]: &[DVec3; 3]) -> DVec3 {
    (b - a).cross(c - a)
}

#[cfg(test)]
mod tests;
