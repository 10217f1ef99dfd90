//! Searches in progress.

use fearless_simd::{Simd, prelude::*};

use super::{
    lanes::{Lanes, columns, differences, halves},
    movers::{Mover, MovingPair, at_weights, balls, cleared, depart, extent},
};
use crate::{
    constants::{CONTACT_ROUNDING, MAX_ADVANCES, TOUCH_ROUNDING},
    query::{
        branchless::{Nearest, each, nearest},
        number::{Ball, Number, Vector},
    },
};

/// The searches that end in an iteration, one bit per lane.
pub(super) struct Ends {
    pub touch: u64,
    pub apart: u64,
    /// Searches for the scalar kernel: they took many iterations, or rounding hides the distance.
    pub unclear: u64,
}

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

/// Searches in progress, one pair per lane.
pub(super) struct Searches<const L: usize, const N: usize, const M: usize> {
    /// Only the radius of the first of these spheres is used, because the sphere is the origin.
    first: [Spheres<L>; N],
    second: [Spheres<L>; M],
    /// Extent of the larger side.
    extent: [f32; L],
    /// Fraction of the step until which the pair does not touch.
    pub fraction: [f32; L],
    /// The instant that the next iteration examines: `fraction` or later.
    look: [f32; L],
    /// Number of iterations so far.
    pub rounds: [f32; L],
}

impl<const L: usize, const N: usize, const M: usize> Searches<L, N, M> {
    pub fn new() -> Self {
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
    pub fn load<S: Simd, R: Lanes<S>>(&mut self, simd: S, pairs: &[MovingPair<N, M>; L], max_fraction: f32) -> u64 {
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
    pub fn copy(&mut self, lane: usize, from: &Self, from_lane: usize) {
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
    pub fn advance<S: Simd, R: Lanes<S>>(&mut self, simd: S, max_fraction: f32) -> Ends {
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
        // Iterations are cheaper in lanes, so there are more of them before the scalar search.
        let many = zero.like(3.0 * MAX_ADVANCES as f32).at_most(rounds);
        rounds.store_slice(&mut self.rounds);
        R::select(touch, fraction, next).store_slice(&mut self.fraction);
        R::select(later, meeting, next).store_slice(&mut self.look);
        let [touch, met, there, clear, apart, many] = [touch, met, there, clear, apart, many].map(SimdMask::to_bitmask);
        Ends { touch: touch | (met & !apart), unclear: (there & !clear) | (many & !apart), apart }
    }
}
