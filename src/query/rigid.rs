//! Time of impact for true rigid motion: the step as a chain of chords (the paper's piecewise linear medial cones).

use glam::Vec3;

use super::{
    separation::{Cuboid, Separation},
    time_of_impact::{Moving, MovingConvex, TimeOfImpact, TimeOfImpactStatus, start, time_of_depth, time_of_impact},
};
use crate::{
    constants::{LEAST_GROWTH, MAX_CHORDS, OVERLAP_LIMIT},
    geometry::{Placement, Sphere, Sweep},
};

/// The motion of a pair of bodies, cut into equal times within which every point moves on a line but for a known deviation.
#[derive(Clone, Debug, Default)]
pub struct Chords {
    /// Where both bodies are at the ends of the chords.
    placements: Vec<[Placement; 2]>,
    /// How far any point strays from its chord, both sides together, in metres.
    deviation: f32,
    /// How far any point goes along a chord relative to the other side, or more, in metres.
    way: f32,
}

impl Chords {
    /// Becomes the chords of two bodies whose sweeps are given in one frame. No point of a body is farther than its arm from its centre of mass.
    /// Enough of them that each side strays by `tolerance` metres at most, up to [`MAX_CHORDS`].
    pub fn set(&mut self, [sweep1, sweep2]: [&Sweep; 2], [arm1, arm2]: [f32; 2], tolerance: f32) {
        let count = sweep1.chords(arm1, tolerance).max(sweep2.chords(arm2, tolerance));
        let turns = sweep1.rotation.length() * arm1 + sweep2.rotation.length() * arm2;
        self.placements.clear();
        self.placements.extend(instants(count).map(|t| [sweep1.pose_at(t).into(), sweep2.pose_at(t).into()]));
        self.deviation = sweep1.sagitta(arm1, count) + sweep2.sagitta(arm2, count);
        self.way = ((sweep1.translation - sweep2.translation).length() + turns) / count as f32;
    }

    /// Becomes the chords of the first body seen from the second, which then is at rest at the origin: a box can turn no other way.
    ///
    /// Seen from a frame that turns, a point has centrifugal and Coriolis acceleration besides its own centripetal one; under the
    /// acceleration `a` it strays from the chord of a time `t` by at most `a t^2 / 8`.
    pub fn set_in_frame_of_second(&mut self, [sweep1, sweep2]: [&Sweep; 2], arm1: f32, tolerance: f32) {
        let (turn1, turn2) = (sweep1.rotation.length(), sweep2.rotation.length());
        let speed = (sweep1.translation - sweep2.translation).length();
        let apart =
            sweep1.start.transform_point(sweep1.local_center) - sweep2.start.transform_point(sweep2.local_center);
        let distance = apart.length() + speed + arm1;
        let acceleration = turn1 * turn1 * arm1 + 2.0 * turn2 * (speed + turn1 * arm1) + turn2 * turn2 * distance;
        let mut count = 1;
        while count < MAX_CHORDS && acceleration > 8.0 * tolerance * (count * count) as f32 {
            count *= 2;
        }
        let relative = |t| sweep2.pose_at(t).inv_mul(&sweep1.pose_at(t)).into();
        self.placements.clear();
        self.placements.extend(instants(count).map(|t| [relative(t), Placement::IDENTITY]));
        self.deviation = acceleration / (8.0 * (count * count) as f32);
        self.way = (speed + turn1 * arm1 + turn2 * distance) / count as f32;
    }
}

impl Chords {
    fn count(&self) -> usize {
        self.placements.len() - 1
    }

    /// Where both bodies are at the ends of the chords.
    pub fn placements(&self) -> &[[Placement; 2]] {
        &self.placements
    }

    /// How far any point strays from its chord, both sides together, in metres.
    pub fn deviation(&self) -> f32 {
        self.deviation
    }

