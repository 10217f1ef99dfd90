//! The user's hooks and the types of bodies filter impacts as well as contacts.

use std::{f32::consts::FRAC_PI_4, path::Path};

use bevy::{ecs::system::SystemParam, prelude::*};
use bevy_medial::{medial_axis::MedialAxis, prelude::*};
use bevy_rapier3d::{prelude::*, rapier::geometry::SolverFlags};

use crate::{common::*, log};

const RADIUS: f32 = 0.2;

#[derive(SystemParam)]
struct Hooks<'w, 's> {
    answers: Query<'w, 's, &'static Answer>,
    platforms: Query<'w, 's, (), With<OneWay>>,
    belts: Query<'w, 's, (), With<Belt>>,
}

/// Answer of the filter for pairs with this collider.
#[derive(Component, Clone, Copy, PartialEq, Debug)]
struct Answer(Option<SolverFlags>);

/// Carries bodies from above, and lets bodies from below pass.
#[derive(Component, Clone, Copy)]
struct OneWay;

#[derive(Component)]
struct Belt;

impl BevyPhysicsHooks for Hooks<'_, '_> {
    fn filter_contact_pair(&self, context: PairFilterContextView) -> Option<SolverFlags> {
        let mut answers = [context.collider1(), context.collider2()].into_iter().flat_map(|co| self.answers.get(co));
        answers.next().map_or(Some(SolverFlags::default()), |answer| answer.0)
    }

    fn filter_intersection_pair(&self, context: PairFilterContextView) -> bool {
        self.filter_contact_pair(context).is_some()
    }

    fn modify_solver_contacts(&self, context: ContactModificationContextView) {
        let first = [&self.platforms.contains(context.collider1()), &self.belts.contains(context.collider1())];
        let second = [&self.platforms.contains(context.collider2()), &self.belts.contains(context.collider2())];
        let sign = if first.contains(&&true) { 1.0 } else { -1.0 };
        if *first[0] || *second[0] {
            context.raw.update_as_oneway_platform(Vec3::Y * sign, FRAC_PI_4);
        }
        if *first[1] || *second[1] {
            let velocity = Vec3::X * -2.0 * sign;
            context.raw.solver_contacts.iter_mut().for_each(|contact| contact.tangent_velocity = velocity);
        }
    }
}

/// An app with hooks. The plugin passes them to rapier, or rapier has them already.
fn hooked(rapier_first: bool) -> App {
    let physics = MedialPhysicsPlugins::default().with_hooks::<Hooks>();
    if !rapier_first {
        return app_with(physics, Path::new("assets"));
    }
    app_with((RapierPhysicsPlugin::<Hooks>::default(), physics), Path::new("assets"))
}

/// A thin target across x: a static box, a dynamic medial mesh, or a dynamic box of rapier.
fn spawn_target(app: &mut App, kind: &str, at: Vec3) -> Entity {
    let at = Transform::from_translation(at);
    match kind {
        "fixed" => app.world_mut().spawn((StaticObb::new(0.05, 1.0, 1.0), at)).id(),
        "medial" => {
            let shape = MedialAxis::rounded_box(Vec3::new(0.05, 1.0, 1.0), 0.05).unwrap();
            spawn_flying(app, shape, at, Velocity::zero())
        }
        _ => {
            let shape = (RigidBody::Dynamic, Collider::cuboid(0.05, 1.0, 1.0), GravityScale(0.0));
            app.world_mut().spawn((shape, at)).id()
        }
    }
}

fn shoot(app: &mut App, speed: f32) -> Entity {
    let axis = MedialAxis::sphere(RADIUS).unwrap();
    spawn_flying(app, axis, Transform::default(), Velocity::linear(Vec3::X * speed))
}

