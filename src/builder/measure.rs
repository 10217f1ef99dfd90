use std::fmt;

use glam::{DVec3, Vec3};

use super::{
    TriangleMesh, envelope::Envelope, hull::Ball, parallel, points::Points, samples::Patch, tree::TriangleTree,
};
use crate::{
    geometry::{Aabb, Sphere},
    medial_axis::MedialAxis,
};

/// Distance between surface samples, as a part of the diagonal.
const SPACING: f64 = 1.0 / 300.0;

/// Largest number of points on the envelope, or on the mesh, in addition to the minimum of each patch. Large parts far from the mesh would need more.
const MOST_SAMPLES: f64 = 6.0e5;

/// Points of the envelope's patches deeper inside than this are hidden by other primitives. Relative to the frame's unit.
const HIDDEN: f64 = 1.0e-5;

/// Depth inside the envelope from which a point of the mesh may be hidden. Relative to the frame's unit.
const EXAMINED: f64 = 1.0e-3;

/// Distance of one surface from another, in percent of the mesh's diagonal.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Deviation {
    /// Largest distance of a point.
    pub max: f32,
    /// Mean distance over the area.
    pub mean: f32,
}

/// Difference between a medial mesh and a triangle mesh.
///
/// Each direction detects errors that the other misses. The surface of a missing limb is far from the envelope, although the envelope is near the mesh
/// everywhere. A surplus sphere is far from the mesh.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TwoSidedError {
    /// From the mesh's surface to the envelope. Exact outside the envelope; inside it is a lower bound, the depth in the deepest
    /// primitive, which is less than the depth in the union where primitives overlap.
    pub mesh_to_envelope: Deviation,
    /// From the envelope to the mesh's surface.
    pub envelope_to_mesh: Deviation,
    /// Diagonal of the mesh's bounding box in metres, the reference of all percentages.
    pub diagonal: f32,
}

impl TwoSidedError {
    /// Largest distance in either direction, in percent of the diagonal: the Hausdorff distance, up to the accuracy of the samples.
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

/// Measures the two-sided error of a medial mesh. Both meshes are in one frame.
///
/// Surfaces are sampled evenly, with about 300 points per diagonal; the mesh also at its vertices. Distances are to the surfaces
/// themselves. The result does not depend on the number of threads, down to the last bit.
///
/// # Panics
/// If an index of the mesh is out of range.
pub fn measure(mesh: &TriangleMesh, axis: &MedialAxis) -> TwoSidedError {
    measure_shown(mesh, axis, |_| false)
}

/// The same without the points of the mesh that are hidden, in its frame. Points at the envelope need not be examined, since their error is small.
pub(super) fn measure_shown(
    mesh: &TriangleMesh,
    axis: &MedialAxis,
    is_hidden: impl Fn(DVec3) -> bool + Sync,
) -> TwoSidedError {
    let frame = Frame::new(mesh, axis);
    let envelope = frame.envelope(axis);
    let surface = TriangleTree::new(&frame.triangles(mesh));
    let spacing = SPACING * frame.diagonal / frame.unit;

    let triangles = surface.triangles().iter().map(|t| Patch::Triangle(t.map(|p| p.as_vec3())));
    let (points, areas) = samples(&triangles.collect::<Vec<_>>(), spacing);
    let distances = envelope.distances(&points);
    let shown = |distance: f64, at: DVec3| -distance < EXAMINED || !is_hidden(at * frame.unit + frame.origin);
    let shown_points = parallel::map(distances.len(), 64, |i| shown(distances[i], points.positions[i]));
    let mut to_envelope = Sum::default();
    let areas = distances.iter().zip(areas).zip(shown_points).filter(|(_, shown)| *shown);
    areas.for_each(|((distance, area), _)| to_envelope.add(distance.abs(), f64::from(area)));
    let errors = frame.signed(mesh, &envelope);
    let mut corners: Vec<u32> = mesh.triangles.iter().flatten().copied().collect();
    corners.sort_unstable();
    corners.dedup();
    for i in corners {
        let error = errors[i as usize];
        if shown(error, frame.point(mesh.positions[i as usize])) {
            to_envelope.add(error.abs(), 0.0);
        }
    }

    let spheres: Vec<Sphere> =
        frame.balls(axis).iter().map(|b| Sphere::new(b.center.as_vec3(), b.radius as f32)).collect();
    let (points, areas) = samples(&Patch::of(&spheres, axis.primitives()), spacing);
    let depths = envelope.depths(&points, HIDDEN);
    let visible: Vec<usize> = (0..depths.len()).filter(|&i| depths[i] < HIDDEN).collect();
    let distances = parallel::map(visible.len(), 64, |i| surface.distance(points.positions[visible[i]]));
    let mut to_mesh = Sum::default();
    visible.iter().zip(distances).for_each(|(&i, distance)| to_mesh.add(f64::from(distance), f64::from(areas[i])));

    let deviation = |sum: Sum| Deviation { max: frame.percent(sum.max), mean: frame.percent(sum.mean()) };
    TwoSidedError {
        mesh_to_envelope: deviation(to_envelope),
        envelope_to_mesh: deviation(to_mesh),
        diagonal: frame.diagonal as f32,
    }
}

/// The signed distance of each vertex from the envelope in percent of the diagonal. It is positive where the envelope is too far inside, and negative
/// where it protrudes from the mesh. For pictures.
///
/// # Panics
/// If an index of the mesh is out of range.
pub fn vertex_errors(mesh: &TriangleMesh, axis: &MedialAxis) -> Vec<f32> {
    let frame = Frame::new(mesh, axis);
    frame.signed(mesh, &frame.envelope(axis)).into_iter().map(|error| frame.percent(error)).collect()
}

/// Coordinates with both shapes near the origin and of about unit size. There f32 is exact to a few parts in ten million.
struct Frame {
    origin: DVec3,
    /// Length of the unit in metres.
    unit: f64,
    /// Diagonal of the mesh in metres.
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

