//! Response through rapier: medial bodies are colliders with a custom shape, and rapier asks our dispatcher for their contacts.
//!
//! ```text
//! SyncBackend      attach: the collider of each loaded shape
//! -- Snapshot      quarantine of what is not finite; poses and velocities at the start of the step
//! StepSimulation   rapier solves; the dispatcher answers from the last step's table, or computes
//! -- Detect        the step of the pipeline from start to solved poses; bodies stop at their first impact; the table for
//!                  the next step
//! Writeback
//! -- Report        messages, events and diagnostics
//! ```
//!
//! One pass of the pipeline serves both ends: the impacts of this step, and the contacts of the next, whose start is this end.
//! A body that is moved in between is no longer where the table knows it, and its contacts are computed on demand.

mod attach;
mod cast;
mod detect;
mod dispatcher;
mod parts;
mod quarantine;
mod shape;
mod table;

use bevy::{
    ecs::{intern::Interned, schedule::ScheduleLabel},
    prelude::*,
};
use bevy_rapier3d::{
    parry::query::{DefaultQueryDispatcher, QueryDispatcher},
    plugin::context::RapierContextSimulation,
    prelude::{NoUserData, PhysicsSet, RapierPhysicsPlugin},
    rapier::geometry::NarrowPhase,
};

use crate::plugin::MedialSystems;

pub use dispatcher::MedialDispatcher;
pub use shape::MedialShape;
pub use table::ContactTable;

/// Adds rapier, if it is not there yet, and the systems around its step.
pub(crate) fn add_systems(app: &mut App, schedule: Interned<dyn ScheduleLabel>) {
    if !app.is_plugin_added::<RapierPhysicsPlugin<NoUserData>>() {
        app.add_plugins(RapierPhysicsPlugin::<NoUserData>::default().in_schedule(schedule));
    }
    app.init_resource::<ContactTable>()
        .init_resource::<detect::Snapshot>()
        .configure_sets(
            schedule,
            (
                MedialSystems::Attach.before(PhysicsSet::SyncBackend),
                MedialSystems::Snapshot.after(PhysicsSet::SyncBackend).before(PhysicsSet::StepSimulation),
                MedialSystems::Detect.after(PhysicsSet::StepSimulation).before(PhysicsSet::Writeback),
                MedialSystems::Report.after(PhysicsSet::Writeback).before(TransformSystems::Propagate),
            ),
        )
        // Later than this, the pairs that rapier's broad phase knows already would be lost.
        .add_systems(Startup, install_dispatcher)
        .add_systems(
            schedule,
            (attach::detach, attach::attach_shapes, attach::attach_boxes).chain().in_set(MedialSystems::Attach),
        )
        .add_systems(
            schedule,
            (attach::wake_attached, quarantine::release, quarantine::isolate, detect::snapshot)
                .chain()
                .in_set(MedialSystems::Snapshot),
        )
        .add_systems(
            schedule,
            (quarantine::isolate, detect::gather_statics, detect::detect).chain().in_set(MedialSystems::Detect),
        );
}

fn install_dispatcher(table: Res<ContactTable>, mut contexts: Query<&mut RapierContextSimulation>) {
    for mut simulation in &mut contexts {
        let dispatcher = MedialDispatcher { table: table.clone() };
        simulation.narrow_phase = NarrowPhase::with_query_dispatcher(dispatcher.chain(DefaultQueryDispatcher));
        // Rapier would keep the old contacts of a pair that has hardly moved: of one that has just stopped at its impact, too.
        simulation.integration_parameters.contact_recycling = false;
    }
}
