//! Other features of rapier work together with medial bodies.

use bevy::{ecs::system::RunSystemOnce, prelude::*};
use bevy_medial::{medial_axis::MedialAxis, prelude::*};
use bevy_rapier3d::{plugin::context::RapierContextSimulation, prelude::*, rapier::dynamics::IntegrationParameters};

use crate::common::*;

fn spawn_wall(app: &mut App, x: f32) -> Entity {
    app.world_mut().spawn((StaticObb::new(0.1, 3.0, 3.0), Transform::from_xyz(x, 0.0, 0.0))).id()
}

#[test]
fn a_stop_does_not_move_a_body_along_a_locked_axis() {
    let mut app = app();
    spawn_wall(&mut app, -2.0);
    spawn_wall(&mut app, 2.0);
    let body = spawn_body(&mut app, ball(), Transform::default());
    app.world_mut().entity_mut(body).insert((
        LockedAxes::TRANSLATION_LOCKED_Y | LockedAxes::TRANSLATION_LOCKED_Z | LockedAxes::ROTATION_LOCKED,
        Velocity::linear(Vec3::X * 100.0),
        Restitution { coefficient: 1.0, combine_rule: CoefficientCombineRule::Max },
    ));
    let mut stops = 0;
    for _ in 0..120 {
        app.update();
        stops += app.world().resource::<MedialStep>().output.stops.len();
    }
    assert!(stops > 20, "{stops}");
    let place = position(&mut app, body);
    assert!(place.y.abs() < 1e-5 && place.z.abs() < 1e-5, "{place}");
}

#[test]
fn a_stop_does_not_slow_down_free_fall() {
    for scale in [0.0, 1.0, -1.0, 3.0] {
        let mut app = app();
        spawn_wall(&mut app, 4.0);
        let body = spawn_body(&mut app, ball(), Transform::default());
        let frictionless = Friction { coefficient: 0.0, combine_rule: CoefficientCombineRule::Min };
        let shot = (GravityScale(scale), Velocity::linear(Vec3::X * 200.0), frictionless);
        app.world_mut().entity_mut(body).insert(shot);
        // The body falls freely along the wall. The time of its last step may still be owed.
        let (mut fallen, mut speed, mut stops) = (0.0, 0.0, 0);
        for _ in 0..20 {
            app.update();
            // The solver divides the step into four parts and applies gravity before each.
            fallen += (speed + 0.625 * 9.81 * scale * DT) * DT;
            speed += 9.81 * scale * DT;
            stops += usize::from(app.world().resource::<MedialStep>().output.stop_of(0).is_some());
        }
        let place = position(&mut app, body);
        assert!(stops > 0 && place.x < 3.71, "{scale}: {place}");
        let short = (fallen + place.y) * scale.signum();
        assert!(short > -1e-3 && short < speed.abs() * DT + 1e-3, "{scale}: {place}, {fallen}, {stops} stops");
    }
}

/// A body with two medial meshes as children, 0.5 m on either side of its origin.
fn spawn_dumbbell(app: &mut App, transform: Transform, velocity: Velocity) -> (Entity, [Entity; 2]) {
    let ends = [-0.5, 0.5].map(|z| {
        let mesh = mesh(app, ball());
        app.world_mut().spawn((mesh, Transform::from_xyz(0.0, 0.0, z))).id()
    });
    let body = app.world_mut().spawn((RigidBody::Dynamic, transform, velocity)).add_children(&ends).id();
    (body, ends)
}

#[test]
fn shapes_of_one_body_do_not_touch_each_other() {
    let mut app = app();
    let ground = spawn_ground(&mut app);
    let (body, ends) = spawn_dumbbell(&mut app, Transform::from_xyz(0.0, 1.0, 0.0), Velocity::zero());
    let overlapping = mesh(&mut app, ball());
    let middle = app.world_mut().spawn((overlapping, Transform::from_xyz(0.0, 0.0, 0.3), ChildOf(body))).id();
    app.world_mut().entity_mut(body).insert(Damping { linear_damping: 0.1, angular_damping: 1.0 });
    let mut record = Record::default();
    record.run(&mut app, 400);
    assert!((position(&mut app, body).y - 0.2).abs() < 2e-3 && is_at_rest(&mut app, body));
    assert_eq!(record.counts(ends[0], ground), [1, 0]);
    assert_eq!(record.counts(ends[1], middle), [0, 0], "two shapes of one body touch");
}

