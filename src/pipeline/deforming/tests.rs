use std::sync::Arc;

use bevy::tasks::TaskPool;
use glam::Quat;

use super::*;
use crate::{
    pipeline::{Body, Culling, Shape, Solid, Statics, StepInput, first_touch, step, with_spheres},
    query::separation,
    random::Random,
};

/// A ring whose spheres move on random polylines.
fn ring(random: &mut Random, knots: usize, motion: f32) -> Arc<Deforming> {
    let axis = MedialAxis::torus(0.4, 0.1, 8).unwrap();
    let mut spheres = axis.spheres().to_vec();
    let mut all = vec![spheres.clone()];
    for _ in 1..knots {
        for sphere in &mut spheres {
            sphere.center += random.in_cube() * motion;
        }
        all.push(spheres.clone());
    }
    Arc::new(Deforming::new(&axis, all))
}

/// Returns the distance of a body and a deforming shape at a fraction of the step.
fn distance_at(body: &Body, shape: &Deforming, fraction: f32) -> f32 {
    let own = body.solid.medial().unwrap();
    let place = body.sweep.pose_at(fraction).into();
    let ours = || (0..own.len() as u32).map(|i| own.hull(i).placed(&place));
    let theirs = || (0..shape.len() as u32).map(|i| shape.hull_at(i, fraction));
    let distance = |a: Hull, b: Hull| with_spheres!(a, |a| with_spheres!(b, |b| separation(&a, &b, 0).distance));
    ours().flat_map(|a| theirs().map(move |b| distance(a, b))).fold(f32::INFINITY, f32::min)
}

fn moving(shape: impl Into<Solid>, random: &mut Random, spread: f32, speed: f32, turn: f32) -> Body {
    let start = Pose3::from_parts(random.in_cube() * spread, Quat::from_scaled_axis(random.in_cube() * 3.0));
    let way = -start.translation * speed + random.in_cube() * 0.3 * speed;
    Body::new(shape, Sweep::at_rates(start, Vec3::ZERO, way, random.in_cube() * turn))
}

#[test]
fn first_touches_are_those_of_a_fine_sampling() {
    const SAMPLES: usize = 1000;
    let mut random = Random(11);
    let (mut hits, mut misses, mut near_misses, mut after_a_corner) = (0, 0, 0, 0);
    for case in 0..300 {
        let shape = match case % 2 {
            0 => Shape::new(MedialAxis::sphere(0.05).unwrap()),
            _ => Shape { axis: MedialAxis::torus(0.3, 0.05, 12).unwrap(), scale: 0.5 },
        };
        let body = moving(shape, &mut random, 1.2, 1.5, [0.0, 0.5][case / 2 % 2]);
        let ring = ring(&mut random, 1 + case % 5, 0.3);
        let other = Body::new(Solid::Deforming(ring.clone()), Sweep::at_rest(Pose3::IDENTITY));
        let distances: Vec<f32> = (0..=SAMPLES).map(|i| distance_at(&body, &ring, i as f32 / SAMPLES as f32)).collect();
        let least = distances.iter().copied().fold(f32::INFINITY, f32::min);
        // Bodies that overlap at the start have another first touch.
        if distances[0] < 0.01 || least.abs() < 2e-3 {
            continue;
        }
        for culling in [Culling::Hybrid, Culling::None] {
            let found = first_touch([body.clone(), other.clone()], culling, None);
            let expected = distances.iter().position(|distance| *distance <= 0.0);
            assert_eq!(found.is_some(), expected.is_some(), "case {case}: {found:?}, least distance {least}");
            let (Some(impact), Some(expected)) = (found, expected) else {
                misses += 1;
                near_misses += usize::from(least < 0.1);
                continue;
            };
            hits += 1;
            after_a_corner += usize::from(case % 5 > 1 && impact.fraction > 0.5);
            // At the touch, the bodies are as near as the chord's tolerance.
            let distance = distance_at(&body, &ring, impact.fraction);
            let time = expected as f32 / SAMPLES as f32;
            assert!(distance.abs() < 2e-3 && impact.fraction < time + 1e-4, "{case}: {impact:?}, {distance} {time}");
            let hull = ring.hull_at(impact.primitive2, impact.fraction);
            let off = with_spheres!(hull, |s| separation(&s, &[Sphere::new(impact.point, 0.0)], 0).distance);
            assert!(off.abs() < 2e-3, "case {case}: the point is {off} m off its primitive");
        }
    }
    assert!(
        hits > 200 && misses > 50 && near_misses > 10 && after_a_corner > 20,
        "{hits} {misses} {near_misses} {after_a_corner}"
    );
}

#[test]
fn a_swinging_limb_pushes_bodies_as_a_rigid_one_does() {
    let mut random = Random(12);
    let (mut pushed, mut missed, mut deepest) = (0, 0, [0.0f32; 2]);
    for case in 0..200 {
        // A limb whose tip moves at 10 m/s in a step of 1/60 s.
        let axis = MedialAxis::capsule(Vec3::ZERO, Vec3::X, 0.1).unwrap();
        let angle = 0.17;
        let [root, tip] = [axis.spheres()[0], axis.spheres()[1]];
        let knot = |i: usize| {
            let turn = Quat::from_rotation_z(angle * i as f32 / 4.0);
            vec![root, Sphere::new(turn * tip.center, tip.radius)]
        };
        let limb = Arc::new(Deforming::new(&axis, (0..=4).map(knot).collect()));
        let at = Vec3::new(0.3 + 0.5 * random.unit(), 0.21 + 0.2 * random.unit(), 0.05 * random.signed());
        let rest = Sweep::at_rest(Pose3::from_translation(at));
        let ball = Body::new(Shape::new(MedialAxis::sphere(0.1).unwrap()), rest);
        let swing = Sweep::at_rates(Pose3::IDENTITY, Vec3::ZERO, Vec3::ZERO, Vec3::Z * angle);
        let solids: [(Solid, Sweep); 2] = [
            (Solid::Deforming(limb.clone()), Sweep::at_rest(Pose3::IDENTITY)),
            (Shape::new(axis.clone()).into(), swing),
        ];
        let [deforming, rigid] = solids.map(|(solid, sweep)| {
            let bodies = vec![ball.clone(), Body { stops: false, ..Body::new(solid, sweep) }];
            let input = StepInput { bodies, stop_at_impact: true, prediction: 0.02, ..Default::default() };
            let output = step(&input, &Statics::default(), &TaskPool::new());
            let stop = output.stop_of(0).map(|stop| stop.pose);
            let ended = Body { sweep: Sweep::at_rest(stop.unwrap_or(rest.end)), ..ball.clone() };
            (stop.is_some(), distance_at(&ended, &limb, 1.0), output.manifolds.len())
        });
        let touched = (0..=64).any(|i| distance_at(&ball, &limb, i as f32 / 64.0) < -1e-3);
        assert!(deforming.0 || !touched, "case {case}: the ball at {at} is missed");
        assert!(deforming.1 > rigid.1.min(0.0) - 2e-3, "case {case}: {deforming:?} {rigid:?}");
        assert!(deforming.2 > 0 || !touched, "case {case}: the pushed ball has no contact");
        pushed += usize::from(touched);
        missed += usize::from(!deforming.0);
        deepest = [deepest[0].min(deforming.1), deepest[1].min(rigid.1)];
    }
    assert!(pushed > 50 && missed > 20 && deepest[0] > -0.01, "{pushed} pushed, {missed} missed, {deepest:?}");
}
