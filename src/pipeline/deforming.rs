//! Shapes whose spheres move freely within a step, such as a skinned medial mesh that follows its joints.

use std::sync::{
    OnceLock,
    atomic::{AtomicUsize, Ordering},
};

use glam::Vec3;

use super::{ConvexParts, Core, Hull, Part, Parts};
use crate::{
    geometry::{Aabb, Bvh, Pose3, Primitive, Sphere, Sweep},
    medial_axis::MedialAxis,
    query::Moving,
};

/// Rounding error of a time, in segments between two knots.
const CORNER_ROUNDING: f32 = 1.0e-3;

/// A medial mesh whose spheres move within a step. Between *knots*, which lie at equal fractions of the step, each sphere moves on a line.
///
/// The second side of a pair. All coordinates are in the frame of its collider, in which only the spheres move.
#[derive(Debug)]
pub struct Deforming {
    /// The shape at the end of the step.
    axis: MedialAxis,
    /// The spheres at each knot before the end of the step. Empty if nothing moves.
    earlier: Vec<Vec<Sphere>>,
    /// Hierarchy over the boxes that the primitives sweep, if it has been used.
    swept: OnceLock<Bvh>,
    aabb: Aabb,
    /// Upper bound of the path of any point over the step, in metres.
    path: f32,
    bounding_sphere: Sphere,
    id: usize,
}

/// Runs an expression with the moving spheres of a [`MovingHull`] bound to a value of the right length.
macro_rules! with_moving {
    ($hull:expr, |$spheres:pat_param| $body:expr) => {
        match $hull {
            $crate::pipeline::deforming::MovingHull::Sphere($spheres) => $body,
            $crate::pipeline::deforming::MovingHull::Cone($spheres) => $body,
            $crate::pipeline::deforming::MovingHull::Slab($spheres) => $body,
        }
    };
}
pub(super) use with_moving;

impl Deforming {
    /// Creates a shape from its spheres at each knot. The primitives are those of `axis`. No knots, or a single one, are a shape at rest.
    ///
    /// # Panics
    /// If a knot does not have as many spheres as the axis.
    pub fn new(axis: &MedialAxis, mut knots: Vec<Vec<Sphere>>) -> Self {
        knots.dedup();
        let end = axis.with_spheres(knots.pop().unwrap_or_else(|| axis.spheres().to_vec()));
        let aabb = Aabb::from_spheres(knots.iter().flatten().copied()).merge(end.aabb());
        let center = aabb.center();
        let all = || knots.iter().map(Vec::as_slice).chain([end.spheres()]);
        let radius = all().flatten().map(|s| s.center.distance(center) + s.radius).fold(0.0, f32::max);
        let lines = |sphere: usize| all().zip(all().skip(1)).map(move |(a, b)| path(&a[sphere], &b[sphere]));
        let path = (0..end.spheres().len()).map(|sphere| lines(sphere).sum()).fold(0.0, f32::max);
        // Ids of deforming shapes are odd. Other shapes use their memory address as id, which is even.
        static NEXT: AtomicUsize = AtomicUsize::new(0);
        let id = 2 * NEXT.fetch_add(1, Ordering::Relaxed) + 1;
        let bounding_sphere = Sphere::new(center, radius.next_up());
        Self { axis: end, earlier: knots, swept: OnceLock::new(), aabb, path, bounding_sphere, id }
    }

    /// Returns the shape at the end of the step.
    pub fn axis(&self) -> &MedialAxis {
        &self.axis
    }

    /// Returns an upper bound of the path of any point over the step, in metres.
    pub fn path(&self) -> f32 {
        self.path
    }

    /// Returns true if a sphere moves or changes its size within the step.
    pub fn is_moving(&self) -> bool {
        self.path > 0.0
    }

    fn knot(&self, number: usize) -> &[Sphere] {
        self.earlier.get(number).map_or(self.axis.spheres(), Vec::as_slice)
    }

    /// Returns false if a sphere is NaN or infinite at a knot.
    #[cfg(feature = "gpu")]
    pub(crate) fn is_finite(&self) -> bool {
        let mut spheres = self.earlier.iter().flatten().chain(self.axis.spheres());
        spheres.all(|sphere| sphere.center.is_finite() && sphere.radius.is_finite())
    }

    /// Returns a shape at rest that contains this one during the whole step, up to rounding.
    #[cfg(feature = "gpu")]
    pub(crate) fn cover(&self) -> MedialAxis {
        if !self.is_moving() {
            return self.axis.clone();
        }
        let cover = |sphere: usize| {
            let knots = || (0..=self.earlier.len()).map(|knot| self.knot(knot)[sphere]);
            let center = Aabb::from_spheres(knots()).center();
            let path = knots().map(|sphere| sphere.center.distance(center)).fold(0.0, f32::max);
            // The largest radius counts at all knots: see `MovingHull`.
            Sphere::new(center, path + knots().map(|sphere| sphere.radius).fold(0.0, f32::max))
        };
        self.axis.with_spheres((0..self.axis.spheres().len()).map(cover).collect())
    }