#[test]
fn a_rotated_shape_of_a_grandchild_has_the_right_pose() {
    for speed in [0.0, 100.0] {
        let mut app = app();
        let ground = spawn_ground(&mut app);
        // The capsule is made along x, and its parent turns it upright half a metre below the body. Its lower end is 0.9 m below the body.
        let capsule = mesh(&mut app, MedialAxis::capsule(Vec3::X * -0.3, Vec3::X * 0.3, 0.1).unwrap());
        let world = app.world_mut();
        let upright = Transform::from_rotation(Quat::from_rotation_z(std::f32::consts::FRAC_PI_2));
        let shape = world.spawn((capsule, Transform::from_xyz(-0.2, 0.0, 0.1))).id();
        let arm = world.spawn(Transform::from_xyz(0.0, -0.3, 0.0) * upright).add_child(shape).id();
        let body = (RigidBody::Dynamic, LockedAxes::ROTATION_LOCKED, Velocity::linear(Vec3::NEG_Y * speed));
        let body = world.spawn((body, Transform::from_xyz(0.0, 3.0, 0.0))).add_child(arm).id();
        let mut record = Record::default();
        for step in 0..240 {
            record.run(&mut app, 1);
            let height = position(&mut app, body).y;
            assert!(height > 0.895, "{speed} m/s, step {step}: {height}");
        }
        assert!((position(&mut app, body).y - 0.9).abs() < 2e-3 && is_at_rest(&mut app, body), "{speed} m/s");
        assert!(record.counts(shape, ground)[0] >= 1 && record.counts(arm, ground) == [0, 0]);
    }
}

#[test]
fn each_shape_of_a_fast_body_can_stop_it() {
    for z in [0.5, -0.5] {
        let mut app = app();
        // One wall is in the path of one end, and a second wall a little later in the path of the other. There is no gap between them.
        for (side, x) in [(z, 4.0), (-z, 4.4)] {
            app.world_mut().spawn((StaticObb::new(0.05, 5.0, 5.0), Transform::from_xyz(x, 0.0, 10.0 * side)));
        }
        let (body, _) = spawn_dumbbell(&mut app, Transform::default(), Velocity::linear(Vec3::X * 200.0));
        app.world_mut().entity_mut(body).insert(GravityScale(0.0));
        for step in 0..60 {
            app.update();
            let pose = *rigid(&mut app, body).position();
            for end in [-0.5, 0.5] {
                let center = pose.transform_point(Vec3::Z * end);
                let wall = if center.z * z > 0.0 { 4.0 } else { 4.4 };
                assert!(center.x < wall - 0.2, "{z}, step {step}: {center}");
            }
        }
    }
}

#[test]
fn solver_groups_prevent_stops() {
    // Solver groups: contacts are found and reported, but no body is pushed.
    let mut app = app();
    let wall = spawn_wall(&mut app, 4.0);
    app.world_mut().entity_mut(wall).insert(SolverGroups::new(Group::GROUP_1, Group::GROUP_1));
    let velocity = Velocity::linear(Vec3::X * 200.0);
    let body = spawn_flying(&mut app, ball(), Transform::default(), velocity);
    app.world_mut().entity_mut(body).insert(SolverGroups::new(Group::GROUP_2, Group::GROUP_2));
    run(&mut app, 10);
    let x = position(&mut app, body).x;
    assert!((x - 10.0 * 200.0 * DT).abs() < 0.01, "{x}");
}

