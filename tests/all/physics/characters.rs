//! Characters in unusual scenes: hidden ones, riders, shapes that change, late names; and bullets against the skinned triangles.

use bevy::{mesh::skinning::SkinnedMesh, prelude::*};
use bevy_medial::{medial_axis::MedialAxis, prelude::*, rapier::MedialRagdoll, scenes::characters::Character};
use bevy_medial_compare::characters::{Actor, hits};
use bevy_rapier3d::prelude::*;

use super::skinned::{LENGTH, Puppet, cpu_app};
use crate::{common::*, log};

fn shape<'a>(app: &'a mut App, tentacle: &Puppet) -> Mut<'a, SkinnedMedialMesh> {
    app.world_mut().get_mut::<SkinnedMedialMesh>(tentacle.entity).unwrap()
}

/// Number of steps among 16 in which a tentacle moves.
fn updates(app: &mut App, tentacle: &mut Puppet) -> usize {
    // Changes of the scene take effect within two steps.
    (0..2).for_each(|_| tentacle.step(app));
    let moves = |_: &i32| {
        tentacle.step(app);
        tentacle.pose(app).shape().path() > 0.0
    };
    (0..16).filter(moves).count()
}

#[test]
fn bullets_hit_a_running_biped_where_its_skinned_triangles_are() {
    let actor = Actor::new(Character::biped(), 60, 5.0).unwrap();
    let fit_error = actor.fit_error(12).unwrap();
    let flights = hits::shoot(&actor, 300, fit_error, 72).unwrap();
    let score = hits::Score::new(&flights, fit_error, [0.0, f32::INFINITY]);
    println!("{score:?} within {fit_error} m");
    assert!(score.hits > 150 && score.touching > 150 && score.near_misses > 50, "{score:?}");
    assert_eq!([score.lost, score.false_hits, score.disturbed], [0; 3], "{score:?}");
    assert!(score.in_place == score.hits && 100 * score.joint_within >= 97 * score.hits, "{score:?}");
    // The check can fail: within a tenth of the error, shapes and triangles differ.
    let strict = hits::Score::new(&flights, 0.1 * fit_error, [0.0, f32::INFINITY]);
    assert!(strict.in_place < strict.hits, "{strict:?}");
}

#[test]
fn hidden_and_distant_characters_are_updated_less_often() {
    let mut app = cpu_app();
    let mut tentacle = Puppet::tentacle(&mut app);
    shape(&mut app, &tentacle).interval = 4;
    let skin = SkinnedMesh { joints: tentacle.joints.clone(), ..default() };
    let mesh = app.world_mut().spawn((skin, ViewVisibility::VISIBLE, ChildOf(tentacle.entity))).id();
    let show = |app: &mut App, visibility| _ = app.world_mut().entity_mut(mesh).insert(visibility);
    assert_eq!(updates(&mut app, &mut tentacle), 4, "without a camera, nothing is known");
    app.world_mut().spawn(Camera::default());
    assert_eq!(updates(&mut app, &mut tentacle), 16, "it is in view");
    show(&mut app, ViewVisibility::HIDDEN);
    assert_eq!(updates(&mut app, &mut tentacle), 4, "it is hidden");
    let focus = app.world_mut().spawn(MedialFocus { near: 100.0 }).id();
    assert_eq!(updates(&mut app, &mut tentacle), 4, "it is near and hidden");
    show(&mut app, ViewVisibility::VISIBLE);
    assert_eq!(updates(&mut app, &mut tentacle), 16, "it is near and in view");
    app.world_mut().entity_mut(focus).insert((MedialFocus { near: 1.0 }, Transform::from_xyz(0.0, 50.0, 0.0)));
    assert_eq!(updates(&mut app, &mut tentacle), 4, "it is in view and far away");
}

#[test]
fn a_slow_update_sweeps_the_motion_since_the_last_one() {
    for interval in [1, 4] {
        let mut app = cpu_app();
        let tentacle = Puppet::tentacle(&mut app);
        shape(&mut app, &tentacle).interval = interval;
        for joint in &tentacle.joints[1..] {
            app.world_mut().get_mut::<Transform>(*joint).unwrap().translation.x = LENGTH;
        }
        (0..4).for_each(|_| app.update());
        let place = Transform::from_xyz(0.5, 0.0, 0.5);
        let ball = spawn_flying(&mut app, MedialAxis::sphere(0.05).unwrap(), place, Velocity::zero());
        app.update();
        let (mut record, mut moves) = (Record::default(), 0);
        for step in 1..=8 {
            let mut root = app.world_mut().get_mut::<Transform>(tentacle.joints[0]).unwrap();
            root.translation.z = 0.25 * step.min(4) as f32;
            record.run(&mut app, 1);
            moves += usize::from(tentacle.pose(&app).shape().path() > 0.0);
        }
        assert!(if interval == 1 { moves == 4 } else { moves <= 2 }, "{moves} moves");
        assert_eq!(record.counts(ball, tentacle.entity)[0], 1, "interval {interval}");
    }
}

