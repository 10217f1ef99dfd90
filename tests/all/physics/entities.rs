//! Entities with `(RigidBody, MedialMesh, Transform)`: colliders appear with the asset, follow the scale, and disappear with the entity.

use std::{fs, path::PathBuf, time::Duration};

use bevy::{
    asset::{
        AssetServer, EphemeralHandleBehavior, HandleDeserializeProcessor, HandleSerializeProcessor, LoadState,
        ReflectAsset,
    },
    ecs::reflect::{ReflectComponent, ReflectResource},
    prelude::*,
    reflect::{
        PartialReflect, ReflectFromReflect, TypeRegistration, TypeRegistry,
        serde::{TypedReflectDeserializer, TypedReflectSerializer},
    },
    time::Fixed,
};
use bevy_medial::{
    builder::{FitOptions, SideLimits},
    medial_axis::MedialAxis,
    plugin::{MedialGizmos, MedialPickingCamera},
    prelude::*,
    scenes::{Bullet, Projectile, SceneEntity, add_monitor},
};
use bevy_rapier3d::prelude::{Collider, ColliderMassProperties, RapierConfiguration, RigidBody};
use serde::de::DeserializeSeed;

use crate::common::*;

/// Height of the model `torus` that lies flat on a floor: the radius of its tube.
const TUBE: f32 = 0.0525;

fn load(app: &App, path: &'static str) -> MedialMesh {
    MedialMesh(app.world().resource::<AssetServer>().load(path))
}

fn has_collider(app: &App, entity: Entity) -> bool {
    app.world().get::<Collider>(entity).is_some()
}

#[test]
fn a_file_gives_collider_mass_and_inertia() {
    let mut app = app_with(MedialPhysicsPlugins::default(), &assets());
    app.world_mut().query::<&mut RapierConfiguration>();
    for (path, name, density) in
        [("models/dinosaur.ma", "dinosaur", 1.0), ("models/bear.ma", "bear", 1.0), ("models/deer.ma", "deer", 700.0)]
    {
        let mesh = load(&app, path);
        let body = app.world_mut().spawn((RigidBody::Dynamic, mesh.clone(), Transform::default())).id();
        if density != 1.0 {
            app.world_mut().entity_mut(body).insert(ColliderMassProperties::Density(density));
        }
        assert!(matches!(wait(&mut app, &mesh), LoadState::Loaded), "{path}");
        assert!(has_collider(&app, body), "{path}");
        app.update();
        let expected = *model(name).mass();
        let properties = rigid(&mut app, body).mass_properties().local_mprops;
        let mass = expected.volume * density;
        assert!((properties.mass() / mass - 1.0).abs() < 1e-5, "{path}: {} {mass}", properties.mass());
        assert!(properties.local_com.distance(expected.center_of_mass) < 1e-6, "{path}");
        let inertia = Mat3::from_cols_array(&properties.reconstruct_inertia_matrix().to_cols_array());
        let error = inertia - expected.inertia * density;
        let size = expected.inertia.col(0).length() * density;
        assert!(error.to_cols_array().iter().all(|e| e.abs() < 1e-4 * size), "{path}: {inertia} {}", expected.inertia);
    }
}

#[test]
fn a_body_does_not_fall_before_its_shape_has_loaded() {
    let mut app = app();
    let handle = app.world().resource::<Assets<MedialAxis>>().reserve_handle();
    let start = Transform::from_xyz(0.3, 1.0, -0.2);
    let body = app.world_mut().spawn((RigidBody::Dynamic, MedialMesh(handle.clone()), start)).id();
    spawn_ground(&mut app);
    // Longer than rapier needs to put the body to sleep.
    run(&mut app, 200);
    assert_eq!(*app.world().get::<Transform>(body).unwrap(), start);
    assert!(!has_collider(&app, body));
    app.world_mut().resource_mut::<Assets<MedialAxis>>().insert(&handle, model("torus")).unwrap();
    run(&mut app, 20);
    assert!(position(&mut app, body).y < 0.8, "the body does not fall");
    run(&mut app, 400);
    assert!((position(&mut app, body).y - TUBE).abs() < 2e-3 && is_at_rest(&mut app, body));
}

