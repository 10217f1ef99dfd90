//! Time of impact for true rigid motion, in an interval so short that every point moves almost on a line (the paper's medial cones).

use glam::Vec3;

use super::{
    moving::{Moving, MovingConvex},
    separation::{Cuboid, Separation},
    support::Support,
    time_of_impact::{TimeOfImpact, start, time_of_depth},
};
use crate::geometry::{Placement, Sphere, Sweep};

/// The motion of a pair of bodies in an interval. Every point moves on the chord of its path, up to a known deviation.
#[derive(Clone, Copy, Debug)]
pub struct Chord {
    /// Placements of both bodies at the start and at the end.
    ends: [[Placement; 2]; 2],
    /// Largest deviation of any point from its chord, summed over both sides, in metres.
    deviation: f32,
}

impl Chord {
    /// Returns the chord of two bodies. The sweeps are given in one frame. `arms`: largest distance of each body's points from its centre of mass, in metres.
    pub fn new([sweep1, sweep2]: [&Sweep; 2], [arm1, arm2]: [f32; 2]) -> Self {
        Self {
            ends: [[sweep1.start, sweep2.start], [sweep1.end, sweep2.end]].map(|poses| poses.map(Placement::from)),
            deviation: sweep1.sagitta(arm1) + sweep2.sagitta(arm2),
        }
    }

    /// Returns the chord of the first body in the frame of the second, which is then at rest at the origin. Boxes need this frame, because a
    /// [`Cuboid`] has no orientation.
    ///
    /// In a rotating frame a point has centrifugal and Coriolis acceleration in addition to its own centripetal one. Under the
    /// acceleration `a` it deviates from the chord of a time `t` by at most `a t^2 / 8`.
    pub fn in_frame_of_second([sweep1, sweep2]: [&Sweep; 2], arm1: f32) -> Self {
        let (turn1, turn2) = (sweep1.rotation.length(), sweep2.rotation.length());
        let speed = (sweep1.translation - sweep2.translation).length();
        let apart =
            sweep1.start.transform_point(sweep1.local_center) - sweep2.start.transform_point(sweep2.local_center);
        let distance = apart.length() + speed + arm1;
        let acceleration = turn1 * turn1 * arm1 + 2.0 * turn2 * (speed + turn1 * arm1) + turn2 * turn2 * distance;
        let relative = [sweep2.start.inv_mul(&sweep1.start), sweep2.end.inv_mul(&sweep1.end)];
        Self { ends: relative.map(|pose| [pose.into(), Placement::IDENTITY]), deviation: acceleration / 8.0 }
    }

    /// Placements of both bodies at the start and at the end.
    pub fn ends(&self) -> &[[Placement; 2]; 2] {
        &self.ends
    }

    /// Largest deviation of any point from its chord, summed over both sides, in metres.
    pub fn deviation(&self) -> f32 {
        self.deviation
    }

    /// The motion of two primitives, with the first enlarged by the deviation.
    #[inline]
    fn along<const N: usize, B: Rigid>(&self, first: &[Sphere; N], second: &B) -> (Moving<N>, B::Moving) {
        let [start, end] = &self.ends;
        let mut moving1 = first.along([&start[0], &end[0]]);
        moving1.start.iter_mut().for_each(|sphere| sphere.radius += self.deviation);
        (moving1, second.along([&start[1], &end[1]]))
    }
}

/// The second side of a pair: a rigid shape, or spheres that move on lines within their body.
pub trait Rigid {
    /// The shape in linear motion.
    type Moving: MovingConvex;

    /// The shape in linear motion from one placement to the next.
    fn along(&self, chord: [&Placement; 2]) -> Self::Moving;

    /// The shape at rest at the end of the motion.
    #[inline]
    fn at_end(&self, end: &Placement) -> Self::Moving {
        self.along([end; 2])
    }
}

impl<const N: usize> Rigid for [Sphere; N] {
    type Moving = Moving<N>;

    #[inline]
    fn along(&self, [start, end]: [&Placement; 2]) -> Moving<N> {
        let placed: [Sphere; N] = self.map(|s| Sphere::new(start.point(s.center), s.radius));
        let motion: [Vec3; N] = std::array::from_fn(|i| end.point(self[i].center) - placed[i].center);
        Moving { start: placed, motion }
    }
}

/// Spheres that move on lines of their own in the frame of the body.
impl<const N: usize> Rigid for Moving<N> {
    type Moving = Moving<N>;

