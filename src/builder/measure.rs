use std::fmt;

use glam::{DVec3, Vec3};

use super::{TriangleMesh, parallel, samples::Patch};
use crate::{
    geometry::{Aabb, Bvh, Primitive, Sphere},
    medial_axis::MedialAxis,
    pipeline::{Hull, with_spheres},
    query::separation,
};

/// Distance of the points at which surfaces are sampled, per diagonal.
const SPACING: f64 = 1.0 / 300.0;

/// Most points on the envelope, or on the mesh, beyond those that every patch has. Large parts far from the mesh would ask for more.
const MOST_SAMPLES: f64 = 6.0e5;

/// Points of the envelope's patches deeper inside than this, relative to the size of all, are hidden by other primitives.
const HIDDEN: f32 = 1.0e-5;

/// How far one surface is from another, in percent of the mesh's diagonal.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Deviation {
    /// Greatest distance of a point.
    pub max: f32,
    /// Mean distance over the area.
    pub mean: f32,
}

/// How well a medial mesh stands for a triangle mesh.
///
/// Each direction finds what the other is blind to: a limb that is missing is far from the envelope, while the envelope is near the mesh
/// everywhere; a sphere too much is far from the mesh.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TwoSidedError {
    /// From the mesh's surface to the envelope. Exact outside the envelope, inside a lower bound: the depth in the deepest
    /// primitive, which is less than the depth in the union where primitives overlap.
    pub mesh_to_envelope: Deviation,
    /// From the envelope to the mesh's surface.
    pub envelope_to_mesh: Deviation,
    /// Diagonal of the mesh's bounding box in metres, of which all is a percentage.
    pub diagonal: f32,
}

impl TwoSidedError {
    /// Greatest distance in either direction, in percent of the diagonal: the Hausdorff distance, as far as samples tell.
    pub fn max(&self) -> f32 {
        self.mesh_to_envelope.max.max(self.envelope_to_mesh.max)
    }
}

impl fmt::Display for TwoSidedError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { mesh_to_envelope: to, envelope_to_mesh: from, .. } = self;
        write!(f, "mesh to envelope: max {:.3} % mean {:.4} %, ", to.max, to.mean)?;
        write!(f, "envelope to mesh: max {:.3} % mean {:.4} %", from.max, from.mean)
    }
}

/// The two-sided error of a medial mesh, both in one frame.
///
/// Surfaces are sampled evenly, about 300 points to the diagonal, the mesh also at its vertices; distances are to the surfaces
/// themselves. The same input gives the same bits, whatever the number of threads.
///
/// # Panics
/// If an index of the mesh is out of range.
pub fn measure(mesh: &TriangleMesh, axis: &MedialAxis) -> TwoSidedError {
    let frame = Frame::new(mesh, axis);
    let triangles: Vec<Patch> = frame.triangles(mesh).map(Patch::Triangle).collect();
    let surface = Union::new(frame.triangles(mesh).map(|t| Hull::Slab(t.map(|p| Sphere::new(p, 0.0)))).collect());
    let spheres = frame.spheres(axis);
    let envelope = Union::of(&spheres, axis.primitives());
    let spacing = SPACING * frame.diagonal / frame.unit;

    let mut to_envelope = sum(&triangles, spacing, |point| Some(envelope.distance(point).abs()));
    let errors = signed(mesh, &frame, &envelope);
    let used = mesh.triangles.iter().flatten().map(|&i| errors[i as usize].abs());
    to_envelope.max = used.fold(to_envelope.max, f32::max);
    let to_mesh = sum(&Patch::of(&spheres, axis.primitives()), spacing, |point| {
        (!envelope.hides(point)).then(|| surface.distance(point).abs())
    });
    let deviation = |sum: Sum| Deviation { max: frame.percent(sum.max), mean: frame.percent(sum.mean()) };
    TwoSidedError {
        mesh_to_envelope: deviation(to_envelope),
        envelope_to_mesh: deviation(to_mesh),
        diagonal: frame.diagonal as f32,
    }
}

/// The signed distance of each vertex from the envelope in percent of the diagonal: positive where the envelope is too far inside, negative
/// where it bulges out of the mesh. For pictures.
///
/// # Panics
/// If an index of the mesh is out of range.
pub fn vertex_errors(mesh: &TriangleMesh, axis: &MedialAxis) -> Vec<f32> {
    let frame = Frame::new(mesh, axis);
    let envelope = Union::of(&frame.spheres(axis), axis.primitives());
    let mut errors = signed(mesh, &frame, &envelope);
    errors.iter_mut().for_each(|error| *error = frame.percent(*error));
    errors
}

/// The signed distance of each vertex from the envelope, in the frame.
fn signed(mesh: &TriangleMesh, frame: &Frame, envelope: &Union) -> Vec<f32> {
    const VERTICES_PER_TASK: usize = 256;
    let positions = &mesh.positions;
    parallel::map(positions.len(), VERTICES_PER_TASK, |i| envelope.distance(frame.point(positions[i])))
}

/// Coordinates in which both shapes are near the origin and about 1 in size, where f32 is exact to a few parts in ten million.
struct Frame {
    origin: DVec3,
    /// Metres.
    unit: f64,
    /// Of the mesh, in metres.
    diagonal: f64,
}

