//! Shapes whose spheres move freely within a step, such as a skinned medial mesh that follows its joints.

use std::sync::atomic::{AtomicUsize, Ordering};

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
    /// The spheres at each knot, from the start to the end of the step. There is a single knot if nothing moves.
    knots: Vec<Vec<Sphere>>,
    /// Hierarchy over the boxes that the primitives sweep.
    swept: Bvh,
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
        if knots.is_empty() {
            knots.push(axis.spheres().to_vec());
        }
        knots.dedup();
        let end = axis.with_spheres(knots[knots.len() - 1].clone());
        let swept = if knots.len() > 1 {
            let boxes: Vec<Aabb> = end.primitives().iter().map(|primitive| swept_box(primitive, &knots)).collect();
            end.bvh().refitted(&boxes)
        } else {
            end.bvh().clone()
        };
        let center = swept.aabb().center();
        let radius = knots.iter().flatten().map(|s| s.center.distance(center) + s.radius).fold(0.0, f32::max);
        let path = (0..end.spheres().len()).map(|sphere| path(sphere, &knots)).fold(0.0, f32::max);
        // Addresses of other shapes are even.
        static NEXT: AtomicUsize = AtomicUsize::new(0);
        let id = 2 * NEXT.fetch_add(1, Ordering::Relaxed) + 1;
        Self { axis: end, knots, swept, path, bounding_sphere: Sphere::new(center, radius.next_up()), id }
    }

    /// Returns the shape at the end of the step.
    pub fn axis(&self) -> &MedialAxis {
        &self.axis
    }

    /// Returns an upper bound of the path of any point over the step, in metres.
    pub fn path(&self) -> f32 {
        self.path
    }

    /// Returns a sphere at a fraction of the step.
    pub fn sphere_at(&self, sphere: usize, fraction: f32) -> Sphere {
        let segments = self.knots.len() - 1;
        let place = fraction * segments as f32;
        let first = (place as usize).min(segments.saturating_sub(1));
        let [a, b] = [first, (first + 1).min(segments)].map(|knot| self.knots[knot][sphere]);
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
        self.swept.visit(crosses, visit);
    }

    /// Returns the primitives that overlap with `reach` at any time after a fraction of the step, in ascending order.
    pub(super) fn moving_within(&self, reach: &Aabb, from: f32) -> impl Iterator<Item = MovingPart<'_>> {
        let mut found = Vec::new();
        self.swept.overlapping(reach, |primitive| found.push(primitive));
        found.sort_unstable();
        found.into_iter().map(move |primitive| MovingPart::new(self, primitive, [from, 1.0]))
    }
}

