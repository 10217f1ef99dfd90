//! Response through rapier: medial bodies are colliders with a custom shape, and rapier gets their contacts from this crate's query dispatcher.
//!
//! ```text
//! SyncBackend      attach: insert the collider of each loaded shape
//! -- Snapshot      disable bodies with invalid values; record poses and velocities at the start of the step
//! StepSimulation   rapier solves; the dispatcher returns contacts from the last step's table, or computes them
//! -- Detect        run the pipeline from start poses to solved poses; stop bodies at their first impact; fill the table for
//!                  the next step; set more solver iterations for fast pairs in contact
//! Writeback
//! -- Report        messages, events and diagnostics; correct transforms of bodies below turned parents
//! ```
//!
//! One pass of the pipeline finds the impacts of this step and the contacts of the next step, because the next step starts where this one ends.
//! If a body is moved between the steps, the table has no entry for its new pose, and its contacts are computed on demand.
//!
//! # Invalid values
//!
//! A body is disabled if its transform, velocity or force is not finite, or if its transform or velocity exceeds
//! [`MAX_MAGNITUDE`](crate::constants::MAX_MAGNITUDE). It gets a `RigidBodyDisabled`; a collider without a body of its own gets a `ColliderDisabled`. A
//! warning names the entity. The body is enabled again when it is set to valid values. This applies to bodies without a medial mesh too, because invalid
//! values spread through contacts. It requires that the app has a medial mesh or a static box.
//!
//! # Saving and restoring
//!
//! A copy of the context in memory replays to the same bits. Clone:
//!
//! - `RapierRigidBodySet`, `RapierContextColliders` and `RapierContextJoints`;
//! - the fields `islands`, `broad_phase`, `narrow_phase`, `ccd_solver` and `integration_parameters` of `RapierContextSimulation`, which is not `Clone`;
//! - the `Transform` and `Velocity` of each body;
//! - the resource [`OwedTime`];
//! - [`MedialStep::contacts`](crate::plugin::MedialStep::contacts);
//! - the context's `SimulationToRenderTime`, for `TimestepMode::Interpolated`.
//!
//! Put the clones back together with a new `PhysicsPipeline`. No entity with a body may have been spawned or despawned in between. Messages of touches
//! continue from the last one that was sent.
//!
//! The context cannot be saved to a file: parry cannot deserialize custom shapes, and a deserialized narrow phase has lost its dispatcher. Save the
//! components instead (`Transform`, `Velocity`, and the path of the `MedialMesh`) and spawn the entities again. The solver then starts without warm-start
//! data of the contacts.

mod attach;
mod carry;
mod context;
mod detect;
mod dispatcher;
mod gather;
mod hierarchy;
mod hooks;
mod interpolation;
mod joints;
mod last_step;
mod motion;
mod owed;
mod parts;
mod points;
mod primitive;
mod quarantine;
pub mod query;
mod ragdoll;
mod rays;
#[cfg(feature = "gltf_scenes")]
mod scene;
mod shape;
mod shape_cast;
mod skinned;
mod snapshot;
mod substeps;
mod table;
mod waiting;

use std::marker::PhantomData;

use bevy::{
    app::AnimationSystems,
    ecs::{
        intern::Interned,
        schedule::{ScheduleConfigs, ScheduleLabel},
        system::{ScheduleSystem, SystemParamItem},
    },
    prelude::*,
    transform::{StaticTransformOptimizations, systems::mark_dirty_trees},
};
use bevy_rapier3d::{
    parry::query::{DefaultQueryDispatcher, QueryDispatcher},
    plugin::{RapierTransformPropagateSet, context::RapierContextSimulation, systems::update_character_controls},
    prelude::{BevyPhysicsHooks, CollisionEvent, NoUserData, PhysicsSet, RapierPhysicsPlugin, RigidBody},
    rapier::geometry::NarrowPhase,
};

use crate::plugin::{MedialMesh, MedialStep, MedialSystems, SkinnedMedialMesh, StaticObb};

pub use dispatcher::MedialDispatcher;
pub use owed::OwedTime;
pub use query::MedialQueries;
pub use ragdoll::MedialRagdoll;
pub use shape::MedialShape;
pub use table::ContactTable;

