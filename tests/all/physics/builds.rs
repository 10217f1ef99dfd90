//! Medial meshes built from Bevy's meshes while the app runs.

use std::{fs, path::PathBuf, time::Duration};

use bevy::{
    asset::RenderAssetUsages,
    mesh::{Mesh, Mesh3d, PrimitiveTopology},
    prelude::*,
};
use bevy_medial::{
    builder::{FitOptions, Level, MedialLevels, TwoSidedError},
    medial_axis::MedialAxis,
    prelude::*,
};
use bevy_rapier3d::prelude::{Collider, RigidBody};

use crate::{common::*, log};

/// An app that builds medial meshes.
fn app(cache: Option<PathBuf>) -> App {
    app_with((MedialPhysicsPlugins::default(), MedialBuildPlugin { cache }), &assets())
}

/// A few spheres, so that tests take little time.
fn few() -> BuildMedialMesh {
    BuildMedialMesh(FitOptions { spheres: Some(16), ..default() })
}

fn add(app: &mut App, mesh: impl Into<Mesh>) -> Mesh3d {
    Mesh3d(app.world_mut().resource_mut::<Assets<Mesh>>().add(mesh.into()))
}

fn ring() -> Mesh {
    Torus::new(0.3, 0.5).mesh().minor_resolution(12).major_resolution(24).build()
}

fn status(app: &App, entity: Entity) -> &MedialBuildStatus {
    app.world().get(entity).unwrap()
}

