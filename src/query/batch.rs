//! Times of impact of many pairs at once, sixteen side by side.

use fearless_simd::{Level, Simd, dispatch, f32x4, f32x16, f64x8, mask32x16, prelude::*};

use super::{
    nearest::{Edge, Face},
    number::{Ball, Number, Vector},
    separation::edges,
    time_of_impact::{Moving, TimeOfImpactStatus, time_of_impact_from},
};
use crate::constants::{CONTACT_ROUNDING, LEAST_SQUARE, MAX_LANE_ADVANCES, TOUCH_ROUNDING};

/// Pairs side by side: as many as the widest vectors hold. Narrower ones go in two or four, whose chains of operations overlap.
const LANES: usize = 16;

/// Two moving primitives.
pub type MovingPair<const N: usize, const M: usize> = (Moving<N>, Moving<M>);

/// When two primitives touch first: a [`TimeOfImpact`](super::TimeOfImpact) without the contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Touch {
    /// How the search ended.
    pub status: TimeOfImpactStatus,
    /// Fraction of the step; the greatest one if they stay apart.
    pub fraction: f32,
}

/// The first touch of each pair in `[0, max_fraction]`, in order: what [`time_of_impact`](super::time_of_impact) finds but for rounding, in a
/// fraction of its time.
///
/// Each pair is on its own: its result is the same bits whatever other pairs there are, and on every machine.
pub fn times_of_impact<const N: usize, const M: usize>(pairs: &[MovingPair<N, M>], max_fraction: f32) -> Vec<Touch> {
    at_level(Level::new(), pairs, max_fraction)
}

/// With the vectors of one kind of machine.
fn at_level<const N: usize, const M: usize>(level: Level, pairs: &[MovingPair<N, M>], max_fraction: f32) -> Vec<Touch> {
    let mut touches = vec![Touch { status: TimeOfImpactStatus::Separated, fraction: max_fraction }; pairs.len()];
    dispatch!(level, simd => run(simd, pairs, max_fraction, &mut touches));
    touches
}

/// Advances the pairs in lanes, and fills each lane that is done with the next pair. `touches`: separated, as far as nothing else is found.
#[inline(always)]
fn run<S: Simd, const N: usize, const M: usize>(
    simd: S,
    pairs: &[MovingPair<N, M>],
    max_fraction: f32,
    touches: &mut [Touch],
) {
    let mut lanes = Lanes::<N, M>::new();
    let mut owners = [0; LANES];
    let mut busy = 0u64;
    // The next pairs, and which of them are still to go to a lane.
    let mut waiting = Lanes::<N, M>::new();
    let (mut first_waiting, mut left) = (0, 0u64);
    let mut rest = pairs;
    loop {
        while busy != (1 << LANES) - 1 {
            if left == 0 {
                if rest.is_empty() {
                    break;
                }
                let (now, later) = rest.split_at(rest.len().min(LANES));
                first_waiting = pairs.len() - rest.len();
                rest = later;
                left = ((1 << now.len()) - 1) & !waiting.load(simd, now, max_fraction);
                continue;
            }
            let (lane, from) = (busy.trailing_ones() as usize, left.trailing_zeros() as usize);
            lanes.copy(lane, &waiting, from);
            owners[lane] = first_waiting + from;
            busy |= 1 << lane;
            left &= left - 1;
        }
        if busy == 0 {
            return;
        }
        let ends = lanes.advance(simd, max_fraction);
        let mut done = busy & (ends.touch | ends.unclear | ends.apart);
        busy &= !done;
        while done != 0 {
            let lane = done.trailing_zeros() as usize;
            done &= done - 1;
            let (index, fraction) = (owners[lane], lanes.fraction[lane]);
            if ends.touch & (1 << lane) != 0 {
                let status = if fraction == 0.0 { TimeOfImpactStatus::Overlapping } else { TimeOfImpactStatus::Hit };
                touches[index] = Touch { status, fraction };
            } else if ends.unclear & (1 << lane) != 0 {
                touches[index] = alone(&pairs[index], fraction, lanes.rounds[lane] as u32, max_fraction);
            }
        }
    }
}

/// The search from where it is after some rounds, by the scalar kernel.
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

