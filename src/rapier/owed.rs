//! Bodies that stop within a step: they are moved back to their impacts, and the rest of the step is owed to them.

use bevy::{platform::collections::HashMap, prelude::*};
use bevy_rapier3d::rapier::dynamics::{RigidBody as RapierBody, RigidBodyHandle};

use super::context::ContextItem;
use crate::{
    geometry::{Pose3, Sweep},
    pipeline::Stop,
    plugin::MedialStep,
};

/// Time that is owed to bodies that stopped at an impact. Their next step is longer by this time.
///
/// This resource has to be [saved and restored](super) with a world.
#[derive(Resource, Clone, Debug, Default, Reflect)]
#[reflect(Resource, Default, Clone)]
pub struct OwedTime(#[reflect(ignore, clone)] HashMap<BodyKey, Owed>);

/// The context and the handle of a rigid body.
type BodyKey = (Entity, RigidBodyHandle);

impl OwedTime {
    /// Returns the time that is owed to a body of a context.
    pub(super) fn get(&self, context: Entity, body: RigidBodyHandle) -> Option<&Owed> {
        self.0.get(&(context, body))
    }

    /// Removes the times of all bodies in some contexts, and returns all times.
    pub(super) fn take(&mut self, is_taken: impl Fn(Entity) -> bool) -> Self {
        let all = self.clone();
        self.0.retain(|(context, _), _| !is_taken(*context));
        all
    }
}

/// Time that is owed to a body.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Owed {
    pub seconds: f32,
    /// Velocity that gravity adds in this time, in metres per second.
    velocity: Vec3,
}

impl Owed {
    fn times(self, factor: f32) -> Self {
        Self { seconds: self.seconds * factor, velocity: self.velocity * factor }
    }

    /// Extends the motion of a body by the owed time, in which gravity accelerates it evenly.
    pub fn longer(&self, sweep: &Sweep, body: &RapierBody) -> Sweep {
        let turn = body.angvel() * self.seconds;
        let center =
            sweep.end.transform_point(sweep.local_center) + (body.linvel() + 0.5 * self.velocity) * self.seconds;
        let rotation = (Quat::from_scaled_axis(turn) * sweep.end.rotation).normalize();
        let end = Pose3::from_parts(center - rotation * sweep.local_center, rotation);
        Sweep::between(sweep.start, end, sweep.local_center, sweep.rotation + turn)
    }
}

/// Returns the acceleration of a body by gravity, in metres per second squared. Gravity accelerates no body along locked axes.
fn acceleration(body: &RapierBody, gravity: Vec3) -> Vec3 {
    let free = Vec3::select(body.mass_properties().effective_inv_mass.cmpgt(Vec3::ZERO), Vec3::ONE, Vec3::ZERO);
    free * gravity * body.gravity_scale()
}

/// Returns the part of the velocity change `fall` by gravity that shows in the velocity of a body. `before`: velocity before the step. A body that a contact
/// holds up has gained no velocity.
fn gained(body: &RapierBody, before: Vec3, fall: Vec3) -> Vec3 {
    let shown = (body.linvel() - before).dot(fall) / fall.length_squared();
    if shown > 0.0 { fall * shown.min(1.0) } else { Vec3::ZERO }
}

/// Returns a velocity without its part along `fall`, up to the length of `fall`.
fn slower(velocity: Vec3, fall: Vec3) -> Vec3 {
    let down = fall.normalize_or_zero();
    velocity - (down * velocity.dot(down).max(0.0)).clamp_length_max(fall.length())
}

/// Moves stopped bodies back to their impacts, so that the next step solves a true contact at a true pose. The rest of the step is owed to the body, and the
/// velocity that gravity has added for this time is removed until the time is used.
///
/// Bodies whose sweep does not end at rapier's pose are moved to the end of the sweep.
pub(super) fn stop_bodies(
    step: &MedialStep,
    astray: &[u32],
    world: u32,
    dt: f32,
    context: ContextItem,
    before: &OwedTime,
    owed: &mut OwedTime,
) {
    let ContextItem { entity, mut bodies, colliders, configuration, .. } = context;
    // The shapes of one body stop together, so the body is moved once.
    let mut last = None;
    let end = |&body: &u32| Stop { body, fraction: 1.0, pose: step.input.bodies[body as usize].sweep.end };
    let ends = astray.iter().filter(|body| step.output.stop_of(**body).is_none()).map(end);
    let mut stops: Vec<Stop> = step.output.stops.iter().copied().chain(ends).collect();
    stops.retain(|stop| step.input.bodies[stop.body as usize].world == world);
    stops.sort_by_key(|stop| step.input.bodies[stop.body as usize].rigid_body);
    for stop in stops {
        let rigid_body = step.input.bodies[stop.body as usize].rigid_body;
        if std::mem::replace(&mut last, rigid_body) == rigid_body {
            continue;
        }
        let info = &step.infos[stop.body as usize];
        // Do not wake a sleeping body that does not move.
        if info.asleep && stop.pose == step.input.bodies[stop.body as usize].sweep.start {
            continue;
        }
        let Some(collider) = colliders.colliders.get(info.collider()) else { continue };
        let local = collider.position_wrt_parent().copied().unwrap_or(Pose3::IDENTITY);
        let Some(parent) = collider.parent() else { continue };
        if let Some(body) = bodies.bodies.get_mut(parent) {
            body.set_position(stop.pose * local.inverse(), true);
            let known = before.get(entity, parent).copied().unwrap_or_default();
            let acceleration = acceleration(body, configuration.gravity);
            let gained = gained(body, info.linear, acceleration * dt);
            let left = Owed { seconds: dt + known.seconds, velocity: gained + known.velocity };
            let rest = left.times(1.0 - stop.fraction);
            // At most one step is owed, and the rest is lost. The body must gain no energy from lost time, so its spin shrinks with it, to zero after a lost step.
            // A contact or a joint may have passed on the weight of the body. The velocity does not show that part of gravity, so the fall loses it.
            let owed_share = (dt / rest.seconds).min(1.0);
            let lost = (rest.seconds - dt).max(0.0);
            let spin = if lost > 0.0 { 1.0 - lost / dt.max(known.seconds) } else { 1.0 };
            let hidden = (acceleration * rest.seconds - rest.velocity) * (1.0 - owed_share);
            body.set_linvel(slower(body.linvel() + known.velocity - rest.velocity, hidden), true);
            body.set_angvel(body.angvel() * spin, true);
            if rest.seconds > 0.0 {
                owed.0.insert((entity, parent), rest.times(owed_share));
            }
        }
    }
}
