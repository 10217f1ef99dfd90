//! Collision without rapier: transforms move the bodies from one frame to the next, and impacts do not stop them. Messages report the impacts and contacts.

use std::collections::{HashMap, HashSet};

use bevy::{
    ecs::{intern::Interned, name::NameOrEntityItem, schedule::ScheduleLabel},
    prelude::*,
    transform::{
        StaticTransformOptimizations,
        systems::{mark_dirty_trees, propagate_parent_transforms, sync_simple_transforms},
    },
};

use super::{
    BodyInfo, Detail, DetailItem, MedialCcd, MedialLevel, MedialMesh, MedialSettings, MedialStep, MedialSystems,
    Skeletons, SkinPose, StaticObb, is_bounded, is_sound_pose, is_uniform,
};
use crate::{
    constants::DEFAULT_PREDICTION,
    geometry::{Obb, Pose3, Sweep},
    medial_axis::MedialAxis,
    pipeline::{Body, PairFilter, Shape, Solid, StaticBody, Statics},
};

pub(super) fn add_systems(app: &mut App, schedule: Interned<dyn ScheduleLabel>) {
    app.configure_sets(
        schedule,
        (MedialSystems::Detect, MedialSystems::Report).chain().after(TransformSystems::Propagate),
    )
    .add_systems(schedule, (pose_skins, gather_statics, detect).chain().in_set(MedialSystems::Detect))
    .add_observer(forget_level);
    // In other schedules, transforms have not been propagated yet.
    if schedule != PostUpdate.intern() {
        app.init_resource::<StaticTransformOptimizations>().add_systems(
            schedule,
            (mark_dirty_trees, propagate_parent_transforms, sync_simple_transforms)
                .chain()
                .in_set(TransformSystems::Propagate),
        );
    }
}

/// Returns pose and scale. None if they are not finite or too large.
fn pose_of(transform: &GlobalTransform) -> Option<(Pose3, Vec3)> {
    let (scale, rotation, translation) = transform.to_scale_rotation_translation();
    let sound = is_sound_pose(&Pose3::from_parts(translation, rotation)) && is_bounded(scale);
    // The rotation of a turned child of a stretched parent is not of unit length.
    sound.then(|| (Pose3::from_parts(translation, rotation.normalize()), scale))
}

/// The same for a medial mesh, which has one scale.
fn uniform_pose_of(transform: &GlobalTransform) -> Option<(Pose3, f32)> {
    pose_of(transform).filter(|(_, scale)| is_uniform(*scale)).map(|(pose, scale)| (pose, scale.x))
}

/// Entities that cannot be placed. This has been logged.
#[derive(Default)]
struct Refused(HashSet<Entity>);

impl Refused {
    /// Logs once for each entity that it collides with nothing, until it can be placed.
    fn check<T>(&mut self, name: NameOrEntityItem, transform: &GlobalTransform, placed: Option<T>) -> Option<T> {
        if placed.is_some() {
            self.0.remove(&name.entity);
        } else if self.0.insert(name.entity) {
            let transform = transform.compute_transform();
            error!(
                "{name}: the entity collides with nothing at {transform:?}; give it finite values and, if it has a medial mesh, a uniform scale with an even number of mirrored axes"
            );
        }
        placed
    }
}