/// Which searches end in a round; a bit for each lane.
struct Ends {
    touch: u64,
    apart: u64,
    /// Those for the scalar kernel: they take many rounds, or rounding hides how far they are apart.
    unclear: u64,
}

/// A sphere at an instant, and its displacement over the step.
type Mover<R> = (Ball<R>, Vector<R>);

/// Sixteen spheres on their way.
#[derive(Clone, Copy)]
struct Spheres {
    /// Centres at the start of the step relative to the first sphere of the first side there, in f64: sums and products of the f32 input are all
    /// but exact.
    start: [[f64; LANES]; 3],
    /// Displacements over the step relative to that sphere's.
    motion: [[f64; LANES]; 3],
    radius: [f32; LANES],
}

impl Spheres {
    const ZERO: Self = Self { start: [[0.0; LANES]; 3], motion: [[0.0; LANES]; 3], radius: [0.0; LANES] };

    #[inline(always)]
    fn copy(&mut self, lane: usize, from: &Self, from_lane: usize) {
        for axis in 0..3 {
            self.start[axis][lane] = from.start[axis][from_lane];
            self.motion[axis][lane] = from.motion[axis][from_lane];
        }
        self.radius[lane] = from.radius[from_lane];
    }

    #[inline(always)]
    fn at<S: Simd>(&self, simd: S, [early, late]: [f64x8<S>; 2]) -> Ball<f32x16<S>> {
        let [x, y, z] = each(
            #[inline(always)]
            |axis| {
                let (start, motion) = (halves(simd, &self.start[axis]), halves(simd, &self.motion[axis]));
                simd.narrow_f64x8(start[0] + motion[0] * early, start[1] + motion[1] * late)
            },
        );
        Ball { center: Vector { x, y, z }, radius: f32x16::load_array(simd, self.radius) }
    }

    #[inline(always)]
    fn velocity<S: Simd>(&self, simd: S) -> Vector<f32x16<S>> {
        let [x, y, z] = each(
            #[inline(always)]
            |axis| {
                let [early, late] = halves(simd, &self.motion[axis]);
                simd.narrow_f64x8(early, late)
            },
        );
        Vector { x, y, z }
    }
}

#[inline(always)]
fn halves<S: Simd>(simd: S, numbers: &[f64; LANES]) -> [f64x8<S>; 2] {
    let (a, b) = numbers.split_at(LANES / 2);
    [f64x8::from_slice(simd, a), f64x8::from_slice(simd, b)]
}

/// An array of what `make` gives for each index: `std::array::from_fn`, inlined for certain.
#[inline(always)]
fn each<T: Copy, const N: usize>(make: impl Fn(usize) -> T) -> [T; N] {
    let mut made = [make(0); N];
    for (i, slot) in made.iter_mut().enumerate().skip(1) {
        *slot = make(i);
    }
    made
}

/// Sixteen pairs on their way.
struct Lanes<const N: usize, const M: usize> {
    /// Of the first of them only the radius counts: it is at the origin.
    first: [Spheres; N],
    second: [Spheres; M],
    /// The larger side's extent.
    extent: [f32; LANES],
    /// Until when nothing touches, and the rounds that it took.
    fraction: [f32; LANES],
    rounds: [f32; LANES],
}

impl<const N: usize, const M: usize> Lanes<N, M> {
    fn new() -> Self {
        Self {
            first: [Spheres::ZERO; N],
            second: [Spheres::ZERO; M],
            extent: [0.0; LANES],
            fraction: [0.0; LANES],
            rounds: [0.0; LANES],
        }
    }

