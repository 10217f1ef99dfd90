//! Times of impact of many pairs at once, in eight or sixteen SIMD lanes.

use fearless_simd::{Level, Simd, dispatch, f32x4, f32x8, f32x16, prelude::*};

use super::{
    branchless::{Nearest, each, nearest},
    number::{Ball, Number, Vector},
    time_of_impact::{Moving, TimeOfImpactStatus, time_of_impact_from},
};
use crate::constants::{CONTACT_ROUNDING, LEAST_SQUARE, MAX_LANE_ADVANCES, TOUCH_ROUNDING};

/// Two moving primitives.
pub type MovingPair<const N: usize, const M: usize> = (Moving<N>, Moving<M>);

/// First touch of two primitives: a [`TimeOfImpact`](super::TimeOfImpact) without the contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Touch {
    /// How the search ended.
    pub status: TimeOfImpactStatus,
    /// Fraction of the step; the largest fraction searched if the primitives stay apart.
    pub fraction: f32,
}

/// The first touch of each pair in `[0, max_fraction]`, in order. Results equal those of [`time_of_impact`](super::time_of_impact) up to rounding, in a
/// fraction of its time.
///
/// The result of a pair depends neither on the other pairs nor on the machine, down to the last bit.
pub fn times_of_impact<const N: usize, const M: usize>(pairs: &[MovingPair<N, M>], max_fraction: f32) -> Vec<Touch> {
    at_level(Level::new(), pairs, max_fraction)
}

/// The same with the vector instructions of one level.
fn at_level<const N: usize, const M: usize>(level: Level, pairs: &[MovingPair<N, M>], max_fraction: f32) -> Vec<Touch> {
    let mut touches = vec![Touch { status: TimeOfImpactStatus::Separated, fraction: max_fraction }; pairs.len()];
    dispatch!(level, simd => run_native(simd, pairs, max_fraction, &mut touches));
    touches
}

/// Uses as many lanes as the machine's vectors hold, but at least eight. With vectors of four, two vectors hide the latency of each other's operations;
/// more would not fit into the registers.
#[inline(always)]
fn run_native<S: Simd, const N: usize, const M: usize>(
    simd: S,
    pairs: &[MovingPair<N, M>],
    max_fraction: f32,
    touches: &mut [Touch],
) {
    if S::f32s::LEN == 16 {
        run::<S, f32x16<S>, 16, N, M>(simd, pairs, max_fraction, touches);
    } else {
        run::<S, f32x8<S>, 8, N, M>(simd, pairs, max_fraction, touches);
    }
}

/// A SIMD vector with one number per pair.
trait Lanes<S: Simd>:
    Number<Mask: SimdMask<S>> + SimdBase<S, Element = f32> + SimdWiden<S, Widened: SimdBase<S, Element = f64>>
{
    /// Joins vectors of four numbers.
    fn of_fours(four: impl Fn(usize) -> f32x4<S>) -> Self;
}

impl<S: Simd> Lanes<S> for f32x8<S> {
    #[inline(always)]
    fn of_fours(four: impl Fn(usize) -> f32x4<S>) -> Self {
        four(0).combine(four(1))
    }
}

impl<S: Simd> Lanes<S> for f32x16<S> {
    #[inline(always)]
    fn of_fours(four: impl Fn(usize) -> f32x4<S>) -> Self {
        four(0).combine(four(1)).combine(four(2).combine(four(3)))
    }
}

