//! Rapier's features outside its step support medial shapes: scene queries, character controller, debug printing and drawing.

use bevy::{ecs::system::RunSystemOnce, prelude::*};
use bevy_medial::{medial_axis::MedialAxis, prelude::*, rapier::MedialShape};
use bevy_rapier3d::{
    parry::{
        math::Vector,
        query::ShapeCastOptions,
        shape::{Ball, Cuboid},
    },
    plugin::context::{RapierContextColliders, RapierContextJoints, RapierContextSimulation, RapierQueryPipeline},
    prelude::*,
    rapier::{
        math::Real,
        pipeline::{
            DebugColor, DebugRenderBackend, DebugRenderMode, DebugRenderObject, DebugRenderPipeline, DebugRenderStyle,
        },
    },
};

use crate::common::*;

/// Medial balls of radius 0.5: a fixed one at x = 3, one of group 2 at x = 6, a sensor at x = 9. A rapier cuboid is at x = 12.
fn scene() -> (App, [Entity; 4]) {
    let mut app = app();
    let mut spawn = |x: f32, body: RigidBody| {
        let mesh = mesh(&mut app, MedialAxis::sphere(0.5).unwrap());
        app.world_mut().spawn((body, mesh, GravityScale(0.0), Transform::from_xyz(x, 0.0, 0.0))).id()
    };
    let [fixed, grouped, sensor] =
        [(3.0, RigidBody::Fixed), (6.0, RigidBody::Dynamic), (9.0, RigidBody::Dynamic)].map(|(x, body)| spawn(x, body));
    app.world_mut().entity_mut(fixed).insert(CollisionGroups::new(Group::GROUP_1, Group::ALL));
    app.world_mut().entity_mut(grouped).insert(CollisionGroups::new(Group::GROUP_2, Group::ALL));
    app.world_mut().entity_mut(sensor).insert(Sensor);
    let cuboid = app
        .world_mut()
        .spawn((RigidBody::Fixed, Collider::cuboid(0.5, 0.5, 0.5), Transform::from_xyz(12.0, 0.0, 0.0)))
        .id();
    run(&mut app, 3);
    (app, [fixed, grouped, sensor, cuboid])
}

/// A query along the x axis. It returns the entity and the position on the axis.
type Ask = fn(&RapierQueryPipeline) -> Option<(Entity, f32)>;

fn queries() -> Vec<(&'static str, Ask)> {
    vec![
        ("cast_ray", |q| q.cast_ray(Vec3::ZERO, Vec3::X, 100.0, true)),
        ("cast_ray_and_get_normal", |q| {
            let (entity, hit) = q.cast_ray_and_get_normal(Vec3::ZERO, Vec3::X, 100.0, true)?;
            assert!((hit.normal + Vec3::X).length() < 1e-4);
            Some((entity, hit.point.x))
        }),
        // Rapier's picking back end uses this query and reports the points and normals of all hits.
        ("intersect_ray", |q| {
            let hits = q.intersect_ray(Vec3::ZERO, Vec3::X, f32::MAX, true);
            let (entity, hit) = hits.min_by(|a, b| a.1.time_of_impact.total_cmp(&b.1.time_of_impact))?;
            assert!((hit.normal + Vec3::X).length() < 1e-4 && (hit.point.x - hit.time_of_impact).abs() < 1e-4);
            Some((entity, hit.time_of_impact))
        }),
        ("project_point", |q| q.project_point(Vec3::ZERO, 100.0, true).map(|(entity, found)| (entity, found.point.x))),
        ("project_point_and_get_feature", |q| {
            q.project_point_and_get_feature(Vec3::ZERO).map(|(entity, found, _)| (entity, found.point.x))
        }),
        ("intersect_point", |q| {
            let mut first = None;
            for step in 0..1300 {
                let x = step as f32 * 0.01;
                first = first.or(q.intersect_point(Vec3::X * x).next().map(|entity| (entity, x)));
            }
            first
        }),
        ("cast_shape of a ball", |q| {
            let (entity, hit) =
                q.cast_shape(Vec3::ZERO, Quat::IDENTITY, Vec3::X, &Ball::new(0.2), ShapeCastOptions::default())?;
            Some((entity, hit.time_of_impact + 0.2))
        }),
        ("cast_shape of a cuboid", |q| {
            let cuboid = Cuboid::new(Vec3::splat(0.2));
            let (entity, hit) =
                q.cast_shape(Vec3::ZERO, Quat::IDENTITY, Vec3::X * 2.0, &cuboid, ShapeCastOptions::default())?;
            Some((entity, hit.time_of_impact * 2.0 + 0.2))
        }),
        ("cast_shape of a medial shape", |q| {
            let ball = bevy_medial::pipeline::Shape::new(MedialAxis::sphere(0.2).unwrap());
            let ball = MedialShape::new(ball, 0);
            let (entity, hit) =
                q.cast_shape(Vec3::ZERO, Quat::IDENTITY, Vec3::X, &ball, ShapeCastOptions::default())?;
            Some((entity, hit.time_of_impact + 0.2))
        }),
        ("intersect_shape", |q| {
            let slab = Cuboid::new(Vec3::new(0.005, 0.2, 0.2));
            (0..1300)
                .map(|step| step as f32 * 0.01)
                .find_map(|x| q.intersect_shape(Vec3::X * x, Quat::IDENTITY, &slab).next().map(|entity| (entity, x)))
        }),
    ]
}

