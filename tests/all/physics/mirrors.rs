//! Shapes below mirrored transforms. An even number of mirrored axes is a rotation; with an odd number the collider is the mirror image of the shape.

use std::collections::HashSet;

use bevy::{math::Affine3A, prelude::*};
use bevy_medial::{geometry::Sphere, medial_axis::MedialAxis, plugin::MedialMesh, rapier::MedialShape};
use bevy_rapier3d::{
    plugin::context::{RapierContextColliders, RapierContextEntityLink},
    prelude::{Collider, GravityScale, RapierColliderHandle, RapierConfiguration, RigidBody, Velocity},
};

use crate::common::*;

/// A shape that no rotation and no mirror maps to itself.
fn hook() -> MedialAxis {
    let spheres = [[0.1, 0.0, 0.2, 0.05], [0.9, 0.3, 0.1, 0.1], [0.7, 0.9, -0.3, 0.15], [0.2, 0.4, 0.8, 0.02]];
    let spheres = spheres.map(|[x, y, z, radius]| Sphere::new(Vec3::new(x, y, z), radius));
    MedialAxis::from_lists(spheres.to_vec(), &[[0, 1], [1, 2], [1, 3]], &[]).unwrap().0
}

/// Largest distance of a sphere's centre in the collider from the same centre as it is drawn. `None` without a collider.
fn distance(app: &App, shape: Entity) -> Option<f32> {
    let world = app.world();
    let handle = world.get::<RapierColliderHandle>(shape)?.0;
    let context = world.get::<RapierContextEntityLink>(shape)?.0;
    let collider = &world.get::<RapierContextColliders>(context)?.colliders[handle];
    let medial = &collider.shape().as_shape::<MedialShape>()?.shape;
    let drawn = world.get::<GlobalTransform>(shape)?;
    let axis = hook();
    let distances = medial.axis.spheres().iter().zip(axis.spheres()).map(|(sphere, original)| {
        let center = *collider.position() * (sphere.center * medial.scale);
        center.distance(drawn.transform_point(original.center))
    });
    distances.reduce(f32::max)
}

/// Signs of a scale, for the numbers from 0 to 7.
fn signs(number: u8) -> Vec3 {
    Vec3::from_array([0, 1, 2].map(|axis| 1.0 - 2.0 * f32::from(number >> axis & 1)))
}

/// A chain of entities from the root to the shape. `at` is the position of the root, and `body` the number of the entity with the `RigidBody`.
fn spawn(app: &mut App, mesh: &MedialMesh, at: Vec3, scales: &[Vec3], body: Option<(usize, RigidBody)>) -> Entity {
    let mut above: Option<Entity> = None;
    for (number, &scale) in scales.iter().enumerate() {
        let place = if number == 0 { at } else { Vec3::new(2.0, -1.0, 3.0) };
        let rotation = Quat::from_euler(EulerRot::XYZ, 0.4 + number as f32, -0.8, 1.3);
        let mut entity = app.world_mut().spawn(Transform { translation: place, rotation, scale });
        if let Some((_, kind)) = body.filter(|(at, _)| *at == number) {
            entity.insert((kind, Velocity { linear: Vec3::new(1.0, 2.0, 0.0), angular: Vec3::new(3.0, -2.0, 1.0) }));
        }
        let id = entity.id();
        if let Some(above) = above {
            app.world_mut().entity_mut(above).add_child(id);
        }
        above = Some(id);
    }
    let shape = above.unwrap();
    app.world_mut().entity_mut(shape).insert(mesh.clone());
    shape
}

