//! The cones that bodies sweep (paper, section 4.1), compared with plain minimisation in f64.

use std::cell::Cell;

use bevy_medial::{
    geometry::Sphere,
    query::{Cuboid, Separation, separation},
};
use bevy_medial_compare::{convex::min_of_convex, paper::conic::distance};
use glam::{DVec3, Vec3};
use proptest::{
    prelude::*,
    test_runner::{Config, RngAlgorithm, TestCaseResult, TestRng, TestRunner},
};

fn lerp(a: &Sphere, b: &Sphere, t: f64) -> (DVec3, f64) {
    let (radius1, radius2) = (f64::from(a.radius), f64::from(b.radius));
    (a.center.as_dvec3().lerp(b.center.as_dvec3(), t), radius1 + (radius2 - radius1) * t)
}

fn cone_to_cone([a, b]: &[Sphere; 2], [c, d]: &[Sphere; 2]) -> f64 {
    min_of_convex(|t| {
        let (center1, radius1) = lerp(a, b, t);
        min_of_convex(|s| {
            let (center2, radius2) = lerp(c, d, s);
            center1.distance(center2) - radius1 - radius2
        })
    })
}

fn vec3(low: f32, high: f32) -> impl Strategy<Value = Vec3> {
    prop::array::uniform3(low..high).prop_map(Vec3::from_array)
}

/// Cones of any slope, also with pointed ends, with one end inside the other, and of length 0.
fn cone() -> impl Strategy<Value = [Sphere; 2]> {
    let radius = || prop_oneof![1 => Just(0.0f32), 5 => 0.0f32..1.0];
    let offset = prop_oneof![1 => Just(Vec3::ZERO), 8 => vec3(-2.0, 2.0)];
    (vec3(-2.5, 2.5), offset, radius(), radius())
        .prop_map(|(start, offset, r1, r2)| [Sphere::new(start, r1), Sphere::new(start + offset, r2)])
}

/// Compares a separation with the minimum `wanted`. That is the distance unless the centres meet; then the overlap is at least that deep.
/// Centres can meet only if the overlap is at least `deepest`, the sum of the smallest radius of each side.
fn check(got: &Separation, wanted: f64, deepest: f32, counts: &[Cell<u32>; 3]) -> TestCaseResult {
    let tolerance = 2e-5;
    let distance = f64::from(got.distance);
    let meet = wanted < f64::from(-deepest) + 1e-6;
    let kind = if meet { 2 } else { usize::from(wanted <= 0.0) };
    counts[kind].set(counts[kind].get() + 1);
    if kind == 2 {
        prop_assert!(distance < wanted + tolerance, "{distance} is above {wanted}");
    } else {
        prop_assert!((distance - wanted).abs() < tolerance, "{distance} is not {wanted}");
    }
    Ok(())
}

/// Runs a property on reproducible cases. Asserts that enough pairs are apart, overlapping, and deep enough for centres to meet.
fn run<S: Strategy>(strategy: S, property: impl Fn(S::Value, &[Cell<u32>; 3]) -> TestCaseResult) {
    let cases = if cfg!(debug_assertions) { 2_000 } else { 20_000 };
    let config = Config { cases, failure_persistence: None, ..Config::default() };
    let mut runner = TestRunner::new_with_rng(config, TestRng::deterministic_rng(RngAlgorithm::ChaCha));
    let counts = [const { Cell::new(0) }; 3];
    let result = runner.run(&strategy, |value| property(value, &counts));
    println!("apart, overlapping, deep: {counts:?}");
    if let Err(error) = result {
        panic!("{error}");
    }
    assert!(counts.iter().all(|count| count.get() > cases / 50), "too few pairs of some kind: {counts:?}");
}

#[test]
fn separation_of_cone_and_box_solves_equation_3() {
    run((cone(), vec3(0.01, 2.0)), |(cone, half), counts| {
        let got = separation(&cone, &Cuboid { half }, 0);
        check(&got, distance(&cone, half), cone[0].radius.min(cone[1].radius), counts)
    });
}

#[test]
fn separation_of_two_cones_is_the_minimum() {
    run((cone(), cone()), |(cone1, cone2), counts| {
        let deepest = cone1[0].radius.min(cone1[1].radius) + cone2[0].radius.min(cone2[1].radius);
        check(&separation(&cone1, &cone2, 0), cone_to_cone(&cone1, &cone2), deepest, counts)
    });
}