/// Response by rapier: medial bodies are its colliders, the step runs around its step, and bodies stop at their first impact.
///
/// Adds `RapierPhysicsPlugin` in the same schedule if it has not been added before. If the app needs its own, for example in another schedule, add it
/// *before* this plugin, in the schedule of this plugin and with the same type of hooks.
///
/// # Panics
/// When the plugin is added, if the app has a `RapierPhysicsPlugin` with other hooks.
#[derive(Clone, Copy, Debug)]
pub struct MedialResponsePlugin<Hooks = NoUserData> {
    schedule: Interned<dyn ScheduleLabel>,
    /// Steps per second, if their length is fixed.
    rate: Option<f32>,
    hooks: PhantomData<fn() -> Hooks>,
}

impl<Hooks> MedialResponsePlugin<Hooks> {
    /// Runs in the given schedule, which has to be that of the [`MedialCollisionPlugin`](crate::plugin::MedialCollisionPlugin). `rate`: steps per
    /// second, if their length is fixed; see [`MedialPhysicsPlugins::fixed`](crate::MedialPhysicsPlugins::fixed).
    pub fn new(schedule: impl ScheduleLabel, rate: Option<f32>) -> Self {
        Self { schedule: schedule.intern(), rate, hooks: PhantomData }
    }
}

impl<Hooks> Plugin for MedialResponsePlugin<Hooks>
where
    Hooks: 'static + BevyPhysicsHooks,
    for<'w, 's> SystemParamItem<'w, 's, Hooks>: BevyPhysicsHooks,
{
    fn build(&self, app: &mut App) {
        if let Some(rate) = self.rate {
            interpolation::fix_steps(app, rate);
        }
        add_rapier::<Hooks>(app, self.schedule);
        add_systems::<Hooks>(app, self.schedule);
    }
}

/// Adds the systems around rapier's step.
fn add_systems<Hooks>(app: &mut App, schedule: Interned<dyn ScheduleLabel>)
where
    Hooks: 'static + BevyPhysicsHooks,
    for<'w, 's> SystemParamItem<'w, 's, Hooks>: BevyPhysicsHooks,
{
    app.add_observer(attach::detach_shape)
        .add_observer(attach::detach_box)
        .add_observer(skinned::detach_skin)
        .add_observer(attach::note_freed::<ChildOf>)
        .add_observer(attach::note_freed::<RigidBody>)
        .init_resource::<attach::Freed>()
        .init_resource::<ContactTable>()
        .register_type::<ContactTable>()
        .init_resource::<OwedTime>()
        .register_type::<OwedTime>()
        .init_resource::<snapshot::Snapshot>()
        .init_resource::<quarantine::Running>();
    #[cfg(feature = "gltf_scenes")]
    app.add_observer(scene::insert_body);
    order_sets(app, schedule);
    let attach = (
        hierarchy::straighten,
        hierarchy::restore,
        attach::attach_shapes,
        attach::attach_boxes,
        attach::keep_unscaled,
        attach::follow_bodies,
        waiting::find,
    );
    let attach = (
        install_dispatcher,
        attach.chain().run_if(is_needed),
        waiting::hold_impulses.run_if(any_with_component::<waiting::Waiting>),
    );
    let place = (hierarchy::place_colliders, skinned::hold, attach::keep_contacts_fresh, attach::stiffen_contacts);
    let prepare = (
        place.chain().run_if(is_needed),
        attach::wake_attached,
        waiting::release.run_if(any_with_component::<waiting::Waiting>),
        // Runs in each step, because a change before the quarantine does not end it.
        quarantine::release,
        (quarantine::isolate, snapshot::snapshot).chain().run_if(is_needed),
    );
    let stop =
        (detect::detect::<Hooks>, substeps::refine, interpolation::show_stops).chain().run_if(snapshot::has_stepped);
    let pose = (skinned::follow_joints, skinned::replace_shapes, skinned::check_bodies)
        .chain()
        .run_if(any_with_component::<SkinnedMedialMesh>.and_then(snapshot::has_stepped));
    let detect = (quarantine::isolate_results, pose, stop).chain().run_if(is_needed);
    app.add_systems(schedule, attach.chain().in_set(MedialSystems::Attach))
        .add_systems(schedule, mark_moved_trees().in_set(PhysicsSet::SyncBackend))
        .add_systems(schedule, prepare.chain().in_set(MedialSystems::Snapshot))
        .add_systems(schedule, detect.in_set(MedialSystems::Detect))
        .add_systems(schedule, hierarchy::correct.run_if(is_needed).in_set(MedialSystems::Report))
        .add_systems(schedule, snapshot::note_step.in_set(PhysicsSet::StepSimulation));
}

