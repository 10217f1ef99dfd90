//! Fixed steps with interpolated transforms.

use bevy::prelude::*;
use bevy_rapier3d::{
    prelude::{RigidBody, TimestepMode, TransformInterpolation},
    rapier::geometry::Collider,
};

use super::{context::ContextReadOnly, snapshot::RapierStep};
use crate::{pipeline::Side, plugin::MedialStep};

/// Fixes the number of steps per second, and interpolates the transforms of all bodies.
pub(super) fn fix_steps(app: &mut App, rate: f32) {
    let is_valid = rate.is_finite() && rate > 0.0;
    if !is_valid {
        error!("MedialPhysicsPlugins::fixed: {rate} is not a positive number of steps per second, so 60 is used");
    }
    let dt = if is_valid { rate.recip() } else { 1.0 / 60.0 };
    app.insert_resource(TimestepMode::Interpolated { dt, time_scale: 1.0, substeps: 1 });
    // The app may have registered the component before.
    let _ = app.try_register_required_components::<RigidBody, TransformInterpolation>();
}

/// Corrects the start pose of `TransformInterpolation` for bodies that stopped.
///
/// If a frame has several steps, rapier interpolates from the pose at the start of the last step. A body that stopped in an earlier step was never at this
/// pose, and the pose may be behind a wall. Such a body is shown at the pose where it stopped.
pub(super) fn show_stops(
    step: Res<MedialStep>,
    rapier: RapierStep,
    contexts: Query<ContextReadOnly>,
    mut shown: Query<&mut TransformInterpolation>,
) {
    for stop in &step.output.stops {
        let side = Side::Body(stop.body);
        let Ok(context) = contexts.get(step.context(side)) else { continue };
        let steps = rapier.steps(&context);
        if stop.fraction * steps > steps - 1.0 {
            continue;
        }
        let collider = context.colliders.colliders.get(step.info(side).collider());
        let Some(handle) = collider.and_then(Collider::parent) else { continue };
        if let Some(body) = context.bodies.bodies.get(handle)
            && let Some(entity) = context.bodies.rigid_body_entity(handle)
            && let Ok(mut shown) = shown.get_mut(entity)
        {
            shown.start = Some(*body.position());
        }
    }
}
