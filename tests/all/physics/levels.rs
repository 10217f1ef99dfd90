//! Levels of detail: the choice of a body's level, and changes of level that do not disturb the motion.

use std::{fs, path::PathBuf};

use bevy::{asset::LoadState, prelude::*};
use bevy_medial::{
    builder::{Deviation, Level, MedialLevels, TwoSidedError},
    medial_axis::MedialAxis,
    prelude::*,
    rapier::MedialShape,
};
use bevy_rapier3d::prelude::{Collider, ColliderMassProperties, RigidBody, Velocity};

use crate::{common::*, log};

/// Radius of the tube.
const TUBE: f32 = 0.2;

/// Segments and error, in percent of a diagonal of 3 m, of each level.
const LEVELS: [(u32, f32); 3] = [(24, 0.3), (12, 0.9), (6, 4.0)];

/// Levels of a ring that lies flat.
fn chain() -> MedialLevels {
    let levels = LEVELS.map(|(segments, max)| {
        let envelope_to_mesh = Deviation { max, mean: 0.1 };
        let mesh_to_envelope = Deviation { max: 0.5 * max, mean: 0.1 };
        let error = TwoSidedError { mesh_to_envelope, envelope_to_mesh, diagonal: 3.0 };
        Level { axis: MedialAxis::torus(1.0, TUBE, segments).unwrap(), error }
    });
    MedialLevels { levels: levels.into(), ..MedialLevels::default() }
}

fn ring() -> MedialAxis {
    chain().into_medial_axis().unwrap()
}

/// Number of spheres in the collision shape of the entity.
fn spheres(app: &App, entity: Entity) -> usize {
    let collider = app.world().get::<Collider>(entity).expect("a collider");
    let shape = collider.raw.as_shape::<MedialShape>().unwrap();
    let spheres = shape.shape.axis.spheres().len();
    let level = app.world().get::<MedialLevel>(entity).unwrap().0;
    assert_eq!(spheres, LEVELS[level].0 as usize, "`MedialLevel` is not the level of the collider");
    spheres
}

fn set(app: &mut App, entity: Entity, budget: MedialBudget) {
    app.world_mut().entity_mut(entity).insert(budget);
}

#[test]
fn coarser_levels_have_the_mass_of_the_finest() {
    let axis = ring();
    assert_eq!(axis.coarser().len(), 2);
    assert_ne!(MedialAxis::torus(1.0, TUBE, 6).unwrap().mass(), axis.mass(), "the masses are equal anyway");
    assert!(axis.coarser().iter().all(|(level, _)| level.mass() == axis.mass()));
    let of = |number| axis.level(number).spheres().len();
    assert_eq!([0, 1, 2, 3, usize::MAX].map(of), [24, 12, 6, 6, 6]);
    assert!(MedialLevels::default().into_medial_axis().is_none());
}

#[test]
fn the_coarsest_level_within_the_budget_is_used() {
    use MedialBudget::{Metres, Percent};
    let mut app = app();
    let mesh = mesh(&mut app, ring());
    // The larger error of both directions counts: 9, 27 and 120 mm. The diagonal of the ring's box is about 3.42 m.
    let cases = [
        (1.0, None, 12),
        (7.0, None, 12),
        (1.0, Some(Percent(0.7)), 24),
        (1.0, Some(Percent(0.9)), 12),
        (1.0, Some(Percent(3.3)), 12),
        (1.0, Some(Percent(3.6)), 6),
        (0.1, Some(Percent(3.6)), 6),
        (1.0, Some(Percent(0.0)), 24),
        (1.0, Some(Metres(0.026)), 24),
        (1.0, Some(Metres(0.028)), 12),
        (2.0, Some(Metres(0.052)), 24),
        (2.0, Some(Metres(0.056)), 12),
        (2.0, Some(Metres(0.239)), 12),
        (2.0, Some(Metres(0.241)), 6),
        (0.1, Some(Metres(0.011)), 12),
        (0.1, Some(Metres(0.013)), 6),
        (1.0, Some(Metres(f32::INFINITY)), 6),
    ];
    let bodies = cases.map(|(scale, budget, _)| {
        let at = Transform::default().with_scale(Vec3::splat(scale));
        let mut body = app.world_mut().spawn((RigidBody::Fixed, mesh.clone(), at));
        if let Some(budget) = budget {
            body.insert(budget);
        }
        body.id()
    });
    app.update();
    for (body, case) in bodies.into_iter().zip(cases) {
        assert_eq!(spheres(&app, body), case.2, "{case:?}");
    }
    // An absolute budget follows the scale, including that of a parent.
    let parent = app.world_mut().spawn(Transform::from_scale(Vec3::splat(2.0))).id();
    let child = app.world_mut().spawn((RigidBody::Fixed, mesh, Metres(0.052), ChildOf(parent))).id();
    app.update();
    assert_eq!(spheres(&app, child), 24);
    app.world_mut().get_mut::<Transform>(parent).unwrap().scale = Vec3::splat(0.4);
    app.update();
    assert_eq!(spheres(&app, child), 6);
    app.world_mut().entity_mut(child).remove::<MedialBudget>();
    app.update();
    assert_eq!(spheres(&app, child), 12);
}