#[test]
fn jointed_bodies_without_contacts_do_not_stop_each_other() {
    let mut app = app();
    let rod = MedialAxis::capsule(Vec3::ZERO, Vec3::Y * -1.0, 0.1).unwrap();
    let anchor = mesh(&mut app, ball());
    let anchor = app.world_mut().spawn((RigidBody::Fixed, anchor, Transform::from_xyz(0.0, 3.0, 0.0))).id();
    let joint = SphericalJointBuilder::new().local_anchor1(Vec3::ZERO).local_anchor2(Vec3::ZERO);
    let mut joint = ImpulseJoint::new(anchor, joint);
    joint.data.as_mut().set_contacts_enabled(false);
    let pendulum =
        spawn_body(&mut app, rod, Transform::from_xyz(0.0, 3.0, 0.0).with_rotation(Quat::from_rotation_z(1.5)));
    app.world_mut().entity_mut(pendulum).insert(joint);
    let (mut least, mut greatest) = (f32::MAX, f32::MIN);
    for _ in 0..240 {
        app.update();
        let tip = rigid(&mut app, pendulum).position().transform_point(Vec3::Y * -1.0);
        (least, greatest) = (least.min(tip.x), greatest.max(tip.x));
        assert!((tip.distance(Vec3::Y * 3.0) - 1.0).abs() < 0.02, "{tip}");
    }
    assert!(least < -0.9 && greatest > 0.9, "the pendulum swings from {least} to {greatest}");
}

#[test]
fn jointed_bodies_without_contacts_pass_through_each_other() {
    let mut app = app();
    let [one, other] = [-1.0, 1.0].map(|side| {
        spawn_flying(
            &mut app,
            ball(),
            Transform::from_xyz(3.0 * side, 0.0, 0.0),
            Velocity::linear(Vec3::X * -100.0 * side),
        )
    });
    let mut joint = ImpulseJoint::new(one, RopeJointBuilder::new(50.0));
    joint.data.as_mut().set_contacts_enabled(false);
    app.world_mut().entity_mut(other).insert(joint);
    run(&mut app, 6);
    assert!(position(&mut app, one).x > 5.0 && position(&mut app, other).x < -5.0);
}

#[test]
fn a_chain_with_a_disabled_middle_does_not_couple_its_ends() {
    let mut app = app();
    spawn_wall(&mut app, 4.0);
    let [one, middle, other] = [(0.0, 200.0), (20.0, 0.0), (40.0, 60.0)].map(|(height, speed)| {
        spawn_flying(&mut app, ball(), Transform::from_xyz(0.0, height, 0.0), Velocity::linear(Vec3::X * speed))
    });
    for [from, to] in [[one, middle], [middle, other]] {
        app.world_mut().entity_mut(to).insert(ImpulseJoint::new(from, RopeJointBuilder::new(500.0)));
    }
    app.world_mut().entity_mut(middle).insert(RigidBodyDisabled);
    run(&mut app, 10);
    let [one, other] = [one, other].map(|body| position(&mut app, body).x);
    assert!(one < 3.9, "the first body flies through the wall");
    assert!((other - 10.0 * 60.0 * DT).abs() < 0.01, "{other}: the last body loses time of the first");
}

#[test]
fn a_kinematic_body_keeps_its_motion_and_pushes_others() {
    for kind in [RigidBody::KinematicVelocityBased, RigidBody::KinematicPositionBased] {
        let mut app = app();
        let pusher = mesh(&mut app, MedialAxis::rounded_box(Vec3::splat(0.5), 0.1).unwrap());
        let pusher = app.world_mut().spawn((kind, pusher, Transform::from_xyz(-3.0, 0.0, 0.0))).id();
        if kind == RigidBody::KinematicVelocityBased {
            app.world_mut().entity_mut(pusher).insert(Velocity::linear(Vec3::X * 6.0));
        }
        let pushed = spawn_flying(&mut app, ball(), Transform::default(), Velocity::zero());
        for step in 1..=60 {
            if kind == RigidBody::KinematicPositionBased {
                app.world_mut().get_mut::<Transform>(pusher).unwrap().translation.x = -3.0 + 0.1 * step as f32;
            }
            app.update();
            let [x, other] = [pusher, pushed].map(|body| position(&mut app, body).x);
            assert!((x - (-3.0 + 0.1 * step as f32)).abs() < 0.01, "{kind:?}: {x} in step {step}");
            // The pusher does not stop at the other body, so for one step they overlap by its displacement of a step.
            assert!(other - x > 0.7 - 0.1 - 0.01, "{kind:?}: {x} {other}");
        }
        assert!(position(&mut app, pushed).x > 3.6, "{kind:?}");
    }
}

