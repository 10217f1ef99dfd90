//! Bounds of times of impact from the shaders, compared with the times of the CPU.

use std::sync::Mutex;

use bevy_medial::{
    gpu::{GpuBounds, MovingPair},
    query::{TimeOfImpactStatus, Touch, alternating, time_of_impact},
};

use super::device;
use crate::{
    pairs::{CATEGORIES, KINDS, Pair, kind_name, random_pair},
    score::{for_each_case, setting},
};

/// Counts of the pairs of one category and kind.
#[derive(Clone, Copy, Default)]
struct Counts {
    pairs: usize,
    /// Pairs that touch within the step.
    touching: usize,
    /// Bounds that exceed the time of impact of the CPU.
    late: usize,
    /// Bounds that are earlier by more than 5 % of the step. A pair that stays apart counts as a touch at the end of the step.
    early: usize,
}

impl Counts {
    fn note(&mut self, bound: f32, touch: &Touch) {
        let is_apart = touch.status == TimeOfImpactStatus::Separated;
        let time = if is_apart { 1.0 } else { touch.fraction };
        self.pairs += 1;
        self.touching += usize::from(!is_apart);
        self.late += usize::from(!is_apart && (bound > touch.fraction || bound.is_nan()));
        self.early += usize::from(time - bound > 0.05);
    }

    fn plus(self, other: Self) -> Self {
        Self {
            pairs: self.pairs + other.pairs,
            touching: self.touching + other.touching,
            late: self.late + other.late,
            early: self.early + other.early,
        }
    }
}

fn check(pairs: u64) {
    let Some(gpu) = device() else { return };
    let bounds = Mutex::new(GpuBounds::new(gpu).unwrap());
    let pack = |pair: &Pair| {
        let (first, second) = pair.relative();
        for_kinds!(first, second, |a, b| hulls: MovingPair::new(&a, &b), cuboid: MovingPair::with_cuboid(&a, &b))
    };
    let exact = |pair: &Pair| {
        let (first, second) = pair.relative();
        let found =
            for_kinds!(first, second, |a, b| hulls: time_of_impact(&a, &b, 1.0), cuboid: time_of_impact(&a, &b, 1.0));
        Touch { status: found.status, fraction: found.fraction }
    };
    let counts = for_each_case(5, |category, kind, mut random| {
        let pairs: Vec<Pair> = (0..pairs).map(|_| random_pair(&mut random, category, KINDS[kind])).collect();
        let found = bounds.lock().unwrap().run(&pairs.iter().map(pack).collect::<Vec<_>>()).unwrap();
        let mut counts = Counts::default();
        pairs.iter().zip(found).for_each(|(pair, bound)| counts.note(bound, &exact(pair)));
        counts
    });
    for (case, Counts { pairs, touching, late, early }) in counts.iter().enumerate() {
        let (category, kind) = (CATEGORIES[case / KINDS.len()], kind_name(KINDS[case % KINDS.len()]));
        println!("{category:16} {kind:12} {pairs:8} pairs {touching:8} touch {late:6} late {early:6} early");
    }
    let all = counts.into_iter().fold(Counts::default(), Counts::plus);
    println!("{} pairs, {} touch, {} late, {} early", all.pairs, all.touching, all.late, all.early);
    assert!(3 * all.touching > all.pairs && 3 * all.touching < 2 * all.pairs + all.pairs / 2);
    assert_eq!(all.late, 0, "bounds are later than the time of impact");
    assert!(20 * all.early <= all.pairs, "{} of {} bounds are early", all.early, all.pairs);
}

#[test]
fn bounds_are_never_late_and_rarely_early() {
    check(setting("KERNEL_PAIRS", 1_000));
}

#[test]
#[ignore = "exhaustive"]
fn a_million_bounds_are_never_late_and_rarely_early() {
    check(10_000);
}

/// The alternation depends on which of two spheres is nearer, so the rounding of f32 decides between results that have little in common.
#[test]
fn the_alternation_finds_the_times_of_the_cpu_in_nearly_all_pairs() {
    let Some(gpu) = device() else { return };
    let kernel = Mutex::new(GpuBounds::alternating(gpu).unwrap());
    let counts = for_each_case(6, |category, kind, mut random| {
        let pairs: Vec<Pair> = (0..200).map(|_| random_pair(&mut random, category, KINDS[kind])).collect();
        let both = pairs.iter().filter_map(|pair| {
            let (first, second) = pair.relative();
            for_kinds!(first, second, |a, b| hulls: Some((MovingPair::new(&a, &b), alternating(&a, &b))), cuboid: { let _ = (a, b); None })
        });
        let (moving, exact): (Vec<_>, Vec<_>) = both.unzip();
        let found = kernel.lock().unwrap().run(&moving).unwrap();
        let mut counts = [0; 3];
        for (found, exact) in found.into_iter().zip(exact) {
            let is_hit = exact.status == TimeOfImpactStatus::Hit;
            let is_same = if is_hit { (found - exact.fraction).abs() < 1e-3 } else { found > 1.0 };
            counts = [counts[0] + 1, counts[1] + usize::from(is_hit), counts[2] + usize::from(is_same)];
        }
        counts
    });
    let [pairs, hits, same] = counts.into_iter().fold([0; 3], |sum, more| [0, 1, 2].map(|i| sum[i] + more[i]));
    println!("{same} of {pairs} pairs are the same, {hits} are hits");
    assert!(4 * hits > pairs && pairs > 5_000, "{hits} of {pairs}");
    assert!(100 * same >= 99 * pairs, "{same} of {pairs}");
}

#[test]
fn empty_input_gives_empty_output() {
    let Some(gpu) = device() else { return };
    assert!(GpuBounds::new(gpu).unwrap().run(&[]).unwrap().is_empty());
}