#[test]
fn scene_queries_find_medial_shapes_with_all_filters() {
    let (mut app, [fixed, grouped, sensor, cuboid]) = scene();
    let check = move |rapier: ReadRapierContext| {
        let context = rapier.single().unwrap();
        let not_the_first = |entity: Entity| entity != fixed;
        let filters: [(QueryFilter, Entity, f32); 7] = [
            (QueryFilter::default(), fixed, 2.5),
            (QueryFilter::only_dynamic(), grouped, 5.5),
            (QueryFilter::default().exclude_collider(fixed), grouped, 5.5),
            (QueryFilter::default().exclude_rigid_body(fixed), grouped, 5.5),
            (QueryFilter::default().predicate(&not_the_first), grouped, 5.5),
            (QueryFilter::default().exclude_solids(), sensor, 8.5),
            (QueryFilter::only_fixed().exclude_collider(fixed), cuboid, 11.5),
        ];
        let groups = QueryFilter::default().groups(CollisionGroups::new(Group::ALL, Group::GROUP_2));
        for (filter, expected, x) in filters.into_iter().chain([(groups, grouped, 5.5)]) {
            for (name, ask) in queries() {
                for (found, accuracy) in [
                    (context.with_query_pipeline(filter, |pipeline| ask(&pipeline)), 2e-3),
                    (context.with_medial_queries(filter, |pipeline| ask(&pipeline)), 1e-4),
                ] {
                    let Some((entity, at)) = found else { panic!("{name} finds nothing at {x}") };
                    let accuracy = match name {
                        // These queries step along the axis.
                        "intersect_point" | "intersect_shape" => 0.011,
                        // Pairs of parry's own shapes have parry's accuracy.
                        _ if expected == cuboid => 2e-3,
                        _ => accuracy,
                    };
                    assert_eq!(entity, expected, "{name} at {x}");
                    assert!((at - x).abs() < accuracy, "{name}: {at} instead of {x}");
                }
            }
        }
        let nothing = QueryFilter::default().predicate(&|_| false);
        for (name, ask) in queries() {
            assert!(context.with_medial_queries(nothing, |pipeline| ask(&pipeline)).is_none(), "{name}");
        }
    };
    app.world_mut().run_system_once(check).unwrap();
}

/// Moves the character by the same translation in each step. Returns its final position, and whether it is grounded.
fn walk(app: &mut App, character: Entity, translation: Vec3, steps: u32) -> (Vec3, bool) {
    for _ in 0..steps {
        app.world_mut().get_mut::<KinematicCharacterController>(character).unwrap().translation = Some(translation);
        app.update();
    }
    let output = app.world().get::<KinematicCharacterControllerOutput>(character).unwrap();
    (app.world().get::<Transform>(character).unwrap().translation, output.grounded)
}

