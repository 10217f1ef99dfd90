//! Bodies are picked and thrown with the mouse. A pressed body follows the pointer, at a constant distance from the camera, until the button is released.

use bevy::{picking::pointer::PointerButton, prelude::*, ui::Pressed, window::PrimaryWindow};
use bevy_medial::{prelude::*, scenes::SceneEntity};
use bevy_panorbit_camera::PanOrbitCamera;
use bevy_rapier3d::prelude::{RapierConfiguration, RigidBody, Velocity};

/// Speed of a held body divided by its distance from the pointer, in 1/s.
const PULL: f32 = 12.0;
/// Max speed of a held body, in metres per second.
const FASTEST: f32 = 25.0;
/// Factor on the angular velocity of a held body in each step.
const SPIN_LEFT: f32 = 0.9;

/// The body that is held.
#[derive(Resource)]
struct Held {
    body: Entity,
    /// The point at which the body was taken, in the frame of the body.
    grip: Vec3,
    /// Distance of that point from the camera, along the ray of the pointer.
    depth: f32,
}

pub fn plugin(app: &mut App) {
    app.add_observer(take).add_systems(Update, (let_go, (pull.run_if(resource_exists::<Held>), keep_camera)).chain());
}

fn take(
    press: On<Pointer<Press>>,
    mut commands: Commands,
    bodies: Query<(&RigidBody, &GlobalTransform), (With<SceneEntity>, With<MedialMesh>)>,
    camera: Single<&GlobalTransform, With<Camera3d>>,
) {
    let Some(place) = press.hit.position.filter(|_| press.button == PointerButton::Primary) else { return };
    if let Ok((RigidBody::Dynamic, transform)) = bodies.get(press.entity) {
        let grip = transform.affine().inverse().transform_point3(place);
        let depth = camera.translation().distance(place);
        commands.insert_resource(Held { body: press.entity, grip, depth });
    }
}

fn let_go(mut commands: Commands, buttons: Res<ButtonInput<MouseButton>>) {
    if !buttons.pressed(MouseButton::Left) {
        commands.remove_resource::<Held>();
    }
}

/// Disables the camera while the mouse holds a body or a button.
fn keep_camera(held: Option<Res<Held>>, pressed: Query<(), With<Pressed>>, mut camera: Single<&mut PanOrbitCamera>) {
    camera.enabled = held.is_none() && pressed.is_empty();
}

