//! Response through rapier: medial bodies are colliders with a custom shape, and rapier asks our dispatcher for their contacts.
//!
//! ```text
//! SyncBackend      attach: the collider of each loaded shape
//! -- Snapshot      quarantine of what is not finite; poses and velocities at the start of the step
//! StepSimulation   rapier solves; the dispatcher answers from the last step's table, or computes
//! -- Detect        the step of the pipeline from start to solved poses; bodies stop at their first impact; the table for
//!                  the next step; finer solver steps for fast pairs in contact
//! Writeback
//! -- Report        messages, events and diagnostics
//! ```
//!
//! One pass of the pipeline serves both ends: the impacts of this step, and the contacts of the next, whose start is this end.
//! A body that is moved in between is no longer where the table knows it, and its contacts are computed on demand.
//!
//! # Values that cannot be computed with
//!
//! A body whose transform, velocity or force is not finite, or beyond [`MAX_MAGNITUDE`](crate::constants::MAX_MAGNITUDE), is disabled by a
//! `RigidBodyDisabled` (a collider without a body of its own by a `ColliderDisabled`), with a warning that names the entity. It comes back when it
//! is set to finite values. This holds for rapier's own bodies as well, since what they touch would be next, as long as the app has a medial mesh
//! or a static box.
//!
//! # Saving and restoring
//!
//! A copy of the context in memory replays to the same bits: clone `RapierRigidBodySet`, `RapierContextColliders`, `RapierContextJoints` and, of
//! `RapierContextSimulation`, which is no `Clone`, the fields `islands`, `broad_phase`, `narrow_phase` and `ccd_solver`; put them back with a new
//! `PhysicsPipeline`, and the `Transform` and `Velocity` of each body with them; for `TimestepMode::Interpolated` the context's
//! `SimulationToRenderTime` as well, and the resource [`OwedTime`]. No entity that has a body may have come or
//! gone in between. Messages of touches continue from the last one that was sent.
//! A file cannot hold it: parry reads no custom shape back, and a narrow phase that is read back has lost its dispatcher. There, save the
//! components (`Transform`, `Velocity`, `MedialMesh` by its path) and spawn them again: contacts then start without what the solver knew of
//! them.

mod attach;
mod detect;
mod dispatcher;
mod hooks;
mod interpolation;
mod joints;
mod motion;
mod parts;
mod points;
mod primitive;
mod quarantine;
pub mod query;
mod rays;
mod shape;
mod shape_cast;
mod substeps;
mod table;

use bevy::{
    ecs::{intern::Interned, schedule::ScheduleLabel, system::SystemParamItem},
    prelude::*,
    transform::{StaticTransformOptimizations, systems::mark_dirty_trees},
};
use bevy_rapier3d::{
    parry::query::{DefaultQueryDispatcher, QueryDispatcher},
    plugin::{RapierTransformPropagateSet, context::RapierContextSimulation, systems::update_character_controls},
    prelude::{BevyPhysicsHooks, CollisionEvent, PhysicsSet, RapierPhysicsPlugin, RigidBody},
    rapier::geometry::NarrowPhase,
};

use crate::plugin::{MedialMesh, MedialStep, MedialSystems, StaticObb};

pub use detect::OwedTime;
pub use dispatcher::MedialDispatcher;
pub use query::MedialQueries;
pub use shape::MedialShape;
pub use table::ContactTable;