    /// Two primitives along a chord, the first enlarged by the deviation.
    #[inline]
    fn along<const N: usize, B: Rigid>(&self, i: usize, first: &[Sphere; N], second: &B) -> (Moving<N>, B::Moving) {
        let [start, end] = [&self.placements[i], &self.placements[i + 1]];
        let mut moving1 = first.along([&start[0], &end[0]]);
        moving1.start.iter_mut().for_each(|sphere| sphere.radius += self.deviation);
        (moving1, second.along([&start[1], &end[1]]))
    }
}

fn instants(count: u32) -> impl Iterator<Item = f32> {
    (0..=count).map(move |i| i as f32 / count as f32)
}

/// The second side of a rigid pair.
pub trait Rigid {
    /// Its motion along a chord.
    type Moving: MovingConvex;

    /// The shape on its way from one placement to the next.
    fn along(&self, chord: [&Placement; 2]) -> Self::Moving;
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

impl Rigid for Cuboid {
    type Moving = Cuboid;

    /// At rest in its own frame.
    #[inline]
    fn along(&self, _: [&Placement; 2]) -> Cuboid {
        *self
    }
}

/// How two primitives begin the step.
#[derive(Clone, Copy, Debug)]
pub struct RigidStart {
    separation: Separation,
    stay_apart: bool,
}

impl RigidStart {
    /// True if they do not touch all through the step, as far as a look at the start can tell.
    pub fn stay_apart(&self) -> bool {
        self.stay_apart
    }

    /// Distance in metres, negative for an overlap.
    pub fn distance(&self) -> f32 {
        self.separation.distance
    }

    /// Unit normal from the first to the second, in the frame of the chords.
    pub fn normal(&self) -> Vec3 {
        self.separation.normal
    }

