//! Time of impact of two primitives whose spheres move on lines: conservative advancement along the separating direction.

use glam::Vec3;

use super::separation::{Convex, Cuboid, Separation, separation};
use crate::{
    constants::{CONTACT_ROUNDING, LEAST_GROWTH, MAX_ADVANCES, MAX_ROUNDS, OVERLAP_LIMIT, TIME_TOLERANCE},
    geometry::Sphere,
};

/// A primitive whose spheres move on lines over the step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moving<const N: usize> {
    /// The spheres at fraction 0.
    pub start: [Sphere; N],
    /// Displacement of their centres over the step, in metres.
    pub motion: [Vec3; N],
}

/// How a time of impact query ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TimeOfImpactStatus {
    /// They stay apart. No other field means anything.
    Separated,
    /// They touch first at `fraction`; `contact` is the separation at or right before that.
    Hit,
    /// They touch or overlap at the start, `fraction` is 0 and `contact` is the separation there.
    Overlapping,
    /// The search ran out of rounds between them: `fraction` is before the first touch, if there is one. To be treated as a hit.
    IterationLimit,
}

/// Result of [`time_of_impact`].
#[derive(Clone, Copy, Debug)]
pub struct TimeOfImpact {
    /// How it ended.
    pub status: TimeOfImpactStatus,
    /// Fraction of the step.
    pub fraction: f32,
    /// The separation at that fraction.
    pub contact: Separation,
    /// Distance queries made.
    pub rounds: u32,
}

/// The second side of a time of impact query.
pub trait MovingConvex {
    /// What it is at an instant.
    type Shape: Convex;

    /// The shape at `fraction`.
    fn at(&self, fraction: f32) -> Self::Shape;

    /// Calls `visit` with support plane and speed, `(c . n - r, c' . n)` at fraction 0, of everything that can be lowest along `n`.
    fn supports(&self, n: Vec3, visit: impl FnMut(f32, f32));

    /// Fastest displacement relative to `motion`.
    fn fastest(&self, motion: Vec3) -> f32;
}

impl<const M: usize> MovingConvex for Moving<M> {
    type Shape = [Sphere; M];

    #[inline]
    fn at(&self, fraction: f32) -> [Sphere; M] {
        std::array::from_fn(|i| Sphere::new(self.start[i].center + self.motion[i] * fraction, self.start[i].radius))
    }

    #[inline]
    fn supports(&self, n: Vec3, mut visit: impl FnMut(f32, f32)) {
        for (sphere, motion) in self.start.iter().zip(&self.motion) {
            visit(sphere.center.dot(n) - sphere.radius, motion.dot(n));
        }
    }

    #[inline]
    fn fastest(&self, motion: Vec3) -> f32 {
        self.motion.iter().map(|m| m.distance_squared(motion)).fold(0.0, f32::max).sqrt()
    }
}

impl MovingConvex for Cuboid {
    type Shape = Cuboid;

    #[inline]
    fn at(&self, _: f32) -> Cuboid {
        *self
    }

    #[inline]
    fn supports(&self, n: Vec3, mut visit: impl FnMut(f32, f32)) {
        visit(self.low(n), 0.0);
    }

    #[inline]
    fn fastest(&self, motion: Vec3) -> f32 {
        motion.length()
    }
}

/// First fraction in `[0, max_fraction]` at which a moving primitive touches another moving primitive or a box at rest.
///
/// At an instant, let `n` be the direction of least distance. Along `n` the gap of the support planes is, over time, the
/// least of at most nine linear functions, and never more than the distance: up to its first root nothing
/// can touch. That root is the next instant, and where the pair closes in for good a few rounds end at the touch.
///
/// A pair that only grazes, or that tilts while its faces slide along each other, gets there by ever smaller steps. After
/// [`MAX_ADVANCES`] of them the search takes trial steps of its own: the gap along a fixed direction is concave
/// in time, so the direction found at the *end* of a trial step clears the time back to its last root before that.
/// Where the two cleared ranges meet the step is taken and the next one is longer, else it is halved.
pub fn time_of_impact<const N: usize, B: MovingConvex>(
    first: &Moving<N>,
    second: &B,
    max_fraction: f32,
) -> TimeOfImpact {
    let start = separation(&first.at(0.0), &second.at(0.0), 0);
    advance(first, second, max_fraction, start, 0.0)
}