impl ConvexParts for Deforming {
    fn aabb(&self) -> Aabb {
        self.swept.aabb()
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

/// Returns the box that a primitive sweeps.
fn swept_box(primitive: &Primitive, knots: &[Vec<Sphere>]) -> Aabb {
    let spheres = primitive.indices();
    Aabb::from_spheres(knots.iter().flat_map(|knot| spheres.iter().map(|&sphere| knot[sphere as usize])))
}

/// Returns an upper bound of the path of the points of a sphere, in metres.
fn path(sphere: usize, knots: &[Vec<Sphere>]) -> f32 {
    let step = |[a, b]: [Sphere; 2]| a.center.distance(b.center) + (a.radius - b.radius).abs();
    knots.windows(2).map(|pair| step([pair[0][sphere], pair[1][sphere]])).sum()
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
        let segments = (self.shape.knots.len() - 1) as f32;
        // Times are rounded, so a corner near an end of the motion is at this end.
        let next = (from * segments + CORNER_ROUNDING).floor() + 1.0;
        let corner = next / segments;
        (next + CORNER_ROUNDING < to * segments).then(|| (corner - from) / (to - from))
    }

    /// Returns boxes at the start and at the end. Linear interpolation between both contains the primitive at any time.
    pub fn boxes(&self) -> [Aabb; 2] {
        if self.first_corner().is_some() {
            return [swept_box(&self.shape.axis.primitives()[self.id as usize], &self.shape.knots); 2];
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
mod tests {
    use std::sync::Arc;

    use bevy::tasks::TaskPool;
    use glam::Quat;

    use super::*;
    use crate::{
        pipeline::{Body, Culling, Shape, Solid, Statics, StepInput, first_touch, step, with_spheres},
        query::separation,
        random::Random,
    };

    /// A ring whose spheres move on random polylines.
    fn ring(random: &mut Random, knots: usize, motion: f32) -> Arc<Deforming> {
        let axis = MedialAxis::torus(0.4, 0.1, 8).unwrap();
        let mut spheres = axis.spheres().to_vec();
        let mut all = vec![spheres.clone()];
        for _ in 1..knots {
            for sphere in &mut spheres {
                sphere.center += random.in_cube() * motion;
            }
            all.push(spheres.clone());
        }
        Arc::new(Deforming::new(&axis, all))
    }

    /// Returns the distance of a body and a deforming shape at a fraction of the step.
    fn distance_at(body: &Body, shape: &Deforming, fraction: f32) -> f32 {
        let own = body.solid.medial().unwrap();
        let place = body.sweep.pose_at(fraction).into();
        let ours = || (0..own.len() as u32).map(|i| own.hull(i).placed(&place));
        let theirs = || (0..shape.len() as u32).map(|i| shape.hull_at(i, fraction));
        let distance = |a: Hull, b: Hull| with_spheres!(a, |a| with_spheres!(b, |b| separation(&a, &b, 0).distance));
        ours().flat_map(|a| theirs().map(move |b| distance(a, b))).fold(f32::INFINITY, f32::min)
    }

    fn moving(shape: impl Into<Solid>, random: &mut Random, spread: f32, speed: f32, turn: f32) -> Body {
        let start = Pose3::from_parts(random.in_cube() * spread, Quat::from_scaled_axis(random.in_cube() * 3.0));
        let way = -start.translation * speed + random.in_cube() * 0.3 * speed;
        Body::new(shape, Sweep::at_rates(start, Vec3::ZERO, way, random.in_cube() * turn))
    }

    #[test]
    fn first_touches_are_those_of_a_fine_sampling() {
        const SAMPLES: usize = 1000;
        let mut random = Random(11);
        let (mut hits, mut misses, mut near_misses, mut after_a_corner) = (0, 0, 0, 0);
        for case in 0..300 {
            let shape = match case % 2 {
                0 => Shape::new(MedialAxis::sphere(0.05).unwrap()),
                _ => Shape { axis: MedialAxis::torus(0.3, 0.05, 12).unwrap(), scale: 0.5 },
            };
            let body = moving(shape, &mut random, 1.2, 1.5, [0.0, 0.5][case / 2 % 2]);
            let ring = ring(&mut random, 1 + case % 5, 0.3);
            let other = Body::new(Solid::Deforming(ring.clone()), Sweep::at_rest(Pose3::IDENTITY));
            let distances: Vec<f32> =
                (0..=SAMPLES).map(|i| distance_at(&body, &ring, i as f32 / SAMPLES as f32)).collect();
            let least = distances.iter().copied().fold(f32::INFINITY, f32::min);
            // Bodies that overlap at the start have another first touch.
            if distances[0] < 0.01 || least.abs() < 2e-3 {
                continue;
            }
            for culling in [Culling::Hybrid, Culling::None] {
                let found = first_touch([body.clone(), other.clone()], culling, None);
                let expected = distances.iter().position(|distance| *distance <= 0.0);
                assert_eq!(found.is_some(), expected.is_some(), "case {case}: {found:?}, least distance {least}");
                let (Some(impact), Some(expected)) = (found, expected) else {
                    misses += 1;
                    near_misses += usize::from(least < 0.1);
                    continue;
                };
                hits += 1;
                after_a_corner += usize::from(case % 5 > 1 && impact.fraction > 0.5);
                // At the touch, the bodies are as near as the chord's tolerance.
                let distance = distance_at(&body, &ring, impact.fraction);
                let time = expected as f32 / SAMPLES as f32;
                assert!(
                    distance.abs() < 2e-3 && impact.fraction < time + 1e-4,
                    "{case}: {impact:?}, {distance} {time}"
                );
                let hull = ring.hull_at(impact.primitive2, impact.fraction);
                let off = with_spheres!(hull, |s| separation(&s, &[Sphere::new(impact.point, 0.0)], 0).distance);
                assert!(off.abs() < 2e-3, "case {case}: the point is {off} m off its primitive");
            }
        }
        assert!(
            hits > 200 && misses > 50 && near_misses > 10 && after_a_corner > 20,
            "{hits} {misses} {near_misses} {after_a_corner}"
        );
    }

    #[test]
    fn a_swinging_limb_pushes_bodies_as_a_rigid_one_does() {
        let mut random = Random(12);
        let (mut pushed, mut missed, mut deepest) = (0, 0, [0.0f32; 2]);
        for case in 0..200 {
            // A limb whose tip moves at 10 m/s in a step of 1/60 s.
            let axis = MedialAxis::capsule(Vec3::ZERO, Vec3::X, 0.1).unwrap();
            let angle = 0.17;
            let [root, tip] = [axis.spheres()[0], axis.spheres()[1]];
            let knot = |i: usize| {
                let turn = Quat::from_rotation_z(angle * i as f32 / 4.0);
                vec![root, Sphere::new(turn * tip.center, tip.radius)]
            };
            let limb = Arc::new(Deforming::new(&axis, (0..=4).map(knot).collect()));
            let at = Vec3::new(0.3 + 0.5 * random.unit(), 0.21 + 0.2 * random.unit(), 0.05 * random.signed());
            let rest = Sweep::at_rest(Pose3::from_translation(at));
            let ball = Body::new(Shape::new(MedialAxis::sphere(0.1).unwrap()), rest);
            let swing = Sweep::at_rates(Pose3::IDENTITY, Vec3::ZERO, Vec3::ZERO, Vec3::Z * angle);
            let solids: [(Solid, Sweep); 2] = [
                (Solid::Deforming(limb.clone()), Sweep::at_rest(Pose3::IDENTITY)),
                (Shape::new(axis.clone()).into(), swing),
            ];
            let [deforming, rigid] = solids.map(|(solid, sweep)| {
                let bodies = vec![ball.clone(), Body { stops: false, ..Body::new(solid, sweep) }];
                let input = StepInput { bodies, stop_at_impact: true, prediction: 0.02, ..Default::default() };
                let output = step(&input, &Statics::default(), &TaskPool::new());
                let stop = output.stop_of(0).map(|stop| stop.pose);
                let ended = Body { sweep: Sweep::at_rest(stop.unwrap_or(rest.end)), ..ball.clone() };
                (stop.is_some(), distance_at(&ended, &limb, 1.0), output.manifolds.len())
            });
            let touched = (0..=64).any(|i| distance_at(&ball, &limb, i as f32 / 64.0) < -1e-3);
            assert!(deforming.0 || !touched, "case {case}: the ball at {at} is missed");
            assert!(deforming.1 > rigid.1.min(0.0) - 2e-3, "case {case}: {deforming:?} {rigid:?}");
            assert!(deforming.2 > 0 || !touched, "case {case}: the pushed ball has no contact");
            pushed += usize::from(touched);
            missed += usize::from(!deforming.0);
            deepest = [deepest[0].min(deforming.1), deepest[1].min(rigid.1)];
        }
        assert!(pushed > 50 && missed > 20 && deepest[0] > -0.01, "{pushed} pushed, {missed} missed, {deepest:?}");
    }
}