/// Components that determine the accuracy of a body, and its current level of detail.
type Told = (Detail, Option<&'static MedialLevel>);

/// Returns pose and shape of an entity that is loaded and can be placed. The entity gets its level of detail; without a shape the level is removed.
fn place(
    commands: &mut Commands,
    refused: &mut Refused,
    name: NameOrEntityItem,
    axis: Option<&MedialAxis>,
    (detail, told): (DetailItem, Option<&MedialLevel>),
    transform: &GlobalTransform,
) -> Option<(Pose3, Shape)> {
    let mut entity = commands.entity(name.entity);
    let placed = axis.and_then(|axis| Some((axis, refused.check(name, transform, uniform_pose_of(transform))?)));
    let Some((axis, (pose, scale))) = placed else {
        if told.is_some() {
            entity.try_remove::<MedialLevel>();
        }
        return None;
    };
    let level = detail.level(axis, scale);
    if told != Some(&MedialLevel(level)) {
        entity.try_insert(MedialLevel(level));
    }
    Some((pose, Shape { axis: axis.level(level).clone(), scale }))
}

/// Removes the level of detail together with the shape.
fn forget_level(removed: On<Remove, MedialMesh>, mut commands: Commands) {
    commands.entity(removed.entity).try_remove::<MedialLevel>();
}

/// A static, with all values on which its place in the hierarchy depends.
#[derive(Clone, PartialEq)]
struct Known {
    entity: Entity,
    pose: Pose3,
    solid: KnownSolid,
}

#[derive(Clone)]
enum KnownSolid {
    /// A box with these half extents.
    Box(Vec3),
    Medial(Shape),
}

impl PartialEq for KnownSolid {
    fn eq(&self, other: &Self) -> bool {
        match (self, other) {
            (KnownSolid::Box(a), KnownSolid::Box(b)) => a == b,
            (KnownSolid::Medial(a), KnownSolid::Medial(b)) => {
                a.axis.address() == b.axis.address() && a.scale == b.scale
            }
            _ => false,
        }
    }
}

fn gather_statics(
    mut commands: Commands,
    mut step: ResMut<MedialStep>,
    statics: Query<(NameOrEntity, &StaticObb, Option<&MedialMesh>, Told, &GlobalTransform)>,
    axes: Res<Assets<MedialAxis>>,
    mut known: Local<Vec<Known>>,
    mut refused: Local<Refused>,
) {
    refused.0.retain(|entity| statics.contains(*entity));
    let (mut found, mut bodies) = (Vec::new(), Vec::new());
    for (name, obb, mesh, told, transform) in statics.iter().sort::<Entity>() {
        let entity = name.entity;
        let (pose, solid) = match mesh {
            None => {
                let Some((pose, scale)) = refused.check(name, transform, pose_of(transform)) else { continue };
                let half_extents = obb.half_extents * scale.abs();
                bodies.push(StaticBody::solid_box(Obb { pose, half_extents }));
                (pose, KnownSolid::Box(half_extents))
            }
            Some(mesh) => {
                let placed = place(&mut commands, &mut refused, name, axes.get(&mesh.0), told, transform);
                let Some((pose, shape)) = placed else { continue };
                bodies.push(StaticBody::new(shape.clone(), pose));
                (pose, KnownSolid::Medial(shape))
            }
        };
        found.push(Known { entity, pose, solid });
    }
    // The resource may have been replaced, and its statics are gone then.
    if found == *known && step.static_infos.len() == found.len() {
        return;
    }
    step.static_infos = found.iter().map(|found| BodyInfo::at_rest(found.entity)).collect();
    step.statics = Statics::new(bodies);
    *known = found;
}

/// Poses all skinned shapes by their joints.
fn pose_skins(mut skeletons: Skeletons) {
    skeletons.pose(|_| true, |_| None);
}

fn detect(
    mut commands: Commands,
    mut step: ResMut<MedialStep>,
    settings: Res<MedialSettings>,
    time: Res<Time>,
    axes: Res<Assets<MedialAxis>>,
    bodies: Query<(NameOrEntity, &MedialMesh, Told, &GlobalTransform, Option<&MedialCcd>), Without<StaticObb>>,
    skins: Query<(Entity, &SkinPose, Option<&MedialCcd>)>,
    mut poses: Local<HashMap<Entity, Pose3>>,
    mut refused: Local<Refused>,
) {
    let step = step.as_mut();
    step.settings = MedialSettings { stop_at_impact: false, ..*settings };
    step.dt = time.delta_secs();
    step.input.prediction = DEFAULT_PREDICTION;
    step.input.length_unit = 1.0;
    step.input.bodies.clear();
    step.infos.clear();
    let before = std::mem::take(&mut *poses);
    refused.0.retain(|entity| bodies.contains(*entity));
    for (name, mesh, told, transform, ccd) in bodies.iter().sort::<Entity>() {
        let entity = name.entity;
        let placed = place(&mut commands, &mut refused, name, axes.get(&mesh.0), told, transform);
        let Some((end, shape)) = placed else { continue };
        let start = before.get(&entity).copied().unwrap_or(end);
        poses.insert(entity, end);
        let sweep = Sweep::between(start, end, shape.center_of_mass(), Vec3::ZERO);
        let speed = if step.dt > 0.0 { 1.0 / step.dt } else { 0.0 };
        step.infos.push(BodyInfo {
            body: Some(entity),
            center: start.transform_point(sweep.local_center),
            linear: sweep.translation * speed,
            angular: sweep.rotation * speed,
            ..BodyInfo::at_rest(entity)
        });
        let passes = ccd.is_some_and(|ccd| !ccd.enabled);
        step.input.bodies.push(Body { stops: false, passes, ..Body::new(shape, sweep) });
    }
    for (entity, pose, ccd) in skins.iter().sort::<Entity>() {
        step.infos.push(BodyInfo { body: Some(entity), ..BodyInfo::at_rest(entity) });
        let passes = ccd.is_some_and(|ccd| !ccd.enabled);
        let solid = Solid::Parts(pose.shape().clone());
        step.input.bodies.push(Body { stops: false, passes, ..Body::new(solid, Sweep::at_rest(pose.frame())) });
    }
    step.run(|_, _, _| PairFilter::Stopping);
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use bevy::{
        asset::AssetPlugin, diagnostic::DiagnosticsPlugin, ecs::message::MessageCursor, time::TimeUpdateStrategy,
    };

    use super::*;
    use crate::plugin::{MedialBackend, MedialContactEnded, MedialContactStarted, MedialPhysicsPlugin};

    const RADIUS: f32 = 0.1;

    #[test]
    fn a_stretched_parent_turns_a_child_by_no_other_length() {
        let parent = Transform::from_scale(Vec3::new(1.0, 1.4, 1.0));
        let child = Transform::from_rotation(Quat::from_rotation_x(0.25 * std::f32::consts::PI));
        let place = GlobalTransform::from(parent) * child;
        let told = place.to_scale_rotation_translation().1.length();
        assert!((told - 1.0).abs() > 1e-3, "{told}: the rotation has unit length already");
        let (pose, _) = pose_of(&place).unwrap();
        assert!(pose.rotation.is_normalized());
    }

    #[test]
    fn an_even_number_of_mirrored_axes_is_a_rotation() {
        let turn = Quat::from_euler(EulerRot::XYZ, 0.3, -0.7, 1.1);
        let mut placed = [0; 2];
        for number in 0..64u8 {
            let scale = |bits: u8| Vec3::from_array([0, 1, 2].map(|k| 1.0 - 2.0 * f32::from(bits >> k & 1))) * 1.5;
            let [parent, child] = [number % 8, number / 8].map(|bits| Transform {
                translation: Vec3::X,
                rotation: turn,
                scale: scale(bits),
            });
            let place = GlobalTransform::from(parent) * child;
            let found = uniform_pose_of(&place);
            placed[usize::from(found.is_some())] += 1;
            assert_eq!(found.is_some(), number.count_ones() % 2 == 0, "{} {}", parent.scale, child.scale);
            for point in [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z] {
                let same = |(pose, scale): (Pose3, f32)| {
                    pose.transform_point(point * scale).distance(place.transform_point(point)) < 1e-5
                };
                assert!(found.is_none_or(same), "{} {}", parent.scale, child.scale);
            }
        }
        assert_eq!(placed, [32, 32]);
    }

    /// An app without rapier. Each update takes 1/60 s.
    fn app() -> App {
        app_with(MedialPhysicsPlugin { add_systems, ..default() })
    }

    fn app_with(physics: MedialPhysicsPlugin) -> App {
        let mut app = App::new();
        app.add_plugins((MinimalPlugins, AssetPlugin::default(), TransformPlugin, DiagnosticsPlugin, physics))
            .insert_resource(MedialSettings { backend: MedialBackend::Cpu, ..default() })
            .insert_resource(TimeUpdateStrategy::ManualDuration(Duration::from_secs_f32(1.0 / 60.0)));
        app
    }

    fn ball(app: &mut App, x: f32) -> Entity {
        let ball = app.world_mut().resource_mut::<Assets<MedialAxis>>().add(MedialAxis::sphere(RADIUS).unwrap());
        app.world_mut().spawn((MedialMesh(ball), Transform::from_xyz(x, 0.0, 0.0))).id()
    }

    /// A wall of 2 cm thickness.
    fn wall(app: &mut App) -> Entity {
        app.world_mut().spawn((StaticObb::new(0.01, 1.0, 1.0), Transform::default())).id()
    }

    fn place(app: &mut App, entity: Entity, x: f32) {
        app.world_mut().get_mut::<Transform>(entity).unwrap().translation.x = x;
        app.update();
    }

    /// Returns all messages so far.
    fn told(app: &App) -> (Vec<MedialContactStarted>, Vec<MedialContactEnded>) {
        let world = app.world();
        let started = MessageCursor::default().read(world.resource::<Messages<_>>()).copied().collect();
        (started, MessageCursor::default().read(world.resource::<Messages<_>>()).copied().collect())
    }

    #[test]
    fn a_body_that_is_moved_through_a_wall_is_told_of_and_goes_on() {
        let mut app = app();
        let (wall, ball) = (wall(&mut app), ball(&mut app, -1.0));
        app.update();
        app.update();
        assert_eq!(told(&app), (vec![], vec![]));
        place(&mut app, ball, 1.0);
        let (started, ended) = told(&app);
        let [hit] = started[..] else { panic!("{started:?}") };
        assert_eq!((hit.entity1, hit.entity2, hit.sensor, ended.len()), (ball, wall, false, 0));
        // Its surface moves by two metres and meets the wall after 89 cm.
        assert!((hit.touch.fraction - 0.445).abs() < 1e-3, "{hit:?}");
        assert!(
            hit.touch.normal.distance(Vec3::X) < 1e-4 && (hit.touch.approach_speed - 120.0).abs() < 0.01,
            "{hit:?}"
        );
        assert_eq!(app.world().get::<Transform>(ball).unwrap().translation, Vec3::X);
        app.update();
        let ended = told(&app).1;
        assert_eq!(ended, [MedialContactEnded { entity1: ball, entity2: wall, body1: Some(ball), body2: None }]);
    }

    #[test]
    fn a_level_of_detail_goes_with_the_shape() {
        let mut app = app();
        let ball = ball(&mut app, 0.0);
        let scale = |app: &mut App, scale: f32| {
            app.world_mut().get_mut::<Transform>(ball).unwrap().scale = Vec3::splat(scale);
            app.update();
        };
        let has_level = |app: &App| app.world().get::<MedialLevel>(ball).is_some();
        for obb in [false, true] {
            if obb {
                app.world_mut().entity_mut(ball).insert(StaticObb::default());
            }
            scale(&mut app, 1.0);
            assert!(has_level(&app));
            scale(&mut app, 0.0);
            assert!(!has_level(&app), "an entity without size has a level");
            scale(&mut app, 1.0);
            assert!(has_level(&app));
        }
        let mesh = app.world().get::<MedialMesh>(ball).unwrap().clone();
        app.world_mut().resource_mut::<Assets<MedialAxis>>().remove(&mesh.0).unwrap();
        app.update();
        assert!(!has_level(&app), "an entity without its asset has a level");
        app.world_mut().resource_mut::<Assets<MedialAxis>>().insert(&mesh.0, MedialAxis::sphere(0.2).unwrap()).unwrap();
        app.update();
        assert!(has_level(&app));
        app.world_mut().entity_mut(ball).remove::<MedialMesh>();
        assert!(!has_level(&app), "an entity without a shape has a level");
    }

    #[test]
    fn in_the_fixed_schedule_nobody_else_has_to_know_transforms() {
        let mut app = App::new();
        let physics = MedialPhysicsPlugin { add_systems, ..default() }.in_fixed_schedule();
        app.add_plugins((MinimalPlugins, AssetPlugin::default(), physics))
            .insert_resource(Time::<Fixed>::from_hz(60.0))
            .insert_resource(TimeUpdateStrategy::ManualDuration(Duration::from_secs_f64(1.0 / 60.0)));
        let (wall, ball) = (wall(&mut app), ball(&mut app, -1.0));
        (0..3).for_each(|_| app.update());
        place(&mut app, ball, 1.0);
        app.update();
        let hits: Vec<_> = told(&app).0.iter().map(|hit| (hit.entity1, hit.entity2)).collect();
        assert_eq!(hits, [(ball, wall)]);
    }

    #[test]
    fn two_bodies_meet_even_if_one_of_them_is_not_to_stop() {
        for enabled in [true, false] {
            let mut app = app();
            let [one, other] = [-1.0, 1.0].map(|x| ball(&mut app, x));
            app.world_mut().entity_mut(other).insert(MedialCcd { enabled, ..default() });
            app.update();
            app.world_mut().get_mut::<Transform>(one).unwrap().translation.x = 1.0;
            place(&mut app, other, -1.0);
            let started = told(&app).0;
            let [hit] = started[..] else { panic!("{started:?}") };
            assert!((hit.touch.fraction - 0.45).abs() < 1e-3, "{hit:?}");
        }
    }

    #[test]
    fn in_the_fixed_schedule_each_step_sees_its_own_part_of_the_path() {
        let mut app = app_with(MedialPhysicsPlugin { add_systems, ..default() }.in_fixed_schedule());
        // Each update has two steps.
        app.insert_resource(Time::<Fixed>::from_hz(120.0));
        let ball = ball(&mut app, 0.0);
        app.add_systems(
            FixedUpdate,
            (move |mut transforms: Query<&mut Transform>, step: Res<MedialStep>, mut seen: Local<u32>| {
                transforms.get_mut(ball).unwrap().translation.x += 1.0;
                if let Some(info) = step.infos.first() {
                    *seen += 1;
                    assert!(*seen < 2 || (info.linear.x - 120.0).abs() < 1e-3, "step {}: {}", *seen, info.linear);
                }
            })
            .before(TransformSystems::Propagate),
        );
        (0..8).for_each(|_| app.update());
        assert!(app.world().get::<Transform>(ball).unwrap().translation.x > 10.0);
    }

    #[test]
    fn a_static_that_goes_while_another_loads_is_gone() {
        let mut app = app();
        let (wall, ball) = (wall(&mut app), ball(&mut app, -1.0));
        let handle = app.world().resource::<Assets<MedialAxis>>().reserve_handle();
        let loading = app.world_mut().spawn((
            StaticObb::default(),
            MedialMesh(handle.clone()),
            Transform::from_xyz(5.0, 0.0, 0.0),
        ));
        let loading = loading.id();
        app.update();
        app.world_mut().despawn(wall);
        place(&mut app, ball, 1.0);
        assert_eq!(told(&app).0, []);
        let sphere = MedialAxis::sphere(RADIUS).unwrap();
        app.world_mut().resource_mut::<Assets<MedialAxis>>().insert(&handle, sphere).unwrap();
        place(&mut app, loading, 0.0);
        place(&mut app, ball, -1.0);
        assert_eq!(told(&app).0.len(), 1);
    }

    #[derive(ScheduleLabel, Clone, Debug, PartialEq, Eq, Hash)]
    struct Rarely;

    #[test]
    fn a_static_whose_shape_changes_while_a_schedule_of_its_own_rests_has_changed_when_that_goes_on() {
        let mut app = app_with(MedialPhysicsPlugin { add_systems, ..default() }.in_schedule(Rarely));
        let fixed = ball(&mut app, 0.0);
        app.world_mut().entity_mut(fixed).insert(StaticObb::default());
        let radius = |app: &mut App| {
            app.world_mut().run_schedule(Rarely);
            app.world().resource::<MedialStep>().statics.bodies()[0].solid.bounding_sphere().radius
        };
        app.update();
        assert!((radius(&mut app) - RADIUS).abs() < 1e-3);
        let mesh = app.world().get::<MedialMesh>(fixed).unwrap().clone();
        app.world_mut().resource_mut::<Assets<MedialAxis>>().insert(&mesh.0, MedialAxis::sphere(0.4).unwrap()).unwrap();
        (0..5).for_each(|_| app.update());
        assert!((radius(&mut app) - 0.4).abs() < 1e-3);
    }

    #[test]
    fn an_invalid_transform_affects_no_other_body() {
        let mut app = app();
        let (wall, ball) = (wall(&mut app), ball(&mut app, -1.0));
        app.update();
        let [flat, stray] = [0.3, 0.4].map(|x| self::ball(&mut app, x));
        app.world_mut().get_mut::<Transform>(flat).unwrap().scale = Vec3::new(1.0, 0.0, 1.0);
        app.world_mut().get_mut::<Transform>(stray).unwrap().translation.y = f32::NAN;
        let broken = app.world_mut().spawn((StaticObb::default(), Transform::from_xyz(f32::INFINITY, 0.0, 0.0))).id();
        app.update();
        place(&mut app, ball, 1.0);
        let step = app.world().resource::<MedialStep>();
        assert_eq!((step.input.bodies.len(), step.statics.bodies().len()), (1, 1));
        let hits: Vec<_> = told(&app).0.iter().map(|hit| (hit.entity1, hit.entity2)).collect();
        assert_eq!(hits, [(ball, wall)]);
        place(&mut app, broken, 5.0);
        assert_eq!(app.world().resource::<MedialStep>().statics.bodies().len(), 2);
    }

    /// Hierarchies of transforms with uneven scales cause such rotations.
    #[test]
    fn a_wall_without_a_proper_rotation_is_a_wall() {
        let mut app = app();
        let (wall, ball) = (wall(&mut app), ball(&mut app, -1.0));
        app.world_mut().get_mut::<Transform>(wall).unwrap().rotation = Quat::from_rotation_x(0.3);
        app.world_mut().spawn(Transform::from_scale(Vec3::new(1.0, 1.3, 1.0))).add_child(wall);
        app.update();
        let rotation = app.world().get::<GlobalTransform>(wall).unwrap().rotation();
        assert!(!rotation.is_normalized(), "{rotation} is normalized");
        place(&mut app, ball, 1.0);
        assert_eq!(told(&app).0.len(), 1);
    }

    #[test]
    fn a_wall_is_where_its_transform_says() {
        let mut app = app();
        let (wall, ball) = (wall(&mut app), ball(&mut app, -1.0));
        app.update();
        place(&mut app, wall, 5.0);
        place(&mut app, ball, 1.0);
        assert_eq!(told(&app).0, []);
        place(&mut app, wall, 0.0);
        place(&mut app, ball, -1.0);
        assert_eq!(told(&app).0.len(), 1);
        app.world_mut().despawn(wall);
        app.update();
        assert_eq!(app.world().resource::<MedialStep>().statics.bodies().len(), 0);
    }
}
