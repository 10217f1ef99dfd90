//! Skinned shapes: rays, bad skeletons, jumps, lower rates, equal bits, ragdolls.

use bevy::{
    ecs::system::RunSystemOnce,
    prelude::*,
    tasks::{TaskPool, TaskPoolBuilder},
};
use bevy_medial::{
    geometry::Sphere, medial_axis::MedialAxis, pipeline::step, prelude::*, query::ray_cast, rapier::MedialRagdoll,
};
use bevy_rapier3d::prelude::*;

use super::skinned::{LENGTH, Puppet, Shot, cpu_app, volley};
use crate::{common::*, log};

fn cast(app: &mut App, origin: Vec3, direction: Vec3) -> Option<(Entity, f32)> {
    let ask = move |rapier: ReadRapierContext| {
        let filter = QueryFilter::default();
        rapier.single().unwrap().with_medial_queries(filter, |queries| queries.cast_ray(origin, direction, 9.0, true))
    };
    app.world_mut().run_system_once(ask).unwrap()
}

#[test]
fn rays_hit_the_pose_of_the_frame() {
    let mut random = Random(52);
    let mut app = cpu_app();
    let mut tentacle = Puppet::tentacle(&mut app);
    let (mut hits, mut before, mut same_joints) = (0, 0, 0);
    for _ in 0..30 {
        tentacle.step(&mut app);
        if tentacle.steps < 4 {
            continue;
        }
        for _ in 0..20 {
            let target = tentacle.spheres_at(tentacle.time())[random.below(7)].center + random.in_ball() * 0.15;
            let direction = random.direction().as_vec3();
            let origin = target - direction * 3.0;
            let spheres = tentacle.spheres_at(tentacle.time());
            let nearest = |spheres: &[Sphere]| {
                let cones = tentacle.axis.primitives().iter().map(|p| p.indices());
                let cones = cones.map(|i| [spheres[i[0] as usize], spheres[i[1] as usize]]);
                let hits = cones.filter_map(|cone| ray_cast(&cone, origin, direction, 9.0));
                hits.map(|hit| hit.time).fold(f32::INFINITY, f32::min)
            };
            let expected = nearest(&spheres);
            let found = cast(&mut app, origin, direction);
            assert_eq!(found.is_some(), expected.is_finite());
            let Some((entity, time)) = found else { continue };
            assert!(entity == tentacle.entity && (time - expected).abs() < 1e-4, "{time} instead of {expected}");
            let hit = tentacle.pose(&app).cast_ray(origin, direction, 9.0, 1.0).unwrap();
            assert!((hit.time - expected).abs() < 1e-4 && tentacle.joints.contains(&hit.joint));
            let near = tentacle.pose(&app).joint_near(origin + direction * (time - 0.01));
            same_joints += usize::from(near == Some(hit.joint));
            hits += 1;
            // At the start of the step, the shape had the pose of the frame before.
            let earlier = nearest(&tentacle.spheres_at(tentacle.time() - DT));
            let hit = tentacle.pose(&app).cast_ray(origin, direction, 9.0, 0.0);
            assert!(hit.map_or(f32::INFINITY, |hit| hit.time) == earlier || (hit.unwrap().time - earlier).abs() < 1e-4);
            before += usize::from((earlier - expected).abs() > 1e-3);
        }
    }
    assert!(hits > 150 && before > 50 && same_joints * 100 > 95 * hits, "{hits} {before} {same_joints}");
}

/// Spawns a tentacle with another setting and runs some steps. Returns whether it has a shape then.
fn is_posed(change: impl FnOnce(&mut App, &mut Puppet)) -> bool {
    let mut app = cpu_app();
    let mut tentacle = Puppet::tentacle(&mut app);
    change(&mut app, &mut tentacle);
    (0..4).for_each(|_| app.update());
    app.world().get::<SkinPose>(tentacle.entity).is_some() && app.world().get::<Collider>(tentacle.entity).is_some()
}

