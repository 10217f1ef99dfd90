//! Spheres in motion, one pair per lane, and bounds of the time of their touch.

use crate::{
    constants::CONTACT_ROUNDING,
    query::{
        branchless::each,
        moving::Moving,
        number::{Ball, Number, Vector},
    },
};

/// Two moving primitives.
pub type MovingPair<const N: usize, const M: usize> = (Moving<N>, Moving<M>);

/// A sphere at an instant, and its displacement over the step in metres.
pub(super) type Mover<R> = (Ball<R>, Vector<R>);

/// Time until which two directions prove the pair apart, and whether that is the whole step. The directions join the centroids of both sides, at the
/// start and at their closest approach.
#[inline(always)]
pub(super) fn depart<R: Number, const N: usize, const M: usize>(
    first: &[Mover<R>; N],
    second: &[Mover<R>; M],
    [extent1, extent2]: [R; 2],
    max_fraction: f32,
) -> (R, R::Mask) {
    let (origin, frame) = first[0];
    let relative = |(ball, motion): Mover<R>| (Ball { center: ball.center - origin.center, ..ball }, motion - frame);
    let first: [_; N] = each(
        #[inline(always)]
        |i| relative(first[i]),
    );
    let second: [_; M] = each(
        #[inline(always)]
        |i| relative(second[i]),
    );
    let zero = extent1.like(0.0);
    let from = middle(&second, |(ball, _)| ball.center) - middle(&first, |(ball, _)| ball.center);
    let displacement =
        (middle(&second, |(_, motion)| *motion) - middle(&first, |(_, motion)| *motion)) * zero.like(max_fraction);
    let nearest = from + displacement * (-(from.dot(displacement)) / displacement.length_squared()).saturate();
    let rounding = (extent1 + extent2 + from.length() + displacement.length()) * zero.like(CONTACT_ROUNDING);
    let mut fraction = zero;
    for direction in [from, nearest] {
        let (_, until) = cleared(&first, &second, direction, rounding, zero, zero);
        fraction = fraction.greater(until);
    }
    (fraction, zero.like(max_fraction).less(fraction))
}

/// Returns true if both sides are more than `margin` apart along a direction at the time `back` before this instant. Also returns the time from this instant
/// until the gap closes, negative if it closes earlier. Returns false and zero if the direction is too short to be accurate. Radii of the first side are
/// enlarged by `rounding`. Coordinates are relative to the first sphere of the first side.
#[inline(always)]
pub(super) fn cleared<R: Number, const N: usize, const M: usize>(
    first: &[Mover<R>; N],
    second: &[Mover<R>; M],
    direction: Vector<R>,
    rounding: R,
    margin: R,
    back: R,
) -> (R::Mask, R) {
    let zero = rounding.like(0.0);
    // Gaps and motions are scaled by the length of `direction`, which cancels in their ratios, the times.
    let length_squared = direction.length_squared();
    let length = length_squared.sqrt();
    let high: [_; N] = each(
        #[inline(always)]
        |i| {
            let (ball, motion) = first[i];
            let reach = (ball.radius + rounding) * length;
            if i == 0 { (reach, zero) } else { (ball.center.dot(direction) + reach, motion.dot(direction)) }
        },
    );
    // The smallest gap, and the gap that closes first. Times are compared by products, because a division costs as much as a dozen products.
    let mut least = rounding.like(f32::INFINITY);
    let (mut next_gap, mut next_closing) = (least, rounding.like(1.0));
    for (ball, motion) in second {
        let low = ball.center.dot(direction) - ball.radius * length;
        let low_motion = motion.dot(direction);
        for (high, high_motion) in high {
            let (gap, closing) = (low - high, high_motion - low_motion);
            least = least.lesser(gap + closing * back);
            let sooner = zero.less(closing) & (gap * next_closing).less(next_gap * closing);
            next_gap = R::select(sooner, gap, next_gap);
            next_closing = R::select(sooner, closing, next_closing);
        }
    }
    // The products above contain the square of the length, so they do not underflow above this length.
    let sound = rounding.like(f32::MIN_POSITIVE.sqrt()).less(length_squared);
    let clear = sound & (margin * length).less(least);
    (clear, R::select(clear, next_gap / next_closing, zero))
}

/// The same as [`Convex::extent`](crate::query::Convex::extent).
#[inline(always)]
pub(super) fn extent<R: Number, const N: usize>(spheres: &[Mover<R>; N]) -> R {
    let (first, _) = spheres[0];
    let (mut spread, mut radius) = (first.radius.like(0.0), first.radius);
    for (ball, _) in spheres {
        spread = spread.greater((ball.center - first.center).length_squared());
        radius = radius.greater(ball.radius);
    }
    spread.sqrt() + radius
}

/// The mean of a vector over a primitive's spheres.
#[inline(always)]
fn middle<T, R: Number, const N: usize>(spheres: &[T; N], vector: impl Fn(&T) -> Vector<R>) -> Vector<R> {
    let mut sum = vector(&spheres[0]);
    for sphere in &spheres[1..] {
        sum = sum + vector(sphere);
    }
    sum * sum.x.like(1.0 / N as f32)
}

/// The spheres at the instant, without their displacements.
#[inline(always)]
pub(super) fn balls<R: Number, const N: usize>(spheres: &[Mover<R>; N]) -> [Ball<R>; N] {
    each(
        #[inline(always)]
        |i| spheres[i].0,
    )
}

/// The interpolated sphere of a primitive at barycentric weights.
#[inline(always)]
pub(super) fn at_weights<R: Number, const N: usize>(spheres: &[Mover<R>; N], weights: [R; N]) -> Mover<R> {
    let (base, base_motion) = spheres[0];
    let (mut at, mut motion) = spheres[0];
    for i in 1..N {
        let (ball, its_motion) = spheres[i];
        at.center = at.center + (ball.center - base.center) * weights[i];
        at.radius = at.radius + (ball.radius - base.radius) * weights[i];
        motion = motion + (its_motion - base_motion) * weights[i];
    }
    (at, motion)
}