impl Frame {
    fn new(mesh: &TriangleMesh, axis: &MedialAxis) -> Self {
        let [around, other] = [mesh.aabb(), axis.aabb()];
        let size = |aabb: Aabb| aabb.min.as_dvec3().distance(aabb.max.as_dvec3());
        let origin = around.center().as_dvec3();
        let apart = origin.distance(other.center().as_dvec3());
        Self { origin, unit: size(around).max(size(other)).max(apart), diagonal: size(around) }
    }

    fn point(&self, point: Vec3) -> Vec3 {
        ((point.as_dvec3() - self.origin) / self.unit).as_vec3()
    }

    fn triangles<'a>(&'a self, mesh: &'a TriangleMesh) -> impl Iterator<Item = [Vec3; 3]> + 'a {
        mesh.triangles.iter().map(|triangle| mesh.corners(*triangle).map(|corner| self.point(corner)))
    }

    fn spheres(&self, axis: &MedialAxis) -> Vec<Sphere> {
        let place = |s: &Sphere| Sphere::new(self.point(s.center), (f64::from(s.radius) / self.unit) as f32);
        axis.spheres().iter().map(place).collect()
    }

    /// A length of the frame in percent of the diagonal.
    fn percent(&self, length: f32) -> f32 {
        (f64::from(length) * self.unit / self.diagonal * 100.0) as f32
    }
}

/// A union of convex hulls of spheres: an envelope, or as hulls of points the triangles of a mesh.
struct Union {
    hulls: Vec<Hull>,
    bvh: Bvh,
}

impl Union {
    fn new(hulls: Vec<Hull>) -> Self {
        let aabb = |hull: &Hull| with_spheres!(*hull, |spheres| Aabb::from_spheres(spheres));
        let boxes: Vec<Aabb> = hulls.iter().map(aabb).collect();
        Self { hulls, bvh: Bvh::new(&boxes) }
    }

    fn of(spheres: &[Sphere], primitives: &[Primitive]) -> Self {
        let sphere = |i: u32| spheres[i as usize];
        let hull = |primitive: &Primitive| match *primitive {
            Primitive::Sphere(index) => Hull::Sphere(index.map(sphere)),
            Primitive::Cone(index) => Hull::Cone(index.map(sphere)),
            Primitive::Slab(index) => Hull::Slab(index.map(sphere)),
        };
        Self::new(primitives.iter().map(hull).collect())
    }

    fn distance_to(&self, hull: u32, point: Vec3) -> f32 {
        let point = [Sphere::new(point, 0.0)];
        with_spheres!(self.hulls[hull as usize], |spheres| separation(&point, &spheres, 0).distance)
    }

    /// Least signed distance to a hull.
    fn distance(&self, point: Vec3) -> f32 {
        // No point of a hull is deeper inside it than inside its box.
        let bound = |aabb: &Aabb| match aabb.distance(point) {
            0.0 => -(point - aabb.min).min(aabb.max - point).min_element(),
            outside => outside,
        };
        self.bvh.least(bound, |hull| self.distance_to(hull, point)).map_or(f32::INFINITY, |(_, distance)| distance)
    }

    /// True if the point lies well inside a hull.
    fn hides(&self, point: Vec3) -> bool {
        let mut hidden = false;
        let found = std::cell::Cell::new(false);
        self.bvh.visit(
            |aabb| !found.get() && aabb.distance(point) == 0.0,
            |hull| {
                hidden |= self.distance_to(hull, point) < -HIDDEN;
                found.set(hidden);
            },
        );
        hidden
    }
}

/// Distances over an area.
#[derive(Clone, Copy, Default)]
struct Sum {
    max: f32,
    sum: f64,
    area: f64,
}

impl Sum {
    fn mean(&self) -> f32 {
        if self.area > 0.0 { (self.sum / self.area) as f32 } else { 0.0 }
    }
}

/// Samples all patches. `distance` is none where the surface is not one of the shape.
fn sum(patches: &[Patch], spacing: f64, distance: impl Fn(Vec3) -> Option<f32> + Sync) -> Sum {
    const PATCHES_PER_TASK: usize = 4;
    let area: f64 = patches.iter().map(|patch| f64::from(patch.area())).filter(|area| area.is_finite()).sum();
    let spacing = spacing.max((area / MOST_SAMPLES).sqrt()) as f32;
    let of_patch = |number: usize| {
        let mut sum = Sum::default();
        patches[number].sample(spacing, |point, area| {
            if let Some(distance) = distance(point) {
                sum.max = sum.max.max(distance);
                if area > 0.0 {
                    sum.sum += f64::from(distance) * f64::from(area);
                    sum.area += f64::from(area);
                }
            }
        });
        sum
    };
    let sums = parallel::map(patches.len(), PATCHES_PER_TASK, of_patch);
    sums.iter().fold(Sum::default(), |all, one| Sum {
        max: all.max.max(one.max),
        sum: all.sum + one.sum,
        area: all.area + one.area,
    })
}

#[cfg(test)]
mod tests;