#[test]
fn a_hook_filters_pairs_at_any_speed() {
    for speed in [2.0, 100.0, 300.0] {
        for target in ["fixed", "medial", "rapier"] {
            for answer in [None, Some(SolverFlags::empty()), Some(SolverFlags::COMPUTE_IMPULSES)] {
                let what = format!("{speed} m/s, {target}, {answer:?}");
                let mut app = hooked(speed == 2.0);
                // The hook is called for every pair of the body. The first target has an answer of its own.
                let targets = [1.0, 4.0].map(|x| spawn_target(&mut app, target, Vec3::X * x));
                app.world_mut().entity_mut(targets[0]).insert(Answer(answer));
                let body = shoot(&mut app, speed);
                app.world_mut().entity_mut(body).insert(ActiveHooks::FILTER_CONTACT_PAIRS);
                let mut record = Record::default();
                record.run(&mut app, 90);
                let x = |app: &mut App, entity| app.world().get::<Transform>(entity).unwrap().translation.x;
                let [at, first, second] = [body, targets[0], targets[1]].map(|entity| x(&mut app, entity));
                let reported = record.counts(body, targets[0]);
                match answer {
                    Some(SolverFlags::COMPUTE_IMPULSES) => {
                        assert!(at < first && reported[0] > 0, "{what}: at {at}, {reported:?}");
                        assert_eq!(first > 1.01, target != "fixed", "{what}: {first}");
                    }
                    _ => {
                        assert!(
                            first == 1.0 && at > 1.0 && at < second,
                            "{what}: at {at}, targets at {first}, {second}"
                        );
                        assert_eq!(reported, if answer.is_some() { [1, 1] } else { [0, 0] }, "{what}");
                        assert!(speed < 10.0 || record.counts(body, targets[1])[0] > 0, "{what}");
                    }
                }
            }
        }
    }
}

#[test]
fn a_hook_filters_touches_of_a_sensor() {
    for passes in [false, true] {
        let mut app = hooked(false);
        let target = spawn_target(&mut app, "fixed", Vec3::X);
        let answer = Answer(passes.then_some(SolverFlags::empty()));
        app.world_mut().entity_mut(target).insert((Sensor, answer, ActiveHooks::FILTER_INTERSECTION_PAIR));
        let body = shoot(&mut app, 100.0);
        let mut record = Record::default();
        record.run(&mut app, 10);
        assert_eq!(record.counts(body, target), [usize::from(passes); 2]);
    }
}

#[test]
fn a_one_way_platform_is_passable_only_from_below() {
    for speed in [3.0, 30.0, 100.0] {
        for medial in [false, true] {
            for side in [-1.0, 1.0] {
                let mut app = hooked(false);
                let platform = app.world_mut().spawn((OneWay, ActiveHooks::MODIFY_SOLVER_CONTACTS)).id();
                if medial {
                    let shape = mesh(&mut app, MedialAxis::rounded_box(Vec3::new(2.0, 0.05, 2.0), 0.05).unwrap());
                    app.world_mut().entity_mut(platform).insert((RigidBody::Fixed, shape));
                } else {
                    app.world_mut().entity_mut(platform).insert(StaticObb::new(2.0, 0.05, 2.0));
                }
                let axis = MedialAxis::sphere(RADIUS).unwrap();
                let at = Transform::from_xyz(0.1, 1.0 * side, 0.1);
                let body = spawn_flying(&mut app, axis, at, Velocity::linear(Vec3::Y * -speed * side));
                run(&mut app, 60);
                let y = position(&mut app, body).y;
                let what = format!("{speed} m/s, medial {medial}, from {side}: the body ends at {y}");
                // A body from below loses one step at most.
                if side > 0.0 {
                    assert!(y > 0.2, "{what}")
                } else {
                    assert!(y > 59.0 * speed * DT - 1.0 - 1e-3, "{what}")
                }
            }
        }
    }
}

#[test]
fn a_hook_on_contacts_can_make_a_conveyor_belt() {
    let mut app = hooked(true);
    let floor = (StaticObb::new(20.0, 0.5, 2.0), Belt, ActiveHooks::MODIFY_SOLVER_CONTACTS);
    app.world_mut().spawn((floor, Transform::from_xyz(0.0, -0.5, 0.0)));
    let medial = spawn_body(&mut app, MedialAxis::sphere(RADIUS).unwrap(), Transform::from_xyz(0.0, RADIUS, -1.0));
    let own = (RigidBody::Dynamic, Collider::ball(RADIUS), Transform::from_xyz(0.0, RADIUS, 1.0));
    let own = app.world_mut().spawn(own).id();
    for body in [medial, own] {
        app.world_mut().entity_mut(body).insert(LockedAxes::ROTATION_LOCKED);
    }
    run(&mut app, 90);
    let [medial, own] = [medial, own].map(|body| rigid(&mut app, body).linvel().x);
    assert!((medial.abs() - 2.0).abs() < 0.1 && (medial - own).abs() < 0.05, "{medial} {own}");
}