fn spawn_character(app: &mut App, at: Vec3) -> Entity {
    let character = (
        RigidBody::KinematicPositionBased,
        Collider::capsule_y(0.3, 0.2),
        KinematicCharacterController { offset: CharacterLength::Absolute(0.02), ..default() },
        Transform::from_translation(at),
    );
    app.world_mut().spawn(character).id()
}

#[test]
fn a_character_stands_on_and_climbs_medial_bodies() {
    let mut app = app();
    let mut spawn = |half: Vec3, transform: Transform| {
        let mesh = mesh(&mut app, MedialAxis::rounded_box(half, 0.1).unwrap());
        app.world_mut().spawn((RigidBody::Fixed, mesh, transform));
    };
    spawn(Vec3::new(6.0, 0.2, 6.0), Transform::from_xyz(0.0, -0.2, 0.0));
    spawn(Vec3::new(0.2, 2.0, 4.0), Transform::from_xyz(2.0, 1.0, 0.0));
    // A ramp of 20 degrees that starts at x = -2 and goes up to the left.
    spawn(Vec3::new(3.0, 0.2, 3.0), Transform::from_xyz(-4.8, 0.8, 0.0).with_rotation(Quat::from_rotation_z(-0.35)));
    let character = spawn_character(&mut app, Vec3::new(0.0, 1.5, 0.0));
    run(&mut app, 2);
    let (at, grounded) = walk(&mut app, character, Vec3::Y * -0.05, 60);
    assert!((at.y - 0.52).abs() < 0.01 && grounded, "the character lands at {at}, {grounded}");
    let (at, grounded) = walk(&mut app, character, Vec3::new(0.05, -0.01, 0.0), 60);
    assert!((at.x - 1.58).abs() < 0.01 && grounded, "the wall stops the character at {at}, {grounded}");
    let (at, _) = walk(&mut app, character, Vec3::new(0.05, -0.01, 0.03), 40);
    assert!((at.x - 1.58).abs() < 0.01 && at.z > 1.0, "the character moves along the wall to {at}");
    let (at, grounded) = walk(&mut app, character, Vec3::new(-0.05, -0.01, 0.0), 110);
    assert!(at.x < -2.5 && at.y > 0.75 && grounded, "the character climbs the ramp to {at}, {grounded}");
    let (at, _) = walk(&mut app, character, Vec3::Y * -1.0, 3);
    assert!(at.y > 0.6, "the character falls through: {at}");
}

/// Counts lines.
#[derive(Default)]
struct Lines(usize);

impl DebugRenderBackend for Lines {
    fn draw_line(&mut self, _: DebugRenderObject, a: Vector, b: Vector, _: DebugColor) {
        assert!(a.is_finite() && b.is_finite());
        self.0 += 1;
    }

    fn draw_polyline(
        &mut self,
        object: DebugRenderObject,
        points: &[Vector],
        lines: &[[u32; 2]],
        _: &bevy_rapier3d::parry::math::Pose,
        _: Vector,
        color: DebugColor,
    ) {
        for line in lines {
            self.draw_line(object, points[line[0] as usize], points[line[1] as usize], color);
        }
    }
}