#[test]
fn bad_skeletons_are_named_once_and_collide_with_nothing() {
    log::keep();
    let named = |app: &mut App, tentacle: &Puppet, name: &'static str| {
        app.world_mut().entity_mut(tentacle.entity).insert(Name::new(name));
    };
    assert!(is_posed(|_, _| {}));
    let no_skin = is_posed(|app, tentacle| {
        named(app, tentacle, "eel without a skin");
        let mesh = app.world_mut().resource_mut::<Assets<MedialAxis>>().add(MedialAxis::sphere(0.1).unwrap());
        app.world_mut().get_mut::<SkinnedMedialMesh>(tentacle.entity).unwrap().mesh = mesh;
    });
    let unknown = is_posed(|app, tentacle| {
        named(app, tentacle, "eel without a tip");
        app.world_mut().entity_mut(tentacle.joints[2]).insert(Name::new("fin"));
    });
    let despawned = is_posed(|app, tentacle| {
        named(app, tentacle, "eel that is cut");
        (0..3).for_each(|_| app.update());
        assert!(app.world().get::<SkinPose>(tentacle.entity).is_some());
        app.world_mut().despawn(tentacle.joints[2]);
    });
    let stretched = is_posed(|app, tentacle| {
        named(app, tentacle, "eel that is long");
        app.world_mut().get_mut::<Transform>(tentacle.joints[1]).unwrap().scale.x = 2.0;
    });
    let astray = is_posed(|app, tentacle| {
        named(app, tentacle, "eel at infinity");
        app.world_mut().get_mut::<Transform>(tentacle.joints[1]).unwrap().translation.x = f32::INFINITY;
    });
    let few = is_posed(|app, tentacle| {
        named(app, tentacle, "eel of two joints");
        app.world_mut().get_mut::<SkinnedMedialMesh>(tentacle.entity).unwrap().joints = tentacle.joints[..2].to_vec();
    });
    assert_eq!([no_skin, unknown, despawned, stretched, astray, few], [false; 6]);
    let cases = [
        ("eel without a skin", "has no skin"),
        ("eel without a tip", "no entity has the name `tip`"),
        ("eel that is cut", "joint `tip`"),
        ("eel that is long", "uniform scale"),
        ("eel at infinity", "finite values"),
        ("eel of two joints", "it lists 2 joints, its skin has 3"),
    ];
    for (name, reason) in cases {
        let lines = log::lines(name);
        assert!(lines.len() == 1 && lines[0].contains(reason), "{name}: {lines:?}");
    }
}

#[test]
fn a_dynamic_body_is_named_once() {
    log::keep();
    for (body, lines) in [(RigidBody::Dynamic, 1), (RigidBody::KinematicPositionBased, 0)] {
        let name = format!("eel of {body:?}");
        assert!(is_posed(|app, tentacle| {
            app.world_mut().entity_mut(tentacle.entity).insert((Name::new(name.clone()), body));
            (0..4).for_each(|_| tentacle.step(app));
        }));
        assert_eq!(log::lines(&name).len(), lines, "{name}");
    }
}

#[test]
fn a_jump_is_not_swept_and_a_requested_one_is_not_logged() {
    log::keep();
    for (name, requested) in [("eel that jumps", false), ("eel that is moved", true)] {
        let mut app = cpu_app();
        let tentacle = Puppet::tentacle(&mut app);
        app.world_mut().entity_mut(tentacle.entity).insert(Name::new(name));
        (0..3).for_each(|_| app.update());
        // One ball lies on the path of the jump, another one on the path after it.
        let ball = |app: &mut App, x: f32| {
            spawn_flying(app, MedialAxis::sphere(0.1).unwrap(), Transform::from_xyz(x, 0.0, 0.0), Velocity::zero())
        };
        let balls = [ball(&mut app, 6.0), ball(&mut app, 11.2)];
        app.update();
        let mut record = Record::default();
        for x in [10.0, 10.3, 10.6, 10.9] {
            app.world_mut().get_mut::<Transform>(tentacle.joints[0]).unwrap().translation.x = x;
            if requested && x == 10.0 {
                app.world_mut().get_mut::<SkinPose>(tentacle.entity).unwrap().teleport();
            }
            record.run(&mut app, 1);
        }
        let reported = balls.map(|ball| record.counts(ball, tentacle.entity)[0]);
        assert_eq!(reported, [0, 1], "{name}");
        assert_eq!(log::lines(name).len(), usize::from(!requested), "{name}: {:?}", log::lines(name));
    }
}

#[test]
fn an_interval_updates_the_shape_less_often() {
    let mut app = cpu_app();
    let mut tentacle = Puppet::tentacle(&mut app);
    app.world_mut().get_mut::<SkinnedMedialMesh>(tentacle.entity).unwrap().interval = 4;
    (0..4).for_each(|_| tentacle.step(&mut app));
    let moved: Vec<bool> = (0..16)
        .map(|_| {
            tentacle.step(&mut app);
            tentacle.pose(&app).shape().path() > 0.0
        })
        .collect();
    assert_eq!(moved.iter().filter(|moved| **moved).count(), 4, "{moved:?}");
    // A shape in focus is updated in each step.
    app.world_mut().spawn(MedialFocus { near: 100.0 });
    (0..2).for_each(|_| tentacle.step(&mut app));
    for _ in 0..8 {
        tentacle.step(&mut app);
        assert!(tentacle.pose(&app).shape().path() > 0.0);
    }
}