    #[inline]
    fn along(&self, [start, end]: [&Placement; 2]) -> Moving<N> {
        let placed: [Sphere; N] = self.start.map(|s| Sphere::new(start.point(s.center), s.radius));
        let motion = std::array::from_fn(|i| end.point(self.start[i].center + self.motion[i]) - placed[i].center);
        Moving { start: placed, motion }
    }

    #[inline]
    fn at_end(&self, end: &Placement) -> Moving<N> {
        let at = |i: usize| Sphere::new(self.start[i].center + self.motion[i], self.start[i].radius);
        std::array::from_fn(at).along([end; 2])
    }
}

impl Rigid for Cuboid {
    type Moving = Cuboid;

    /// The box is at rest in its own frame.
    #[inline]
    fn along(&self, _: [&Placement; 2]) -> Cuboid {
        *self
    }
}

impl Rigid for Support<'_> {
    type Moving = Self;

    /// The shape is at rest in its own frame.
    fn along(&self, _: [&Placement; 2]) -> Self {
        *self
    }
}

/// Relative position of two primitives at the start of an interval.
#[derive(Clone, Copy, Debug)]
pub struct RigidStart {
    separation: Separation,
    touch_bound: f32,
}

impl RigidStart {
    /// Lower bound of the fraction of the interval at which the primitives touch. It exceeds 1 if they provably do not touch.
    pub fn touch_bound(&self) -> f32 {
        self.touch_bound
    }

    /// Distance in metres, negative for an overlap.
    pub fn distance(&self) -> f32 {
        self.separation.distance
    }

    /// Unit normal from the first to the second, in the frame of the chord.
    pub fn normal(&self) -> Vec3 {
        self.separation.normal
    }

    /// Overlap depth in metres; 0 if they are apart.
    pub fn overlap(&self) -> f32 {
        (-self.distance()).max(0.0)
    }
}

/// Relative position of two primitives of rigid bodies at the start of an interval.
pub fn rigid_start<const N: usize, B: Rigid>(first: &[Sphere; N], second: &B, chord: &Chord) -> RigidStart {
    let (moving1, moving2) = chord.along(first, second);
    let (separation, touch_bound) = start(&moving1, &moving2);
    RigidStart { separation, touch_bound }
}

/// First fraction of the interval at which two primitives of rigid bodies overlap by `depth` metres. `depth` must exceed their overlap at the start.
///
/// Both are in the frames of their bodies; the contact is in the frame of the chord. The first side is enlarged by the chord's deviation, so an
/// impact is early by at most twice the deviation, and never late.
///
/// The search ends without a result as soon as the fraction provably exceeds `limit`. A fraction up to the limit does not depend on it.
pub fn rigid_impact<const N: usize, B: Rigid>(
    first: &[Sphere; N],
    second: &B,
    chord: &Chord,
    start: &RigidStart,
    limit: f32,
    depth: f32,
) -> TimeOfImpact {
    let (moving1, moving2) = chord.along(first, second);
    time_of_depth(&moving1, &moving2, limit, depth, start.separation)
}

/// Distance of two primitives of rigid bodies at the end of their chord, in metres; negative for an overlap.
pub fn rigid_end<const N: usize, B: Rigid>(first: &[Sphere; N], second: &B, chord: &Chord) -> f32 {
    let [_, [end1, end2]] = &chord.ends;
    start(&first.along([end1; 2]), &second.at_end(end2)).0.distance
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{geometry::Pose3, query::TimeOfImpactStatus};

    #[test]
    fn the_impact_of_balls_is_at_the_given_depth_of_overlap() {
        // The balls are 1 cm apart, and the first one moves by 10 cm.
        let ball = [Sphere::new(Vec3::ZERO, 0.1)];
        let at = |x: f32| Pose3::from_translation(Vec3::X * x);
        let sweep = |from: f32, to: f32| Sweep::between(at(from), at(to), Vec3::ZERO, Vec3::ZERO);
        let chord = Chord::new([&sweep(0.0, 0.1), &sweep(0.21, 0.21)], [0.0; 2]);
        let start = rigid_start(&ball, &ball, &chord);
        let fraction = |depth: f32| rigid_impact(&ball, &ball, &chord, &start, 1.0, depth).fraction;
        for (depth, expected) in [(0.0, 0.1), (1.0e-3, 0.11), (0.02, 0.3)] {
            assert!((fraction(depth) - expected).abs() < 1.0e-4, "{} at {depth} m", fraction(depth));
        }
        assert_eq!(rigid_impact(&ball, &ball, &chord, &start, 1.0, 0.1).status, TimeOfImpactStatus::Separated);
    }
}