#[test]
fn printing_drawing_and_viewing_a_collider_is_safe() {
    let mut app = app();
    let body = spawn_body(&mut app, model("bear"), Transform::from_scale(Vec3::splat(0.5)));
    run(&mut app, 2);
    let collider = app.world().get::<Collider>(body).unwrap().clone();
    assert!(format!("{collider:?}").contains("Compound"));
    assert!(matches!(collider.as_typed_shape(), ColliderView::Compound(_)));
    assert!(matches!(collider.as_unscaled_typed_shape(), ColliderView::Compound(_)));
    assert!(collider.as_ball().is_none() && collider.as_compound().is_none());
    let shapes = model("bear").primitives().len();
    let ColliderView::Compound(view) = collider.as_typed_shape() else { unreachable!() };
    assert_eq!(view.shapes().len(), shapes);
    for scale in [Vec3::splat(2.0), Vec3::new(1.0, 2.0, 0.5)] {
        let mut scaled = collider.clone();
        scaled.set_scale(scale, 10);
        assert!(scaled.as_compound().is_some(), "a scaled collider must be a compound of parry's shapes");
    }
    let mut contexts =
        app.world_mut()
            .query::<(&RapierContextColliders, &RapierRigidBodySet, &RapierContextSimulation, &RapierContextJoints)>();
    let (colliders, bodies, simulation, joints) = contexts.single(app.world()).unwrap();
    assert!(format!("{colliders:?}").contains("Cylinder"));
    let mut lines = Lines::default();
    DebugRenderPipeline::new(DebugRenderStyle::default(), DebugRenderMode::all()).render(
        &mut lines,
        &bodies.bodies,
        &colliders.colliders,
        &joints.impulse_joints,
        &joints.multibody_joints,
        &simulation.narrow_phase,
    );
    assert!(lines.0 > shapes, "{} lines", lines.0);
}

/// The scale of the entity's medial shape in rapier.
fn scale_in_rapier(app: &mut App, entity: Entity) -> Option<Real> {
    let handle = app.world().get::<RapierColliderHandle>(entity)?.0;
    let mut contexts = app.world_mut().query::<&RapierContextColliders>();
    let collider = contexts.single(app.world()).unwrap().colliders.get(handle)?;
    collider.shape().as_shape::<MedialShape>().map(|medial| medial.shape.scale)
}

#[test]
fn every_valid_scale_keeps_the_medial_shape() {
    let mut app = app();
    let body = spawn_body(&mut app, model("bear"), Transform::default());
    let parent = app.world_mut().spawn((RigidBody::Dynamic, Transform::from_scale(Vec3::splat(2.0)))).id();
    let mesh = mesh(&mut app, model("bear"));
    let child = app.world_mut().spawn((mesh, ChildOf(parent), Transform::from_xyz(9.0, 0.0, 0.0))).id();
    run(&mut app, 2);
    assert_eq!(scale_in_rapier(&mut app, body), Some(1.0));
    assert_eq!(scale_in_rapier(&mut app, child), Some(2.0));
    let expect = |app: &mut App, entity: Entity, scale: f32| {
        run(app, 2);
        let found = scale_in_rapier(app, entity).expect("a medial shape");
        assert!((found - scale).abs() < 1e-4 * scale, "{found} instead of {scale}");
    };
    for scale in [1.0001, 0.3, 3.0] {
        app.world_mut().get_mut::<Transform>(body).unwrap().scale = Vec3::splat(scale);
        expect(&mut app, body, scale);
    }
    app.world_mut().get_mut::<Transform>(parent).unwrap().scale = Vec3::splat(0.5);
    expect(&mut app, child, 0.5);
    for scale in [ColliderScale::Relative(Vec3::splat(2.0)), ColliderScale::Absolute(Vec3::new(1.0, 5.0, 2.0))] {
        app.world_mut().entity_mut(body).insert(scale);
        expect(&mut app, body, 3.0);
    }
    app.world_mut().entity_mut(body).remove::<ColliderScale>();
    expect(&mut app, body, 3.0);
    // An uneven scale is invalid for medial shapes: an error is logged, and no collider is left.
    app.world_mut().get_mut::<Transform>(body).unwrap().scale = Vec3::new(1.0, 2.0, 1.0);
    run(&mut app, 2);
    assert_eq!(scale_in_rapier(&mut app, body), None);
    app.world_mut().get_mut::<Transform>(body).unwrap().scale = Vec3::ONE;
    expect(&mut app, body, 1.0);
}

