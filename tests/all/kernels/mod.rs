//! The kernels compared with an independent reference in f64, on random pairs of every category and kind.
//!
//! The variable `KERNEL_SEED` selects other pairs, and `KERNEL_PAIRS` sets their number per category and kind.

mod at_once;
mod paper;
mod swept_cones;

use std::fmt::Debug;

use bevy_medial::random::Random;
use bevy_medial::{
    geometry::Sphere,
    query::{Convex, MovingConvex, TimeOfImpact, TimeOfImpactStatus, Touch, alternating, separation, time_of_impact},
};
use glam::{DQuat, DVec3};

use crate::{
    pairs::{KINDS, Pair, Verdict, corners, random_pair},
    reference::{Ball, Difference},
    score::{Score, assert_all_good, for_each_case, setting, summary},
};

fn advancement(pair: &Pair) -> TimeOfImpact {
    let (first, second) = pair.relative();
    for_kinds!(first, second, |a, b| hulls: time_of_impact(&a, &b, 1.0), cuboid: time_of_impact(&a, &b, 1.0))
}

/// Runs a kernel for single pairs on each of many pairs.
fn one_by_one(kernel: impl Fn(&Pair) -> TimeOfImpact) -> impl Fn(&[Pair]) -> Vec<Touch> {
    move |pairs| {
        pairs.iter().map(&kernel).map(|found| Touch { status: found.status, fraction: found.fraction }).collect()
    }
}

#[test]
fn time_of_impact_agrees_with_reference() {
    check_time_of_impact(setting("KERNEL_PAIRS", 1_000));
}

#[test]
#[ignore = "exhaustive"]
fn exhaustive_time_of_impact_agrees_with_reference() {
    check_time_of_impact(setting("KERNEL_PAIRS", 9_700));
}

fn check_time_of_impact(pairs: u64) {
    let scores =
        for_each_case(1, |category, kind, random| Score::of(category, kind, random, pairs, one_by_one(advancement)));
    assert_all_good(&scores, pairs, KINDS.len());
}

/// Proves that the judge can fail a kernel. The published scheme misses hits and reports some late or early. It has no false alarms, so
/// kernels that report every pair as a hit check the last two verdicts.
#[test]
fn judge_finds_faults_of_wrong_kernels() {
    let pairs = setting("KERNEL_PAIRS", 500);
    let kernel = |pair: &Pair| {
        let (first, second) = pair.relative();
        for_kinds!(first, second, |a, b| hulls: alternating(&a, &b), cuboid: time_of_impact(&a, &b, 1.0))
    };
    let scores =
        for_each_case(2, |category, kind, random| Score::of(category, kind, random, pairs, one_by_one(kernel)));
    let verdicts = summary(&scores);
    for verdict in [Verdict::Missed, Verdict::Late, Verdict::Early, Verdict::OverlapMissed] {
        assert!(verdicts[verdict as usize] > 0, "{verdict:?} never given");
    }

    let alarmist = |fraction: f32| {
        let kernel = move |pair: &Pair| TimeOfImpact { status: TimeOfImpactStatus::Hit, fraction, ..advancement(pair) };
        let scores = for_each_case(2, |category, kind, random| {
            Score::of(category, kind, random, pairs / 10, one_by_one(kernel))
        });
        summary(&scores)
    };
    assert!(alarmist(0.5)[Verdict::FalseAlarm as usize] > 0);
    assert!(alarmist(f32::NAN)[Verdict::Invalid as usize] > 0);
}

/// Counts of pairs by their relative position, and faults of the answers.
#[derive(Default)]
struct Separations {
    apart: usize,
    shallow: usize,
    crossing: usize,
    faults: Vec<String>,
}

fn balls(spheres: &[Sphere]) -> Vec<Ball> {
    let ball = |s: &Sphere| Ball { center: s.center.as_dvec3(), radius: s.radius.into(), motion: DVec3::ZERO };
    spheres.iter().map(ball).collect()
}