    /// Returns the hierarchy over the boxes that the primitives sweep.
    fn swept(&self) -> &Bvh {
        if self.earlier.is_empty() {
            return self.axis.bvh();
        }
        self.swept.get_or_init(|| {
            let boxes: Vec<Aabb> = self.axis.primitives().iter().map(|primitive| self.swept_box(primitive)).collect();
            self.axis.bvh().refitted(&boxes)
        })
    }

    /// Returns the box that a primitive sweeps.
    fn swept_box(&self, primitive: &Primitive) -> Aabb {
        let spheres = primitive.indices();
        let at = |knot: usize| spheres.iter().map(move |&sphere| self.knot(knot)[sphere as usize]);
        Aabb::from_spheres((0..=self.earlier.len()).flat_map(at))
    }

    /// Returns a sphere at a fraction of the step.
    pub fn sphere_at(&self, sphere: usize, fraction: f32) -> Sphere {
        let segments = self.earlier.len();
        let place = fraction * segments as f32;
        let first = (place as usize).min(segments.saturating_sub(1));
        let [a, b] = [first, (first + 1).min(segments)].map(|knot| self.knot(knot)[sphere]);
        let part = place - first as f32;
        let mix = |a: f32, b: f32| a * (1.0 - part) + b * part;
        Sphere::new(a.center * (1.0 - part) + b.center * part, mix(a.radius, b.radius))
    }

    /// Returns a primitive at a fraction of the step.
    pub fn hull_at(&self, primitive: u32, fraction: f32) -> Hull {
        let at = |sphere: u32| self.sphere_at(sphere as usize, fraction);
        Hull::new(self.axis.primitives()[primitive as usize], at)
    }

    /// Returns the displacement of a point of a primitive over the step, in metres. `at`: the fraction of the step at which the point is on the primitive. It
    /// moves with the spheres, in proportion to their shares in the nearest point of the primitive.
    pub fn displacement(&self, primitive: u32, point: Vec3, at: f32) -> Vec3 {
        self.moved(primitive, point, at, [0.0, 1.0])
    }

    /// The same from a fraction `from` to the end of the step, for a point in the world. `rest`: motion of the body from that fraction on.
    pub(super) fn displacement_from(&self, primitive: u32, rest: &Sweep, point: Vec3, from: f32) -> Vec3 {
        let local = rest.start.inverse_transform_point(point);
        rest.end.rotation * self.moved(primitive, local, from, [from, 1.0])
    }

    fn moved(&self, primitive: u32, point: Vec3, at: f32, times: [f32; 2]) -> Vec3 {
        let shares = self.hull_at(primitive, at).shares(point);
        let indices = self.axis.primitives()[primitive as usize].indices();
        let moved = |sphere: u32| {
            let [from, to] = times.map(|time| self.sphere_at(sphere as usize, time).center);
            to - from
        };
        indices.iter().zip(shares).map(|(&sphere, share)| moved(sphere) * share).sum()
    }

    /// Calls `visit` for each primitive whose swept box the ray `origin + time * direction` crosses until `max_time`.
    pub(crate) fn visit_crossed(&self, origin: Vec3, direction: Vec3, max_time: f32, visit: impl FnMut(u32)) {
        // The coordinates of a ray that starts far from the shape are rounded by this much.
        let rounding = f32::EPSILON * origin.length();
        let crosses = |aabb: &Aabb| aabb.inflated(rounding).crossing(origin, direction, max_time).is_some();
        self.swept().visit(crosses, visit);
    }

    /// Returns the primitives that overlap with `reach` at any time after a fraction of the step, in ascending order.
    pub(super) fn moving_within(&self, reach: &Aabb, from: f32) -> impl Iterator<Item = MovingPart<'_>> {
        let mut found = Vec::new();
        self.swept().overlapping(reach, |primitive| found.push(primitive));
        found.sort_unstable();
        found.into_iter().map(move |primitive| MovingPart::new(self, primitive, [from, 1.0]))
    }
}

impl ConvexParts for Deforming {
    fn aabb(&self) -> Aabb {
        self.aabb
    }

    fn bounding_sphere(&self) -> Sphere {
        self.bounding_sphere
    }

    fn len(&self) -> usize {
        self.axis.primitives().len()
    }