/// Advances the pairs in lanes, and refills each finished lane with the next pair. `touches` must be initialized as separated; only other results are written.
#[inline(always)]
fn run<S: Simd, R: Lanes<S>, const L: usize, const N: usize, const M: usize>(
    simd: S,
    pairs: &[MovingPair<N, M>],
    max_fraction: f32,
    touches: &mut [Touch],
) {
    let mut searches = Searches::<L, N, M>::new();
    let mut pair_of_lane = [0; L];
    let mut busy = 0u64;
    // The next loaded pairs, and a bit mask of those that wait for a lane.
    let mut waiting = Searches::<L, N, M>::new();
    let (mut first_waiting, mut left) = (0, 0u64);
    let mut rest = pairs;
    loop {
        while busy != (1 << L) - 1 {
            if left == 0 {
                if rest.is_empty() {
                    break;
                }
                let (now, later) = rest.split_at(rest.len().min(L));
                first_waiting = pairs.len() - rest.len();
                rest = later;
                let apart = match now.as_array() {
                    Some(full) => waiting.load::<S, R>(simd, full, max_fraction),
                    // Missing pairs are filled with copies of the last one.
                    None => waiting.load::<S, R>(simd, &each(|lane| now[lane.min(now.len() - 1)]), max_fraction),
                };
                left = ((1 << now.len()) - 1) & !apart;
                continue;
            }
            let (lane, from) = (busy.trailing_ones() as usize, left.trailing_zeros() as usize);
            searches.copy(lane, &waiting, from);
            pair_of_lane[lane] = first_waiting + from;
            busy |= 1 << lane;
            left &= left - 1;
        }
        if busy == 0 {
            return;
        }
        let ends = searches.advance::<S, R>(simd, max_fraction);
        let mut done = busy & (ends.touch | ends.unclear | ends.apart);
        busy &= !done;
        while done != 0 {
            let lane = done.trailing_zeros() as usize;
            done &= done - 1;
            let (index, fraction) = (pair_of_lane[lane], searches.fraction[lane]);
            if ends.touch & (1 << lane) != 0 {
                let status = if fraction == 0.0 { TimeOfImpactStatus::Overlapping } else { TimeOfImpactStatus::Hit };
                touches[index] = Touch { status, fraction };
            } else if ends.unclear & (1 << lane) != 0 {
                touches[index] = alone(&pairs[index], fraction, searches.rounds[lane] as u32, max_fraction);
            }
        }
    }
}

/// Continues the search of one pair with the scalar kernel, from the time `cleared` and after `rounds` iterations.
#[inline(never)]
fn alone<const N: usize, const M: usize>(
    (first, second): &MovingPair<N, M>,
    cleared: f32,
    rounds: u32,
    max_fraction: f32,
) -> Touch {
    let found = time_of_impact_from(first, second, cleared, rounds, max_fraction);
    let fraction = if found.status == TimeOfImpactStatus::Separated { max_fraction } else { found.fraction };
    Touch { status: found.status, fraction }
}

/// The searches that end in an iteration, one bit per lane.
struct Ends {
    touch: u64,
    apart: u64,
    /// Searches for the scalar kernel: they took many iterations, or rounding hides the distance.
    unclear: u64,
}

/// A sphere at an instant, and its displacement over the step in metres.
type Mover<R> = (Ball<R>, Vector<R>);

/// One moving sphere of each pair.
#[derive(Clone, Copy)]
struct Spheres<const L: usize> {
    /// Centres at the start of the step, relative to the first sphere of the first side at that time. In f64, where sums and products of the f32 input
    /// are nearly exact.
    start: [[f64; L]; 3],
    /// Displacements over the step, relative to the displacement of that sphere.
    motion: [[f64; L]; 3],
    radius: [f32; L],
}

impl<const L: usize> Spheres<L> {
    const ZERO: Self = Self { start: [[0.0; L]; 3], motion: [[0.0; L]; 3], radius: [0.0; L] };

    #[inline(always)]
    fn copy(&mut self, lane: usize, from: &Self, from_lane: usize) {
        for axis in 0..3 {
            self.start[axis][lane] = from.start[axis][from_lane];
            self.motion[axis][lane] = from.motion[axis][from_lane];
        }
        self.radius[lane] = from.radius[from_lane];
    }

    #[inline(always)]
    fn at<S: Simd, R: Lanes<S>>(&self, simd: S, [early, late]: [R::Widened; 2]) -> Ball<R> {
        let [x, y, z] = each(
            #[inline(always)]
            |axis| {
                let (start, motion) =
                    (halves::<S, R, L>(simd, &self.start[axis]), halves::<S, R, L>(simd, &self.motion[axis]));
                (start[0] + motion[0] * early).narrow(start[1] + motion[1] * late)
            },
        );
        Ball { center: Vector { x, y, z }, radius: R::from_slice(simd, &self.radius) }
    }

    #[inline(always)]
    fn velocity<S: Simd, R: Lanes<S>>(&self, simd: S) -> Vector<R> {
        let [x, y, z] = each(
            #[inline(always)]
            |axis| {
                let [early, late] = halves::<S, R, L>(simd, &self.motion[axis]);
                early.narrow(late)
            },
        );
        Vector { x, y, z }
    }
}

#[inline(always)]
fn halves<S: Simd, R: Lanes<S>, const L: usize>(simd: S, numbers: &[f64; L]) -> [R::Widened; 2] {
    let (a, b) = numbers.split_at(L / 2);
    [R::Widened::from_slice(simd, a), R::Widened::from_slice(simd, b)]
}