#[test]
fn bodies_bounce_according_to_their_restitution() {
    for (restitution, expected) in [(0.0, 0.0), (0.5, 0.25), (0.9, 0.81)] {
        let mut app = app();
        spawn_ground(&mut app);
        let body = spawn_body(&mut app, ball(), Transform::from_xyz(0.0, 1.2, 0.0));
        let bouncy = Restitution { coefficient: restitution, combine_rule: CoefficientCombineRule::Max };
        app.world_mut().entity_mut(body).insert(bouncy);
        let (mut down, mut apex) = (false, 0.0f32);
        for _ in 0..75 {
            app.update();
            let rigid = rigid(&mut app, body);
            down |= rigid.translation().y < 0.35;
            if down && rigid.linvel().y >= 0.0 {
                apex = apex.max(rigid.translation().y - 0.2);
            }
        }
        assert!(down && (apex - expected).abs() < 0.06, "{restitution}: {apex}");
    }
}

#[test]
fn a_paused_world_stands_still_and_continues() {
    let mut app = app();
    let ground = spawn_ground(&mut app);
    let body = spawn_body(&mut app, model("torus"), Transform::from_xyz(0.0, 0.5, 0.0));
    let mut record = Record::default();
    record.run(&mut app, 10);
    let place = position(&mut app, body);
    let pause = |app: &mut App, active: bool| {
        let mut configuration = app.world_mut().query::<&mut RapierConfiguration>();
        configuration.single_mut(app.world_mut()).unwrap().physics_pipeline_active = active;
    };
    pause(&mut app, false);
    record.run(&mut app, 50);
    assert_eq!(position(&mut app, body), place);
    pause(&mut app, true);
    record.run(&mut app, 300);
    assert!((position(&mut app, body).y - 0.0525).abs() < 2e-3 && is_at_rest(&mut app, body));
    assert_eq!(record.counts(body, ground), [1, 0]);
}

#[test]
fn a_fast_body_stops_at_a_wall_with_substeps() {
    for substeps in [1, 2, 4] {
        let mut app = app();
        app.insert_resource(TimestepMode::Fixed { dt: DT, substeps });
        spawn_wall(&mut app, 4.0);
        let velocity = Velocity { linear: Vec3::X * 200.0, angular: Vec3::new(40.0, 200.0, 20.0) };
        let axis = MedialAxis::capsule(Vec3::X * -0.4, Vec3::X * 0.4, 0.05).unwrap();
        let body = spawn_flying(&mut app, axis, Transform::default(), velocity);
        for _ in 0..30 {
            app.update();
            let place = position(&mut app, body);
            let beside = place.yz().abs().max_element() > 3.0;
            assert!(place.x < 3.95 || beside, "{substeps} substeps: {place}");
        }
    }
}

#[test]
fn a_child_of_a_turning_body_keeps_its_collider() {
    let mut app = app();
    let velocity = Velocity { linear: Vec3::ZERO, angular: Vec3::new(3.0, 5.0, 7.0) };
    let (body, ends) = spawn_dumbbell(&mut app, Transform::from_scale(Vec3::splat(1.7)), velocity);
    app.world_mut().entity_mut(body).insert(GravityScale(0.0));
    run(&mut app, 5);
    let shape_of =
        |app: &App| std::sync::Arc::as_ptr(&app.world().get::<Collider>(ends[0]).unwrap().raw.0).cast::<()>();
    let before = shape_of(&app);
    for step in 0..120 {
        app.update();
        assert_eq!(before, shape_of(&app), "step {step}: another collider for the same shape");
    }
}

#[test]
fn a_body_on_a_tilted_floor_keeps_its_locked_axis() {
    let mut app = app();
    let floor = Transform::from_rotation(Quat::from_rotation_x(0.4) * Quat::from_rotation_z(-0.5));
    app.world_mut().spawn((StaticObb::new(20.0, 0.1, 20.0), floor));
    let body = spawn_body(&mut app, ball(), Transform::from_xyz(-6.0, 6.0, 0.0));
    app.world_mut().entity_mut(body).insert(LockedAxes::TRANSLATION_LOCKED_Z);
    for _ in 0..150 {
        app.update();
        let place = position(&mut app, body);
        assert!(place.z.abs() < 1e-5, "{place}");
        let height = floor.rotation.inverse() * place;
        assert!(height.y > 0.29, "the ball sinks in by {}", 0.3 - height.y);
    }
    assert!(position(&mut app, body).y < 0.0, "the ball does not slide down");
}