#[test]
fn a_shape_without_levels_ignores_the_budget() {
    let mut app = app();
    let body = spawn_body(&mut app, model("torus"), Transform::default());
    set(&mut app, body, MedialBudget::Percent(50.0));
    app.update();
    assert_eq!(app.world().get::<MedialLevel>(body), Some(&MedialLevel(0)));
    assert!(app.world().get::<Collider>(body).is_some());
    // `MedialLevel` is removed with the shape.
    app.world_mut().entity_mut(body).remove::<MedialMesh>();
    app.update();
    assert_eq!(app.world().get::<MedialLevel>(body), None);
}

#[test]
fn a_change_of_level_on_a_floor_does_not_disturb_motion() {
    let mut app = app();
    let ground = spawn_ground(&mut app);
    let body = spawn_body(&mut app, ring(), Transform::from_xyz(0.0, TUBE, 0.0));
    app.world_mut().entity_mut(body).insert(ColliderMassProperties::Density(700.0));
    let mut record = Record::default();
    record.run(&mut app, 10);
    // The body slides while its level changes.
    app.world_mut().entity_mut(body).insert(Velocity::linear(Vec3::X));
    record.run(&mut app, 2);
    let properties = |app: &mut App| rigid(app, body).mass_properties().local_mprops;
    let mass = properties(&mut app);
    let mut changes = 0;
    for (step, percent) in (0..).zip([0.1, 1.0, 5.0, 1.0, 0.1, 5.0, 0.1, 1.0]) {
        let before = (spheres(&app, body), rigid(&mut app, body));
        set(&mut app, body, MedialBudget::Percent(percent));
        record.run(&mut app, 1);
        changes += usize::from(spheres(&app, body) != before.0);
        let now = rigid(&mut app, body);
        let linear = now.linvel() - before.1.linvel();
        // Only friction reduces the speed, and it does so evenly.
        assert!((-0.17..=0.0).contains(&linear.x) && linear.y.abs() < 0.01, "step {step}: {linear}");
        assert!(now.angvel().distance(before.1.angvel()) < 0.02, "step {step}: {}", now.angvel());
        assert!((now.translation().y - TUBE).abs() < 1e-3, "step {step}: {}", now.translation());
        assert_eq!(properties(&mut app), mass, "step {step}");
    }
    assert!(changes >= 7, "only {changes} changes");
    assert_eq!(record.counts(body, ground), [1, 0]);
    record.run(&mut app, 300);
    assert!(is_at_rest(&mut app, body));
    assert_eq!(record.counts(body, ground), [1, 0]);
}