/// Compares the query for a body's next impact with the impact that follows in the steps after it, without gravity.
#[test]
fn the_predicted_first_impact_happens() {
    let mut random = Random(8);
    let (mut hits, mut spinning, mut misses, mut grazes) = (0, 0, 0, 0);
    for round in 0..60 {
        let mut app = app();
        // The query finds touches of surfaces, not of cores.
        app.world_mut().resource_mut::<MedialSettings>().core_depth = 0.0;
        let mut spawn = |position: Vec3, velocity: Velocity, name| {
            let mesh = mesh(&mut app, model(name));
            let place = Transform::from_translation(position).with_rotation(random.rotation());
            // A body with the same inertia about every axis keeps its spin.
            let round = MassProperties { mass: 1e4, principal_inertia: Vec3::splat(1e4), ..default() };
            let round = AdditionalMassProperties::MassProperties(round);
            let bundle = (RigidBody::Dynamic, mesh, velocity, GravityScale(0.0), place, round);
            app.world_mut().spawn(bundle).id()
        };
        let spin = if round % 2 == 0 { Vec3::ZERO } else { Vec3::new(3.0, -8.0, 5.0) };
        let aside = Vec3::Y * (round % 6) as f32 * 0.3;
        let asked = spawn(Vec3::ZERO, Velocity { linear: Vec3::X * 8.0, angular: spin }, "bear");
        let coming = spawn(Vec3::X * 5.0 + aside, Velocity { linear: -Vec3::X * 3.0, angular: -spin }, "deer");
        let wall = (RigidBody::Fixed, Collider::cuboid(0.1, 3.0, 3.0), Transform::from_xyz(9.0, 0.0, 0.0));
        let wall = app.world_mut().spawn(wall).id();
        run(&mut app, 1);
        // Queries use the poses at this time and predict the first touch of each pair.
        let ask = move |rapier: ReadRapierContext| {
            let rapier = rapier.single().unwrap();
            let ahead = rapier.first_impact(asked, 2.0, QueryFilter::default());
            let behind = rapier.first_impact(asked, 2.0, QueryFilter::only_fixed());
            assert!(
                rapier
                    .first_impact(asked, 2.0, QueryFilter::default().exclude_collider(wall))
                    .is_none_or(|(e, _)| e == coming)
            );
            assert!(rapier.first_impact(asked, 0.01, QueryFilter::default()).is_none(), "no collider is that close");
            assert_eq!(behind.map(|(entity, _)| entity), Some(wall));
            assert!(rapier.first_impact(wall, 2.0, QueryFilter::default()).is_none(), "a wall is not medial");
            ahead
        };
        let (entity, impact) = app.world_mut().run_system_once(ask).unwrap().expect("the wall is in the way");
        let expected = 2.0 * impact.fraction;
        assert!(impact.normal.is_normalized());
        let dt = 1.0 / 60.0;
        let steps = (0..120).find(|_| {
            app.update();
            let step = app.world().resource::<MedialStep>();
            // A fast pair that is near has contacts in the step before its impact. They may prevent the impact.
            step.output.pairs.iter().any(|pair| pair.impact.is_some() || !pair.manifolds.is_empty())
        });
        let found = steps.expect("an impact") as f32 * dt;
        // Rapier turns a body slightly less than its velocity implies, so a predicted graze may pass.
        grazes += u32::from(found - expected > 1.5 * dt);
        assert!(found - expected >= -1.5 * dt, "round {round}: predicted after {expected} s, found after {found} s");
        match entity == coming {
            true => hits += 1,
            false => misses += 1,
        }
        spinning += u32::from(entity == coming && spin != Vec3::ZERO);
    }
    assert!(hits >= 20 && spinning >= 10 && misses >= 5, "{hits} hits, {spinning} of them spinning, {misses} misses");
    assert!(grazes <= 2, "{grazes} impacts came later");
}

#[test]
fn a_character_with_a_child_moves_once_per_step() {
    let mut app = app();
    let character = spawn_character(&mut app, Vec3::Y);
    app.world_mut().entity_mut(character).with_child(Transform::default());
    for step in 1..=5 {
        run(&mut app, 10);
        let (at, _) = walk(&mut app, character, Vec3::X * 0.3, 1);
        run(&mut app, 2);
        let now = app.world().get::<Transform>(character).unwrap().translation;
        assert!((now.x - 0.3 * step as f32).abs() < 1e-3, "step {step}: at {at}, then {now}");
    }
}
