//! Shapes of the meshes in glTF scenes that Bevy spawns.

use std::{
    collections::HashSet,
    fs,
    ops::ControlFlow,
    path::{Path, PathBuf},
    time::Duration,
};

use bevy::{
    gltf::{GltfAssetLabel, GltfPlugin},
    image::ImagePlugin,
    mesh::{Mesh, Mesh3d},
    prelude::*,
    world_serialization::WorldSerializationPlugin,
};
use bevy_medial::{
    builder::{FitOptions, NodeBody, fit, load},
    geometry::Aabb,
    prelude::*,
    rapier::MedialShape,
};
use bevy_rapier3d::prelude::{Collider, RapierConfiguration, RigidBody};
use yard::{MOVING, STILL, register, yard};

use crate::{common::*, log};

#[path = "../../../examples/gltf_scene/yard.rs"]
mod yard;

/// Few spheres, so that tests take little time.
fn few() -> FitOptions {
    FitOptions { spheres: Some(24), searches: Some(1), ..default() }
}

/// A folder with `yard.glb`.
fn folder(name: &str) -> PathBuf {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).unwrap();
    let animal = load::load(&assets().join("models/deer.obj")).unwrap();
    fs::write(folder.join("yard.glb"), yard(&animal)).unwrap();
    folder
}