#[test]
fn a_sleeping_body_wakes_only_if_its_level_changes() {
    let mut app = app();
    let ground = spawn_ground(&mut app);
    let body = spawn_body(&mut app, ring(), Transform::from_xyz(0.0, TUBE, 0.0));
    let mut record = Record::default();
    record.run(&mut app, 300);
    assert!(is_at_rest(&mut app, body) && spheres(&app, body) == 12);
    // Another budget that selects the same level.
    set(&mut app, body, MedialBudget::Metres(0.03));
    record.run(&mut app, 1);
    assert!(rigid(&mut app, body).is_sleeping() && spheres(&app, body) == 12);
    set(&mut app, body, MedialBudget::Metres(0.2));
    record.run(&mut app, 1);
    assert!(!rigid(&mut app, body).is_sleeping() && spheres(&app, body) == 6);
    record.run(&mut app, 300);
    assert!(is_at_rest(&mut app, body));
    assert_eq!(record.counts(body, ground), [1, 0]);
}

#[test]
fn bodies_of_one_level_and_scale_share_their_shape() {
    let mut app = app();
    let mesh = mesh(&mut app, ring());
    let bodies = [5.0, 5.0, 0.1].map(|percent| {
        let budget = MedialBudget::Percent(percent);
        app.world_mut().spawn((RigidBody::Fixed, mesh.clone(), budget, Transform::default())).id()
    });
    app.update();
    let drawn = bodies.map(|body| {
        let collider = app.world().get::<Collider>(body).unwrap();
        std::ptr::from_ref(collider.raw.as_composite_shape().unwrap()).cast::<()>()
    });
    assert!(drawn[0] == drawn[1] && drawn[0] != drawn[2]);
}

#[test]
fn an_invalid_budget_is_logged_once_and_the_default_holds() {
    log::keep();
    let mut app = app();
    let wrong = [MedialBudget::Percent(f32::NAN), MedialBudget::Metres(-1.0), MedialBudget::Metres(f32::NEG_INFINITY)];
    for (number, budget) in (1..).zip(wrong) {
        let name = format!("misjudged ring {number}");
        let body = spawn_body(&mut app, ring(), Transform::default());
        app.world_mut().entity_mut(body).insert((budget, Name::new(name.clone())));
        run(&mut app, 5);
        assert_eq!(spheres(&app, body), 12, "{budget:?}");
        let reported = log::lines(&name);
        assert_eq!(reported.len(), 1, "{reported:?}");
        assert!(
            reported[0].contains(&format!("MedialBudget::{budget:?}")) && reported[0].contains("Percent(1.0)"),
            "{reported:?}"
        );
    }
}

#[test]
fn a_file_without_levels_is_logged_once() {
    log::keep();
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("physics-without-levels");
    fs::create_dir_all(&folder).unwrap();
    let mut app = app_with(MedialPhysicsPlugins::default(), &folder);
    for (file, copy, warnings) in [("bear.ma", "flat bear.ma", 1), ("bear.medial", "levelled bear.medial", 0)] {
        fs::copy(assets().join("models").join(file), folder.join(copy)).unwrap();
        let mesh = MedialMesh(app.world().resource::<AssetServer>().load(copy));
        let bodies = (0..3).map(|_| app.world_mut().spawn((RigidBody::Dynamic, mesh.clone())).id()).collect::<Vec<_>>();
        assert!(matches!(wait(&mut app, &mesh), LoadState::Loaded));
        run(&mut app, 5);
        assert!(bodies.iter().all(|&body| app.world().get::<MedialLevel>(body).is_some()));
        let lines = log::lines(copy);
        assert_eq!(lines.len(), warnings, "{lines:?}");
        assert!(lines.iter().all(|line| line.contains("medial build MESH -o flat bear.medial")), "{lines:?}");
    }
}