    /// Puts up to sixteen pairs where two directions show that nothing touches until then. A bit for each pair that stays apart.
    #[inline(always)]
    fn load<S: Simd>(&mut self, simd: S, pairs: &[MovingPair<N, M>], max_fraction: f32) -> u64 {
        // The lanes of what is missing are like the last.
        let pair = |lane: usize| &pairs[lane.min(pairs.len() - 1)];
        let first = columns(
            simd,
            #[inline(always)]
            |lane| &pair(lane).0,
        );
        let second = columns(
            simd,
            #[inline(always)]
            |lane| &pair(lane).1,
        );
        let extents = [extent(&first), extent(&second)];
        self.extent = extents[0].greater(extents[1]).into();
        let (fraction, apart) = depart(&first, &second, extents, max_fraction);
        self.fraction = fraction.into();
        self.rounds = [0.0; LANES];
        let apart = apart.to_bitmask();
        if apart != (1 << LANES) - 1 {
            let (origin, frame) = first[0];
            self.first[0].radius = origin.radius.into();
            for (into, from) in [(&mut self.first[1..], &first[1..]), (&mut self.second[..], &second[..])] {
                for (into, (ball, motion)) in into.iter_mut().zip(from) {
                    into.start = differences(simd, ball.center, origin.center);
                    into.motion = differences(simd, *motion, frame);
                    into.radius = ball.radius.into();
                }
            }
        }
        apart
    }

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
        self.rounds[lane] = from.rounds[from_lane];
    }

    #[inline(always)]
    fn at<S: Simd>(&self, simd: S, fraction: f32x16<S>) -> ([Ball<f32x16<S>>; N], [Ball<f32x16<S>>; M]) {
        let (early, late) = simd.widen_f32x16(fraction);
        (
            each(
                #[inline(always)]
                |i| if i == 0 { self.origin(simd) } else { self.first[i].at(simd, [early, late]) },
            ),
            each(
                #[inline(always)]
                |i| self.second[i].at(simd, [early, late]),
            ),
        )
    }

    /// The first sphere of the first side.
    #[inline(always)]
    fn origin<S: Simd>(&self, simd: S) -> Ball<f32x16<S>> {
        let zero = f32x16::splat(simd, 0.0);
        Ball { center: Vector { x: zero, y: zero, z: zero }, radius: f32x16::load_array(simd, self.first[0].radius) }
    }

    /// One round of conservative advancement.
    #[inline(always)]
    fn advance<S: Simd>(&mut self, simd: S, max_fraction: f32) -> Ends {
        let fraction = f32x16::load_array(simd, self.fraction);
        let (first, second) = self.at(simd, fraction);
        let (upper, direction) = nearest(&first, &second);
        let zero = upper.like(0.0);
        // The first of all stays at the origin.
        let moving1: [_; N] = each(
            #[inline(always)]
            |i| (first[i], if i == 0 { first[0].center } else { self.first[i].velocity(simd) }),
        );
        let moving2: [_; M] = each(
            #[inline(always)]
            |i| (second[i], self.second[i].velocity(simd)),
        );
        let tolerance = f32x16::select(fraction.at_most(zero), zero.like(CONTACT_ROUNDING), zero.like(TOUCH_ROUNDING));
        let touching = f32x16::load_array(simd, self.extent) * tolerance;
        let (clear, until) = cleared(&moving1, &moving2, direction, zero, touching);
        let touch = upper.at_most(touching);
        let next = fraction + until;
        let apart = zero.like(max_fraction).less(next);
        let rounds = f32x16::load_array(simd, self.rounds) + zero.like(1.0);
        let many = zero.like(MAX_LANE_ADVANCES).at_most(rounds);
        self.rounds = rounds.into();
        self.fraction = f32x16::select(touch, fraction, next).into();
        let [touch, clear, apart, many] = [touch, clear, apart, many].map(mask32x16::to_bitmask);
        Ends { touch, unclear: !clear | (many & !apart), apart }
    }
}

/// Until when two directions show that nothing touches, and whether that is the whole step: that between the middles of both sides at the start, and
/// that when the middles are nearest to each other.
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
    let way =
        (middle(&second, |(_, motion)| *motion) - middle(&first, |(_, motion)| *motion)) * zero.like(max_fraction);
    let nearest = from + way * (-(from.dot(way)) / way.length_squared()).saturate();
    let rounding = (extent1 + extent2 + from.length() + way.length()) * zero.like(CONTACT_ROUNDING);
    let mut fraction = zero;
    for direction in [from, nearest] {
        let (_, until) = cleared(&first, &second, direction, rounding, zero);
        fraction = fraction.greater(until);
    }
    (fraction, zero.like(max_fraction).less(fraction))
}