/// Searches in progress, one pair per lane.
struct Searches<const L: usize, const N: usize, const M: usize> {
    /// Only the radius of the first of these spheres is used, because the sphere is the origin.
    first: [Spheres<L>; N],
    second: [Spheres<L>; M],
    /// Extent of the larger side.
    extent: [f32; L],
    /// Fraction of the step until which the pair does not touch.
    fraction: [f32; L],
    /// The instant that the next iteration examines: `fraction` or later.
    look: [f32; L],
    /// Number of iterations so far.
    rounds: [f32; L],
}

impl<const L: usize, const N: usize, const M: usize> Searches<L, N, M> {
    fn new() -> Self {
        Self {
            first: [Spheres::ZERO; N],
            second: [Spheres::ZERO; M],
            extent: [0.0; L],
            fraction: [0.0; L],
            look: [0.0; L],
            rounds: [0.0; L],
        }
    }

    /// Loads pairs, and sets `fraction` to the time until which two directions prove them apart. Returns a bit for each pair that stays apart.
    #[inline(always)]
    fn load<S: Simd, R: Lanes<S>>(&mut self, simd: S, pairs: &[MovingPair<N, M>; L], max_fraction: f32) -> u64 {
        let first = columns::<S, R, N>(
            simd,
            #[inline(always)]
            |lane| &pairs[lane].0,
        );
        let second = columns::<S, R, M>(
            simd,
            #[inline(always)]
            |lane| &pairs[lane].1,
        );
        let extents = [extent(&first), extent(&second)];
        extents[0].greater(extents[1]).store_slice(&mut self.extent);
        let (fraction, apart) = depart(&first, &second, extents, max_fraction);
        fraction.store_slice(&mut self.fraction);
        let apart = apart.to_bitmask();
        if apart != (1 << L) - 1 {
            let (origin, frame) = first[0];
            origin.radius.store_slice(&mut self.first[0].radius);
            for (into, from) in [(&mut self.first[1..], &first[1..]), (&mut self.second[..], &second[..])] {
                for (into, (ball, motion)) in into.iter_mut().zip(from) {
                    differences(&mut into.start, ball.center, origin.center);
                    differences(&mut into.motion, *motion, frame);
                    ball.radius.store_slice(&mut into.radius);
                }
            }
        }
        apart
    }

    /// Starts the search of a loaded pair.
    #[inline(always)]
    fn copy(&mut self, lane: usize, from: &Self, from_lane: usize) {
        self.first[0].radius[lane] = from.first[0].radius[from_lane];
        for (into, from) in self.first[1..].iter_mut().zip(&from.first[1..]) {
            into.copy(lane, from, from_lane);
        }
        for (into, from) in self.second.iter_mut().zip(&from.second) {
            into.copy(lane, from, from_lane);
        }
        self.extent[lane] = from.extent[from_lane];
        self.fraction[lane] = from.fraction[from_lane];
        self.look[lane] = from.fraction[from_lane];
        self.rounds[lane] = 0.0;
    }

    /// The spheres at an instant, and their displacements.
    #[inline(always)]
    fn at<S: Simd, R: Lanes<S>>(&self, simd: S, fraction: R) -> ([Mover<R>; N], [Mover<R>; M]) {
        let (early, late) = fraction.widen();
        let zero = fraction.like(0.0);
        let origin = Vector { x: zero, y: zero, z: zero };
        (
            each(
                #[inline(always)]
                |i| {
                    if i == 0 {
                        (Ball { center: origin, radius: R::from_slice(simd, &self.first[0].radius) }, origin)
                    } else {
                        (self.first[i].at(simd, [early, late]), self.first[i].velocity(simd))
                    }
                },
            ),
            each(
                #[inline(always)]
                |i| (self.second[i].at(simd, [early, late]), self.second[i].velocity(simd)),
            ),
        )
    }

