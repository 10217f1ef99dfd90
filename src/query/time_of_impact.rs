//! Time of impact of two primitives with linearly moving spheres: conservative advancement along the separating direction.

use super::{
    moving::{Moving, MovingConvex, Quadratic},
    number::Number,
    separation::{Separation, refined, separation},
};
use crate::{
    constants::{CONTACT_ROUNDING, FIRST_TRIAL, MAX_ADVANCES, MAX_ITERATIONS, TIME_TOLERANCE, TOUCH_ROUNDING},
    geometry::Sphere,
};

/// Outcome of a time of impact query.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TimeOfImpactStatus {
    /// The primitives stay apart. `contact` is their separation at some instant before `max_fraction`; `fraction` is unspecified.
    Separated,
    /// The primitives touch first at `fraction`; `contact` is the separation at that time or just before it.
    Hit,
    /// The primitives touch or overlap at the start: `fraction` is 0 and `contact` is the separation there.
    Overlapping,
    /// The search reached its limit of iterations. `fraction` is before the first touch, if there is one. Treat it as a hit.
    IterationLimit,
}

/// Result of [`time_of_impact`].
#[derive(Clone, Copy, Debug)]
pub struct TimeOfImpact {
    /// Outcome of the search.
    pub status: TimeOfImpactStatus,
    /// Fraction of the step.
    pub fraction: f32,
    /// The separation at that fraction.
    pub contact: Separation,
    /// Number of distance queries.
    pub rounds: u32,
}

/// A pair at an instant, in coordinates relative to an origin that moves with it. The coordinates are of the pair's own size.
struct Instant<const N: usize, B> {
    fraction: f32,
    first: [Sphere; N],
    second: B,
    separation: Separation,
}

/// A moving pair. The frame moves with the first sphere of the first side.
struct Pair<'a, const N: usize, B> {
    first: &'a Moving<N>,
    second: &'a B,
    /// Distance that counts as contact, in metres; negative in searches for a depth.
    target: f32,
}