#[test]
fn a_collider_is_where_its_entity_is_drawn() {
    let mut app = app();
    let mesh = mesh(&mut app, hook());
    let mut cases = Vec::new();
    for kind in [None, Some(RigidBody::Fixed), Some(RigidBody::KinematicPositionBased), Some(RigidBody::Dynamic)] {
        for (entities, body) in [(1, 0), (2, 0), (2, 1), (3, 0), (3, 1)] {
            // All signs of the outer two entities.
            for number in 0..(if entities == 1 { 8 } else { 64 }) {
                let scales = [signs(number % 8) * 2.0, signs(number / 8) * 0.7, Vec3::new(-1.0, 1.0, -1.0)];
                let at = Vec3::new((cases.len() % 32) as f32, 0.0, (cases.len() / 32) as f32) * 20.0;
                let shape = spawn(&mut app, &mesh, at, &scales[..entities], kind.map(|kind| (body, kind)));
                let is_mirrored = scales[..entities].iter().map(|scale| scale.element_product()).product::<f32>() < 0.0;
                cases.push((shape, kind, is_mirrored, format!("{kind:?} at {body} of {:?}", &scales[..entities])));
            }
        }
    }
    let place = |app: &App, shape: Entity| app.world().get::<GlobalTransform>(shape).unwrap().affine();
    let changes = |a: Affine3A, b: Affine3A| {
        [Vec3::ZERO, Vec3::X, Vec3::Y].map(|point| a.transform_point3(point).distance(b.transform_point3(point)))
    };
    app.update();
    let before: Vec<Affine3A> = cases.iter().map(|(shape, ..)| place(&app, *shape)).collect();
    let mut reached = [0; 2];
    for step in 0..20 {
        app.update();
        for ((shape, kind, is_mirrored, name), before) in cases.iter().zip(&before) {
            reached[usize::from(*is_mirrored)] += 1;
            let found = distance(&app, *shape);
            assert!(found.is_some_and(|found| found < 1e-3), "step {step}, {name}: {found:?}");
            let moved = changes(*before, place(&app, *shape)).into_iter().fold(0.0, f32::max);
            match kind {
                Some(RigidBody::Dynamic) => assert!((step < 10 || moved > 0.1) && moved < 10.0, "{name}: {moved}"),
                _ => assert!(moved < 1e-3, "step {step}, {name}: {moved}"),
            }
        }
    }
    assert!(reached.iter().all(|count| *count > 10_000), "{reached:?}");
    let spheres = cases.iter().map(|(shape, ..)| {
        let collider = &app.world().get::<Collider>(*shape).unwrap().raw;
        collider.as_shape::<MedialShape>().unwrap().shape.axis.spheres().as_ptr()
    });
    assert_eq!(spheres.collect::<HashSet<_>>().len(), 2, "all colliders share the shape or its mirror image");
}

/// The corrected rotation is no change by the user, so a body falls asleep. A change by the user is one.
#[test]
fn a_body_below_a_mirrored_parent_rests_and_can_be_moved() {
    let turned = Vec3::new(1.0, 1.0, -1.0);
    for scales in
        [&[Vec3::new(1.0, -1.0, 1.0), turned][..], &[turned, Vec3::ONE], &[turned, turned, -Vec3::ONE, -Vec3::ONE]]
    {
        rests_and_can_be_moved(scales);
    }
}

fn rests_and_can_be_moved(scales: &[Vec3]) {
    let mut app = app();
    let mesh = mesh(&mut app, hook());
    let shape = spawn(&mut app, &mesh, Vec3::ZERO, scales, Some((scales.len() - 1, RigidBody::Dynamic)));
    app.world_mut().entity_mut(shape).insert((Velocity::default(), GravityScale(0.0)));
    run(&mut app, 200);
    assert!(is_at_rest(&mut app, shape), "{scales:?}");
    let before = position(&mut app, shape);
    for is_running in [false, true] {
        let mut worlds = app.world_mut().query::<&mut RapierConfiguration>();
        worlds.iter_mut(app.world_mut()).for_each(|mut rapier| rapier.physics_pipeline_active = is_running);
        run(&mut app, 3);
        assert!(position(&mut app, shape).distance(before) < 1e-4 && distance(&app, shape).unwrap() < 1e-4);
    }
    let parent = app.world().get::<ChildOf>(shape).unwrap().parent();
    for moved in [shape, parent] {
        let before = position(&mut app, shape);
        app.world_mut().get_mut::<Transform>(moved).unwrap().translation += Vec3::new(0.5, 0.2, 0.1);
        run(&mut app, 2);
        assert!(position(&mut app, shape).distance(before) > 0.4);
        assert!(distance(&app, shape).unwrap() < 1e-4);
    }
    app.world_mut().get_mut::<Transform>(shape).unwrap().rotate_local_x(1.0);
    run(&mut app, 2);
    assert!(distance(&app, shape).unwrap() < 1e-4);
}
