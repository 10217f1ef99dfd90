//! The binding of medial spheres to the joints of a skinned triangle mesh.

use std::ops::ControlFlow;

use glam::{DVec3, Vec3};

use super::{
    BuildError, FitOptions, MedialLevels, SkinnedTriangleMesh, TriangleMesh, fit, parallel, tree::closest_on_triangle,
};
use crate::{
    geometry::{Aabb, Bvh, Sphere},
    medial_axis::{JointWeights, MedialAxis, Skin, strongest},
};

/// Distance from a sphere's centre up to which it touches the surface, relative to its radius or to the distance of the nearest surface, whichever is
/// larger. So a sphere in a limb takes its weights from a ring of half its radius to either side, and errors of the fit do not matter.
const REACH: f64 = 1.1;

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
    Ok(fit(mesh.mesh(), options, progress)?.bound(mesh))
}

impl MedialLevels {
    /// The same levels, each [bound](SkinnedTriangleMesh::bind) to the joints of the mesh that they were built from.
    #[must_use]
    pub fn bound(mut self, mesh: &SkinnedTriangleMesh) -> Self {
        for level in &mut self.levels {
            level.axis = mesh.bind(&level.axis);
        }
        self
    }
}

impl SkinnedTriangleMesh {
    /// Binds a medial mesh of this triangle mesh to its joints. Both are in the bind pose.
    ///
    /// The weights of a sphere are the mean of those of the surface that it touches, weighted by area, without all but the four largest. A sphere touches
    /// surface within its radius and 10 % of it, or within the distance of the nearest surface and 10 % of it. Only surface that faces away from the centre
    /// counts, so another limb beside the sphere's own does not.
    #[must_use]
    pub fn bind(&self, axis: &MedialAxis) -> MedialAxis {
        let surface = Surface::new(self);
        let spheres = axis.spheres();
        let weights = parallel::map(spheres.len(), 4, |sphere| surface.weights(&spheres[sphere]));
        let skin = self.skin().with_weights(weights);
        // The counts are equal.
        axis.clone().with_skin(skin).unwrap_or_else(|_| axis.clone())
    }
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
