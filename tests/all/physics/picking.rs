//! Pointers pick the nearest medial body along the ray of the camera. `Pickable` and the settings restrict the choice.

use bevy::{
    camera::{CameraProjection, ComputedCameraValues, NormalizedRenderTarget, RenderTargetInfo},
    picking::{
        InteractionPlugin, Pickable, PickingSettings,
        backend::PointerHits,
        pointer::{Location, PointerId, PointerLocation},
    },
    prelude::*,
    window::{PrimaryWindow, WindowRef},
};
use bevy_medial::{
    medial_axis::MedialAxis,
    plugin::{MedialPickingCamera, MedialPickingPlugin, MedialPickingSettings},
    prelude::*,
};
use bevy_rapier3d::prelude::{GravityScale, RigidBody};

use crate::common::*;

const SIZE: UVec2 = UVec2::new(400, 300);

/// Entities that the pointer has moved over, in order.
#[derive(Resource, Default)]
struct Over(Vec<Entity>);

/// Pointer hits of the last frame.
#[derive(Resource, Default)]
struct Hits(Vec<PointerHits>);

/// An app with a camera at the origin that looks along -z and a pointer in the middle of its window.
fn picking_app() -> (App, Entity) {
    let mut app = app_with((MedialPhysicsPlugins::default(), MedialPickingPlugin, InteractionPlugin), &assets());
    app.init_resource::<Over>()
        .init_resource::<Hits>()
        .add_systems(Update, |mut messages: MessageReader<PointerHits>, mut hits: ResMut<Hits>| {
            hits.0 = messages.read().cloned().collect();
        })
        .add_observer(|over: On<Pointer<bevy::picking::events::Over>>, mut seen: ResMut<Over>| {
            // Each event bubbles up to the window.
            if over.entity == over.original_event_target() {
                seen.0.push(over.entity);
            }
        });
    // Picking of the window itself is not tested.
    app.world_mut().resource_mut::<PickingSettings>().is_window_picking_enabled = false;
    let window = app.world_mut().spawn((Window::default(), PrimaryWindow)).id();
    let target = NormalizedRenderTarget::Window(WindowRef::Primary.normalize(Some(window)).unwrap());
    let location = Location { target, position: SIZE.as_vec2() * 0.5 };
    app.world_mut().spawn((PointerId::Mouse, PointerLocation::new(location)));
    let target_info = Some(RenderTargetInfo { physical_size: SIZE, scale_factor: 1.0 });
    let clip_from_view = PerspectiveProjection::default().get_clip_from_view();
    let camera =
        Camera { order: 3, computed: ComputedCameraValues { clip_from_view, target_info, ..default() }, ..default() };
    let camera = app.world_mut().spawn((Camera3d::default(), camera, Transform::default())).id();
    (app, camera)
}

fn spawn_still(app: &mut App, axis: MedialAxis, transform: Transform) -> Entity {
    let body = spawn_body(app, axis, transform);
    app.world_mut().entity_mut(body).insert((RigidBody::Fixed, GravityScale(0.0)));
    body
}

/// Entities and depths of the last hits.
fn picked(app: &mut App) -> Vec<(Entity, f32)> {
    run(app, 3);
    let hits = &app.world().resource::<Hits>().0;
    let mut picks: Vec<_> =
        hits.iter().flat_map(|hits| &hits.picks).map(|(entity, hit)| (*entity, hit.depth)).collect();
    picks.sort_by(|a, b| a.1.total_cmp(&b.1));
    picks
}

fn entities(picks: &[(Entity, f32)]) -> Vec<Entity> {
    picks.iter().map(|(entity, _)| *entity).collect()
}