impl<const N: usize, B: MovingConvex> Pair<'_, N, B> {
    /// Centres are computed in f64, where sums and products of the f32 input are nearly exact, and rounded relative to the origin.
    #[inline]
    fn shapes(&self, fraction: f32) -> ([Sphere; N], B::Shape) {
        let time = f64::from(fraction);
        let origin = self.second.origin(time, self.first.center(0, time));
        (MovingConvex::at(self.first, time, origin), self.second.at(time, origin))
    }

    #[inline]
    fn at(&self, fraction: f32, feature: usize) -> Instant<N, B::Shape> {
        let (first, second) = self.shapes(fraction);
        let separation = separation(&first, &second, feature);
        Instant { fraction, first, second, separation }
    }

    /// The same during a search. Near the target, a tilted normal would end the search too early, so the separation is refined.
    fn look(&self, fraction: f32, feature: usize, extent: f32) -> Instant<N, B::Shape> {
        let mut now = self.at(fraction, feature);
        let is_near = now.separation.distance - self.target <= CONTACT_ROUNDING * extent;
        if is_near && now.separation.loss() > 0.5 * TOUCH_ROUNDING * extent {
            now.separation = refined(&now.first, &now.second, now.separation);
        }
        now
    }

    /// Calls `visit` for every pair of spheres with the excess of its gap over the target, and the amount of closing over the step. Both are along the normal.
    #[inline]
    fn gaps(&self, now: &Instant<N, B::Shape>, mut visit: impl FnMut(f32, f32)) {
        let n = now.separation.normal;
        let frame = self.first.motion[0];
        let high: [(f32, f32); N] = std::array::from_fn(|i| {
            (now.first[i].center.dot(n) + now.first[i].radius, (self.first.motion[i] - frame).dot(n))
        });
        self.second.supports(&now.second, n, frame, |low, low_motion| {
            for (high, high_motion) in high {
                visit(low - high - self.target, high_motion - low_motion);
            }
        });
    }

    /// Fraction until which the gap along the instant's normal stays above the target. The pair does not touch before.
    #[inline]
    fn cleared_until(&self, now: &Instant<N, B::Shape>) -> f32 {
        let mut root = f32::INFINITY;
        self.gaps(now, |gap, closing| {
            if closing > 0.0 {
                root = root.lesser(gap.greater(0.0) / closing);
            }
        });
        now.fraction + root
    }

    /// True if the interpolated normals of two instants stay separating directions in between, which proves that the pair does not touch.
    ///
    /// Along such a direction the gap of two spheres is quadratic in time. The direction is at most of unit length, so subtracting the full
    /// radii is conservative.
    fn clear_between(&self, here: &Instant<N, B::Shape>, there: &Instant<N, B::Shape>) -> bool {
        let normals = [here.separation.normal, there.separation.normal];
        let high: [Quadratic; N] = std::array::from_fn(|i| {
            let [a, b] = [here.first[i], there.first[i]];
            Quadratic::dot([a.center, b.center], normals).plus(a.radius + self.target)
        });
        let mut clear = true;
        B::lows([&here.second, &there.second], normals, |low| {
            clear &= high.iter().all(|high| low.minus(high).is_positive());
        });
        clear
    }

    /// The search of [`time_of_impact`], from an instant without an earlier touch, after `rounds` iterations.
    ///
    /// The search ends as soon as the fraction provably exceeds `limit`. A fraction up to the limit does not depend on it.
    fn advance(&self, start: Instant<N, B::Shape>, mut rounds: u32, max_fraction: f32, limit: f32) -> TimeOfImpact {
        let extent = self.first.extent_at_start().max(self.second.extent_at_start());
        let touching = self.target + TOUCH_ROUNDING * extent;
        // At the start the larger tolerance applies, so slight overlaps are not missed. A depth that is missed here is found by the next iteration.
        let overlapping = if self.target < 0.0 { touching } else { CONTACT_ROUNDING * extent };
        if start.fraction == 0.0 && start.separation.distance <= overlapping {
            return self.end(TimeOfImpactStatus::Overlapping, 0.0, &start, rounds);
        }
        let mut here = start;
        let mut cleared = self.cleared_until(&here);
        while rounds < MAX_ADVANCES {
            if cleared > max_fraction.min(limit) {
                return self.end(TimeOfImpactStatus::Separated, cleared, &here, rounds);
            }
            let next = self.look(cleared, here.separation.feature, extent);
            rounds += 1;
            if next.separation.distance <= touching {
                return self.end(TimeOfImpactStatus::Hit, cleared, &next, rounds);
            }
            here = next;
            cleared = self.cleared_until(&here);
        }
        self.try_steps(here, cleared, [extent, touching], rounds, max_fraction, limit)
    }

    /// Continues the search of [`advance`](Self::advance) by trial steps. `extent`: that of the larger side. `touching`: distance of a touch.
    fn try_steps(
        &self,
        mut here: Instant<N, B::Shape>,
        mut cleared: f32,
        [extent, touching]: [f32; 2],
        mut rounds: u32,
        max_fraction: f32,
        limit: f32,
    ) -> TimeOfImpact {
        let fastest = self.first.motion.iter().map(|&m| self.second.fastest(m)).fold(0.0, f32::max);
        let shortest = (TIME_TOLERANCE * extent / fastest).max(f32::EPSILON);
        let aim = 0.5 * (self.target + touching);
        let mut step = FIRST_TRIAL * shortest.max(cleared - here.fraction);
        let mut halve = false;
        while cleared <= max_fraction && here.fraction <= limit {
            if rounds >= MAX_ITERATIONS {
                return self.end(TimeOfImpactStatus::IterationLimit, here.fraction, &here, rounds);
            }
            let next = (here.fraction + step).min(max_fraction);
            step = next - here.fraction;
            let there = self.look(next, here.separation.feature, extent);
            rounds += 1;
            let [before, after] = [&here, &there].map(|instant| instant.separation.distance);
            // The part of the step at which the distance reaches the aim, if it shrinks linearly.
            let part = (before - aim) / (before - after);
            if after > self.target && self.clear_between(&here, &there) {
                if after <= touching {
                    return self.end(TimeOfImpactStatus::Hit, next, &there, rounds);
                } else if next >= max_fraction {
                    break;
                }
                here = there;
                cleared = self.cleared_until(&here);
                let rest = if after < before { part - 1.0 } else { f32::INFINITY };
                step = (step * rest.min(2.0)).max(FIRST_TRIAL * shortest);
                halve = false;
            } else if step <= shortest {
                return self.end(TimeOfImpactStatus::Hit, cleared.min(next), &here, rounds);
            } else {
                // If all steps ended on the same side of the root, the search would take many iterations. So halving alternates with interpolation.
                step *= if halve || after > touching { 0.5 } else { part.clamp(0.1, 0.9) };
                halve = !halve;
            }
        }
        self.end(TimeOfImpactStatus::Separated, max_fraction, &here, rounds)
    }

    /// Returns the result of a search. Its contact is that of the instant `now`, in the frame of both sides.
    fn end(&self, status: TimeOfImpactStatus, fraction: f32, now: &Instant<N, B::Shape>, rounds: u32) -> TimeOfImpact {
        let mut contact = now.separation;
        let origin = self.second.origin(f64::from(now.fraction), self.first.center(0, f64::from(now.fraction)));
        for point in [&mut contact.point1, &mut contact.point2] {
            *point = (point.as_dvec3() + origin).as_vec3();
        }
        TimeOfImpact { status, fraction, contact, rounds }
    }
}

