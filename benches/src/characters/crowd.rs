//! A character that runs through a crowd of dynamic bodies on a ground.

use std::error::Error;

use bevy::prelude::*;
use bevy_medial::{
    geometry::{Primitive, Sphere},
    medial_axis::MedialAxis,
    pipeline::Hull,
    prelude::*,
    query::separation,
    random::Random,
};
use bevy_rapier3d::{
    plugin::context::{RapierContextEntityLink, RapierRigidBodySet},
    prelude::{RapierRigidBodyHandle, RigidBody},
    rapier::dynamics::RigidBody as RapierBody,
};

use super::{Actor, Cast, add_axis, cpu_app};

/// Number of bodies.
pub const BODIES: usize = 100;
/// Duration in seconds.
const DURATION: f32 = 1.5;
/// Interval between two samples of the energy in seconds.
const SAMPLE: f32 = 1.0 / 60.0;
/// Duration before the start of the run in which the bodies come to rest, in seconds.
const REST: f32 = 0.5;

/// State of the bodies after a run.
#[derive(Clone, Copy, Debug)]
pub struct Outcome {
    /// Mean kinetic energy of a body over the time of the run, in joules.
    pub energy: f64,
    /// Bodies that have moved by more than 10 cm.
    pub moved: usize,
    /// Bodies whose centre is within the character at the end.
    pub inside: usize,
    /// Deepest overlap of a body with the character at the end, and at any time, in metres.
    pub deepest: [f32; 2],
}

/// Runs the scene in steps of `dt` seconds.
///
/// # Errors
/// If shapes are not valid.
pub fn run(actor: &Actor, dt: f32, seed: u64) -> Result<Outcome, Box<dyn Error>> {
    let mut app = cpu_app(dt);
    app.world_mut().spawn((StaticObb::new(20.0, 1.0, 4.0), Transform::from_xyz(4.0, -1.0, 0.0)));
    let bodies = spawn_bodies(&mut app, seed)?;
    let steps = |seconds: f32| (seconds / dt).round() as u32;
    (0..steps(REST)).for_each(|_| app.update());
    let mesh = add_axis(&mut app, &actor.axis);
    let cast = Cast::spawn(&mut app, actor, Vec3::ZERO);
    app.world_mut().entity_mut(cast.root).insert(SkinnedMedialMesh::new(mesh));
    let places: Vec<Option<Vec3>> = bodies.iter().map(|(body, _)| Some(rigid(&app, *body)?.translation())).collect();
    let mut outcome = Outcome { energy: 0.0, moved: 0, inside: 0, deepest: [0.0; 2] };
    let (every, mut samples) = (steps(SAMPLE).max(1), 0);
    for step in 1..=steps(DURATION) {
        cast.animate(&mut app, actor, step as f32 * dt);
        app.update();
        if step % every > 0 {
            continue;
        }
        samples += 1;
        let energy = bodies.iter().filter_map(|(body, _)| Some(f64::from(rigid(&app, *body)?.kinetic_energy())));
        outcome.energy += energy.sum::<f64>() / BODIES as f64;
        let (depth, inside) = overlap(&app, cast.root, &bodies);
        outcome.deepest = [depth, depth.max(outcome.deepest[1])];
        outcome.inside = inside;
    }
    outcome.energy /= f64::from(samples);
    let is_moved = |((body, _), place): &(&(Entity, MedialAxis), Option<Vec3>)| {
        let now = rigid(&app, *body).map(RapierBody::translation);
        now.zip(*place).is_some_and(|(now, place)| now.distance(place) > 0.1)
    };
    outcome.moved = bodies.iter().zip(places).filter(is_moved).count();
    Ok(outcome)
}

/// Spheres, capsules and tori in front of the character.
fn spawn_bodies(app: &mut App, seed: u64) -> Result<Vec<(Entity, MedialAxis)>, Box<dyn Error>> {
    let capsule = [-0.15, 0.15].map(|x| Sphere::new(Vec3::X * x, 0.06));
    let (capsule, _) = MedialAxis::new(capsule.to_vec(), vec![Primitive::Cone([0, 1])])?;
    let axes = [MedialAxis::sphere(0.1)?, capsule, MedialAxis::torus(0.14, 0.05, 10)?];
    let meshes = axes.each_ref().map(|axis| MedialMesh(add_axis(app, axis)));
    let mut random = Random(seed);
    // A grid of cells, so that no two bodies overlap.
    let body = |index: usize| {
        let cell = Vec3::new((index / 2 % 25) as f32, (index / 50) as f32, (index % 2) as f32);
        let place = Vec3::new(1.0, 0.3, -0.25) + cell * Vec3::new(0.28, 0.5, 0.5) + random.in_ball() * 0.03;
        let place = Transform::from_translation(place).with_rotation(random.rotation());
        let mesh = meshes[index % axes.len()].clone();
        (app.world_mut().spawn((RigidBody::Dynamic, mesh, place)).id(), axes[index % axes.len()].clone())
    };
    Ok((0..BODIES).map(body).collect())
}

fn rigid(app: &App, entity: Entity) -> Option<&RapierBody> {
    let handle = app.world().get::<RapierRigidBodyHandle>(entity)?.0;
    let context = app.world().get::<RapierContextEntityLink>(entity)?.0;
    app.world().get::<RapierRigidBodySet>(context)?.bodies.get(handle)
}

/// The deepest overlap of a body's spheres with the character in metres, and the number of bodies with a centre of mass within it.
fn overlap(app: &App, character: Entity, bodies: &[(Entity, MedialAxis)]) -> (f32, usize) {
    let Some(pose) = app.world().get::<SkinPose>(character) else { return (0.0, 0) };
    let hulls: Vec<Hull> =
        (0..pose.shape().axis().primitives().len() as u32).map(|number| pose.shape().hull_at(number, 1.0)).collect();
    let bound = pose.shape().axis().bounding_sphere();
    let distance = |ball: Sphere| {
        let of = |hull: &Hull| match hull {
            Hull::Sphere(spheres) => separation(spheres, &[ball], 0).distance,
            Hull::Cone(spheres) => separation(spheres, &[ball], 0).distance,
            Hull::Slab(spheres) => separation(spheres, &[ball], 0).distance,
        };
        hulls.iter().map(of).fold(f32::INFINITY, f32::min)
    };
    let (mut deepest, mut inside) = (0.0f32, 0);
    for (body, axis) in bodies {
        let Some(place) = rigid(app, *body).map(|body| pose.frame().inv_mul(body.position())) else { continue };
        if place.translation.distance(bound.center) > bound.radius + axis.bounding_sphere().radius {
            continue;
        }
        let balls = axis.spheres().iter().map(|s| Sphere::new(place.transform_point(s.center), s.radius));
        deepest = balls.fold(deepest, |deepest, ball| deepest.max(-distance(ball)));
        // The centre of a ring is not a part of it.
        let has_center = axis.spheres().len() < 3;
        if has_center && distance(Sphere::new(place.translation, 0.0)) < 0.0 {
            inside += 1;
        }
    }
    (deepest, inside)
}
