//! The scene `dinosaur`: what the fast body touches first is what its true motion meets first.

use bevy::prelude::*;
use bevy_medial::{
    pipeline::{Body, Shape, Target},
    plugin::MedialStep,
    scenes::{Monitor, Projectile, Scene},
};
use glam::DVec3;

use crate::{
    common::*,
    true_motion::{Corners, Motion, MovingPair, corners_of, corners_of_box},
};

/// All convex parts of a body, or one box, with a sphere around each.
struct Solid {
    parts: Vec<(Corners, DVec3, f64)>,
    motion: Motion,
}

impl Solid {
    fn new(parts: impl Iterator<Item = Corners>, motion: Motion) -> Self {
        let bound = |corners: Corners| {
            let middle = corners.iter().map(|(center, _)| *center).sum::<DVec3>() / corners.len() as f64;
            let radius = corners.iter().map(|(center, r)| center.distance(middle) + r).fold(0.0, f64::max);
            (corners, middle, radius)
        };
        Self { parts: parts.map(bound).collect(), motion }
    }

    fn of_body(body: &Body, origin: DVec3) -> Self {
        let parts = |shape: &Shape| (0..shape.len() as u32).map(|i| corners_of(shape, i)).collect::<Vec<_>>();
        Self::new(parts(&body.shape).into_iter(), Motion::new(&body.sweep, origin))
    }

    fn reach(&self) -> f64 {
        self.parts.iter().map(|(corners, _, _)| self.motion.reach(corners)).fold(0.0, f64::max)
    }
}

/// Least distance of two solids at an instant, if it is less than `limit`.
fn distance(first: &Solid, second: &Solid, fraction: f64, limit: f64) -> f64 {
    let placed = |solid: &Solid| {
        let place = |(_, middle, radius): &(Corners, DVec3, f64)| (solid.motion.point(*middle, fraction), *radius);
        solid.parts.iter().map(place).collect::<Vec<_>>()
    };
    let (bounds1, bounds2) = (placed(first), placed(second));
    let mut order = Vec::new();
    for (i, (center1, radius1)) in bounds1.iter().enumerate() {
        for (j, (center2, radius2)) in bounds2.iter().enumerate() {
            let bound = center1.distance(*center2) - radius1 - radius2;
            if bound < limit {
                order.push((bound, i, j));
            }
        }
    }
    order.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut least = limit;
    for (bound, i, j) in order {
        if bound >= least {
            break;
        }
        let sides = [(first.parts[i].0.clone(), first.motion), (second.parts[j].0.clone(), second.motion)];
        least = least.min(MovingPair { sides }.distance(fraction));
    }
    least
}

/// First fraction up to `limit` at which the solids come within `level`, by steps that cannot pass it.
fn first_within(first: &Solid, second: &Solid, level: f64, limit: f64) -> Option<f64> {
    let reach = first.reach() + second.reach();
    let mut fraction = 0.0;
    while fraction <= limit {
        // Nothing farther away matters in what is left of the step.
        let far = reach * (limit - fraction) + level + 1e-3;
        let above = distance(first, second, fraction, far) - level;
        if above <= 1e-5 {
            return Some(fraction);
        }
        fraction += above / reach;
    }
    None
}

/// What the projectile meets in the step, in the order of time: the entity and the fraction.
fn true_impacts(step: &MedialStep, projectile: u32, level: f64) -> Vec<(Entity, f64)> {
    let body = &step.input.bodies[projectile as usize];
    let origin = body.sweep.start.translation.as_dvec3();
    let fast = Solid::of_body(body, origin);
    let bodies = (0..step.input.bodies.len() as u32).filter(|&other| other != projectile).map(|other| {
        (step.infos[other as usize].entity, Solid::of_body(&step.input.bodies[other as usize], origin))
    });
    let statics = step.statics.bodies().iter().zip(&step.static_infos).map(|(body, info)| {
        assert!(body.shape.is_none());
        let still = Motion::new(&bevy_medial::geometry::Sweep::at_rest(body.obb.pose), origin);
        (info.entity, Solid::new(std::iter::once(corners_of_box(&body.obb)), still))
    });
    let mut found: Vec<(Entity, f64)> = Vec::new();
    for (entity, solid) in bodies.chain(statics) {
        found.extend(first_within(&fast, &solid, level, 1.0).map(|fraction| (entity, fraction)));
    }
    found.sort_by(|a, b| a.1.total_cmp(&b.1));
    found
}

#[test]
fn the_dinosaur_meets_first_what_its_true_motion_meets_first() {
    let scene = Scene::by_name("dinosaur").unwrap();
    let (mut certain, mut in_first_steps) = (0, 0);
    for seed in 0..20 {
        let mut app = app();
        scene.spawn(app.world_mut(), models(), seed);
        let fast = app.world_mut().query_filtered::<Entity, With<Projectile>>().single(app.world()).unwrap();
        let mut met = None;
        for number in 0..4 {
            app.update();
            let step = app.world().resource::<MedialStep>();
            let index = step.infos.iter().position(|info| info.entity == fast).unwrap() as u32;
            let truth = true_impacts(step, index, 0.0);
            let impact = step
                .output
                .pairs
                .iter()
                .filter_map(|pair| {
                    let other = match pair.target {
                        Target::Body(other) if other == index => step.infos[pair.body1 as usize].entity,
                        target if pair.body1 == index => step.info(target).entity,
                        _ => return None,
                    };
                    Some((other, pair.impact?.fraction))
                })
                .min_by(|a, b| a.1.total_cmp(&b.1));
            let Some(&(entity, fraction)) = truth.first() else {
                assert!(impact.is_none(), "seed {seed}, step {number}: {impact:?} though nothing is met");
                continue;
            };
            let (found, found_fraction) = impact.unwrap_or_else(|| panic!("seed {seed}, step {number}: {truth:?} missed"));
            println!("seed {seed}, step {number}: {:?}, found {found} {found_fraction}", &truth[..truth.len().min(2)]);
            in_first_steps += 1;
            // Two at all but the same time, within a few millimetres of the way, cannot be told apart.
            let close = 5e-3 / fast_way(step, index);
            let candidates: Vec<Entity> = truth.iter().filter(|(_, f)| *f <= fraction + close).map(|(e, _)| *e).collect();
            assert!(candidates.contains(&found), "seed {seed}, step {number}: {found} {found_fraction}, but {truth:?}");
            assert!((f64::from(found_fraction) - fraction).abs() < close, "seed {seed}: {found_fraction} {fraction}");
            certain += usize::from(candidates.len() == 1);
            met = Some(entity.min(found));
            assert!(app.world().resource::<Monitor>().touched_by_projectile.contains(&found), "seed {seed}");
            met = met.map(|_| found);
            break;
        }
        let met = met.unwrap_or_else(|| panic!("seed {seed}: nothing is met in the first steps"));
        run(&mut app, scene.steps - 4);
        assert!(app.world().resource::<Monitor>().touched_by_projectile.contains(&met), "seed {seed}");
        assert_eq!(app.world().resource::<Monitor>().tunnelled, 0, "seed {seed}");
    }
    println!("{in_first_steps} first impacts, {certain} of them certain");
    assert!(in_first_steps == 20 && certain >= 15);
}

/// How far the body goes within the step, in metres.
fn fast_way(step: &MedialStep, index: u32) -> f64 {
    let body = &step.input.bodies[index as usize];
    f64::from(body.sweep.reach(body.shape.bounding_sphere().radius))
}
