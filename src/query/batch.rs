//! Times of impact of many pairs at once, in eight or sixteen SIMD lanes.

mod lanes;
mod movers;
mod searches;

use fearless_simd::{Level, Simd, dispatch, f32x8, f32x16, prelude::*};

use super::{
    branchless::each,
    time_of_impact::{TimeOfImpactStatus, time_of_impact_from},
};
use lanes::Lanes;
pub use movers::MovingPair;
use searches::Searches;

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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{geometry::Sphere, query::Moving, random::Random};

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