/// Poses and velocities of shots after hits on the tentacle, as bits.
pub fn fight(app: &mut App) -> Vec<u32> {
    let mut random = Random(54);
    let mut tentacle = Puppet::tentacle(app);
    (0..4).for_each(|_| tentacle.step(app));
    let shots = volley(app, &tentacle, 40, &mut random);
    let mut hits = 0;
    for _ in 0..20 {
        tentacle.step(app);
        hits += app.world().resource::<MedialStep>().output.stops.len();
    }
    assert!(hits > 10, "{hits} hits");
    let state = |shot: &Shot| {
        let body = rigid(app, shot.entity);
        [body.translation(), body.linvel(), body.angvel()].map(|v| v.to_array().map(f32::to_bits))
    };
    shots.iter().map(state).collect::<Vec<_>>().into_iter().flatten().flatten().collect()
}

#[test]
fn a_fight_has_the_same_bits_without_culling() {
    let hybrid = fight(&mut cpu_app());
    let mut app = cpu_app();
    app.world_mut().resource_mut::<MedialSettings>().brute_force = true;
    assert!(hybrid == fight(&mut app));
}

#[test]
fn steps_with_skinned_shapes_do_not_depend_on_the_number_of_threads() {
    let pools: Vec<TaskPool> = [1, 2, 8].map(|threads| TaskPoolBuilder::new().num_threads(threads).build()).into();
    let (mut random, mut app, mut stops) = (Random(56), cpu_app(), 0);
    let mut tentacle = Puppet::tentacle(&mut app);
    (0..4).for_each(|_| tentacle.step(&mut app));
    volley(&mut app, &tentacle, 60, &mut random);
    for _ in 0..6 {
        tentacle.step(&mut app);
        let MedialStep { input, statics, .. } = app.world().resource::<MedialStep>();
        let ends = pools.iter().map(|pool| {
            let output = step(input, statics, pool);
            stops += output.stops.len();
            format!("{:?} {:?} {:?}", output.pairs, output.manifolds, output.stops)
        });
        let ends: Vec<String> = ends.collect();
        assert!(ends.iter().all(|end| *end == ends[0]));
    }
    assert!(stops > 30, "{stops} stops");
}

#[test]
fn a_character_becomes_a_ragdoll_at_its_pose_and_velocities() {
    let mut app = cpu_app();
    let mut tentacle = Puppet::tentacle(&mut app);
    (0..10).for_each(|_| tentacle.step(&mut app));
    let before = tentacle.spheres_at(tentacle.time());
    let earlier = tentacle.spheres_at(tentacle.time() - DT);
    let is_bent = |(now, full): (&Sphere, &Sphere)| now.radius < full.radius - 1e-4;
    assert!(before.iter().zip(tentacle.axis.spheres()).any(is_bent), "no limb is bent");
    app.world_mut().commands().entity(tentacle.entity).queue(MedialRagdoll::default());
    app.world_mut().flush();
    assert!(app.world().get::<SkinnedMedialMesh>(tentacle.entity).is_none());
    // The middle of each joint's own part has the velocity of the animation.
    for (index, joint) in tentacle.joints.iter().copied().enumerate() {
        let velocity = *app.world().get::<Velocity>(joint).unwrap();
        let place = app.world().get::<GlobalTransform>(joint).unwrap().translation();
        let moved = (before[2 * index].center - earlier[2 * index].center) / DT;
        let axes = app.world().resource::<Assets<MedialAxis>>();
        let mesh = app.world().get::<MedialMesh>(joint).unwrap();
        let limb = axes.get(&mesh.0).unwrap();
        let center = limb.mass().center_of_mass;
        // Limbs get their full thickness back where they were bent.
        for sphere in limb.spheres() {
            assert!(
                tentacle.axis.spheres().iter().any(|full| (full.radius - sphere.radius).abs() < 1e-5),
                "{sphere:?}"
            );
        }
        let turn = app.world().get::<GlobalTransform>(joint).unwrap().rotation();
        let at_joint = velocity.linear - velocity.angular.cross(turn * center);
        assert!(at_joint.distance(moved) < 0.1 * moved.length() + 0.3, "{index}: {at_joint} instead of {moved}");
        assert!(place.distance(before[2 * index].center) < 1e-3);
    }
    run(&mut app, 2);
    let masses: Vec<f32> = tentacle.joints.iter().map(|joint| rigid(&mut app, *joint).mass()).collect();
    assert!(masses.iter().all(|mass| *mass > 1e-3), "{masses:?}");
    // The bodies fall, and the joints hold.
    let height = |app: &mut App| tentacle.joints.iter().map(|joint| position(app, *joint).y).sum::<f32>();
    let from = height(&mut app);
    for _ in 0..60 {
        app.update();
        for pair in tentacle.joints.windows(2) {
            let [parent, child] = [pair[0], pair[1]].map(|joint| *rigid(&mut app, joint).position());
            let anchor = parent.transform_point(Vec3::X * LENGTH);
            assert!(anchor.distance(child.translation) < 0.03, "{anchor} {}", child.translation);
            let shown = app.world().get::<GlobalTransform>(pair[1]).unwrap().translation();
            assert!(shown.distance(child.translation) < 0.2, "{shown} {}", child.translation);
        }
    }
    assert!(height(&mut app) < from - 6.0);
}