#[test]
fn a_ragdoll_of_a_slow_shape_has_its_mean_velocities() {
    const INTERVAL: u32 = 3;
    let mut app = cpu_app();
    let mut tentacle = Puppet::tentacle(&mut app);
    shape(&mut app, &tentacle).interval = INTERVAL;
    (0..8).for_each(|_| tentacle.step(&mut app));
    while tentacle.pose(&app).shape().path() == 0.0 {
        tentacle.step(&mut app);
    }
    let ends = [tentacle.time() - INTERVAL as f32 * DT, tentacle.time()].map(|time| tentacle.spheres_at(time));
    app.world_mut().commands().entity(tentacle.entity).queue(MedialRagdoll::default());
    app.world_mut().flush();
    for index in [1, 2] {
        let joint = tentacle.joints[index];
        let Velocity { linear, angular, .. } = *app.world().get::<Velocity>(joint).unwrap();
        let mesh = app.world().get::<MedialMesh>(joint).unwrap();
        let center = app.world().resource::<Assets<MedialAxis>>().get(&mesh.0).unwrap().mass().center_of_mass;
        let turn = app.world().get::<GlobalTransform>(joint).unwrap().rotation();
        let found = linear - angular.cross(turn * center);
        let moved = (ends[1][2 * index].center - ends[0][2 * index].center) / (INTERVAL as f32 * DT);
        assert!(moved.length() > 1.0 && found.distance(moved) < 0.3 * moved.length() + 0.3, "{found} not {moved}");
    }
}

#[test]
fn hit_regions_may_change() {
    let mut app = cpu_app();
    let mut tentacle = Puppet::tentacle(&mut app);
    (0..4).for_each(|_| tentacle.step(&mut app));
    assert_eq!(tentacle.pose(&app).region(tentacle.joints[2]), None);
    shape(&mut app, &tentacle).regions.insert("tip".into(), "sting".into());
    tentacle.step(&mut app);
    assert_eq!(tentacle.pose(&app).region(tentacle.joints[2]), Some("sting"));
    assert_eq!(tentacle.pose(&app).region(tentacle.joints[0]), None);
}

#[test]
fn a_rider_with_the_same_joint_names_has_its_own_joints() {
    let mut app = cpu_app();
    let [mount, rider] = [0, 1].map(|_| Puppet::tentacle(&mut app));
    app.world_mut().entity_mut(rider.entity).insert(ChildOf(mount.entity));
    // The joints of the rider are nearer to the root of the mount than the mount's own.
    let between = app.world_mut().spawn((Transform::default(), ChildOf(mount.entity))).id();
    let between = app.world_mut().spawn((Transform::default(), ChildOf(between))).id();
    app.world_mut().entity_mut(mount.joints[0]).insert(ChildOf(between));
    (0..4).for_each(|_| app.update());
    assert_eq!(mount.pose(&app).joints(), mount.joints);
    assert_eq!(rider.pose(&app).joints(), rider.joints);
}

#[test]
fn a_second_shape_is_named_and_has_no_effect() {
    log::keep();
    let mut app = cpu_app();
    let mut tentacle = Puppet::tentacle(&mut app);
    let ball = mesh(&mut app, MedialAxis::sphere(3.0).unwrap());
    app.world_mut().entity_mut(tentacle.entity).insert((Name::new("eel with a ball"), ball));
    (0..4).for_each(|_| tentacle.step(&mut app));
    let entity = tentacle.entity;
    let size = |app: &App| {
        let collider = app.world().get::<Collider>(entity).unwrap();
        collider.raw.compute_local_bounding_sphere().radius
    };
    assert!(size(&app) < 2.0, "{}", size(&app));
    let lines = log::lines("eel with a ball");
    assert!(lines.len() == 1 && lines[0].contains("MedialMesh has no effect"), "{lines:?}");
    app.world_mut().entity_mut(tentacle.entity).remove::<MedialMesh>();
    (0..2).for_each(|_| tentacle.step(&mut app));
    assert!(size(&app) < 2.0);
}

#[test]
fn joints_may_get_their_names_a_step_late() {
    log::keep();
    let mut app = cpu_app();
    let tentacle = Puppet::tentacle(&mut app);
    app.world_mut().entity_mut(tentacle.entity).insert(Name::new("eel with a late tip"));
    app.world_mut().entity_mut(tentacle.joints[2]).remove::<Name>();
    app.update();
    assert!(app.world().get::<SkinPose>(tentacle.entity).is_none());
    app.world_mut().entity_mut(tentacle.joints[2]).insert(Name::new("tip"));
    (0..3).for_each(|_| app.update());
    assert_eq!(tentacle.pose(&app).joints(), tentacle.joints);
    assert!(log::lines("eel with a late tip").is_empty());
}

#[test]
fn huge_scales_are_named_and_moderate_ones_are_followed() {
    log::keep();
    for (scale, is_followed) in [(1.0e3, true), (1.0e12, false), (1.0e30, false)] {
        let mut app = cpu_app();
        let tentacle = Puppet::tentacle(&mut app);
        let name = format!("eel of scale {scale}");
        app.world_mut().entity_mut(tentacle.entity).insert(Name::new(name.clone()));
        app.world_mut().get_mut::<Transform>(tentacle.joints[0]).unwrap().scale = Vec3::splat(scale);
        (0..4).for_each(|_| app.update());
        assert_eq!(app.world().get::<SkinPose>(tentacle.entity).is_some(), is_followed, "{name}");
        let lines = log::lines(&name);
        assert_eq!(lines.iter().filter(|line| line.contains("moderate size")).count(), usize::from(!is_followed));
    }
}
