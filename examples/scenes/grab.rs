//! Bodies are picked and thrown with the mouse: one that is pressed follows the pointer, at the distance at which it was taken, until it is let go.

use bevy::{picking::pointer::PointerButton, prelude::*, ui::Pressed, window::PrimaryWindow};
use bevy_medial::{prelude::*, scenes::SceneEntity};
use bevy_panorbit_camera::PanOrbitCamera;
use bevy_rapier3d::prelude::{RapierConfiguration, RigidBody, Velocity};

/// Parts of the way to the pointer that a body goes in a second.
const PULL: f32 = 12.0;
/// Greatest speed by which a body follows, in metres per second.
const FASTEST: f32 = 25.0;
/// What is left of the spin of a held body after a step.
const SPIN_LEFT: f32 = 0.9;

/// The body that is held.
#[derive(Resource)]
struct Held {
    body: Entity,
    /// Where it was taken, in its own frame.
    grip: Vec3,
    /// Distance from the camera along the pointer's ray.
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

/// The camera keeps still while the mouse holds a body or a button.
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
    let (grip, target) = (transform.transform_point(held.grip), ray.get_point(held.depth));
    lines.line(grip, target, Color::BLACK);
    // Frames without a step leave it as it is.
    if rapier.iter().any(|rapier| rapier.physics_pipeline_active) {
        velocity.linear = ((target - grip) * PULL).clamp_length_max(FASTEST);
        velocity.angular *= SPIN_LEFT;
    }
}