/// Updates the app until the status of a build satisfies a condition. The limit is a number of updates, not a time.
fn wait_for(app: &mut App, entity: Entity, done: impl Fn(&MedialBuildStatus) -> bool) -> MedialBuildStatus {
    for _ in 0..60_000 {
        app.update();
        if done(status(app, entity)) {
            return status(app, entity).clone();
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    panic!("the build is still {:?}", status(app, entity));
}

fn is_over(status: &MedialBuildStatus) -> bool {
    matches!(status, MedialBuildStatus::Built | MedialBuildStatus::Failed(_))
}

fn axis_of(app: &App, entity: Entity) -> MedialAxis {
    let mesh = app.world().get::<MedialMesh>(entity).expect("a medial mesh");
    app.world().resource::<Assets<MedialAxis>>().get(&mesh.0).unwrap().clone()
}

/// An empty directory.
fn folder(name: &str) -> PathBuf {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = fs::remove_dir_all(&folder);
    folder
}

fn files(folder: &PathBuf) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten();
    entries.map(|entry| entry.unwrap().path()).collect()
}

#[test]
fn a_built_shape_collides_and_is_shared() {
    let mut app = app(None);
    let ground = spawn_ground(&mut app);
    let mesh = add(&mut app, ring());
    let at = |x: f32| Transform::from_xyz(x, 0.3, 0.0);
    let bodies = [-2.0, 2.0].map(|x| app.world_mut().spawn((RigidBody::Dynamic, mesh.clone(), few(), at(x))).id());
    let other = BuildMedialMesh(FitOptions { levels: true, ..few().0 });
    let leveled =
        app.world_mut().spawn((RigidBody::Dynamic, mesh.clone(), other, Transform::from_xyz(0.0, 0.3, 3.0))).id();
    assert_eq!(*status(&app, bodies[0]), MedialBuildStatus::Waiting);
    app.update();
    assert!(matches!(status(&app, bodies[0]), MedialBuildStatus::Building(_)));
    for body in bodies {
        assert_eq!(wait_for(&mut app, body, is_over), MedialBuildStatus::Built);
    }
    assert_eq!(wait_for(&mut app, leveled, is_over), MedialBuildStatus::Built);
    // Both bodies and a later one share an asset. Other options give another asset.
    let late = app.world_mut().spawn((RigidBody::Dynamic, mesh, few(), Transform::from_xyz(0.0, 0.3, -3.0))).id();
    app.update();
    assert_eq!(*status(&app, late), MedialBuildStatus::Built);
    let handle = |entity| app.world().get::<MedialMesh>(entity).unwrap();
    assert!(handle(bodies[0]) == handle(bodies[1]) && handle(bodies[0]) == handle(late));
    assert_eq!(app.world().resource::<Assets<MedialAxis>>().len(), 2);
    assert!(axis_of(&app, late).coarser().is_empty() && axis_of(&app, leveled).coarser().len() > 1);
    assert_eq!(axis_of(&app, late).spheres().len(), 16);
    let mut record = Record::default();
    record.run(&mut app, 300);
    for body in bodies {
        let height = position(&mut app, body).y;
        assert!((height - 0.1).abs() < 0.03, "{height}");
        assert_eq!(record.counts(body, ground)[1], 0);
    }
    // The built shape stays when the component is removed.
    app.world_mut().entity_mut(late).remove::<BuildMedialMesh>();
    app.update();
    assert!(app.world().get::<MedialBuildStatus>(late).is_none() && app.world().get::<Collider>(late).is_some());
}

#[test]
fn late_meshes_are_built_and_changed_meshes_built_again() {
    let mut app = app(None);
    let handle = app.world().resource::<Assets<Mesh>>().reserve_handle();
    let body = app.world_mut().spawn((Mesh3d(handle.clone()), few())).id();
    run(&mut app, 5);
    assert_eq!(*status(&app, body), MedialBuildStatus::Waiting);
    let set = |app: &mut App, mesh: Mesh| app.world_mut().resource_mut::<Assets<Mesh>>().insert(&handle, mesh).unwrap();
    set(&mut app, Cuboid::new(1.0, 1.0, 1.0).into());
    wait_for(&mut app, body, is_over);
    // Eight spheres bulge out of the box.
    let is_wide = |app: &App, half: f32| (axis_of(app, body).aabb().half_extents().x / half - 1.0).abs() < 0.2;
    assert!(is_wide(&app, 0.5));
    set(&mut app, Cuboid::new(3.0, 1.0, 1.0).into());
    wait_for(&mut app, body, |status| *status != MedialBuildStatus::Built);
    wait_for(&mut app, body, is_over);
    assert!(is_wide(&app, 1.5));
    // A different mesh asset is built as well.
    let small = add(&mut app, Cuboid::new(0.2, 0.2, 0.2));
    app.world_mut().entity_mut(body).insert(small);
    app.update();
    wait_for(&mut app, body, is_over);
    assert!(is_wide(&app, 0.1));
}

#[test]
fn a_build_without_entities_is_cancelled() {
    let cache = folder("physics-broken-off");
    let mut app = app(Some(cache.clone()));
    let long = BuildMedialMesh(FitOptions { spheres: Some(200), levels: true, ..default() });
    let mesh = add(&mut app, Torus::new(0.3, 0.5).mesh().minor_resolution(40).major_resolution(120));
    let bodies = [0; 2].map(|_| app.world_mut().spawn((mesh.clone(), long)).id());
    let is_within = |status: &MedialBuildStatus| matches!(status, MedialBuildStatus::Building(part) if *part > 0.0);
    wait_for(&mut app, bodies[0], is_within);
    app.world_mut().despawn(bodies[0]);
    // The other body still waits for the build.
    let MedialBuildStatus::Building(part) = *status(&app, bodies[1]) else { panic!("the build has ended") };
    wait_for(&mut app, bodies[1], |status| matches!(status, MedialBuildStatus::Building(more) if *more > part));
    app.world_mut().entity_mut(bodies[1]).remove::<BuildMedialMesh>();
    app.update();
    assert!(app.world().get::<MedialBuildStatus>(bodies[1]).is_none());
    // Builds may run one after the other, so the next one ends only after the first. The cancelled build has left no file.
    let mesh = add(&mut app, Cuboid::default());
    let next = app.world_mut().spawn((mesh, few())).id();
    assert_eq!(wait_for(&mut app, next, is_over), MedialBuildStatus::Built);
    assert_eq!(files(&cache).len(), 1);
    assert!(app.world().get::<MedialMesh>(bodies[1]).is_none());
}

#[test]
fn a_build_requested_again_at_once_is_done_in_any_order() {
    let again = |app: &mut App| {
        let want = |mut commands: Commands, bodies: Query<Entity, (With<Mesh3d>, Without<BuildMedialMesh>)>| {
            bodies.iter().for_each(|body| _ = commands.entity(body).insert(few()));
        };
        app.add_systems(Update, want);
    };
    let physics = || (MedialPhysicsPlugins::default(), MedialBuildPlugin { cache: None });
    for mut app in [app_with((again, physics()), &assets()), app_with((physics(), again), &assets())] {
        let mesh = add(&mut app, Cuboid::default());
        let body = app.world_mut().spawn(mesh).id();
        app.update();
        for _ in 0..3 {
            assert_eq!(wait_for(&mut app, body, is_over), MedialBuildStatus::Built);
            app.world_mut().entity_mut(body).remove::<BuildMedialMesh>();
            app.update();
        }
    }
}

#[test]
fn a_cached_build_is_not_repeated() {
    let cache = folder("physics-cache");
    let built = |mesh: Mesh, options: BuildMedialMesh| {
        let mut app = app(Some(cache.clone()));
        let mesh = add(&mut app, mesh);
        let body = app.world_mut().spawn((mesh, options)).id();
        assert_eq!(wait_for(&mut app, body, is_over), MedialBuildStatus::Built);
        let axis = axis_of(&app, body);
        (axis.spheres().to_vec(), axis.primitives().to_vec(), *axis.mass())
    };
    let fresh = built(ring(), few());
    let file = files(&cache);
    assert_eq!(file.len(), 1, "{file:?}");
    let bytes = fs::read(&file[0]).unwrap();
    assert_eq!(built(ring(), few()), fresh, "the cache contains another shape");
    // A file with another content shows that it is read.
    let axis = MedialAxis::sphere(0.123).unwrap();
    let doctored =
        MedialLevels { levels: vec![Level { axis, error: TwoSidedError::default() }], ..MedialLevels::default() };
    fs::write(&file[0], doctored.to_bytes()).unwrap();
    assert_eq!(built(ring(), few()).0[0].radius, 0.123);
    // Other options and another mesh have files of their own.
    assert_ne!(built(ring(), BuildMedialMesh(FitOptions { seed: 5, ..few().0 })).0.len(), 1);
    assert_ne!(built(Cuboid::default().into(), few()).0.len(), 1);
    assert_eq!(files(&cache).len(), 3);
    // A damaged file is written again.
    log::keep();
    fs::write(&file[0], &bytes[..bytes.len() / 2]).unwrap();
    assert_eq!(built(ring(), few()), fresh);
    assert_eq!(fs::read(&file[0]).unwrap(), bytes);
    assert_eq!(log::lines(&file[0].to_string_lossy()).len(), 1);
}

#[test]
fn a_build_succeeds_without_a_writable_cache() {
    log::keep();
    let cache = folder("physics-no-cache");
    fs::write(&cache, "a file where the directory should be").unwrap();
    let mut app = app(Some(cache.clone()));
    let mesh = add(&mut app, Cuboid::default());
    let body = app.world_mut().spawn((mesh, few())).id();
    assert_eq!(wait_for(&mut app, body, is_over), MedialBuildStatus::Built);
    let reported = log::lines("physics-no-cache");
    assert!(reported.iter().any(|line| line.contains("MedialBuildPlugin::cache")), "{reported:?}");
    fs::remove_file(&cache).unwrap();
}

#[test]
fn a_failed_build_is_logged_once_with_the_remedy() {
    log::keep();
    let mut app = app(None);
    let flat = add(&mut app, Plane3d::default());
    let line = add(&mut app, Mesh::new(PrimitiveTopology::LineList, RenderAssetUsages::default()));
    for (mesh, name, remedy) in [(flat, "flat sheet", "close its holes"), (line, "bare line", "a triangle list")] {
        let bodies = [0; 2].map(|_| app.world_mut().spawn((mesh.clone(), few(), Name::new(name))).id());
        for body in bodies {
            let MedialBuildStatus::Failed(error) = wait_for(&mut app, body, is_over) else { panic!("{name}") };
            assert!(error.contains(remedy), "{error}");
        }
        run(&mut app, 20);
        let reported = log::lines(name);
        assert!(reported.len() == 1 && reported[0].contains(remedy), "{reported:?}");
        // Another mesh is tried.
        let good = add(&mut app, Cuboid::default());
        app.world_mut().entity_mut(bodies[0]).insert(good);
        app.update();
        assert_eq!(wait_for(&mut app, bodies[0], is_over), MedialBuildStatus::Built);
    }
    // A mesh that does not load is logged as well.
    let missing = Mesh3d(app.world().resource::<AssetServer>().load("no such.mesh"));
    let body = app.world_mut().spawn((missing, few(), Name::new("unloaded thing"))).id();
    assert!(matches!(wait_for(&mut app, body, is_over), MedialBuildStatus::Failed(_)));
    run(&mut app, 20);
    assert_eq!(log::lines("unloaded thing").len(), 1);
}

#[test]
fn plugins_may_be_added_in_any_order() {
    let mut app = App::new();
    app.add_plugins((MinimalPlugins, bevy::asset::AssetPlugin::default(), MedialBuildPlugin::default()));
    app.add_plugins((TransformPlugin, bevy::diagnostic::DiagnosticsPlugin, MedialPhysicsPlugins::default()));
    let mesh = add(&mut app, Cuboid::default());
    let body = app.world_mut().spawn((RigidBody::Dynamic, mesh, few())).id();
    assert_eq!(wait_for(&mut app, body, is_over), MedialBuildStatus::Built);
    app.update();
    assert!(app.world().get::<Collider>(body).is_some());
}
