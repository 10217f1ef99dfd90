//! Time of impact for true rigid motion: the step is split into chords (the paper's piecewise linear medial cones).

use glam::Vec3;

use super::{
    separation::{Cuboid, Separation},
    time_of_impact::{Moving, MovingConvex, TimeOfImpact, TimeOfImpactStatus, start, time_of_depth},
};
use crate::{
    constants::MAX_CHORDS,
    geometry::{Placement, Sphere, Sweep},
};

/// The motion of a pair of bodies, split into equal time intervals. In each interval every point moves on a line up to a known deviation.
#[derive(Clone, Debug, Default)]
pub struct Chords {
    /// Placements of both bodies at the ends of the chords.
    placements: Vec<[Placement; 2]>,
    /// Largest deviation of any point from its chord, summed over both sides, in metres.
    deviation: f32,
    /// Upper bound of a point's displacement along one chord, relative to the other side, in metres.
    way: f32,
}

impl Chords {
    /// Sets the chords of two bodies. The sweeps are given in one frame. `arm` is the largest distance of a body's points from its centre of mass.
    /// The number of chords is chosen so that each side deviates by at most `tolerance` metres, up to [`MAX_CHORDS`].
    pub fn set(&mut self, [sweep1, sweep2]: [&Sweep; 2], [arm1, arm2]: [f32; 2], tolerance: f32) {
        let count = sweep1.chords(arm1, tolerance).max(sweep2.chords(arm2, tolerance));
        let turns = sweep1.rotation.length() * arm1 + sweep2.rotation.length() * arm2;
        self.placements.clear();
        self.placements.extend(instants(count).map(|t| [sweep1.pose_at(t).into(), sweep2.pose_at(t).into()]));
        self.deviation = sweep1.sagitta(arm1, count) + sweep2.sagitta(arm2, count);
        self.way = ((sweep1.translation - sweep2.translation).length() + turns) / count as f32;
    }

    /// Sets the chords of the first body in the frame of the second, which is then at rest at the origin. Boxes need this frame, because a
    /// [`Cuboid`] has no orientation.
    ///
    /// In a rotating frame a point has centrifugal and Coriolis acceleration in addition to its own centripetal one. Under the
    /// acceleration `a` it deviates from the chord of a time `t` by at most `a t^2 / 8`.
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

    /// Placements of both bodies at the ends of the chords.
    pub fn placements(&self) -> &[[Placement; 2]] {
        &self.placements
    }

    /// Largest deviation of any point from its chord, summed over both sides, in metres.
    pub fn deviation(&self) -> f32 {
        self.deviation
    }

    /// The motion of two primitives along a chord, with the first enlarged by the deviation.
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
    /// The shape in linear motion along a chord.
    type Moving: MovingConvex;

    /// The shape in linear motion from one placement to the next.
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

    /// The box is at rest in its own frame.
    #[inline]
    fn along(&self, _: [&Placement; 2]) -> Cuboid {
        *self
    }
}

/// Relative position of two primitives at the start of the step.
#[derive(Clone, Copy, Debug)]
pub struct RigidStart {
    separation: Separation,
    stay_apart: bool,
}

impl RigidStart {
    /// True if a conservative test at the start proves that the primitives do not touch during the step.
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

    /// Overlap depth in metres; 0 if they are apart.
    pub fn overlap(&self) -> f32 {
        (-self.distance()).max(0.0)
    }
}

/// Relative position of two primitives of rigid bodies at the start of the step.
pub fn rigid_start<const N: usize, B: Rigid>(first: &[Sphere; N], second: &B, chords: &Chords) -> RigidStart {
    let (moving1, moving2) = chords.along(0, first, second);
    let (separation, clear) = start(&moving1, &moving2, 1.0);
    // `clear` covers the first chord only. With several chords, the length of the path decides.
    let stay_apart = match chords.count() {
        1 => clear,
        count => separation.distance > chords.way * count as f32,
    };
    RigidStart { separation, stay_apart }
}

/// First fraction of the step, up to `max_fraction`, at which two primitives of rigid bodies overlap by `depth` metres. `depth` must exceed their overlap
/// at the start.
///
/// Both are in the frames of their bodies; the contact is in the frame of the chords. The first side is enlarged by the chords' deviation, so an
/// impact is early by at most twice the deviation, and never late.
pub fn rigid_impact<const N: usize, B: Rigid>(
    first: &[Sphere; N],
    second: &B,
    chords: &Chords,
    start: &RigidStart,
    max_fraction: f32,
    depth: f32,
) -> TimeOfImpact {
    let count = chords.count() as f32;
    let max_fraction = max_fraction.min(1.0);
    if start.distance() + depth > chords.way * count * max_fraction {
        let status = TimeOfImpactStatus::Separated;
        return TimeOfImpact { status, fraction: max_fraction, contact: start.separation, rounds: 0 };
    }
    let mut chord = 0;
    let mut rounds = 0;
    loop {
        let (moving1, moving2) = chords.along(chord, first, second);
        let limit = max_fraction * count - chord as f32;
        let known = (chord == 0).then_some(start.separation);
        let found = time_of_depth(&moving1, &moving2, limit.min(1.0), depth, known);
        rounds += found.rounds;
        if found.status != TimeOfImpactStatus::Separated {
            return TimeOfImpact { fraction: (chord as f32 + found.fraction) / count, rounds, ..found };
        }
        // A pair at this distance cannot meet within some chords, which are skipped.
        chord += ((found.contact.distance / chords.way) as usize).max(1);
        if chord as f32 >= max_fraction * count {
            return TimeOfImpact { rounds, ..found };
        }
    }
}

/// Distance of two primitives of rigid bodies at the end of their chords, in metres; negative for an overlap.
pub fn rigid_end<const N: usize, B: Rigid>(first: &[Sphere; N], second: &B, chords: &Chords) -> f32 {
    let [end1, end2] = &chords.placements[chords.count()];
    start(&first.along([end1; 2]), &second.along([end2; 2]), 0.0).0.distance
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Pose3;

    #[test]
    fn balls_meet_where_they_overlap_by_the_depth() {
        // The balls are 1 cm apart, and the first one moves by 10 cm.
        let ball = [Sphere::new(Vec3::ZERO, 0.1)];
        let at = |x: f32| Pose3::from_translation(Vec3::X * x);
        let sweep = |from: f32, to: f32| Sweep::between(at(from), at(to), Vec3::ZERO, Vec3::ZERO);
        let mut chords = Chords::default();
        chords.set([&sweep(0.0, 0.1), &sweep(0.21, 0.21)], [0.0; 2], 1.0e-4);
        let start = rigid_start(&ball, &ball, &chords);
        let fraction = |depth: f32| rigid_impact(&ball, &ball, &chords, &start, 1.0, depth).fraction;
        for (depth, expected) in [(0.0, 0.1), (1.0e-3, 0.11), (0.02, 0.3)] {
            assert!((fraction(depth) - expected).abs() < 1.0e-4, "{} at {depth} m", fraction(depth));
        }
        assert_eq!(rigid_impact(&ball, &ball, &chords, &start, 1.0, 0.1).status, TimeOfImpactStatus::Separated);
    }
}