#[test]
fn missing_and_broken_files_do_not_affect_other_bodies() {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("physics-broken-files");
    fs::create_dir_all(&folder).unwrap();
    fs::copy(assets().join("models/torus.ma"), folder.join("good.ma")).unwrap();
    fs::write(folder.join("text.ma"), "this is no mesh\n").unwrap();
    fs::write(folder.join("short.ma"), "2 1 0\nv 0 0 0 1\n").unwrap();
    fs::write(folder.join("empty.ma"), "").unwrap();
    fs::write(folder.join("negative.ma"), "1 0 0\nv 0 0 0 -1\n").unwrap();
    let mut app = app_with(MedialPhysicsPlugins::default(), &folder);
    spawn_ground(&mut app);
    let mut bad = Vec::new();
    for (x, path) in (2..).zip(["missing.ma", "text.ma", "short.ma", "empty.ma", "negative.ma"]) {
        let mesh = load(&app, path);
        let at = Transform::from_xyz(x as f32, 1.0, 0.0);
        bad.push(app.world_mut().spawn((RigidBody::Dynamic, mesh.clone(), at)).id());
        assert!(matches!(wait(&mut app, &mesh), LoadState::Failed(_)), "{path}");
    }
    let mesh = load(&app, "good.ma");
    let good = app.world_mut().spawn((RigidBody::Dynamic, mesh.clone(), Transform::from_xyz(0.0, 1.0, 0.0))).id();
    assert!(matches!(wait(&mut app, &mesh), LoadState::Loaded));
    run(&mut app, 400);
    assert!(bad.iter().all(|&entity| !has_collider(&app, entity)));
    assert!((position(&mut app, good).y - TUBE).abs() < 2e-3 && is_at_rest(&mut app, good));
    // A valid shape replaces a broken one.
    let mesh = self::mesh(&mut app, model("torus"));
    app.world_mut().entity_mut(bad[0]).insert(mesh);
    run(&mut app, 400);
    assert!((position(&mut app, bad[0]).y - TUBE).abs() < 2e-3, "{}", position(&mut app, bad[0]));
}

#[test]
fn height_and_mass_of_a_body_follow_its_scale() {
    let mut app = app();
    spawn_ground(&mut app);
    let bodies = [1.0, 2.0].map(|scale| {
        let at = Transform::from_xyz(3.0 * scale, 0.5, 0.0).with_scale(Vec3::splat(scale));
        spawn_body(&mut app, model("torus"), at)
    });
    run(&mut app, 400);
    let [small, large] = bodies.map(|body| (position(&mut app, body).y, rigid(&mut app, body).mass()));
    assert!((small.0 - TUBE).abs() < 2e-3 && (large.0 - 2.0 * TUBE).abs() < 2e-3, "{small:?} {large:?}");
    assert!((large.1 / small.1 - 8.0).abs() < 1e-4, "{small:?} {large:?}");
    assert!(bodies.into_iter().all(|body| is_at_rest(&mut app, body)));
}

#[test]
fn the_collider_follows_a_change_of_scale() {
    let mut app = app();
    spawn_ground(&mut app);
    let body = spawn_body(&mut app, model("torus"), Transform::from_xyz(0.0, 0.5, 0.0));
    run(&mut app, 400);
    let mass = rigid(&mut app, body).mass();
    // The body is asleep. A larger one is inside the ground and must wake up and get out; a smaller one hangs in the air and must fall.
    for scale in [2.0, 0.5, 1.0] {
        assert!(is_at_rest(&mut app, body));
        app.world_mut().get_mut::<Transform>(body).unwrap().scale = Vec3::splat(scale);
        run(&mut app, 600);
        let height = position(&mut app, body).y;
        assert!((height - TUBE * scale).abs() < 2e-3, "{scale}: {height}");
        let ratio = rigid(&mut app, body).mass() / mass;
        assert!((ratio / scale.powi(3) - 1.0).abs() < 1e-4, "{scale}: {ratio}");
    }
}

#[test]
fn a_body_of_uneven_scale_has_no_collider() {
    let mut app = app();
    spawn_ground(&mut app);
    let uneven = [Vec3::new(1.0, 2.0, 1.0), Vec3::new(1.0, 1.0, 3.0), Vec3::ZERO, Vec3::new(-1.0, 1.0, 2.0)];
    let bad =
        uneven.map(|scale| spawn_body(&mut app, model("torus"), Transform::from_xyz(2.0, 0.5, 0.0).with_scale(scale)));
    let good = spawn_body(&mut app, model("torus"), Transform::from_xyz(0.0, 0.5, 0.0));
    run(&mut app, 400);
    assert!(bad.iter().all(|&body| !has_collider(&app, body)));
    assert!(has_collider(&app, good) && is_at_rest(&mut app, good));
    // The first bad body gets a valid scale, and the good one an uneven scale.
    app.world_mut().get_mut::<Transform>(bad[0]).unwrap().scale = Vec3::ONE;
    app.world_mut().get_mut::<Transform>(good).unwrap().scale = uneven[0];
    run(&mut app, 400);
    assert!(has_collider(&app, bad[0]) && is_at_rest(&mut app, bad[0]));
    assert!((position(&mut app, bad[0]).y - TUBE).abs() < 2e-3);
    assert!(!has_collider(&app, good));
}