impl Separations {
    /// Checks an answer with the normal `n` and the distance `d`:
    ///
    /// * `n` is a unit vector and `d` is the gap along it: for an overlap, `-d n` is a translation of the second that ends it;
    /// * the points are `d` apart along `n`. Their sideways offset is at most about the square root of the rounding error;
    /// * unless the centres cross, `d` is the true distance, and the points lie on the surfaces;
    /// * if the centres cross, no shorter translation ends the overlap.
    fn check<const N: usize, B: Convex + Debug>(
        &mut self,
        a: &[Sphere; N],
        b: &B,
        second: &[Ball],
        random: &mut Random,
    ) {
        let hint = if random.chance(0.5) { 0 } else { random.below(b.features::<N>()) };
        let got = separation(a, b, hint);
        let first = balls(a);
        let difference = Difference::new(&first, second);
        let truth = difference.distance();
        let (n, d) = (got.normal.as_dvec3(), f64::from(got.distance));
        let size = f64::from(a.extent() + b.extent());
        let farthest = first.iter().chain(second).map(|ball| ball.center.length()).fold(0.0, f64::max);
        let tolerance = 3e-6 * size + 4e-7 * farthest;
        let mut fault = |wrong: bool, what: &str, by: f64| {
            if wrong && self.faults.len() < 3 {
                self.faults
                    .push(format!("{what}, {by:e} of {size}: {a:?} {b:?} hint {hint}: {got:?}, truth {truth:?}"));
            }
        };
        let length = (n.length() - 1.0).abs();
        fault(length.is_nan() || length > 1e-6, "not a unit normal", length);
        let error = (difference.gap(n) - d).abs();
        fault(error.is_nan() || error > tolerance, "not the gap along the normal", error);
        let apart = (got.point2 - got.point1).as_dvec3();
        let error = (apart.dot(n) - d).abs();
        fault(error.is_nan() || error > 2.0 * tolerance, "points are not that far apart along the normal", error);
        let error = apart.reject_from(n).length();
        fault(error > (2.0 * tolerance * (size + farthest)).sqrt(), "points are offset sideways", error);

        if truth.normal.length() > 0.999 {
            let error = (d - truth.lower).abs();
            fault(error > tolerance, "not the distance", error);
            for (point, side) in [(got.point1, first.as_slice()), (got.point2, second)] {
                let point = Ball { center: point.as_dvec3(), ..Ball::default() };
                let error = Difference::new(&[point], side).distance().lower.abs();
                fault(error > 1e-5 * size + 4e-7 * farthest, "a point is off the surface", error);
            }
            if d > 0.0 { self.apart += 1 } else { self.shallow += 1 }
        } else {
            self.crossing += 1;
            if self.crossing % 16 == 1 {
                let shorter = difference.depth(500) - d;
                fault(shorter > tolerance, "a shorter translation ends the overlap", shorter);
            }
        }
    }
}

#[test]
fn separation_agrees_with_reference() {
    check_separation(setting("KERNEL_PAIRS", 150));
}

#[test]
#[ignore = "exhaustive"]
fn exhaustive_separation_agrees_with_reference() {
    check_separation(setting("KERNEL_PAIRS", 2_000));
}

fn check_separation(pairs: u64) {
    let results = for_each_case(3, |category, kind, mut random| {
        let mut result = Separations::default();
        for _ in 0..pairs {
            let pair = random_pair(&mut random, category, KINDS[kind]);
            // Half of the pairs that hit are tested at their impact.
            let impact = advancement(&pair);
            let touch = impact.status == TimeOfImpactStatus::Hit && random.chance(0.5);
            let fraction = if touch { impact.fraction } else { random.range(0.0, 1.0) as f32 };
            let (first, second) = pair.relative();
            for_kinds!(first, second, |a, b|
            hulls: result.check(&a.at(f64::from(fraction), DVec3::ZERO), &b.at(f64::from(fraction), DVec3::ZERO), &balls(&b.at(f64::from(fraction), DVec3::ZERO)), &mut random),
            cuboid: {
                let points = corners(b.half.as_dvec3(), DVec3::ZERO, DQuat::IDENTITY);
                result.check(&a.at(f64::from(fraction), DVec3::ZERO), &b, &points, &mut random);
            });
        }
        result
    });
    let sum = |count: fn(&Separations) -> usize| results.iter().map(count).sum::<usize>();
    let (apart, shallow, crossing) = (sum(|r| r.apart), sum(|r| r.shallow), sum(|r| r.crossing));
    println!("{apart} apart, {shallow} overlapping, {crossing} with centres crossing");
    let enough = pairs as usize * 2;
    assert!(apart > enough && shallow > enough && crossing > enough);
    let faults: Vec<&String> = results.iter().flat_map(|r| &r.faults).collect();
    faults.iter().for_each(|fault| println!("{fault}"));
    assert!(faults.is_empty(), "{} cases failed", faults.len());
}
