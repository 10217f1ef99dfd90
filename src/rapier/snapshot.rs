//! Poses and velocities before rapier's step, and the contacts for it.

use std::time::Duration;

use bevy::{
    ecs::system::SystemParam,
    platform::{collections::HashMap, time::Instant},
    prelude::*,
};
use bevy_rapier3d::{prelude::TimestepMode, rapier::geometry::ColliderHandle};

use super::{
    context::{Context, ContextReadOnlyItem, collider_pose, displacement},
    owed::OwedTime,
    table::{ContactTable, Displacements, SecondKey},
};
use crate::{
    geometry::Pose3,
    pipeline::{ContactMargin, Displacement},
    plugin::MedialStep,
};

/// Poses and velocities of colliders before rapier's step.
#[derive(Resource, Default)]
pub(super) struct Snapshot {
    /// Colliders of awake bodies, by the entity of the context. The others are at rest.
    pub starts: HashMap<(Entity, ColliderHandle), Start>,
    /// [`SimulationToRenderTime`] of each world before the step: rendered time minus simulated time, in seconds.
    pub leads: HashMap<Entity, f32>,
    /// True if rapier's step has run since the snapshot. A condition on its system set may skip it.
    stepped: bool,
    /// A buffer for the displacements of the next step.
    displacements: Displacements,
    pub took: Duration,
}

#[derive(Clone, Copy, Default)]
pub(super) struct Start {
    pub pose: Pose3,
    pub linear: Vec3,
    pub angular: Vec3,
}

impl Start {
    /// A body at rest.
    pub fn at_rest(pose: Pose3) -> Self {
        Self { pose, linear: Vec3::ZERO, angular: Vec3::ZERO }
    }
}

/// Records poses and velocities, and passes the contacts of the last step to rapier.
pub(super) fn snapshot(
    mut snapshot: ResMut<Snapshot>,
    step: Res<MedialStep>,
    table: Res<ContactTable>,
    mode: Res<TimestepMode>,
    time: Res<Time>,
    owed: Res<OwedTime>,
    contexts: Query<Context>,
) {
    let clock = Instant::now();
    let Snapshot { starts, leads, stepped, displacements, took } = snapshot.as_mut();
    displacements.clear();
    let mut reach = ContactMargin::new(0.0, 0.0);
    let dt = to_come(&mode, &time);
    starts.clear();
    leads.clear();
    leads.extend(contexts.iter().map(|context| (context.entity, context.lead.diff)));
    *stepped = false;
    for context in contexts.iter().filter(|context| context.is_medial()) {
        let ContactMargin { prediction, length_unit, .. } = context.reach();
        reach.prediction = reach.prediction.max(prediction);
        reach.length_unit = reach.length_unit.max(length_unit);
        for (handle, collider, moving) in context.awake() {
            let owed = collider.parent().and_then(|parent| owed.get(context.entity, parent));
            let seconds = dt + owed.map_or(0.0, |owed| owed.seconds);
            let displacement = displacement(collider, moving, context.configuration.gravity, seconds);
            // The dispatcher cannot distinguish colliders that share a shape. The fastest one counts, because a slow one also has contacts with bodies that it only
            // passes.
            let known = displacements.entry(SecondKey::of(collider.shape())).or_insert(displacement);
            if displacement.against(&Displacement::REST) > known.against(&Displacement::REST) {
                *known = displacement;
            }
            let (linear, angular) = (moving.linvel(), moving.angvel());
            let pose = collider_pose(collider, Some(moving));
            starts.insert((context.entity, handle), Start { pose, linear, angular });
        }
    }
    let colliders = contexts.iter().filter(|context| context.is_medial()).map(|context| context.colliders);
    table.prepare(displacements, reach, step.contacts(), colliders);
    *took = clock.elapsed();
}

/// Records that rapier's step runs. This system is in rapier's step set, so the same run conditions apply.
pub(super) fn note_step(mut snapshot: ResMut<Snapshot>) {
    snapshot.stepped = true;
}

/// Returns true if rapier's step has run since the snapshot.
pub(super) fn has_stepped(snapshot: Res<Snapshot>) -> bool {
    snapshot.stepped
}

/// Returns an estimate of the time that rapier will simulate in the next step, in seconds.
pub(super) fn to_come(mode: &TimestepMode, time: &Time) -> f32 {
    match *mode {
        TimestepMode::Interpolated { dt, time_scale, .. } => dt * time_scale,
        TimestepMode::Variable { max_dt, time_scale, .. } => (time.delta_secs() * time_scale).min(max_dt),
        TimestepMode::Fixed { dt, .. } => dt,
    }
}

/// Returns true if rapier's next step has a length.
pub(super) fn takes_time(mode: Res<TimestepMode>, time: Res<Time>) -> bool {
    to_come(&mode, &time) != 0.0
}

/// Information about the last step of rapier.
#[derive(SystemParam)]
pub(super) struct RapierStep<'w> {
    pub snapshot: Res<'w, Snapshot>,
    pub mode: Res<'w, TimestepMode>,
    pub time: Res<'w, Time>,
}

impl RapierStep<'_> {
    /// Returns the number of steps of length `dt` that rapier has run for a world in this frame.
    pub fn steps(&self, context: &ContextReadOnlyItem) -> f32 {
        let TimestepMode::Interpolated { dt, .. } = *self.mode else { return 1.0 };
        // A world that was added after the snapshot starts at 0.
        let lead = self.snapshot.leads.get(&context.entity).copied().unwrap_or(0.0);
        ((lead + self.time.delta_secs() - context.lead.diff) / dt).round()
    }

    /// Returns the time that rapier has simulated for a world, in seconds.
    pub fn simulated(&self, context: &ContextReadOnlyItem) -> f32 {
        match *self.mode {
            TimestepMode::Interpolated { dt, time_scale, .. } => self.steps(context) * dt * time_scale,
            TimestepMode::Fixed { .. } | TimestepMode::Variable { .. } => context.simulation.integration_parameters.dt,
        }
    }

    /// Returns false for a paused world, and in a frame without a step.
    pub fn runs(&self, context: &ContextReadOnlyItem) -> bool {
        context.configuration.physics_pipeline_active && self.simulated(context) > 0.0
    }
}