/// Adds rapier, if it is not there yet, and the systems around its step.
///
/// # Panics
/// If rapier is there with other hooks.
pub(crate) fn add_systems<Hooks>(app: &mut App, schedule: Interned<dyn ScheduleLabel>)
where
    Hooks: 'static + BevyPhysicsHooks,
    for<'w, 's> SystemParamItem<'w, 's, Hooks>: BevyPhysicsHooks,
{
    if !app.is_plugin_added::<RapierPhysicsPlugin<Hooks>>() {
        // Whatever its hooks are, it brings these messages.
        let other = app.world().contains_resource::<Messages<CollisionEvent>>();
        assert!(!other, "RapierPhysicsPlugin has other hooks: name them by MedialPhysicsPlugin::with_hooks");
        app.add_plugins(RapierPhysicsPlugin::<Hooks>::default().in_schedule(schedule));
    } else if !has_rapier(app, schedule) {
        warn!(
            "RapierPhysicsPlugin does not step in {schedule:?}, so that nothing would stop at an impact: \
             give MedialPhysicsPlugin the same schedule, by in_schedule or in_fixed_schedule"
        );
    }
    app.add_observer(attach::detach_shape)
        .add_observer(attach::detach_box)
        .add_observer(attach::note_freed::<ChildOf>)
        .add_observer(attach::note_freed::<RigidBody>)
        .init_resource::<attach::Freed>()
        .init_resource::<ContactTable>()
        .register_type::<ContactTable>()
        .init_resource::<OwedTime>()
        .register_type::<OwedTime>()
        .init_resource::<detect::Snapshot>()
        .init_resource::<quarantine::Running>()
        .configure_sets(
            schedule,
            (
                MedialSystems::Attach.before(PhysicsSet::SyncBackend),
                MedialSystems::Snapshot.after(PhysicsSet::SyncBackend).before(PhysicsSet::StepSimulation),
                MedialSystems::Detect.after(PhysicsSet::StepSimulation).before(PhysicsSet::Writeback),
                MedialSystems::Report.after(PhysicsSet::Writeback).before(TransformSystems::Propagate),
            ),
        )
        .add_systems(
            schedule,
            (
                install_dispatcher,
                attach::attach_shapes,
                attach::attach_boxes,
                attach::keep_unscaled,
                attach::follow_bodies,
            )
                .chain()
                .in_set(MedialSystems::Attach),
        )
        // Rapier propagates transforms without: what is set on an entity with children, by rapier's characters too, would be lost.
        .add_systems(
            schedule,
            mark_dirty_trees
                .run_if(resource_exists::<StaticTransformOptimizations>)
                .in_set(PhysicsSet::SyncBackend)
                .after(update_character_controls)
                .before(RapierTransformPropagateSet),
        )
        .add_systems(
            schedule,
            (
                attach::keep_contacts_fresh,
                attach::wake_attached,
                quarantine::release,
                (quarantine::isolate, detect::snapshot).chain().run_if(is_needed),
            )
                .chain()
                .in_set(MedialSystems::Snapshot),
        )
        .add_systems(
            schedule,
            (
                quarantine::isolate_results,
                (detect::detect::<Hooks>, substeps::refine, interpolation::show_stops)
                    .chain()
                    .run_if(detect::has_stepped),
            )
                .chain()
                .run_if(is_needed)
                .in_set(MedialSystems::Detect),
        )
        .add_systems(schedule, detect::note_step.in_set(PhysicsSet::StepSimulation));
}

/// True if an entity has a medial mesh or a static box, or if the last step had bodies, whose contacts have to end. Without, no system loops over
/// rapier's bodies.
fn is_needed(shapes: Query<(), Or<(With<MedialMesh>, With<StaticObb>)>>, step: Res<MedialStep>) -> bool {
    !shapes.is_empty() || !step.input.bodies.is_empty()
}

/// True if rapier steps in a schedule.
fn has_rapier(app: &App, schedule: Interned<dyn ScheduleLabel>) -> bool {
    let step = PhysicsSet::StepSimulation.intern();
    app.get_schedule(schedule).is_some_and(|schedule| schedule.graph().system_sets.get_key(step).is_some())
}

/// Before a world has its first collider: later the pairs that rapier's broad phase knows already would be lost.
fn install_dispatcher(
    table: Res<ContactTable>,
    mut contexts: Query<&mut RapierContextSimulation, Added<RapierContextSimulation>>,
) {
    for mut simulation in &mut contexts {
        let dispatcher = MedialDispatcher { table: table.clone() };
        simulation.narrow_phase = NarrowPhase::with_query_dispatcher(dispatcher.chain(DefaultQueryDispatcher));
    }
}