/// First fraction at which they overlap by more than `slop` metres beyond what they do at the start, if they do there.
///
/// A contact that the solver keeps within the slop is none, and a pair in touch that turns deeper into each other is one.
pub fn time_of_overlap<const N: usize, B: MovingConvex>(
    first: &Moving<N>,
    second: &B,
    max_fraction: f32,
    slop: f32,
) -> TimeOfImpact {
    let start = separation(&first.at(0.0), &second.at(0.0), 0);
    let depth = (-start.distance).max(0.0);
    let growth = slop * (1.0 - depth / (OVERLAP_LIMIT * slop)).max(LEAST_GROWTH);
    // Less than the rounding, and a small body on a large one could not even move away.
    let extent = first.start.extent().max(second.at(0.0).extent());
    let growth = growth.max(2.0 * CONTACT_ROUNDING * extent);
    advance(first, second, max_fraction, start, -depth - growth)
}

/// The search of [`time_of_impact`] for the distance `target`, from the separation at the start.
fn advance<const N: usize, B: MovingConvex>(
    first: &Moving<N>,
    second: &B,
    max_fraction: f32,
    start: Separation,
    target: f32,
) -> TimeOfImpact {
    let extent = first.start.extent().max(second.at(0.0).extent());
    let touching = target + CONTACT_ROUNDING * extent;
    let mut here = start;
    let mut rounds = 1;
    let result = |status, fraction, contact, rounds| TimeOfImpact { status, fraction, contact, rounds };
    if here.distance <= touching {
        return result(TimeOfImpactStatus::Overlapping, 0.0, here, rounds);
    }
    let mut fraction = 0.0;
    let mut cleared = cleared_until(first, second, here.normal, target);
    while rounds < MAX_ADVANCES {
        if cleared > max_fraction {
            return result(TimeOfImpactStatus::Separated, fraction, here, rounds);
        }
        let next = separation(&first.at(cleared), &second.at(cleared), here.feature);
        rounds += 1;
        if next.distance <= touching {
            return result(TimeOfImpactStatus::Hit, cleared, next, rounds);
        }
        (fraction, here) = (cleared, next);
        cleared = fraction.max(cleared_until(first, second, here.normal, target));
    }

    let fastest = first.motion.iter().map(|&m| second.fastest(m)).fold(0.0, f32::max);
    let shortest = (TIME_TOLERANCE * extent / fastest).max(f32::EPSILON);
    let mut step = 4.0 * shortest.max(cleared - fraction);
    while cleared <= max_fraction {
        let trial = (fraction + step).min(max_fraction);
        let there = separation(&first.at(trial), &second.at(trial), here.feature);
        rounds += 1;
        if there.distance > touching && cleared_since(first, second, there.normal, target) <= cleared {
            if trial >= max_fraction {
                break;
            }
            (fraction, here) = (trial, there);
            cleared = fraction.max(cleared_until(first, second, here.normal, target));
            step *= 2.0;
        } else if step <= shortest {
            return result(TimeOfImpactStatus::Hit, cleared.min(trial), here, rounds);
        } else if rounds >= MAX_ROUNDS {
            return result(TimeOfImpactStatus::IterationLimit, fraction, here, rounds);
        } else {
            step *= 0.5;
        }
    }
    result(TimeOfImpactStatus::Separated, fraction, here, rounds)
}

/// First time that the gap along `n` falls to `target`: from an instant at which it is more until then nothing touches.
#[inline]
fn cleared_until<const N: usize, B: MovingConvex>(first: &Moving<N>, second: &B, n: Vec3, target: f32) -> f32 {
    let mut root = f32::INFINITY;
    gaps(first, second, n, target, |gap, closing| {
        if closing > 0.0 {
            root = root.min(gap / closing);
        }
    });
    root
}

/// Last time that the gap along `n` rises above `target`: from then until an instant at which it is more nothing touches.
fn cleared_since<const N: usize, B: MovingConvex>(first: &Moving<N>, second: &B, n: Vec3, target: f32) -> f32 {
    let mut root = f32::NEG_INFINITY;
    gaps(first, second, n, target, |gap, closing| {
        if closing < 0.0 {
            root = root.max(gap / closing);
        }
    });
    root
}

/// For every pair of spheres how far its gap along `n` exceeds `target` at fraction 0, and how much of it closes over the step.
#[inline]
fn gaps<const N: usize, B: MovingConvex>(
    first: &Moving<N>,
    second: &B,
    n: Vec3,
    target: f32,
    mut visit: impl FnMut(f32, f32),
) {
    let high: [(f32, f32); N] =
        std::array::from_fn(|i| (first.start[i].center.dot(n) + first.start[i].radius, first.motion[i].dot(n)));
    second.supports(n, |low, low_motion| {
        for (high, high_motion) in high {
            visit(low - high - target, high_motion - low_motion);
        }
    });
}
