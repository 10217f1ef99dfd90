//! The scene `dinosaur`: the first body that the projectile touches is the first one along its true motion.

use bevy::prelude::*;
use bevy_medial::{
    geometry::Sweep,
    pipeline::{Body, Side},
    plugin::{MedialSettings, MedialStep},
    scenes::{Monitor, Projectile, Scene},
};
use glam::DVec3;

use crate::{
    common::*,
    true_motion::{Motion, Solid, corners_of_box, distance},
};

/// Deepest overlap that is not an impact, in metres, because limbs may graze each other.
const SLOP: f64 = 1e-3;

/// Largest distance at an impact, in metres. It is not zero because bodies turn and chords deviate from arcs.
const EARLY: f64 = 2e-3;

/// First fraction before `until` at which the solids overlap by more than [`SLOP`]. The steps of the search are so short that they cannot skip it.
fn first_overlap(first: &Solid, second: &Solid, until: f64) -> Option<f64> {
    let reach = first.reach() + second.reach();
    let mut fraction = 0.0;
    while fraction < until {
        // Solids at a larger distance cannot meet in the rest of the interval.
        let above = SLOP + distance(first, second, fraction, reach * (until - fraction) + SLOP);
        if above <= 1e-5 {
            return Some(fraction);
        }
        fraction += above / reach;
    }
    None
}

fn of_body(body: &Body, origin: DVec3) -> Solid {
    Solid::of_shape(body.solid.medial().unwrap(), Motion::new(&body.sweep, origin))
}

/// The projectile and all other solids of a step.
fn solids(step: &MedialStep, projectile: u32) -> (Solid, Vec<(Entity, Solid)>) {
    let body = &step.input.bodies[projectile as usize];
    let origin = body.sweep.start.translation.as_dvec3();
    let bodies = (0..step.input.bodies.len() as u32)
        .filter(|&other| other != projectile)
        .map(|other| (step.infos[other as usize].entity, of_body(&step.input.bodies[other as usize], origin)));
    let statics = step.statics.bodies().iter().zip(&step.static_infos).map(|(body, info)| {
        assert!(body.solid.medial().is_none());
        let still = Motion::new(&Sweep::at_rest(body.pose), origin);
        (info.entity, Solid::new(std::iter::once(corners_of_box(&body.obb())), still))
    });
    (of_body(body, origin), bodies.chain(statics).collect())
}

/// The projectile's first impact in the step: the other entity and the fraction.
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
fn the_first_impact_is_that_of_the_true_motion() {
    let scene = Scene::by_name("dinosaur").unwrap();
    let mut certain = 0;
    for seed in 0..20 {
        let mut app = app();
        // First touches of surfaces, not of cores.
        app.world_mut().resource_mut::<MedialSettings>().core_depth = 0.0;
        scene.spawn(app.world_mut(), models(), seed);
        let fast = app.world_mut().query_filtered::<Entity, With<Projectile>>().single(app.world()).unwrap();
        let mut steps = 0;
        let found = loop {
            app.update();
            steps += 1;
            let step = app.world().resource::<MedialStep>();
            let index = step.infos.iter().position(|info| info.entity == fast).unwrap() as u32;
            let (fast, others) = solids(step, index);
            let found = found_impact(step, index);
            let until = found.map_or(1.0, |(_, fraction)| fraction);
            for (entity, other) in &others {
                let missed = first_overlap(&fast, other, until);
                assert_eq!(missed, None, "seed {seed}, step {steps}: {entity} is hit before {found:?}");
            }
            let Some((found, fraction)) = found else {
                assert!(steps < 4, "seed {seed}: no impact");
                continue;
            };
            let near: Vec<Entity> = others
                .iter()
                .filter(|(_, other)| distance(&fast, other, fraction, 1.0) < EARLY)
                .map(|(entity, _)| *entity)
                .collect();
            assert!(near.contains(&found), "seed {seed}: {found} at {fraction}, where {near:?} are near");
            certain += usize::from(near.len() == 1);
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