    fn point(&self, point: Vec3) -> DVec3 {
        (point.as_dvec3() - self.origin) / self.unit
    }

    fn triangles(&self, mesh: &TriangleMesh) -> Vec<[DVec3; 3]> {
        mesh.triangles.iter().map(|triangle| mesh.corners(*triangle).map(|corner| self.point(corner))).collect()
    }

    fn balls(&self, axis: &MedialAxis) -> Vec<Ball> {
        let ball = |s: &Sphere| Ball { center: self.point(s.center), radius: f64::from(s.radius) / self.unit };
        axis.spheres().iter().map(ball).collect()
    }

    fn envelope(&self, axis: &MedialAxis) -> Envelope {
        Envelope::of(&self.balls(axis), axis.primitives().to_vec())
    }

    /// The signed distance of each vertex from an envelope.
    fn signed(&self, mesh: &TriangleMesh, envelope: &Envelope) -> Vec<f64> {
        envelope.distances(&Points::new(mesh.positions.iter().map(|&p| self.point(p)).collect()))
    }

    /// Converts a length of the frame to percent of the diagonal.
    fn percent(&self, length: f64) -> f32 {
        (length * self.unit / self.diagonal * 100.0) as f32
    }
}

/// Maximum and area-weighted mean of distances.
#[derive(Clone, Copy, Default)]
pub(super) struct Sum {
    /// The largest distance.
    pub max: f64,
    sum: f64,
    area: f64,
}

impl Sum {
    /// Adds a distance and the area that it represents.
    pub fn add(&mut self, distance: f64, area: f64) {
        self.max = self.max.max(distance);
        if area > 0.0 {
            self.sum += distance * area;
            self.area += area;
        }
    }

    /// The mean over the area.
    pub fn mean(&self) -> f64 {
        if self.area > 0.0 { self.sum / self.area } else { 0.0 }
    }
}

/// Points of all patches, and the areas that they represent.
fn samples(patches: &[Patch], spacing: f64) -> (Points, Vec<f32>) {
    const PATCHES_PER_TASK: usize = 64;
    let area: f64 = patches.iter().map(|patch| f64::from(patch.area())).filter(|area| area.is_finite()).sum();
    let spacing = spacing.max((area / MOST_SAMPLES).sqrt()) as f32;
    let samples = parallel::flat_map(patches.len(), PATCHES_PER_TASK, |number, samples| {
        patches[number].sample(spacing, |point, area| samples.push((point.as_dvec3(), area)));
    });
    let (points, areas) = samples.into_iter().unzip();
    (Points::new(points), areas)
}

#[cfg(test)]
mod tests;