    /// How deep they overlap, in metres; 0 if they are apart.
    pub fn overlap(&self) -> f32 {
        (-self.distance()).max(0.0)
    }
}

/// How two primitives of rigid bodies begin the step.
pub fn rigid_start<const N: usize, B: Rigid>(first: &[Sphere; N], second: &B, chords: &Chords) -> RigidStart {
    let (moving1, moving2) = chords.along(0, first, second);
    let (separation, clear) = start(&moving1, &moving2, 1.0);
    // Along several chords nothing is known of directions.
    let stay_apart = match chords.count() {
        1 => clear,
        count => separation.distance > chords.way * count as f32,
    };
    RigidStart { separation, stay_apart }
}

/// First fraction of the step, up to `max_fraction`, at which two primitives of rigid bodies overlap by more than `slop` metres beyond an
/// `overlap`, as they may have had; if they begin the step farther apart than `near`, in metres, the fraction at which they touch.
///
/// Both in the frames of their bodies; the contact is in the frame of the chords. The first side is larger by the chords' deviation, so an
/// impact is early by twice as much at most, and never late.
pub fn rigid_impact<const N: usize, B: Rigid>(
    first: &[Sphere; N],
    second: &B,
    chords: &Chords,
    start: &RigidStart,
    max_fraction: f32,
    [overlap, slop, near]: [f32; 3],
) -> TimeOfImpact {
    let growth = slop * (1.0 - overlap / (OVERLAP_LIMIT * slop)).max(LEAST_GROWTH);
    let count = chords.count() as f32;
    let max_fraction = max_fraction.min(1.0);
    if start.distance() > chords.way * count * max_fraction {
        let status = TimeOfImpactStatus::Separated;
        return TimeOfImpact { status, fraction: max_fraction, contact: start.separation, rounds: 0 };
    }
    let along = |i: usize| chords.along(i, first, second);
    let mut chord = 0;
    let mut rounds = 0;
    let mut found = loop {
        let (moving1, moving2) = along(chord);
        let limit = max_fraction * count - chord as f32;
        let known = (chord == 0).then_some(start.separation);
        let found = time_of_depth(&moving1, &moving2, limit.min(1.0), [overlap, growth], known);
        rounds += found.rounds;
        if found.status != TimeOfImpactStatus::Separated {
            break found;
        }
        // So far apart, they cannot meet for some chords.
        chord += ((found.contact.distance / chords.way) as usize).max(1);
        if chord as f32 >= max_fraction * count {
            break found;
        }
    };
    if found.status != TimeOfImpactStatus::Separated && start.distance() > near {
        // Back to where they touch.
        let (mut touching, mut limit) = (chord, found.fraction);
        let mut after = None;
        loop {
            let (moving1, moving2) = along(touching);
            let touch = time_of_impact(&moving1, &moving2, limit);
            rounds += touch.rounds;
            match touch.status {
                TimeOfImpactStatus::Hit => (found, chord) = (touch, touching),
                // By a rounding they touch at the end of this chord, or at the start of the next.
                TimeOfImpactStatus::Separated => (found, chord) = after.unwrap_or((found, chord)),
                TimeOfImpactStatus::Overlapping if touching > 0 => {
                    after = Some((touch, touching));
                    (touching, limit) = (touching - 1, 1.0);
                    continue;
                }
                TimeOfImpactStatus::Overlapping | TimeOfImpactStatus::IterationLimit => {}
            }
            break;
        }
    }
    TimeOfImpact { fraction: (chord as f32 + found.fraction) / count, rounds, ..found }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Pose3;

    #[test]
    fn what_begins_near_may_overlap_by_a_slop() {
        // A centimetre apart, on a way of ten.
        let (ball, slop) = ([Sphere::new(Vec3::ZERO, 0.1)], 1.0e-3);
        let at = |x: f32| Pose3::from_translation(Vec3::X * x);
        let sweep = |from: f32, to: f32| Sweep::between(at(from), at(to), Vec3::ZERO, Vec3::ZERO);
        let mut chords = Chords::default();
        chords.set([&sweep(0.0, 0.1), &sweep(0.21, 0.21)], [0.0; 2], 1.0e-4);
        let start = rigid_start(&ball, &ball, &chords);
        let fraction = |near: f32| rigid_impact(&ball, &ball, &chords, &start, 1.0, [0.0, slop, near]).fraction;
        assert!((fraction(0.009) - 0.1).abs() < 1.0e-4, "{}", fraction(0.009));
        assert!((fraction(0.011) - 0.11).abs() < 1.0e-4, "{}", fraction(0.011));
    }

    #[test]
    fn what_is_in_a_large_primitive_goes_on_along_it() {
        // A marble two millimetres deep in a bar of thirty metres, whose rounding is as much as it may gain.
        let marble = [Sphere::new(Vec3::ZERO, 0.01)];
        let bar = [-15.0, 15.0].map(|x| Sphere::new(Vec3::new(x, -0.5, 0.0), 0.5));
        let at = |x: f32, y: f32| Pose3::from_translation(Vec3::new(x, 0.008 + y, 0.0));
        let impact = |sinks: f32| {
            let sweep = Sweep::between(at(0.0, 0.0), at(0.01, -sinks), Vec3::ZERO, Vec3::ZERO);
            let mut chords = Chords::default();
            chords.set([&sweep, &Sweep::at_rest(Pose3::IDENTITY)], [0.01; 2], 1.0e-5);
            let start = rigid_start(&marble, &bar, &chords);
            assert!((start.overlap() - 2.0e-3).abs() < 1.0e-5);
            rigid_impact(&marble, &bar, &chords, &start, 1.0, [start.overlap(), 2.5e-4, 0.02])
        };
        assert_eq!(impact(0.0).status, TimeOfImpactStatus::Separated);
        let sinking = impact(1.0e-3);
        assert!(sinking.status == TimeOfImpactStatus::Hit && sinking.fraction > 0.01, "{sinking:?}");
        assert!(sinking.fraction < 0.2, "{sinking:?}");
    }
}
