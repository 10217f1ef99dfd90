//! Medial bodies against every standard collider of rapier: contact, distance, rest.

use bevy::prelude::*;
use bevy_medial::{medial_axis::MedialAxis, prelude::*, scenes::headless_app};
use bevy_rapier3d::{parry::shape::SharedShape, prelude::*};

/// Every kind of collider whose top is a horizontal plane, a ridge or a dome at height 0, wide enough to rest on.
fn colliders() -> Vec<(&'static str, Collider, f32)> {
    let flat = [[-2.0, 0.0, -2.0], [2.0, 0.0, -2.0], [2.0, 0.0, 2.0], [-2.0, 0.0, 2.0]].map(Vec3::from);
    let box_corners: Vec<Vec3> = (0..8)
        .map(|i| {
            Vec3::new(
                if i & 1 == 0 { -2.0 } else { 2.0 },
                if i & 2 == 0 { -1.0 } else { 0.0 },
                if i & 4 == 0 { -2.0 } else { 2.0 },
            )
        })
        .collect();
    let mesh = Collider::trimesh(flat.to_vec(), vec![[0, 2, 1], [0, 3, 2]]).expect("two triangles are a mesh");
    let shape = |shape: SharedShape| Collider::from(shape);
    vec![
        ("cuboid", Collider::cuboid(2.0, 0.5, 2.0), 0.5),
        ("half-space", Collider::halfspace(Vec3::Y).expect("a unit normal"), 0.0),
        ("cylinder", Collider::cylinder(0.5, 2.0), 0.5),
        ("convex hull", Collider::convex_hull(&box_corners).expect("eight corners have a hull"), 0.0),
        ("triangle mesh", mesh, 0.0),
        (
            "triangle",
            Collider::triangle(Vec3::new(-4.0, 0.0, -3.0), Vec3::new(0.0, 0.0, 6.0), Vec3::new(4.0, 0.0, -3.0)),
            0.0,
        ),
        ("height field", Collider::heightfield(vec![0.0; 25], 5, 5, Vec3::new(4.0, 1.0, 4.0)), 0.0),
        ("voxels", Collider::voxels(Vec3::splat(0.5), &voxel_plate()), 0.5),
        (
            "compound",
            Collider::compound(vec![
                (Vec3::new(-1.0, -0.5, 0.0), Quat::IDENTITY, Collider::cuboid(1.0, 0.5, 2.0)),
                (Vec3::new(1.0, -0.5, 0.0), Quat::IDENTITY, Collider::cuboid(1.0, 0.5, 2.0)),
            ]),
            0.0,
        ),
        ("round cuboid", Collider::round_cuboid(1.9, 0.4, 1.9, 0.1), 0.5),
        ("round cylinder", Collider::round_cylinder(0.4, 1.9, 0.1), 0.5),
        (
            "round triangle",
            shape(SharedShape::round_triangle(
                Vec3::new(-4.0, 0.0, -3.0),
                Vec3::new(0.0, 0.0, 6.0),
                Vec3::new(4.0, 0.0, -3.0),
                0.1,
            )),
            0.1,
        ),
    ]
}

/// A plate of voxels whose lowest corner is a multiple of the voxel's size.
fn voxel_plate() -> Vec<IVec3> {
    (-4..4).flat_map(|x| (-4..4).map(move |z| IVec3::new(x, 0, z))).collect()
}

#[test]
fn rests_on_every_flat_collider() {
    let radius = 0.1;
    for (name, collider, top) in colliders() {
        for medial_first in [false, true] {
            let mut app = headless_app(1.0 / 60.0);
            let capsule = MedialAxis::capsule(Vec3::X * -0.3, Vec3::X * 0.3, radius).expect("a capsule");
            let mesh = MedialMesh(app.world_mut().resource_mut::<Assets<MedialAxis>>().add(capsule));
            let spawn_ground = |app: &mut App| {
                app.world_mut().spawn((collider.clone(), Transform::from_xyz(0.0, -top, 0.0)));
            };
            if !medial_first {
                spawn_ground(&mut app);
            }
            let body = app.world_mut().spawn((RigidBody::Dynamic, mesh, Transform::from_xyz(0.05, 0.4, 0.1))).id();
            if medial_first {
                spawn_ground(&mut app);
            }
            (0..240).for_each(|_| app.update());
            let transform = app.world().get::<Transform>(body).expect("the body is there");
            let height = transform.translation.y;
            assert!((height - radius).abs() < 0.003, "{name}: the middle rests at {height} instead of {radius}");
            let velocity = app
                .world_mut()
                .query::<&RapierRigidBodySet>()
                .single(app.world())
                .expect("one context")
                .bodies
                .iter()
                .find(|(_, b)| b.is_dynamic())
                .map(|(_, b)| (b.linvel().length(), b.is_sleeping()));
            assert!(velocity.is_some_and(|(speed, _)| speed < 0.02), "{name}: {velocity:?}");
        }
    }
}

#[test]
fn fast_bodies_of_rapier_stop_at_a_medial_wall() {
    let plate = || MedialAxis::rounded_box(Vec3::new(0.05, 2.0, 2.0), 0.05).expect("a plate");
    for (name, collider) in [
        ("ball", Collider::ball(0.1)),
        ("cuboid", Collider::cuboid(0.1, 0.05, 0.2)),
        ("capsule", Collider::capsule_y(0.2, 0.05)),
        ("convex hull", Collider::round_cylinder(0.1, 0.05, 0.02)),
    ] {
        for (speed, spin) in [(30.0, 0.0), (200.0, 0.0), (200.0, 40.0)] {
            let mut app = headless_app(1.0 / 60.0);
            let mesh = MedialMesh(app.world_mut().resource_mut::<Assets<MedialAxis>>().add(plate()));
            app.world_mut().spawn((mesh, StaticObb::default(), RigidBody::Fixed, Transform::from_xyz(4.0, 0.0, 0.0)));
            let velocity = Velocity { linear: Vec3::X * speed, angular: Vec3::new(0.3, 0.5, 0.8) * spin };
            let body = (RigidBody::Dynamic, collider.clone(), velocity, GravityScale(0.0), Transform::default());
            let body = app.world_mut().spawn(body).id();
            (0..60).for_each(|_| app.update());
            let x = app.world().get::<Transform>(body).expect("the body is there").translation.x;
            assert!(x < 4.0, "{name} at {speed} m/s, {spin} rad/s ends at {x}, behind the wall");
        }
    }
}
