//! The scene `dinosaur`: what the fast body touches first is what its true motion meets first.

use bevy::prelude::*;
use bevy_medial::{
    geometry::Sweep,
    pipeline::{Body, Side},
    plugin::MedialStep,
    scenes::{Monitor, Projectile, Scene},
};
use glam::DVec3;

use crate::{
    common::*,
    true_motion::{Motion, Solid, corners_of_box, distance},
};

/// First fraction at which the solids touch, by steps that cannot pass it.
fn first_touch(first: &Solid, second: &Solid) -> Option<f64> {
    let reach = first.reach() + second.reach();
    let mut fraction = 0.0;
    while fraction <= 1.0 {
        // Nothing farther away matters in what is left of the step.
        let distance = distance(first, second, fraction, reach * (1.0 - fraction) + 1e-3);
        if distance <= 1e-5 {
            return Some(fraction);
        }
        fraction += distance / reach;
    }
    None
}

fn of_body(body: &Body, origin: DVec3) -> Solid {
    Solid::of_shape(body.solid.medial().unwrap(), Motion::new(&body.sweep, origin))
}

/// What the projectile meets in the step, in the order of time: the entity and the fraction.
fn true_impacts(step: &MedialStep, projectile: u32) -> Vec<(Entity, f64)> {
    let body = &step.input.bodies[projectile as usize];
    let origin = body.sweep.start.translation.as_dvec3();
    let fast = of_body(body, origin);
    let bodies = (0..step.input.bodies.len() as u32)
        .filter(|&other| other != projectile)
        .map(|other| (step.infos[other as usize].entity, of_body(&step.input.bodies[other as usize], origin)));
    let statics = step.statics.bodies().iter().zip(&step.static_infos).map(|(body, info)| {
        assert!(body.solid.medial().is_none());
        let still = Motion::new(&Sweep::at_rest(body.pose), origin);
        (info.entity, Solid::new(std::iter::once(corners_of_box(&body.obb())), still))
    });
    let mut found: Vec<(Entity, f64)> = Vec::new();
    for (entity, solid) in bodies.chain(statics) {
        found.extend(first_touch(&fast, &solid).map(|fraction| (entity, fraction)));
    }
    found.sort_by(|a, b| a.1.total_cmp(&b.1));
    found
}

/// The projectile's first impact in the step: with whom, and when.
fn found_impact(step: &MedialStep, projectile: u32) -> Option<(Entity, f64)> {
    let impacts = step.output.pairs.iter().filter_map(|pair| {
        let other = match (pair.first, pair.second) {
            (first, Side::Body(second)) if second == projectile => step.info(first).entity,
            (Side::Body(first), second) if first == projectile => step.info(second).entity,
            _ => return None,
        };
        Some((other, f64::from(pair.impact?.fraction)))
    });
    impacts.min_by(|a, b| a.1.total_cmp(&b.1))
}

#[test]
fn the_dinosaur_meets_first_what_its_true_motion_meets_first() {
    let scene = Scene::by_name("dinosaur").unwrap();
    let mut certain = 0;
    for seed in 0..20 {
        let mut app = app();
        scene.spawn(app.world_mut(), models(), seed);
        let fast = app.world_mut().query_filtered::<Entity, With<Projectile>>().single(app.world()).unwrap();
        let mut steps = 0;
        let found = loop {
            app.update();
            steps += 1;
            let step = app.world().resource::<MedialStep>();
            let index = step.infos.iter().position(|info| info.entity == fast).unwrap() as u32;
            let (truth, found) = (true_impacts(step, index), found_impact(step, index));
            let Some(&(_, fraction)) = truth.first() else {
                assert_eq!(found, None, "seed {seed}, step {steps}");
                assert!(steps < 4, "seed {seed}: nothing is met");
                continue;
            };
            let (found, found_fraction) = found.unwrap_or_else(|| panic!("seed {seed}: {truth:?} missed"));
            // Impacts are early by the chords' tolerance and, where limbs touch that will not overlap, late by less than the slop.
            let body = &step.input.bodies[index as usize];
            let close = 5e-3 / f64::from(body.sweep.reach(body.solid.bounding_sphere().radius));
            assert!((found_fraction - fraction).abs() < close, "seed {seed}: {found_fraction} not {fraction}");
            let first: Vec<Entity> = truth.iter().filter(|(_, f)| *f <= fraction + close).map(|(e, _)| *e).collect();
            assert!(first.contains(&found), "seed {seed}: {found}, but {truth:?}");
            certain += usize::from(first.len() == 1);
            break found;
        };
        assert!(app.world().resource::<Monitor>().touched_by_projectile.contains(&found), "seed {seed}");
        run(&mut app, scene.steps - steps);
        let monitor = app.world().resource::<Monitor>();
        assert!(monitor.touched_by_projectile.contains(&found), "seed {seed}");
        assert_eq!(monitor.tunnelled, 0, "seed {seed}");
    }
    assert!(certain >= 15, "{certain}");
}