#[test]
#[should_panic = "with_hooks"]
fn hooks_of_rapier_without_hooks_of_the_plugin_are_an_error() {
    let mut app = App::new();
    let rapier = RapierPhysicsPlugin::<Hooks>::default();
    app.add_plugins((MinimalPlugins, AssetPlugin::default(), TransformPlugin, rapier, MedialPhysicsPlugins::default()));
}

#[test]
fn a_schedule_other_than_that_of_rapier_is_logged() {
    log::keep();
    let reported = |schedule: &str| {
        log::lines("RapierPhysicsPlugin does not step in").iter().filter(|line| line.contains(schedule)).count()
    };
    let build = |rapier: RapierPhysicsPlugin<NoUserData>, medial: MedialPhysicsPlugins| {
        App::new().add_plugins((MinimalPlugins, AssetPlugin::default(), TransformPlugin, rapier, medial));
    };
    let (rapier, medial) = (RapierPhysicsPlugin::default, MedialPhysicsPlugins::default);
    build(rapier(), medial());
    build(rapier().in_fixed_schedule(), medial().in_fixed_schedule());
    assert_eq!([reported("PostUpdate"), reported("FixedUpdate")], [0, 0]);
    build(rapier().in_fixed_schedule(), medial());
    build(rapier(), medial().in_fixed_schedule());
    assert_eq!([reported("PostUpdate"), reported("FixedUpdate")], [1, 1]);
}

#[test]
fn inactive_collision_types_prevent_stops() {
    let default = ActiveCollisionTypes::default();
    for (kind, type_) in [
        (RigidBody::Fixed, ActiveCollisionTypes::DYNAMIC_STATIC),
        (RigidBody::Dynamic, ActiveCollisionTypes::DYNAMIC_DYNAMIC),
        (RigidBody::KinematicVelocityBased, ActiveCollisionTypes::DYNAMIC_KINEMATIC),
        (RigidBody::KinematicPositionBased, ActiveCollisionTypes::DYNAMIC_KINEMATIC),
    ] {
        // A pair collides if the type is active for one of both colliders.
        for types in [[default, default], [default, default - type_], [default - type_, default], [default - type_; 2]]
        {
            for speed in [2.0, 100.0] {
                let mut app = app();
                let target = mesh(&mut app, MedialAxis::rounded_box(Vec3::new(0.05, 1.0, 1.0), 0.05).unwrap());
                let target = (kind, target, Transform::from_xyz(1.0, 0.0, 0.0), GravityScale(0.0), types[0]);
                let target = app.world_mut().spawn(target).id();
                let body = shoot(&mut app, speed);
                app.world_mut().entity_mut(body).insert(types[1]);
                let mut record = Record::default();
                record.run(&mut app, 60);
                let [x, other] = [body, target].map(|entity| position(&mut app, entity).x);
                let what = format!("{kind:?}, {types:?}, {speed} m/s: at {x}, the target at {other}");
                let collide = types[0] == default || types[1] == default;
                assert_eq!(x < other, collide, "{what}");
                assert_eq!(record.counts(body, target)[0] > 0, collide, "{what}");
            }
        }
    }
}

#[test]
fn a_kinematic_body_reports_a_wall_and_passes_it() {
    for also in [false, true] {
        let mut app = app();
        let wall = spawn_target(&mut app, "fixed", Vec3::X);
        let body = shoot(&mut app, 100.0);
        app.world_mut().entity_mut(body).insert(RigidBody::KinematicVelocityBased);
        if also {
            app.world_mut().entity_mut(body).insert(ActiveCollisionTypes::all());
        }
        let mut record = Record::default();
        record.run(&mut app, 10);
        assert_eq!(record.counts(body, wall), [1, 1]);
        assert!((position(&mut app, body).x - 10.0 * 100.0 * DT).abs() < 1e-3);
    }
}