    /// One iteration of conservative advancement, with bounds from both sides. The direction of minimum distance at `look` clears the time from `fraction`
    /// until the first gap along it closes, if all gaps are open at `fraction`. The nearest spheres at `look` bound the first touch from above: the
    /// primitives touch at the latest when these spheres do. If both times agree, that is the first touch. Otherwise the next iteration looks at the
    /// time when the spheres touch or pass, because the direction at that time is close to the direction of the touch.
    #[inline(always)]
    fn advance<S: Simd, R: Lanes<S>>(&mut self, simd: S, max_fraction: f32) -> Ends {
        let [fraction, look, extent, rounds] = each(
            #[inline(always)]
            |i| R::from_slice(simd, [&self.fraction, &self.look, &self.extent, &self.rounds][i]),
        );
        let (first, second) = self.at(simd, look);
        let Nearest { upper, normal, weights } = nearest(&balls(&first), &balls(&second));
        let (zero, max) = (look.like(0.0), look.like(max_fraction));
        let tolerance = R::select(fraction.at_most(zero), zero.like(CONTACT_ROUNDING), zero.like(TOUCH_ROUNDING));
        let touching = extent * tolerance;
        let (clear, until) = cleared(&first, &second, normal, zero, touching, look - fraction);
        // If `look` is far ahead of `fraction`, rounding may yield a time before `fraction`.
        let next = R::select(clear, fraction.greater(look + until), fraction);
        let apart = max.less(next);

        let (ball1, motion1) = at_weights(&first, weights.0);
        let (ball2, motion2) = at_weights(&second, weights.1);
        let (from, displacement) = (ball2.center - ball1.center, motion2 - motion1);
        let radii = ball1.radius + ball2.radius;
        let reach = radii + extent * zero.like(TOUCH_ROUNDING);
        // For a larger distance the rounding error exceeds the tolerance of a touch.
        let met = (from + displacement * until).length_squared().at_most(reach * reach) & upper.at_most(extent) & clear;
        let (approach, speed_squared) = (-from.dot(displacement), displacement.length_squared());
        let discriminant = approach * approach - speed_squared * (from.length_squared() - radii * radii);
        let discriminant = R::select(zero.less(discriminant), discriminant, zero);
        let meeting = look + (approach - Number::sqrt(discriminant)) / speed_squared;
        let later = clear & next.less(meeting);
        let meeting = meeting.lesser(max);

        let there = look.at_most(fraction);
        let touch = there & upper.at_most(touching);
        let rounds = rounds + zero.like(1.0);
        let many = zero.like(MAX_LANE_ADVANCES).at_most(rounds);
        rounds.store_slice(&mut self.rounds);
        R::select(touch, fraction, next).store_slice(&mut self.fraction);
        R::select(later, meeting, next).store_slice(&mut self.look);
        let [touch, met, there, clear, apart, many] = [touch, met, there, clear, apart, many].map(SimdMask::to_bitmask);
        Ends { touch: touch | (met & !apart), unclear: (there & !clear) | (many & !apart), apart }
    }
}

/// Time until which two directions prove the pair apart, and whether that is the whole step. The directions join the centroids of both sides, at the
/// start and at their closest approach.
#[inline(always)]
fn depart<R: Number, const N: usize, const M: usize>(
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
fn cleared<R: Number, const N: usize, const M: usize>(
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
    let sound = rounding.like(LEAST_SQUARE).less(length_squared);
    let clear = sound & (margin * length).less(least);
    (clear, R::select(clear, next_gap / next_closing, zero))
}

/// The spheres of the primitives and their displacements, one pair per lane.
#[inline(always)]
fn columns<'p, S: Simd, R: Lanes<S>, const N: usize>(
    simd: S,
    moving: impl Fn(usize) -> &'p Moving<N>,
) -> [Mover<R>; N] {
    each(
        #[inline(always)]
        |i| {
            let [x, y, z, radius] = transposed(
                simd,
                #[inline(always)]
                |lane| bytemuck::cast(moving(lane).start[i]),
            );
            let ball = Ball { center: Vector { x, y, z }, radius };
            let [x, y, z, _] = transposed(
                simd,
                #[inline(always)]
                |lane| moving(lane).motion[i].extend(0.0).to_array(),
            );
            (ball, Vector { x, y, z })
        },
    )
}

/// The columns of a matrix with one row per lane.
#[inline(always)]
fn transposed<S: Simd, R: Lanes<S>>(simd: S, row: impl Fn(usize) -> [f32; 4]) -> [R; 4] {
    // An eight-lane vector has two groups of four: the other groups are zero and unused.
    let fours: [_; 4] = each(
        #[inline(always)]
        |four| if 4 * four < R::LEN { transposed_from(simd, &row, 4 * four) } else { [f32x4::splat(simd, 0.0); 4] },
    );
    each(
        #[inline(always)]
        |i| {
            R::of_fours(
                #[inline(always)]
                |four| fours[four][i],
            )
        },
    )
}

