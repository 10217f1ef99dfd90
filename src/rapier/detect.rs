//! Runs the pipeline over the motion that rapier has solved, and applies the result.

use bevy::{
    ecs::system::{StaticSystemParam, SystemParamItem},
    platform::time::Instant,
    prelude::*,
};
use bevy_rapier3d::prelude::BevyPhysicsHooks;

use super::{
    carry::carry,
    context::Context,
    gather::{Gather, Gathered},
    hooks,
    last_step::LastStep,
    owed::{OwedTime, stop_bodies},
    snapshot::RapierStep,
};
use crate::{
    pipeline::{Pair, PairFilter},
    plugin::{MedialCcd, MedialSettings, MedialStep},
};

/// Sweeps bodies along the motion that rapier has solved, and stops them at their first impact.
pub(super) fn detect<Hooks>(
    mut step: ResMut<MedialStep>,
    rapier: RapierStep,
    ccd: Query<&'static MedialCcd>,
    settings: Res<MedialSettings>,
    mut contexts: Query<Context>,
    hooks: StaticSystemParam<Hooks>,
    mut owed: ResMut<OwedTime>,
    mut last: Local<LastStep>,
) where
    Hooks: 'static + BevyPhysicsHooks,
    for<'w, 's> SystemParamItem<'w, 's, Hooks>: BevyPhysicsHooks,
{
    // Without a step, the output of the last step stays valid. Changes by the user count in the next step.
    if !contexts.iter().any(|context| rapier.runs(&context)) {
        return;
    }
    let clock = Instant::now();
    let step = step.as_mut();
    step.settings = *settings;
    let mut gather = Gather { step, rapier: &rapier, ccd: &ccd, owed: &owed };
    let Gathered { worlds, astray, .. } = gather.run(&contexts, &mut last);
    let hooks = hooks.into_inner();
    step.snapshot_time = rapier.snapshot.took + clock.elapsed();
    step.run(|step, first, second| {
        let Ok(context) = contexts.get(step.context(first)) else { return PairFilter::Apart };
        let pair = [first, second].map(|side| step.info(side).collider());
        let narrow_phase = &context.simulation.narrow_phase;
        hooks::meeting(&hooks, pair, &context.bodies.bodies, &context.colliders.colliders, narrow_phase)
    });
    let clock = Instant::now();
    step.impulses = step.output.pairs.iter().map(|pair| impulse(step, pair, &contexts)).collect();
    // A context that is paused keeps the times of its bodies.
    let before = owed.take(|context| contexts.get(context).map_or(true, |context| rapier.runs(&context)));
    for (world, (entity, dt)) in (0..).zip(&worlds) {
        if let Ok(context) = contexts.get_mut(*entity) {
            stop_bodies(step, &astray, world, *dt, context, &before, &mut owed);
        }
    }
    carry(step, &mut contexts);
    step.move_time = clock.elapsed();
}

/// Returns the impulse of the solver on the second side of a pair, along the normals of the contacts.
fn impulse(step: &MedialStep, pair: &Pair, contexts: &Query<Context>) -> Vec3 {
    let [first, second] = [pair.first, pair.second].map(|side| step.info(side).collider());
    let context = contexts.get(step.context(pair.first)).ok();
    let contact = context.and_then(|context| context.simulation.narrow_phase.contact_pair(first, second));
    contact.map_or(Vec3::ZERO, |contact| {
        let impulse = contact.total_impulse();
        if contact.collider1 == first { impulse } else { -impulse }
    })
}