    /// The parts at the end of the step.
    fn within(&self, reach: &Aabb) -> Parts<'_> {
        let mut parts = Parts::new();
        self.axis.bvh().overlapping(reach, |id| {
            parts.push(Part { id, pose: Pose3::IDENTITY, core: Core::Hull(self.hull_at(id, 1.0)), rounding: 0.0 });
        });
        parts.sort_unstable_by_key(|part| part.id);
        parts
    }

    fn address(&self) -> usize {
        self.id
    }
}

/// Returns an upper bound of the path of the points of a sphere that moves on a line, in metres.
fn path(from: &Sphere, to: &Sphere) -> f32 {
    from.center.distance(to.center) + (from.radius - to.radius).abs()
}

/// A primitive of a deforming shape between two fractions of the step.
#[derive(Clone, Copy)]
pub(super) struct MovingPart<'a> {
    shape: &'a Deforming,
    pub id: u32,
    times: [f32; 2],
    /// The primitive on lines from the first time to the second.
    pub hull: MovingHull,
}

/// The spheres of one primitive on lines. Radii do not change: each is the largest of the motion, so spheres that grow or shrink are hit early by the change
/// of their radius.
#[derive(Clone, Copy)]
pub(super) enum MovingHull {
    Sphere(Moving<1>),
    Cone(Moving<2>),
    Slab(Moving<3>),
}

impl<'a> MovingPart<'a> {
    fn new(shape: &'a Deforming, id: u32, times: [f32; 2]) -> Self {
        let at = |sphere: u32| times.map(|time| shape.sphere_at(sphere as usize, time));
        let hull = match shape.axis.primitives()[id as usize] {
            Primitive::Sphere(index) => MovingHull::Sphere(moving(index.map(at))),
            Primitive::Cone(index) => MovingHull::Cone(moving(index.map(at))),
            Primitive::Slab(index) => MovingHull::Slab(moving(index.map(at))),
        };
        Self { shape, id, times, hull }
    }

    /// Returns the part of the motion between two fractions of it.
    pub fn part(&self, part: [f32; 2]) -> Self {
        let [from, to] = self.times;
        Self::new(self.shape, self.id, part.map(|fraction| from * (1.0 - fraction) + to * fraction))
    }

    /// Returns the fraction of the motion at which the first line ends; `None` if there is only one line.
    pub fn first_corner(&self) -> Option<f32> {
        let [from, to] = self.times;
        let segments = self.shape.earlier.len() as f32;
        // Times are rounded, so a corner near an end of the motion is at this end.
        let next = (from * segments + CORNER_ROUNDING).floor() + 1.0;
        let corner = next / segments;
        (next + CORNER_ROUNDING < to * segments).then(|| (corner - from) / (to - from))
    }

    /// Returns boxes at the start and at the end. Linear interpolation between both contains the primitive at any time.
    pub fn boxes(&self) -> [Aabb; 2] {
        if self.first_corner().is_some() {
            return [self.shape.swept_box(&self.shape.axis.primitives()[self.id as usize]); 2];
        }
        with_moving!(&self.hull, |moving| [0.0, 1.0].map(|time| {
            let spheres = std::iter::zip(&moving.start, &moving.motion);
            Aabb::from_spheres(spheres.map(|(s, motion)| Sphere::new(s.center + motion * time, s.radius)))
        }))
    }

    /// Returns an upper bound of the path of any point, in metres.
    pub fn path(&self) -> f32 {
        if self.first_corner().is_some() {
            return self.shape.path;
        }
        with_moving!(&self.hull, |moving| moving.motion.iter().map(|motion| motion.length()).fold(0.0, f32::max))
    }

    /// Returns the smallest coordinate along a unit direction. `instant`: 0 for the start, 1 for the end.
    pub fn low(&self, direction: Vec3, instant: usize) -> f32 {
        let time = instant as f32;
        with_moving!(&self.hull, |moving| {
            let spheres = std::iter::zip(&moving.start, &moving.motion);
            let lows = spheres.map(|(s, motion)| (s.center + motion * time).dot(direction) - s.radius);
            lows.fold(f32::INFINITY, f32::min)
        })
    }

    /// Returns the largest radius in metres.
    pub fn max_radius(&self) -> f32 {
        with_moving!(&self.hull, |moving| moving.start.iter().map(|s| s.radius).fold(0.0, f32::max))
    }
}

fn moving<const N: usize>(ends: [[Sphere; 2]; N]) -> Moving<N> {
    Moving {
        start: ends.map(|[a, b]| Sphere::new(a.center, a.radius.max(b.radius))),
        motion: ends.map(|[a, b]| b.center - a.center),
    }
}

#[cfg(test)]
mod tests;