#[test]
fn a_despawned_body_no_longer_supports_others() {
    let mut app = app();
    let ground = spawn_ground(&mut app);
    let flat = MedialAxis::rounded_box(Vec3::new(0.5, 0.1, 0.5), 0.05).unwrap();
    let lower = spawn_body(&mut app, flat.clone(), Transform::from_xyz(0.0, 0.101, 0.0));
    let upper = spawn_body(&mut app, flat, Transform::from_xyz(0.0, 0.302, 0.0));
    let mut record = Record::default();
    record.run(&mut app, 300);
    assert!(is_at_rest(&mut app, upper) && (position(&mut app, upper).y - 0.3).abs() < 4e-3);
    app.world_mut().despawn(lower);
    record.run(&mut app, 300);
    assert!((position(&mut app, upper).y - 0.1).abs() < 2e-3, "{}", position(&mut app, upper));
    assert_eq!(record.counts(lower, upper), [1, 1]);
    assert_eq!(record.counts(lower, ground), [1, 1]);
    app.world_mut().despawn(ground);
    record.run(&mut app, 60);
    assert!(position(&mut app, upper).y < -3.0);
    assert_eq!(record.counts(upper, ground), [1, 1]);
    app.world_mut().despawn(upper);
    record.run(&mut app, 3);
}

#[test]
fn a_body_falls_and_rests_in_the_fixed_schedule() {
    for rate in [60.0f64, 144.0] {
        let mut app = app_with(MedialPhysicsPlugins::default().in_fixed_schedule(), &assets());
        app.insert_resource(Time::<Fixed>::from_hz(60.0));
        app.insert_resource(bevy::time::TimeUpdateStrategy::ManualDuration(Duration::from_secs_f64(1.0 / rate)));
        let ground = spawn_ground(&mut app);
        let body = spawn_body(&mut app, model("torus"), Transform::from_xyz(0.0, 1.0, 0.0));
        let mut record = Record::default();
        record.run(&mut app, (6.0 * rate) as u32);
        let height = app.world().get::<Transform>(body).unwrap().translation.y;
        assert!((height - TUBE).abs() < 2e-3 && is_at_rest(&mut app, body), "{rate}: {height}");
        assert_eq!(record.counts(body, ground), [1, 0], "{rate}");
    }
}

/// Writes a value as text and reads it back, as for saved worlds: handles are saved as the paths of their files.
fn through_text(
    value: &dyn PartialReflect,
    registration: &TypeRegistration,
    registry: &TypeRegistry,
    assets: &AssetServer,
) -> Box<dyn PartialReflect> {
    let write = HandleSerializeProcessor { ephemeral_handle_behavior: EphemeralHandleBehavior::Error };
    let text = serde_json::to_string(&TypedReflectSerializer::with_processor(value, registry, &write)).unwrap();
    let mut load_from_path = assets.clone();
    let mut read = HandleDeserializeProcessor { load_from_path: &mut load_from_path };
    let seed = TypedReflectDeserializer::with_processor(registration, registry, &mut read);
    seed.deserialize(&mut serde_json::Deserializer::from_str(&text)).unwrap()
}

