//! Bodies that rapier shows between its steps.

use bevy::prelude::*;
use bevy_rapier3d::{prelude::TransformInterpolation, rapier::geometry::Collider};

use super::detect::{ContextReadOnly, RapierStep};
use crate::{pipeline::Side, plugin::MedialStep};

/// Of the steps of a frame rapier shows the way from where the last one began. Who has stopped in an earlier one was never there, which may be beyond
/// a wall: it is shown where it stopped.
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
        let collider = context.colliders.colliders.get(step.info(side).collider);
        let Some(handle) = collider.and_then(Collider::parent) else { continue };
        if let Some(body) = context.bodies.bodies.get(handle)
            && let Some(entity) = context.bodies.rigid_body_entity(handle)
            && let Ok(mut shown) = shown.get_mut(entity)
        {
            shown.start = Some(*body.position());
        }
    }
}