#[test]
fn a_sensor_reports_bodies_that_a_joint_keeps_from_contact() {
    for sensor in [false, true] {
        let mut app = app();
        let [still, flying] = [0.0, -1.0].map(|x| {
            spawn_flying(&mut app, ball(), Transform::from_xyz(x, 0.0, 0.0), Velocity::linear(Vec3::X * -20.0 * x))
        });
        let mut joint = ImpulseJoint::new(still, RopeJointBuilder::new(50.0));
        joint.data.as_mut().set_contacts_enabled(false);
        app.world_mut().entity_mut(flying).insert(joint);
        if sensor {
            app.world_mut().entity_mut(flying).insert(Sensor);
        }
        let mut record = Record::default();
        record.run(&mut app, 12);
        assert!(position(&mut app, flying).x > 1.0);
        assert_eq!(record.counts(still, flying), [usize::from(sensor); 2]);
    }
}

#[test]
fn a_body_moved_by_poses_hits_at_its_actual_speed() {
    let mut app = app();
    let piston =
        (RigidBody::KinematicPositionBased, Collider::cuboid(0.1, 0.5, 0.5), Transform::from_xyz(-0.4, 0.0, 0.0));
    let piston = app.world_mut().spawn(piston).id();
    let body = spawn_flying(&mut app, ball(), Transform::default(), Velocity::zero());
    app.update();
    app.world_mut().get_mut::<Transform>(piston).unwrap().translation.x += 0.25;
    let mut record = Record::default();
    record.run(&mut app, 1);
    let speeds: Vec<f32> = record.started.iter().map(|(_, started)| started.touch.approach_speed).collect();
    assert_eq!(record.counts(body, piston)[0], 1);
    assert!((speeds[0] * DT - 0.25).abs() < 1e-3, "{speeds:?}");
}

#[test]
fn only_contacts_of_rapier_bodies_are_recycled() {
    // Contacts are recycled while a pair moves by less than this distance, here 5 m.
    let parameters = IntegrationParameters { normalized_contact_recycle_distance: 5.0, ..default() };
    assert!(parameters.contact_recycling);
    // A ball touches a wall and is then moved away by more than the prediction distance. Only recycled contacts remain.
    let is_recycled = |medial: bool, hooks: Option<ActiveHooks>| {
        let mut app = app();
        app.update();
        let mut contexts = app.world_mut().query::<&mut RapierContextSimulation>();
        contexts.single_mut(app.world_mut()).unwrap().integration_parameters = parameters;
        let wall = spawn_wall(&mut app, 0.299);
        let body = if medial {
            spawn_flying(&mut app, ball(), Transform::default(), Velocity::zero())
        } else {
            let bundle = (RigidBody::Dynamic, Collider::ball(0.2), GravityScale(0.0), Transform::default());
            app.world_mut().spawn(bundle).id()
        };
        if let Some(hooks) = hooks {
            run(&mut app, 2);
            app.world_mut().entity_mut(body).insert(hooks);
        }
        run(&mut app, 3);
        let touches = move |rapier: ReadRapierContext| {
            rapier.single().unwrap().contact_pair(body, wall).is_some_and(|pair| pair.has_any_active_contact())
        };
        assert!(app.world_mut().run_system_once(touches).unwrap(), "the ball touches the wall");
        app.world_mut().get_mut::<Transform>(body).unwrap().translation.x -= 0.03;
        run(&mut app, 2);
        assert!(contexts.single(app.world()).unwrap().integration_parameters.contact_recycling);
        app.world_mut().run_system_once(touches).unwrap()
    };
    assert!(!is_recycled(true, None));
    assert!(!is_recycled(true, Some(ActiveHooks::empty())));
    assert!(is_recycled(false, None));
}