#[test]
fn a_damaged_file_of_levels_is_logged() {
    log::keep();
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("physics-levels");
    fs::create_dir_all(&folder).unwrap();
    let mut bytes = chain().to_bytes();
    fs::write(folder.join("ring.medial"), &bytes).unwrap();
    bytes.truncate(300);
    fs::write(folder.join("torn ring.medial"), &bytes).unwrap();
    let mut app = app_with(MedialPhysicsPlugins::default(), &folder);
    let bodies = ["ring.medial", "torn ring.medial"].map(|path| {
        let mesh = MedialMesh(app.world().resource::<AssetServer>().load(path));
        (app.world_mut().spawn((RigidBody::Dynamic, mesh.clone(), Transform::default())).id(), mesh)
    });
    let states = bodies.clone().map(|(_, mesh)| wait(&mut app, &mesh));
    assert!(matches!(states, [LoadState::Loaded, LoadState::Failed(_)]), "{states:?}");
    run(&mut app, 5);
    assert_eq!(spheres(&app, bodies[0].0), 12);
    set(&mut app, bodies[0].0, MedialBudget::Percent(0.1));
    run(&mut app, 1);
    assert_eq!(spheres(&app, bodies[0].0), 24);
    assert!(app.world().get::<Collider>(bodies[1].0).is_none());
    let reported = log::lines("torn ring.medial");
    let of_body: Vec<_> = reported.iter().filter(|line| line.contains(&bodies[1].0.to_string())).collect();
    assert!(of_body.len() == 1 && of_body[0].contains("copy or build it again"), "{reported:?}");
}

#[test]
fn important_bodies_are_finer_and_far_ones_coarser() {
    let mut app = app();
    let mesh = mesh(&mut app, ring());
    // A budget of 1 % selects 12 segments with an error of 27 mm. Half of it selects 24 with 9 mm, and four times as much selects 6 with 120 mm.
    let body = |app: &mut App, x: f32, importance: Option<f32>| {
        let mut body = app.world_mut().spawn((RigidBody::Fixed, mesh.clone(), Transform::from_xyz(x, 0.0, 0.0)));
        if let Some(importance) = importance {
            body.insert(MedialImportance(importance));
        }
        body.id()
    };
    let cases = [
        (0.0, None),
        (0.0, Some(2.0)),
        (0.0, Some(0.2)),
        (0.0, Some(-1.0)),
        (39.0, None),
        (42.0, None),
        (42.0, Some(5.0)),
    ];
    let bodies = cases.map(|(x, importance)| body(&mut app, x, importance));
    let check = |app: &mut App, wanted: [usize; 7]| {
        app.update();
        app.update();
        assert_eq!(bodies.map(|body| spheres(app, body)), wanted);
    };
    check(&mut app, [12, 24, 6, 12, 12, 12, 24]);
    let focus = app.world_mut().spawn((MedialFocus::default(), Transform::default())).id();
    check(&mut app, [12, 24, 6, 12, 6, 6, 12]);
    // A small change of distance changes no level. Otherwise bodies near the limit would change their level all the time.
    app.world_mut().get_mut::<Transform>(focus).unwrap().translation.x = 4.0;
    check(&mut app, [12, 24, 6, 12, 6, 6, 12]);
    app.world_mut().get_mut::<Transform>(focus).unwrap().translation.x = 34.0;
    check(&mut app, [12, 12, 6, 12, 12, 12, 24]);
    app.world_mut().get_mut::<Transform>(focus).unwrap().translation.x = 0.0;
    check(&mut app, [12, 24, 6, 12, 6, 6, 12]);
    // A focus has no effect on statics.
    app.world_mut().entity_mut(bodies[5]).insert(StaticObb::default());
    check(&mut app, [12, 24, 6, 12, 6, 12, 12]);
    app.world_mut().entity_mut(bodies[5]).remove::<StaticObb>();
    check(&mut app, [12, 24, 6, 12, 6, 6, 12]);
    app.world_mut().despawn(focus);
    check(&mut app, [12, 24, 6, 12, 12, 12, 24]);
}

#[test]
fn a_body_wakes_when_the_level_beneath_it_changes() {
    let mut app = app();
    spawn_ground(&mut app);
    let mesh = mesh(&mut app, ring());
    for (x, kind) in [(0.0, RigidBody::Fixed), (5.0, RigidBody::Dynamic)] {
        let at = Transform::from_xyz(x, TUBE, 0.0);
        let mut lower = app.world_mut().spawn((kind, mesh.clone(), MedialBudget::Metres(0.0), at));
        if kind == RigidBody::Fixed {
            lower.insert(StaticObb::default());
        }
        let lower = lower.id();
        // The beam lies across the ring near its side, where a ring of six segments is narrower.
        let beam = MedialAxis::capsule(Vec3::X * -2.0, Vec3::X * 2.0, 0.1).unwrap();
        let upper = spawn_body(&mut app, beam, Transform::from_xyz(x, 2.0 * TUBE + 0.1, 0.93));
        run(&mut app, 400);
        assert!(is_at_rest(&mut app, upper) && spheres(&app, lower) == 24, "{kind:?}");
        set(&mut app, lower, MedialBudget::Metres(1.0));
        run(&mut app, 3);
        assert!(!rigid(&mut app, upper).is_sleeping() && spheres(&app, lower) == 6, "{kind:?}");
    }
}