/// An app with the scene of a file, when all nodes have their shapes. The simulation is stopped.
fn app(folder: &Path, scene: MedialScene) -> App {
    let gltf = (ImagePlugin::default(), WorldSerializationPlugin, GltfPlugin::default());
    let mut app = app_with((MedialPhysicsPlugins::default(), MedialBuildPlugin::default(), gltf), folder);
    register(&mut app);
    app.update();
    set_active(&mut app, false);
    let file = app.world().resource::<AssetServer>().load(GltfAssetLabel::Scene(0).from_asset("yard.glb"));
    // A scene may be turned and scaled as a whole.
    let place =
        Transform::from_xyz(3.0, 1.0, -2.0).with_rotation(Quat::from_rotation_y(0.4)).with_scale(Vec3::splat(1.5));
    app.world_mut().spawn((WorldAssetRoot(file), scene, place));
    for _ in 0..60_000 {
        app.update();
        if app.world_mut().query::<&Collider>().iter(app.world()).count() == STILL.len() + MOVING.len() {
            return app;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    panic!("the scene has no shapes");
}

fn set_active(app: &mut App, active: bool) {
    let mut worlds = app.world_mut().query::<&mut RapierConfiguration>();
    worlds.iter_mut(app.world_mut()).for_each(|mut world| world.physics_pipeline_active = active);
}

/// The entity with the shape of a node.
fn shape_of(app: &mut App, name: &str) -> Entity {
    let mut shapes = app.world_mut().query_filtered::<(Entity, &Name), With<MedialMesh>>();
    let found = shapes.iter(app.world()).find(|(_, other)| other.as_str() == name);
    found.unwrap_or_else(|| panic!("{name} has no shape")).0
}

/// The box around what is drawn for a node, and the box around its collider.
fn boxes(app: &mut App, name: &str) -> [Aabb; 2] {
    let shape = shape_of(app, name);
    let node = app.world().get::<ChildOf>(shape).unwrap().parent();
    let mut drawn = Aabb::EMPTY;
    for part in app.world().get::<Children>(node).unwrap().iter().filter(|part| *part != shape) {
        let Some(mesh) = app.world().get::<Mesh3d>(part) else { continue };
        let mesh = app.world().resource::<Assets<Mesh>>().get(&mesh.0).unwrap();
        let place = app.world().get::<GlobalTransform>(part).unwrap();
        for point in mesh.attribute(Mesh::ATTRIBUTE_POSITION).unwrap().as_float3().unwrap() {
            let point = place.transform_point(Vec3::from(*point));
            drawn = drawn.merge(Aabb { min: point, max: point });
        }
    }
    let collider = app.world().get::<Collider>(shape).unwrap();
    let place = app.world().get::<GlobalTransform>(shape).unwrap();
    let (_, rotation, translation) = place.to_scale_rotation_translation();
    let medial = &collider.raw.as_shape::<MedialShape>().unwrap().shape;
    let balls = medial.axis.spheres().iter().map(|sphere| {
        let (center, radius) = (translation + rotation * (medial.scale * sphere.center), medial.scale * sphere.radius);
        Aabb { min: center - radius, max: center + radius }
    });
    [drawn, balls.fold(Aabb::EMPTY, Aabb::merge)]
}

/// Asserts that colliders are where the nodes are drawn.
fn check_places(app: &mut App) {
    for name in STILL.iter().chain(&MOVING) {
        let [drawn, collider] = boxes(app, name);
        let off = (drawn.min - collider.min).abs().max((drawn.max - collider.max).abs()).max_element();
        let size = drawn.min.distance(drawn.max);
        assert!(off < 0.02 * size, "{name}: {drawn:?} {collider:?}");
    }
}

#[test]
fn everything_in_a_scene_collides() {
    let mut app = app(&folder("physics-gltf"), MedialScene { options: few(), ..default() });
    check_places(&mut app);
    for (names, body) in [(&MOVING[..], RigidBody::Dynamic), (&STILL, RigidBody::Fixed)] {
        for name in names {
            let shape = shape_of(&mut app, name);
            let node = app.world().get::<ChildOf>(shape).unwrap().parent();
            assert_eq!(app.world().get::<RigidBody>(node), Some(&body), "{name}");
            let budget = app.world().get::<MedialBudget>(shape);
            assert_eq!(budget.is_some(), name.starts_with("crate"), "{name}");
        }
    }
    let mut shapes = app.world_mut().query::<&MedialMesh>();
    assert_eq!(shapes.iter(app.world()).count(), MOVING.len() + STILL.len(), "the lawn has no shape");
    // The box in three proportions, the crate in two, the ball and the animal.
    let distinct: HashSet<_> = shapes.iter(app.world()).map(|mesh| mesh.0.id()).collect();
    assert_eq!(distinct.len(), 7);
    set_active(&mut app, true);
    run(&mut app, 400);
    check_places(&mut app);
    for name in MOVING {
        let shape = shape_of(&mut app, name);
        let at = app.world().get::<GlobalTransform>(shape).unwrap().translation();
        // The top of the ground is at 1 m.
        assert!(at.y > 0.99 && at.y < 3.0 && at.with_y(0.0).distance(Vec3::new(3.0, 0.0, -2.0)) < 10.0, "{name}: {at}");
    }
}

#[test]
fn shapes_of_a_scene_come_from_files() {
    let folder = folder("physics-gltf-files");
    fs::create_dir_all(folder.join("baked")).unwrap();
    for node in load::read_nodes(&folder.join("yard.glb")).unwrap() {
        if node.mark.body == Some(NodeBody::NoShape) || folder.join(format!("baked/{}.medial", node.file)).exists() {
            continue;
        }
        let levels = fit(&node.triangles.unwrap(), &few(), &|_| ControlFlow::Continue(())).unwrap();
        levels.save(&folder.join(format!("baked/{}.medial", node.file))).unwrap();
    }
    assert_eq!(fs::read_dir(folder.join("baked")).unwrap().count(), 7);
    let mut app = app(&folder, MedialScene { folder: Some("baked".into()), ..default() });
    check_places(&mut app);
    assert!(app.world_mut().query::<&BuildMedialMesh>().iter(app.world()).next().is_none());
}

#[test]
fn rules_precede_marks_and_failures_name_the_node() {
    log::keep();
    let mut app = app_with((MedialPhysicsPlugins::default(), MedialBuildPlugin::default()), &assets());
    let mesh = app.world_mut().resource_mut::<Assets<Mesh>>().add(Cuboid::from_length(1.0));
    let sheet = app.world_mut().resource_mut::<Assets<Mesh>>().add(Plane3d::default().mesh().build());
    let nodes = vec![("part*".into(), NodeBody::Part), ("*-medial".into(), NodeBody::Kinematic)];
    let scene = app.world_mut().spawn((MedialScene { nodes, ..default() }, Transform::default())).id();
    let mut spawn = |name: &str, mesh: &Handle<Mesh>, place: Transform, parent: Entity| {
        app.world_mut().spawn((Name::new(name.to_owned()), Mesh3d(mesh.clone()), place, ChildOf(parent))).id()
    };
    let stretched = spawn("stretched node", &mesh, Transform::from_scale(Vec3::new(1.0, 3.0, 1.0)), scene);
    spawn("sheared node", &mesh, Transform::from_rotation(Quat::from_rotation_x(0.7)), stretched);
    spawn("sheet node", &sheet, Transform::default(), scene);
    let part = spawn("part of it", &mesh, Transform::from_xyz(5.0, 0.0, 0.0), scene);
    let moved = spawn("lift-medial", &mesh, Transform::from_xyz(9.0, 0.0, 0.0), scene);
    for _ in 0..20_000 {
        app.update();
        if !log::lines("sheet node").is_empty() && app.world_mut().query::<&Collider>().iter(app.world()).count() == 3 {
            break;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    assert_eq!(app.world_mut().query::<&Collider>().iter(app.world()).count(), 3);
    let sheared = log::lines("sheared node");
    assert_eq!(sheared.len(), 1, "{sheared:?}");
    assert!(sheared[0].contains("shears it"), "{sheared:?}");
    let sheet = log::lines("sheet node");
    assert!(sheet.len() == 1 && sheet[0].contains("encloses no volume"), "{sheet:?}");
    let body = |entity| app.world().get::<RigidBody>(entity);
    assert_eq!(
        [body(part), body(moved), body(stretched)],
        [None, Some(&RigidBody::KinematicPositionBased), Some(&RigidBody::Fixed)]
    );
}