#[test]
fn a_pointer_hits_the_exact_shape_of_the_front_body() {
    let (mut app, camera) = picking_app();
    // A ring across the view: the ray hits its box, but not its shape.
    let ring = MedialAxis::torus(1.0, 0.1, 16).unwrap();
    let around =
        spawn_still(&mut app, ring, Transform::from_xyz(0.0, 0.0, -3.0).with_rotation(Quat::from_rotation_x(1.57)));
    let front = spawn_still(&mut app, MedialAxis::sphere(0.5).unwrap(), Transform::from_xyz(0.0, 0.0, -5.0));
    let behind = spawn_still(
        &mut app,
        MedialAxis::sphere(0.5).unwrap(),
        Transform::from_xyz(0.0, 0.0, -9.0).with_scale(Vec3::splat(2.0)),
    );
    let wall = app.world_mut().spawn((StaticObb::new(2.0, 2.0, 0.5), Transform::from_xyz(0.0, 0.0, -12.0))).id();
    let picks = picked(&mut app);
    assert_eq!(entities(&picks), [front, behind, wall], "the pointer passes through the ring {around}");
    let near = PerspectiveProjection::default().near;
    for ((_, depth), expected) in picks.iter().zip([4.5, 8.0, 11.5]) {
        assert!((depth + near - expected).abs() < 1e-3, "{depth} instead of {expected}");
    }
    let hits = &app.world().resource::<Hits>().0;
    assert!(hits.iter().all(|hits| hits.order == 3.0 && hits.pointer == PointerId::Mouse));
    for (_, hit) in hits.iter().flat_map(|hits| &hits.picks) {
        assert_eq!(hit.camera, camera);
        assert!(hit.normal.unwrap().distance(Vec3::Z) < 1e-3, "{:?}", hit.normal);
    }
    // Only the front body is hovered over.
    assert_eq!(app.world().resource::<Over>().0, [front]);
    // In another orientation the ring is in front of the bodies.
    app.world_mut().get_mut::<Transform>(around).unwrap().rotation = Quat::IDENTITY;
    let picks = picked(&mut app);
    assert_eq!(entities(&picks), [around, front, behind, wall]);
    assert!((picks[0].1 + near - 1.9).abs() < 0.02, "{}", picks[0].1);
    assert_eq!(app.world().resource::<Over>().0, [front, around]);
}

#[test]
fn a_hit_on_a_flat_box_has_the_normal_of_its_face() {
    let (mut app, _) = picking_app();
    let flat = StaticObb::new(2.0, 2.0, 0.0);
    for (x, y) in [(0.0, 0.0), (0.3, -1.7)] {
        let wall = app.world_mut().spawn((flat, Transform::from_xyz(x, y, -4.0))).id();
        assert_eq!(entities(&picked(&mut app)), [wall]);
        let hits = &app.world().resource::<Hits>().0;
        assert_eq!(hits[0].picks[0].1.normal, Some(Vec3::Z));
        app.world_mut().despawn(wall);
    }
}

#[test]
fn unpickable_bodies_do_not_hide_bodies_behind() {
    let (mut app, _) = picking_app();
    let ball = || MedialAxis::sphere(0.5).unwrap();
    let front = spawn_still(&mut app, ball(), Transform::from_xyz(0.0, 0.0, -5.0));
    let behind = spawn_still(&mut app, ball(), Transform::from_xyz(0.0, 0.0, -9.0));
    app.world_mut().entity_mut(front).insert(Pickable::IGNORE);
    assert_eq!(entities(&picked(&mut app)), [behind]);
    // The front body cannot be hovered over, but hides the other one.
    app.world_mut().entity_mut(front).insert(Pickable { is_hoverable: false, should_block_lower: true });
    app.world_mut().resource_mut::<Over>().0.clear();
    assert_eq!(entities(&picked(&mut app)), [front, behind]);
    app.world_mut().entity_mut(front).remove::<Pickable>().insert(InheritedVisibility::HIDDEN);
    assert_eq!(entities(&picked(&mut app)), [behind]);
    assert_eq!(app.world().resource::<Over>().0, [behind]);
    app.world_mut().resource_mut::<MedialPickingSettings>().visible_only = false;
    assert_eq!(entities(&picked(&mut app)), [front, behind]);
}

#[test]
fn required_markers_limit_picking_to_marked_entities() {
    let (mut app, camera) = picking_app();
    let ball = || MedialAxis::sphere(0.5).unwrap();
    spawn_still(&mut app, ball(), Transform::from_xyz(0.0, 0.0, -5.0));
    let marked = spawn_still(&mut app, ball(), Transform::from_xyz(0.0, 0.0, -9.0));
    app.world_mut().entity_mut(marked).insert(Pickable::default());
    assert_eq!(picked(&mut app).len(), 2);
    app.world_mut().resource_mut::<MedialPickingSettings>().require_markers = true;
    assert_eq!(picked(&mut app), []);
    app.world_mut().entity_mut(camera).insert(MedialPickingCamera);
    assert_eq!(entities(&picked(&mut app)), [marked]);
}