#[test]
fn diagnostics_report_bodies_per_level_and_shape_memory() {
    use bevy::diagnostic::{DiagnosticPath, DiagnosticsStore};
    use bevy_medial::plugin::diagnostic_paths::{LEVELS as COUNTED, SHAPE_MEMORY};

    let mut app = app();
    let shape = mesh(&mut app, ring());
    for (i, percent) in [0.0, 1.0, 1.0, 100.0].into_iter().enumerate() {
        let place = Transform::from_xyz(i as f32 * 4.0, 0.0, 0.0);
        app.world_mut().spawn((RigidBody::Dynamic, shape.clone(), MedialBudget::Percent(percent), place));
    }
    run(&mut app, 3);
    let value = |app: &App, path: &DiagnosticPath| {
        app.world().resource::<DiagnosticsStore>().get(path).unwrap().value().unwrap()
    };
    let counts: Vec<f64> = COUNTED.iter().map(|path| value(&app, path)).collect();
    assert_eq!(counts, [1.0, 2.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    // Spheres alone are 16 bytes each.
    let least = LEVELS.iter().map(|(spheres, _)| 16 * spheres).sum::<u32>();
    let memory = value(&app, &SHAPE_MEMORY);
    assert!(memory > f64::from(least) && memory < 20.0 * f64::from(least), "{memory} bytes, spheres {least}");
    let ball = mesh(&mut app, MedialAxis::sphere(1.0).unwrap());
    run(&mut app, 1);
    assert!(value(&app, &SHAPE_MEMORY) > memory);
    drop(ball);
    run(&mut app, 3);
    assert_eq!(value(&app, &SHAPE_MEMORY), memory);
}

#[test]
fn diagnostics_equal_the_counts_and_times_of_the_step() {
    use bevy::diagnostic::DiagnosticsStore;
    use bevy_medial::{plugin::diagnostic_paths as paths, scenes::Scene};

    let mut app = app();
    Scene::by_name("rods").unwrap().spawn(app.world_mut(), models(), 1);
    let mut sums = [0.0; 14];
    for _ in 0..90 {
        app.update();
        let step = app.world().resource::<MedialStep>();
        let (counts, times) = (&step.output.counts, &step.output.times);
        let ms = |time: std::time::Duration| time.as_secs_f64() * 1e3;
        let expected = [
            (paths::SNAPSHOT, ms(step.snapshot_time)),
            (paths::BROAD, ms(times.broad)),
            (paths::MID, ms(times.mid)),
            (paths::NARROW, ms(times.narrow)),
            (paths::STOP, ms(times.stop)),
            (paths::CONTACT_SEARCH, ms(times.contacts)),
            (paths::MOVE, ms(step.move_time)),
            (paths::BODIES, counts.bodies as f64),
            (paths::BODY_PAIRS, counts.body_pairs as f64),
            (paths::CANDIDATES, counts.candidates as f64),
            (paths::TOI_TESTS, counts.toi_tests as f64),
            (paths::CONTACTS, counts.contacts as f64),
            (paths::UNRESOLVED, counts.unresolved as f64),
            (paths::STOPPED, step.output.stops.len() as f64),
        ];
        let store = app.world().resource::<DiagnosticsStore>();
        for (sum, (path, value)) in sums.iter_mut().zip(&expected) {
            assert_eq!(store.get(path).unwrap().value(), Some(*value), "{path}");
            *sum += value;
        }
    }
    // Every value except the number of unresolved pairs occurs.
    let [times @ .., _, _] = &sums;
    assert!(times.iter().all(|sum| *sum > 0.0) && sums[13] > 0.0, "{sums:?}");
}