/// Whether both sides keep more than `margin` apart along a direction, and how much time goes by until the gap is closed; false and none if rounding
/// hides where the direction leads. Spheres count as larger by `rounding`. Relative to the first sphere of the first side.
#[inline(always)]
fn cleared<R: Number, const N: usize, const M: usize>(
    first: &[Mover<R>; N],
    second: &[Mover<R>; M],
    direction: Vector<R>,
    rounding: R,
    margin: R,
) -> (R::Mask, R) {
    let zero = rounding.like(0.0);
    // Gaps and motions are those along the unit vector times this: their ratios, the times, are the same.
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
    // The least gap, and that closed first: a division is as dear as a dozen products.
    let mut least = rounding.like(f32::INFINITY);
    let (mut next_gap, mut next_closing) = (least, rounding.like(1.0));
    for (ball, motion) in second {
        let low = ball.center.dot(direction) - ball.radius * length;
        let low_motion = motion.dot(direction);
        for (high, high_motion) in high {
            let (gap, closing) = (low - high, high_motion - low_motion);
            least = least.lesser(gap);
            let sooner = zero.less(closing) & (gap * next_closing).less(next_gap * closing);
            next_gap = R::select(sooner, gap, next_gap);
            next_closing = R::select(sooner, closing, next_closing);
        }
    }
    let sound = rounding.like(LEAST_SQUARE).less(length_squared);
    let clear = sound & (margin * length).less(least);
    (clear, R::select(clear, next_gap / next_closing, zero))
}