/// Orders the plugin's sets and those of rapier.
fn order_sets(app: &mut App, schedule: Interned<dyn ScheduleLabel>) {
    app.configure_sets(
        schedule,
        (
            MedialSystems::Attach.before(PhysicsSet::SyncBackend),
            MedialSystems::Snapshot.after(PhysicsSet::SyncBackend).before(PhysicsSet::StepSimulation),
            MedialSystems::Detect.after(PhysicsSet::StepSimulation).before(PhysicsSet::Writeback),
            MedialSystems::Report.after(PhysicsSet::Writeback).before(TransformSystems::Propagate),
            // Even in a step without length, rapier's solver would change velocities.
            PhysicsSet::StepSimulation.run_if(snapshot::takes_time),
        ),
    );
    // Joints have the transforms of this frame's animation.
    app.configure_sets(schedule, RapierTransformPropagateSet.after(AnimationSystems));
}

/// Rapier propagates transforms without marking dirty trees. Changes to entities with children, such as those by character controllers, would be lost.
fn mark_moved_trees() -> ScheduleConfigs<ScheduleSystem> {
    mark_dirty_trees
        .run_if(resource_exists::<StaticTransformOptimizations>)
        .after(update_character_controls)
        .before(RapierTransformPropagateSet)
}

/// Adds `RapierPhysicsPlugin` unless the app has it. Warns if the app has it in another schedule.
fn add_rapier<Hooks>(app: &mut App, schedule: Interned<dyn ScheduleLabel>)
where
    Hooks: 'static + BevyPhysicsHooks,
    for<'w, 's> SystemParamItem<'w, 's, Hooks>: BevyPhysicsHooks,
{
    if !app.is_plugin_added::<RapierPhysicsPlugin<Hooks>>() {
        // A RapierPhysicsPlugin adds these messages, for any type of hooks.
        let other = app.world().contains_resource::<Messages<CollisionEvent>>();
        assert!(
            !other,
            "RapierPhysicsPlugin has other hooks: set the same hooks with MedialPhysicsPlugins::with_hooks"
        );
        app.add_plugins(RapierPhysicsPlugin::<Hooks>::default().in_schedule(schedule));
    } else if !has_rapier(app, schedule) {
        warn!(
            "RapierPhysicsPlugin does not step in {schedule:?}, so no body would stop at an impact: \
             give MedialPhysicsPlugins the same schedule with in_schedule or in_fixed_schedule"
        );
    }
}

/// Selects entities with a shape of this crate.
type AnyShape = Or<(With<MedialMesh>, With<SkinnedMedialMesh>, With<StaticObb>)>;

/// Returns true if an entity has a shape of this crate, or if the last step had bodies, because their contacts have to end. Otherwise apps with rapier's
/// shapes alone pay for few systems.
fn is_needed(shapes: Query<(), AnyShape>, step: Res<MedialStep>) -> bool {
    !shapes.is_empty() || !step.input.bodies.is_empty()
}

/// Returns true if rapier steps in a schedule.
fn has_rapier(app: &App, schedule: Interned<dyn ScheduleLabel>) -> bool {
    let step = PhysicsSet::StepSimulation.intern();
    app.get_schedule(schedule).is_some_and(|schedule| schedule.graph().system_sets.get_key(step).is_some())
}

/// Installs the dispatcher before a world has its first collider. Replacing the narrow phase later would lose the pairs that rapier's broad phase has reported.
fn install_dispatcher(
    table: Res<ContactTable>,
    mut contexts: Query<&mut RapierContextSimulation, Added<RapierContextSimulation>>,
) {
    for mut simulation in &mut contexts {
        let dispatcher = MedialDispatcher { table: table.clone() };
        simulation.narrow_phase = NarrowPhase::with_query_dispatcher(dispatcher.chain(DefaultQueryDispatcher));
    }
}