fn pull(
    held: Res<Held>,
    window: Single<&Window, With<PrimaryWindow>>,
    camera: Single<(&Camera, &GlobalTransform), With<Camera3d>>,
    rapier: Query<&RapierConfiguration>,
    mut bodies: Query<(&GlobalTransform, &mut Velocity)>,
    mut lines: Gizmos,
) {
    let Some(ray) = window.cursor_position().and_then(|at| camera.0.viewport_to_world(camera.1, at).ok()) else {
        return;
    };
    let Ok((transform, mut velocity)) = bodies.get_mut(held.body) else { return };
    // The origin of the ray is on the near plane, but `depth` starts at the camera.
    let target = camera.1.translation() + ray.direction * held.depth;
    let grip = transform.transform_point(held.grip);
    lines.line(grip, target, Color::BLACK);
    // In frames without a step, the velocity does not change.
    if rapier.iter().any(|rapier| rapier.physics_pipeline_active) {
        velocity.linear = ((target - grip) * PULL).clamp_length_max(FASTEST);
        velocity.angular *= SPIN_LEFT;
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use bevy::{
        camera::{CameraProjection, ComputedCameraValues, NormalizedRenderTarget, RenderTargetInfo},
        diagnostic::DiagnosticsPlugin,
        picking::{
            InteractionPlugin,
            pointer::{Location, PointerAction, PointerId, PointerInput, PointerLocation},
        },
        time::TimeUpdateStrategy,
        window::WindowRef,
    };
    use bevy_medial::plugin::MedialPickingPlugin;
    use bevy_rapier3d::prelude::{GravityScale, TimestepMode};

    use super::*;

    const SIZE: UVec2 = UVec2::new(400, 300);
    const DT: f32 = 1.0 / 60.0;

    /// A camera that looks along -z at a ball five metres away, and the mouse in the middle of its view.
    struct Stage {
        app: App,
        window: Entity,
        ball: Entity,
    }

    impl Stage {
        fn new() -> Self {
            let mut app = App::new();
            app.add_plugins((MinimalPlugins, AssetPlugin::default(), TransformPlugin, DiagnosticsPlugin))
                .add_plugins((MedialPhysicsPlugins::default(), MedialPickingPlugin, InteractionPlugin, plugin))
                .add_plugins(MedialDebugPlugin { enabled: false })
                .init_gizmo_group::<DefaultGizmoConfigGroup>()
                .init_resource::<ButtonInput<MouseButton>>()
                .insert_resource(TimestepMode::Fixed { dt: DT, substeps: 1 })
                .insert_resource(TimeUpdateStrategy::ManualDuration(Duration::from_secs_f32(DT)));
            let window = app.world_mut().spawn((Window::default(), PrimaryWindow)).id();
            let ball = app.world_mut().resource_mut::<Assets<_>>().add(MedialAxis::sphere(0.3).unwrap());
            let ball = (SceneEntity, RigidBody::Dynamic, MedialMesh(ball), GravityScale(0.0), Velocity::zero());
            let ball = app.world_mut().spawn((ball, Transform::from_xyz(0.0, 0.0, -5.0))).id();
            let mut stage = Self { app, window, ball };
            let pointer = PointerLocation::new(stage.location(SIZE.as_vec2() * 0.5));
            stage.app.world_mut().spawn((PointerId::Mouse, pointer));
            let target_info = Some(RenderTargetInfo { physical_size: SIZE, scale_factor: 1.0 });
            let clip_from_view = PerspectiveProjection::default().get_clip_from_view();
            let computed = ComputedCameraValues { clip_from_view, target_info, ..default() };
            let camera = (Camera3d::default(), Camera { computed, ..default() }, PanOrbitCamera::default());
            stage.app.world_mut().spawn((camera, Transform::default()));
            stage.point_at(SIZE.as_vec2() * 0.5);
            stage.update(3);
            stage
        }

        fn location(&self, position: Vec2) -> Location {
            let target = WindowRef::Primary.normalize(Some(self.window)).unwrap();
            Location { target: NormalizedRenderTarget::Window(target), position }
        }

        fn point_at(&mut self, place: Vec2) {
            let mut window = self.app.world_mut().get_mut::<Window>(self.window).unwrap();
            window.set_cursor_position(Some(place));
        }

        fn press(&mut self, button: PointerButton) {
            let location = self.location(SIZE.as_vec2() * 0.5);
            let world = self.app.world_mut();
            world.write_message(PointerInput::new(PointerId::Mouse, location, PointerAction::Press(button)));
            world.resource_mut::<ButtonInput<MouseButton>>().press(MouseButton::Left);
            self.update(1);
        }

        fn release(&mut self) {
            self.app.world_mut().resource_mut::<ButtonInput<MouseButton>>().release(MouseButton::Left);
            self.update(1);
        }

        fn update(&mut self, frames: u32) {
            (0..frames).for_each(|_| self.app.update());
        }

        fn holds(&self) -> bool {
            self.app.world().contains_resource::<Held>()
        }

        fn camera_is_free(&mut self) -> bool {
            let world = self.app.world_mut();
            world.query::<&PanOrbitCamera>().single(world).unwrap().enabled
        }

        fn ball(&self) -> (Vec3, Vec3) {
            let ball = self.app.world().entity(self.ball);
            (ball.get::<Transform>().unwrap().translation, ball.get::<Velocity>().unwrap().linear)
        }
    }

    #[test]
    fn a_body_that_is_pressed_follows_the_mouse_and_flies_on_when_it_is_let_go() {
        let mut stage = Stage::new();
        assert!(!stage.holds() && stage.camera_is_free());
        stage.press(PointerButton::Primary);
        stage.update(1);
        assert!(stage.holds() && !stage.camera_is_free());
        assert!(stage.ball().1.length() < 0.05, "a taken body moves although the mouse does not: {:?}", stage.ball());
        // The pointer moves to the right by a quarter of the view, and the front of the ball follows its ray.
        stage.point_at(Vec2::new(300.0, 150.0));
        stage.update(5);
        let (place, velocity) = stage.ball();
        assert!(place.x > 0.1 && velocity.x > 1.0 && velocity.x <= FASTEST, "{place} {velocity}");
        stage.release();
        assert!(!stage.holds() && stage.camera_is_free());
        let (thrown, _) = stage.ball();
        stage.update(30);
        let (place, velocity_after) = stage.ball();
        assert!(place.x > thrown.x + 0.4 && velocity_after.x > 0.5 * velocity.x, "{place} {velocity_after}");
    }

    #[test]
    fn a_body_that_is_held_comes_to_rest_at_the_pointer() {
        let mut stage = Stage::new();
        stage.press(PointerButton::Primary);
        stage.point_at(Vec2::new(300.0, 150.0));
        stage.update(120);
        let (place, velocity) = stage.ball();
        // The pointer is halfway from the middle to the edge of a view of aspect 1. The grip is the front of the ball, 4.7 m from the camera.
        let slope = (PerspectiveProjection::default().fov * 0.5).tan() * 0.5;
        let target = Vec3::new(slope, 0.0, -1.0).normalize() * 4.7;
        let grip = place + Vec3::Z * 0.3;
        assert!(grip.distance(target) < 0.01 && velocity.length() < 0.05, "{place} {velocity}");
    }

    #[test]
    fn other_buttons_and_fixed_bodies_take_nothing() {
        let mut stage = Stage::new();
        stage.press(PointerButton::Secondary);
        stage.update(1);
        assert!(!stage.holds());
        let mut stage = Stage::new();
        let ball = stage.ball;
        stage.app.world_mut().entity_mut(ball).insert(RigidBody::Fixed);
        stage.update(1);
        stage.press(PointerButton::Primary);
        stage.update(1);
        assert!(!stage.holds());
    }
}