/// The spheres of sixteen primitives, and their motions.
#[inline(always)]
fn columns<'p, S: Simd, const N: usize>(simd: S, moving: impl Fn(usize) -> &'p Moving<N>) -> [Mover<f32x16<S>>; N] {
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

/// The columns of a matrix of sixteen rows.
#[inline(always)]
fn transposed<S: Simd>(simd: S, row: impl Fn(usize) -> [f32; 4]) -> [f32x16<S>; 4] {
    let quarters: [_; LANES / 4] = each(
        #[inline(always)]
        |quarter| transposed_from(simd, &row, 4 * quarter),
    );
    each(
        #[inline(always)]
        |i| {
            let [a, b, c, d] = quarters.map(|quarter| quarter[i]);
            a.combine(b).combine(c.combine(d))
        },
    )
}

/// The same of four, from one on.
#[inline(always)]
fn transposed_from<S: Simd>(simd: S, row: &impl Fn(usize) -> [f32; 4], from: usize) -> [f32x4<S>; 4] {
    let [a, b, c, d] = each(
        #[inline(always)]
        |i| f32x4::load_array(simd, row(from + i)),
    );
    let (ac, bd) = ((a.zip_low(c), a.zip_high(c)), (b.zip_low(d), b.zip_high(d)));
    [ac.0.zip_low(bd.0), ac.0.zip_high(bd.0), ac.1.zip_low(bd.1), ac.1.zip_high(bd.1)]
}

/// A vector of differences, all but exact and rounded.
#[inline(always)]
fn differences<S: Simd>(simd: S, a: Vector<f32x16<S>>, b: Vector<f32x16<S>>) -> [[f64; LANES]; 3] {
    let mut exact = [[0.0; LANES]; 3];
    for (axis, (a, b)) in [(a.x, b.x), (a.y, b.y), (a.z, b.z)].into_iter().enumerate() {
        let (a, b) = (simd.widen_f32x16(a), simd.widen_f32x16(b));
        let (early, late) = (a.0 - b.0, a.1 - b.1);
        let halves = exact[axis].split_at_mut(LANES / 2);
        early.store_slice(halves.0);
        late.store_slice(halves.1);
    }
    exact
}

/// As [`Convex::extent`](super::Convex::extent).
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

/// The mean of a primitive's spheres' vectors.
#[inline(always)]
fn middle<T, R: Number, const N: usize>(spheres: &[T; N], vector: impl Fn(&T) -> Vector<R>) -> Vector<R> {
    let mut sum = vector(&spheres[0]);
    for sphere in &spheres[1..] {
        sum = sum + vector(sphere);
    }
    sum * sum.x.like(1.0 / N as f32)
}

/// The least distance of two primitives, or more, and a direction from the first to the second where they are that near.
#[inline(always)]
fn nearest<R: Number, const N: usize, const M: usize>(first: &[Ball<R>; N], second: &[Ball<R>; M]) -> (R, Vector<R>) {
    let apart = second[0].center - first[0].center;
    let mut best = Best { upper: apart.x.like(f32::INFINITY), normal: apart };
    if N == 1 && M == 1 {
        best.take(apart.length() - first[0].radius - second[0].radius, apart);
    }
    let edges1: [Edge<R>; N] = each(
        #[inline(always)]
        |i| Edge::new(first[i], first[(i + 1) % N]),
    );
    let edges2: [Edge<R>; M] = each(
        #[inline(always)]
        |i| Edge::new(second[i], second[(i + 1) % M]),
    );
    // Where there is a cone, the two ends that face each other are less work than every end. Two slabs have nine pairs of edges.
    let facing = N.min(M) == 2;
    if !facing {
        for ball in first {
            for edge in &edges2[..edges(M)] {
                let (gap, normal) = edge.gap(ball.center);
                best.take(gap - ball.radius, -normal);
            }
        }
        for ball in second {
            for edge in &edges1[..edges(N)] {
                let (gap, normal) = edge.gap(ball.center);
                best.take(gap - ball.radius, normal);
            }
        }
    }
    for (i, edge1) in edges1[..edges(N)].iter().enumerate() {
        for (j, edge2) in edges2[..edges(M)].iter().enumerate() {
            let crossing = edge1.crossing(edge2);
            let (gap, normal, inside) = crossing.gap(edge1, edge2);
            best.take_if(inside, gap, -normal);
            if facing {
                let [late1, late2] = crossing.facing(edge1, edge2);
                let ball1 = Ball::select(late1, first[(i + 1) % N], first[i]);
                let ball2 = Ball::select(late2, second[(j + 1) % M], second[j]);
                let (gap, normal) = edge2.gap(ball1.center);
                best.take(gap - ball1.radius, -normal);
                let (gap, normal) = edge1.gap(ball2.center);
                best.take(gap - ball2.radius, normal);
            }
        }
    }
    if M == 3 {
        let face = Face::new(second[0], second[1 % M], second[2 % M]);
        for ball in first {
            let (gap, normal, inside) = face.gap(ball.center);
            best.take_if(inside, gap - ball.radius, -normal);
        }
    }
    if N == 3 {
        let face = Face::new(first[0], first[1 % N], first[2 % N]);
        for ball in second {
            let (gap, normal, inside) = face.gap(ball.center);
            best.take_if(inside, gap - ball.radius, normal);
        }
    }
    (best.upper, best.normal)
}

/// The nearest so far.
struct Best<R> {
    upper: R,
    normal: Vector<R>,
}

impl<R: Number> Best<R> {
    #[inline(always)]
    fn take(&mut self, upper: R, normal: Vector<R>) {
        let nearer = upper.less(self.upper);
        self.upper = R::select(nearer, upper, self.upper);
        self.normal = Vector::select(nearer, normal, self.normal);
    }

    #[inline(always)]
    fn take_if(&mut self, mask: R::Mask, upper: R, normal: Vector<R>) {
        let nearer = mask & upper.less(self.upper);
        self.upper = R::select(nearer, upper, self.upper);
        self.normal = Vector::select(nearer, normal, self.normal);
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::geometry::Sphere;

    /// Random pairs of about unit size, of which some meet.
    fn pairs<const N: usize, const M: usize>() -> Vec<MovingPair<N, M>> {
        let mut state = 1u64;
        let mut signed = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            ((state >> 40) as f32) / (1u64 << 23) as f32 - 1.0
        };
        let mut vector = || Vec3::new(signed(), signed(), signed());
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
    }

    #[test]
    fn every_machine_gives_the_same_bits() {
        let best = Level::new();
        #[cfg(target_arch = "x86_64")]
        let levels = [best.as_sse4_2().map(Level::Sse4_2), best.as_avx2().map(Level::Avx2), Some(best)];
        #[cfg(not(target_arch = "x86_64"))]
        let levels = [Some(best)];
        let levels: Vec<Level> = levels.into_iter().flatten().collect();
        check::<1, 1>(&levels);
        check::<2, 2>(&levels);
        check::<2, 3>(&levels);
        check::<3, 3>(&levels);
    }
}
