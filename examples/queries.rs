//! Queries on medial bodies: ray cast, nearest point, bodies in a box, shape cast, and the first impact of a moving body. Bodies are also picked with the
//! mouse.
//!
//! ```text
//! cargo run --release --example queries
//! ```

mod common;

use bevy::prelude::*;
use bevy_medial::{plugin::MedialPickingPlugin, prelude::*};
use bevy_rapier3d::{
    parry::{query::ShapeCastOptions, shape::Ball, shape::Cuboid},
    prelude::{QueryFilter, ReadRapierContext, RigidBody},
};
use common::stage::Stage;

fn main() -> AppExit {
    App::new()
        .add_plugins((Stage { steps: 60 }, MedialPhysicsPlugins::default(), MedialPickingPlugin))
        .add_systems(Startup, setup)
        .add_systems(Last, ask_once.run_if(|step: Res<MedialStep>| step.input.bodies.len() == 2))
        .run()
}

fn setup(mut commands: Commands, assets: Res<AssetServer>) {
    commands.spawn((Name::new("ground"), StaticObb::new(10.0, 0.5, 10.0), Transform::from_xyz(0.0, -0.5, 0.0)));
    for (name, x) in [("bear", -1.0), ("deer", 1.0)] {
        commands
            .spawn((
                Name::new(name),
                RigidBody::Dynamic,
                MedialMesh(assets.load(format!("models/{name}.medial"))),
                Transform::from_xyz(x, 1.0, 0.0),
            ))
            // The event contains the point that was hit, in world coordinates.
            .observe(move |click: On<Pointer<Click>>| println!("{name} was clicked at {:?}", click.hit.position));
    }
}

fn ask_once(
    rapier: ReadRapierContext,
    names: Query<&Name>,
    bodies: Query<Entity, With<MedialMesh>>,
    mut asked: Local<bool>,
) -> Result {
    if std::mem::replace(&mut *asked, true) {
        return Ok(());
    }
    let name = |entity: Entity| names.get(entity).map_or("an entity without a name", Name::as_str);
    // All filters of rapier are supported: groups, predicates, excluded entities.
    let filter = QueryFilter::only_dynamic();
    let rapier = rapier.single()?;
    rapier.with_medial_queries(filter, |queries| {
        let origin = Vec3::new(-5.0, 1.0, 0.0);
        match queries.cast_ray_and_get_normal(origin, Vec3::X, 10.0, true) {
            Some((entity, hit)) => {
                println!("the ray hits {} at {:.2}, normal {:.2}", name(entity), hit.point, hit.normal)
            }
            None => println!("the ray hits nothing"),
        }
        if let Some((entity, nearest)) = queries.project_point(Vec3::new(0.5, 3.0, 0.0), 10.0, true) {
            println!("the nearest body to the point is {}, at {:.2}", name(entity), nearest.point);
        }
        let half = Cuboid::new(Vec3::splat(0.5));
        let inside: Vec<&str> =
            queries.intersect_shape(Vec3::new(1.0, 1.0, 0.0), Quat::IDENTITY, &half).map(name).collect();
        println!("in the box: {inside:?}");
        let options = ShapeCastOptions::with_max_time_of_impact(10.0);
        if let Some((entity, hit)) = queries.cast_shape(origin, Quat::IDENTITY, Vec3::X, &Ball::new(0.2), options) {
            println!("a ball of 20 cm goes {:.2} m until it hits {}", hit.time_of_impact, name(entity));
        }
    });
    // Impacts are predicted for the current linear and angular velocities of all bodies.
    let within = 5.0;
    for body in &bodies {
        if let Some((entity, impact)) = rapier.first_impact(body, within, QueryFilter::default()) {
            println!("{} would hit {} in {:.2} s", name(body), name(entity), within * impact.fraction);
        }
    }
    Ok(())
}