/// First fraction in `[0, max_fraction]` at which a moving primitive touches another moving primitive or a box at rest.
///
/// Let `n` be the direction of minimum distance at an instant. Along `n` the gap of the support planes over time is the
/// minimum of at most nine linear functions and never exceeds the distance, so the pair cannot touch before its first root.
/// That root is the next instant. If the pair approaches steadily, a few iterations converge to the touch.
///
/// A pair that grazes, or that tilts while its faces slide along each other, converges by ever smaller steps. After
/// [`MAX_ADVANCES`] iterations the search takes trial steps instead. The directions of minimum distance at both ends of a step are interpolated: if the gap
/// along the result stays open, the pair does not touch within the step. The length of the next step is extrapolated from the last one to a distance
/// of zero, at most doubled. A failed step is shortened by interpolation, or halved.
pub fn time_of_impact<const N: usize, B: MovingConvex>(
    first: &Moving<N>,
    second: &B,
    max_fraction: f32,
) -> TimeOfImpact {
    time_of_impact_from(first, second, 0.0, 0, max_fraction)
}

/// The same if the pair is known not to touch until `cleared`, which took `rounds` iterations.
pub(super) fn time_of_impact_from<const N: usize, B: MovingConvex>(
    first: &Moving<N>,
    second: &B,
    cleared: f32,
    rounds: u32,
    max_fraction: f32,
) -> TimeOfImpact {
    let pair = Pair { first, second, target: 0.0 };
    pair.advance(pair.at(cleared, 0), rounds + 1, max_fraction, max_fraction)
}

/// The separation at the start, relative to the origin there, and a lower bound of the fraction at which the pair touches.
pub(super) fn start<const N: usize, B: MovingConvex>(first: &Moving<N>, second: &B) -> (Separation, f32) {
    let pair = Pair { first, second, target: 0.0 };
    let start = pair.at(0.0, 0);
    let is_apart = start.separation.distance > 0.0;
    (start.separation, if is_apart { pair.cleared_until(&start) } else { 0.0 })
}

/// First fraction of the step at which two primitives overlap by `depth` metres. `depth` must exceed their overlap at the start. `separation`: that of the
/// start, as found by [`start`]. The search ends as soon as the fraction provably exceeds `limit`.
pub(super) fn time_of_depth<const N: usize, B: MovingConvex>(
    first: &Moving<N>,
    second: &B,
    limit: f32,
    depth: f32,
    separation: Separation,
) -> TimeOfImpact {
    let rounding = 2.0 * TOUCH_ROUNDING * first.extent_at_start().max(second.extent_at_start());
    let pair = Pair { first, second, target: -depth.max(rounding - separation.distance) };
    let (first, second) = pair.shapes(0.0);
    pair.advance(Instant { fraction: 0.0, first, second, separation }, 1, 1.0, limit)
}