#[test]
fn components_and_resources_survive_a_round_trip_as_text() {
    let plugins = (
        MedialPhysicsPlugins::default(),
        MedialBuildPlugin::default(),
        MedialDebugPlugin::default(),
        MedialPickingPlugin,
    );
    let mut app = app_with(plugins, &assets());
    add_monitor(&mut app);
    let mesh = load(&app, "models/bear.medial");
    let options = FitOptions {
        spheres: Some(7),
        max_error: Some(0.5),
        error_limit: 5.0,
        sides: SideLimits { inside: Some(1.0), enclose: None },
        levels: true,
        searches: Some(2),
        seed: 9,
    };
    let skinned = SkinnedMedialMesh {
        interval: 3,
        regions: [("head".into(), "critical".into())].into(),
        ..SkinnedMedialMesh::new(mesh.0.clone())
    };
    let world = app.world_mut();
    let original = world
        .spawn((
            (mesh, skinned, StaticObb::new(1.0, 2.0, 3.0), MedialCcd::DISABLED, MedialBudget::Metres(0.25)),
            (MedialLevel(3), MedialImportance(2.0), MedialFocus::default(), BuildMedialMesh(options)),
            (MedialBuildStatus::Building(0.5), MedialGizmo { enabled: false, color: Some(Color::WHITE) }),
            (MedialPickingCamera, SceneEntity, Projectile, Bullet),
            MedialScene { body: NodeBody::Dynamic, ..default() },
        ))
        .id();
    let copy = world.spawn_empty().id();
    *world.resource_mut::<MedialSettings>() = MedialSettings {
        stop_at_impact: false,
        core_depth: 0.5,
        brute_force: true,
        recycle_contacts: false,
        backend: MedialBackend::Cpu,
        pipelined: true,
    };

    let registry = world.resource::<AppTypeRegistry>().clone();
    let registry = registry.read();
    let assets = world.resource::<AssetServer>().clone();
    let [mut components, mut resources] = [Vec::new(), Vec::new()];
    for registration in registry.iter().filter(|r| r.type_info().type_path().starts_with("bevy_medial::")) {
        let Some(component) = registration.data::<ReflectComponent>() else { continue };
        let name = registration.type_info().type_path_table().short_path();
        let is_resource = registration.contains::<ReflectResource>();
        // Each resource is a component of its own entity.
        let entities: Vec<Entity> = world.query::<Entity>().query(world).iter().collect();
        let holder = entities.into_iter().find(|&entity| component.contains(world.entity(entity)));
        let holder = holder.unwrap_or_else(|| panic!("no entity has {name}"));
        assert!(is_resource || holder == original, "{name}");
        let value = component.reflect(world.entity(holder)).unwrap();
        let read = through_text(value.as_partial_reflect(), registration, &registry, &assets);
        let read = registration.data::<ReflectFromReflect>().unwrap().from_reflect(&*read).expect(name);
        assert_eq!(read.reflect_partial_eq(value.as_partial_reflect()), Some(true), "{name}: {read:?} {value:?}");
        if is_resource {
            resources.push(name);
            continue;
        }
        components.push(name);
        component.insert(&mut world.entity_mut(copy), read.as_partial_reflect(), &registry);
        let [value, copied] = [original, copy].map(|entity| component.reflect(world.entity(entity)).unwrap());
        assert_eq!(copied.reflect_partial_eq(value.as_partial_reflect()), Some(true), "{name}");
    }
    components.sort();
    resources.sort();
    let expected = [
        "BuildMedialMesh",
        "Bullet",
        "MedialBudget",
        "MedialBuildStatus",
        "MedialCcd",
        "MedialFocus",
        "MedialGizmo",
        "MedialImportance",
        "MedialLevel",
        "MedialMesh",
        "MedialPickingCamera",
        "MedialScene",
        "Projectile",
        "SceneEntity",
        "SkinnedMedialMesh",
        "StaticObb",
    ];
    assert_eq!(components, expected);
    let expected =
        ["ContactTable", "GpuCapacity", "MedialPickingSettings", "MedialSettings", "MedialStep", "Monitor", "OwedTime"];
    assert_eq!(resources, expected);
    assert!(registry.get_type_data::<ReflectAsset>(std::any::TypeId::of::<MedialAxis>()).is_some());
}

#[test]
fn messages_and_layers_survive_a_round_trip_as_text() {
    let touch = TouchPoint {
        fraction: 0.5,
        point: Vec3::X,
        normal: Vec3::Y,
        separation: -0.25,
        approach_speed: 3.0,
        primitive1: 4,
        primitive2: 5,
        joint1: None,
        joint2: None,
    };
    let [entity1, entity2] = [7, 8].map(Entity::from_raw_u32).map(Option::unwrap);
    let (body1, body2) = (Some(entity1), None);
    let started = MedialContactStarted { entity1, entity2, body1, body2, touch, sensor: true };
    let ended = MedialContactEnded { entity1, entity2, body1, body2 };
    let mut layers = MedialGizmos { normal_length: 0.125, color_by_level: true, ..default() };
    layers.contacts.color = Color::WHITE;
    let text = serde_json::to_string(&(started, ended, &layers)).unwrap();
    let read: (MedialContactStarted, MedialContactEnded, MedialGizmos) = serde_json::from_str(&text).unwrap();
    assert_eq!(read, (started, ended, layers));
}