/// The same for the four lanes that start at `from`.
#[inline(always)]
fn transposed_from<S: Simd>(simd: S, row: &impl Fn(usize) -> [f32; 4], from: usize) -> [f32x4<S>; 4] {
    let [a, b, c, d] = each(
        #[inline(always)]
        |i| f32x4::load_array(simd, row(from + i)),
    );
    let (ac, bd) = ((a.zip_low(c), a.zip_high(c)), (b.zip_low(d), b.zip_high(d)));
    [ac.0.zip_low(bd.0), ac.0.zip_high(bd.0), ac.1.zip_low(bd.1), ac.1.zip_high(bd.1)]
}

/// Stores the differences `a - b` in f64, where they are nearly exact.
#[inline(always)]
fn differences<S: Simd, R: Lanes<S>, const L: usize>(into: &mut [[f64; L]; 3], a: Vector<R>, b: Vector<R>) {
    for (into, (a, b)) in into.iter_mut().zip([(a.x, b.x), (a.y, b.y), (a.z, b.z)]) {
        let (a, b) = (a.widen(), b.widen());
        let (early, late) = into.split_at_mut(L / 2);
        (a.0 - b.0).store_slice(early);
        (a.1 - b.1).store_slice(late);
    }
}

/// The same as [`Convex::extent`](super::Convex::extent).
#[inline(always)]
fn extent<R: Number, const N: usize>(spheres: &[Mover<R>; N]) -> R {
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
fn balls<R: Number, const N: usize>(spheres: &[Mover<R>; N]) -> [Ball<R>; N] {
    each(
        #[inline(always)]
        |i| spheres[i].0,
    )
}

/// The interpolated sphere of a primitive at barycentric weights.
#[inline(always)]
fn at_weights<R: Number, const N: usize>(spheres: &[Mover<R>; N], weights: [R; N]) -> Mover<R> {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{geometry::Sphere, random::Random};

    /// Random pairs of about unit size; some of them meet.
    fn pairs<const N: usize, const M: usize>() -> Vec<MovingPair<N, M>> {
        let mut random = Random(1);
        let mut vector = || random.in_cube();
        let mut pair = || {
            let (offset, aim) = (vector() * 3.0, vector());
            let start1 = std::array::from_fn(|_| Sphere::new(offset + vector() * 0.5, 0.1 * vector().x.abs()));
            let motion1 = std::array::from_fn(|_| aim - offset * 1.2 + vector() * 0.3);
            let start2 = std::array::from_fn(|_| Sphere::new(vector() * 0.5, 0.1 * vector().x.abs()));
            let motion2 = std::array::from_fn(|_| vector() * 0.3);
            (Moving { start: start1, motion: motion1 }, Moving { start: start2, motion: motion2 })
        };
        (0..2000).map(|_| pair()).collect()
    }

    fn check<const N: usize, const M: usize>(levels: &[Level]) {
        let pairs = pairs::<N, M>();
        let bits = |touch: &Touch| (touch.status, touch.fraction.to_bits());
        let expected: Vec<_> = at_level(Level::baseline(), &pairs, 1.0).iter().map(bits).collect();
        for status in [TimeOfImpactStatus::Hit, TimeOfImpactStatus::Separated] {
            assert!(expected.iter().any(|(found, _)| *found == status), "no pair is {status:?}");
        }
        for &level in levels {
            let found: Vec<_> = at_level(level, &pairs, 1.0).iter().map(bits).collect();
            assert_eq!(found, expected, "{level:?}");
        }
        let mut wide = vec![Touch { status: TimeOfImpactStatus::Separated, fraction: 1.0 }; pairs.len()];
        dispatch!(Level::new(), simd => run::<_, f32x16<_>, 16, N, M>(simd, &pairs, 1.0, &mut wide));
        assert_eq!(wide.iter().map(bits).collect::<Vec<_>>(), expected, "sixteen");
    }

    #[test]
    fn every_machine_gives_the_same_bits() {
        let best = Level::new();
        #[cfg(target_arch = "x86_64")]
        let levels = [best.as_sse4_2().map(Level::Sse4_2), best.as_avx2().map(Level::Avx2), Some(best)];
        #[cfg(not(target_arch = "x86_64"))]
        let levels = [Some(best)];
        let levels: Vec<Level> = levels.into_iter().flatten().collect();
        // The kernel of slabs contains those of all other primitives.
        check::<1, 1>(&levels);
        check::<3, 3>(&levels);
    }
}
