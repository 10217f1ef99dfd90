//! Runs the pipeline around rapier's step: records the poses before it, sweeps bodies along the motion that rapier has solved, and applies the result.

use std::{sync::Arc, time::Duration};

use bevy::{
    ecs::{
        query::QueryData,
        system::{StaticSystemParam, SystemParam, SystemParamItem},
    },
    platform::{collections::HashMap, time::Instant},
    prelude::*,
};
use bevy_rapier3d::{
    parry::shape::SharedShape,
    plugin::context::{
        RapierContextColliders, RapierContextJoints, RapierContextSimulation, RapierRigidBodySet,
        SimulationToRenderTime,
    },
    prelude::{BevyPhysicsHooks, RapierConfiguration, TimestepMode},
    rapier::{
        dynamics::{RigidBody as RapierBody, RigidBodyHandle, RigidBodyType},
        geometry::{Collider as RapierCollider, ColliderHandle},
    },
};

use super::{
    hooks,
    joints::{assemblies, kept_apart},
    motion::motion,
    parts::solid,
    shape::MedialShape,
    table::{ContactTable, SecondKey},
};
use crate::{
    geometry::{Pose3, Sweep},
    pipeline::{Body, Groups, Meeting, Pace, Reach, StaticBody, Statics, Stop},
    plugin::{BodyInfo, MedialCcd, MedialSettings, MedialStep},
};

/// A rapier context: a world. Bodies of different worlds do not collide.
#[derive(QueryData)]
#[query_data(mutable)]
pub(super) struct Context {
    pub entity: Entity,
    pub bodies: &'static mut RapierRigidBodySet,
    pub colliders: &'static RapierContextColliders,
    joints: &'static RapierContextJoints,
    pub simulation: &'static RapierContextSimulation,
    configuration: &'static RapierConfiguration,
    lead: &'static SimulationToRenderTime,
}

impl ContextReadOnlyItem<'_, '_> {
    fn reach(&self) -> Reach {
        let parameters = &self.simulation.integration_parameters;
        Reach::new(parameters.prediction_distance(), parameters.length_unit)
    }

    /// Returns true if the world has a medial collider.
    fn is_medial(&self) -> bool {
        self.colliders.colliders.iter().any(|(_, collider)| medial(collider).is_some())
    }

    fn body(&self, collider: &RapierCollider) -> Option<&RapierBody> {
        self.bodies.bodies.get(collider.parent()?)
    }
}

/// Poses and velocities of colliders before rapier's step.
#[derive(Resource, Default)]
pub(super) struct Snapshot {
    starts: HashMap<(Entity, ColliderHandle), Start>,
    /// [`SimulationToRenderTime`] of each world before the step: rendered time minus simulated time, in seconds.
    leads: HashMap<Entity, f32>,
    /// True if rapier's step has run since the snapshot. A condition on its system set may skip it.
    stepped: bool,
    took: Duration,
}

#[derive(Clone, Copy)]
struct Start {
    pose: Pose3,
    linear: Vec3,
    angular: Vec3,
}

/// Returns the pose of a collider in the world, from the pose of its body. After a change by the user, the body's pose is newer than that of the collider.
pub(super) fn collider_pose(collider: &RapierCollider, body: Option<&RapierBody>) -> Pose3 {
    rigid(match (body, collider.position_wrt_parent()) {
        (Some(body), Some(local)) => body.position() * local,
        _ => *collider.position(),
    })
}

/// Returns the pose with a normalized rotation. Sheared transform hierarchies give rotations that are not normalized. Normalized poses keep their bits.
pub(super) fn rigid(pose: Pose3) -> Pose3 {
    let length = pose.rotation.length();
    if pose.rotation.is_normalized() || length == 0.0 {
        return pose;
    }
    Pose3::from_parts(pose.translation, pose.rotation / length)
}

fn medial(collider: &RapierCollider) -> Option<&MedialShape> {
    collider.shape().as_shape::<MedialShape>()
}

/// Returns the motion of a collider in `dt` seconds at the velocity of its body.
fn pace(collider: &RapierCollider, body: &RapierBody, dt: f32) -> Pace {
    let radius = collider.shape().compute_local_bounding_sphere().radius;
    Pace { way: body.linvel() * dt, rotation: body.angvel() * dt, radius }
}

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
    let snapshot = snapshot.as_mut();
    let mut paces = HashMap::new();
    let mut reach = Reach::new(0.0, 0.0);
    let dt = to_come(&mode, &time);
    snapshot.starts.clear();
    snapshot.leads.clear();
    snapshot.leads.extend(contexts.iter().map(|context| (context.entity, context.lead.diff)));
    snapshot.stepped = false;
    for context in contexts.iter().filter(|context| context.is_medial()) {
        let Reach { prediction, length_unit, .. } = context.reach();
        reach.prediction = reach.prediction.max(prediction);
        reach.length_unit = reach.length_unit.max(length_unit);
        for (handle, collider) in context.colliders.colliders.iter() {
            let body = context.body(collider);
            let Some(moving) = body.filter(|body| !body.is_fixed()) else { continue };
            let owed = collider.parent().and_then(|parent| owed.0.get(&(context.entity, parent)));
            let seconds = dt + owed.map_or(0.0, |owed| owed.seconds);
            let pace = pace(collider, moving, seconds);
            // The dispatcher cannot distinguish colliders that share a shape. The fastest one counts, because the reach of a slower one would include bodies
            // that the fastest one only passes.
            let known = paces.entry(SecondKey::of(collider.shape())).or_insert(pace);
            if pace.against(&Pace::REST) > known.against(&Pace::REST) {
                *known = pace;
            }
            let (linear, angular) = (moving.linvel(), moving.angvel());
            let start = Start { pose: collider_pose(collider, body), linear, angular };
            snapshot.starts.insert((context.entity, handle), start);
        }
    }
    let colliders = contexts.iter().filter(|context| context.is_medial()).map(|context| context.colliders);
    table.prepare(paces, reach, step.contacts(), colliders);
    snapshot.took = clock.elapsed();
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
fn to_come(mode: &TimestepMode, time: &Time) -> f32 {
    match *mode {
        TimestepMode::Interpolated { dt, time_scale, .. } => dt * time_scale,
        TimestepMode::Variable { max_dt, time_scale, .. } => (time.delta_secs() * time_scale).min(max_dt),
        TimestepMode::Fixed { dt, .. } => dt,
    }
}

/// Information about the last step of rapier.
#[derive(SystemParam)]
pub(super) struct RapierStep<'w> {
    snapshot: Res<'w, Snapshot>,
    mode: Res<'w, TimestepMode>,
    time: Res<'w, Time>,
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
    fn simulated(&self, context: &ContextReadOnlyItem) -> f32 {
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

/// Returns the collision groups and the solver groups.
fn groups(collider: &RapierCollider) -> [Groups; 2] {
    [collider.collision_groups(), collider.solver_groups()]
        .map(|groups| Groups { memberships: groups.memberships.bits(), filter: groups.filter.bits() })
}

/// Returns the type of a collider's body, and the types that it collides with. Pairs without a dynamic body are always included, even if rapier skips them,
/// because they only report contacts and stop no body.
fn types(collider: &RapierCollider, body: Option<&RapierBody>) -> Groups {
    use RigidBodyType::{Dynamic, Fixed, KinematicPositionBased, KinematicVelocityBased};
    let own = body.map_or(Fixed, RapierBody::body_type);
    let active = collider.active_collision_types();
    let all = [Dynamic, Fixed, KinematicPositionBased, KinematicVelocityBased].into_iter();
    let collides = |other| active.test(own, other) || (own != Dynamic && other != Dynamic);
    let filter = all.filter(|&other| collides(other)).fold(0, |bits, other| bits | 1 << other as u32);
    Groups { memberships: 1 << own as u32, filter }
}

/// Returns the world axes along which the body cannot move.
fn locked(body: &RapierBody) -> BVec3 {
    let bits = body.locked_axes().bits();
    BVec3::new(bits & 1 != 0, bits & 2 != 0, bits & 4 != 0)
}

/// Returns the index of a collider in rapier's order.
fn order(collider: ColliderHandle) -> u32 {
    collider.into_raw_parts().0
}

/// Returns an id of a rigid body. Two bodies that exist at the same time have different ids.
fn owner(world: u32, body: RigidBodyHandle) -> u64 {
    u64::from(world) << 32 | u64::from(body.into_raw_parts().0)
}

/// A collider that does not move, with all properties that the pipeline uses.
#[derive(Clone)]
pub(super) struct Fixed {
    entity: Entity,
    collider: ColliderHandle,
    shape: SharedShape,
    pose: Pose3,
    owner: Option<u64>,
    groups: [Groups; 2],
    types: Groups,
    world: u32,
    sensor: bool,
    passes: bool,
}

impl PartialEq for Fixed {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.shape.0, &other.shape.0)
            && (self.entity, self.collider, self.pose, self.groups, self.types)
                == (other.entity, other.collider, other.pose, other.groups, other.types)
            && (self.owner, self.world, self.sensor, self.passes)
                == (other.owner, other.world, other.sensor, other.passes)
    }
}

fn sensors(fixed: &[Fixed]) -> impl Iterator<Item = &Fixed> {
    fixed.iter().filter(|item| item.sensor)
}

/// Runs the pipeline over the motion that rapier has solved, stops bodies at their first impact and fills the contact table.
pub(super) fn detect<Hooks>(
    mut step: ResMut<MedialStep>,
    rapier: RapierStep,
    ccd: Query<&MedialCcd>,
    settings: Res<MedialSettings>,
    mut contexts: Query<Context>,
    hooks: StaticSystemParam<Hooks>,
    mut owed: ResMut<OwedTime>,
    mut known: Local<Vec<Fixed>>,
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
    // Poses of sleeping bodies. A body that sleeps at another pose was moved there, e.g. by restoring a context, so its pairs are searched once.
    let sleepers: HashMap<Entity, Pose3> = std::iter::zip(&step.infos, &step.input.bodies)
        .filter(|(info, _)| info.asleep)
        .map(|(info, body)| (info.entity, body.sweep.end))
        .collect();
    step.input.prediction = 0.0;
    step.input.length_unit = 0.0;
    step.input.core_depth = settings.core_depth;
    step.input.apart.clear();
    step.input.bodies.clear();
    step.infos.clear();
    let mut worlds: Vec<(Entity, f32)> = Vec::new();
    let mut fixed = Vec::new();
    let to_come = to_come(&rapier.mode, &rapier.time);
    // Bodies that sleep at the same pose as in the last step.
    let mut resting = Vec::new();
    // Bodies whose sweep does not end at rapier's pose.
    let mut astray = Vec::new();
    for context in contexts.iter().sort::<Entity>().filter(|context| context.is_medial()) {
        let world = worlds.len() as u32;
        let running = rapier.runs(&context);
        let dt = rapier.simulated(&context);
        worlds.push((context.entity, dt));
        let Reach { prediction, length_unit, .. } = context.reach();
        step.input.prediction = step.input.prediction.max(prediction);
        step.input.length_unit = step.input.length_unit.max(length_unit);
        let owner = |body| owner(world, body);
        step.input.apart.extend(kept_apart(context.joints).into_iter().map(|pair| {
            let [a, b] = pair.map(owner);
            [a.min(b), a.max(b)]
        }));
        let assemblies = assemblies(context.joints, &context.bodies.bodies);
        // Iterate in the order of the handles, because rapier orders pairs by them.
        for (handle, collider) in context.colliders.colliders.iter().filter(|(_, collider)| collider.is_enabled()) {
            let Some(entity) = context.colliders.collider_entity(handle) else { continue };
            let body = context.body(collider);
            let end = collider_pose(collider, body);
            let sensor = collider.is_sensor();
            let types = types(collider, body);
            let passes = sensor || ccd.get(entity).is_ok_and(|ccd| !ccd.enabled);
            let Some((body, parent)) = body.zip(collider.parent()).filter(|(body, _)| !body.is_fixed()) else {
                let (shape, pose, groups) = (collider.shared_shape().clone(), end, groups(collider));
                let (collider, owner) = (handle, collider.parent().map(owner));
                fixed.push(Fixed { entity, collider, shape, pose, owner, groups, types, world, sensor, passes });
                continue;
            };
            let Some(solid) = solid(collider.shared_shape()) else { continue };
            let start = rapier.snapshot.starts.get(&(context.entity, handle)).filter(|_| running).copied();
            let start = start.unwrap_or(Start { pose: end, linear: Vec3::ZERO, angular: Vec3::ZERO });
            let center = end.inverse_transform_point(body.center_of_mass());
            let simulated = running && body.is_enabled();
            let active = simulated && (!body.is_sleeping() || sleepers.get(&entity) != Some(&end));
            if simulated && !active {
                resting.push((step.input.bodies.len(), sensor || !body.is_dynamic()));
            }
            let [groups, stop_groups] = groups(collider);
            // A link of a multibody cannot be moved by itself.
            let linked = context.joints.multibody_joints.rigid_body_link(parent).is_some();
            // Sleeping bodies count too: a fast kinematic body would pass through them before rapier finds a contact.
            let stops = simulated && body.is_dynamic() && !linked;
            let motion = if stops { motion } else { Sweep::between };
            let mut held = false;
            let mut sweep = motion(start.pose, end, center, body.angvel() * dt);
            if let Some(owed) = owed.0.get(&(context.entity, parent)).filter(|_| active && stops) {
                sweep = owed.longer(&sweep, body);
                held = owed.is_full;
            }
            if sweep.end != end {
                astray.push(step.input.bodies.len() as u32);
            }
            // Rapier computes the velocity of a kinematic body within the step, so it is taken from the sweep.
            let (linear, angular) = if running && body.is_kinematic() {
                (sweep.translation / dt, sweep.rotation / dt)
            } else {
                (start.linear, start.angular)
            };
            step.input.bodies.push(Body {
                solid,
                sweep,
                order: order(handle),
                id: Some(entity.to_bits()),
                groups,
                types,
                stop_groups,
                owner: Some(owner(parent)),
                assembly: Some(owner(assemblies.get(&parent).copied().unwrap_or(parent))),
                world,
                active,
                stops,
                passes,
                sensor,
                locked: locked(body),
                held,
                core_depth: ccd.get(entity).ok().and_then(|ccd| ccd.core_depth).unwrap_or(settings.core_depth),
                pace: Some(pace(collider, body, to_come)),
            });
            step.infos.push(BodyInfo {
                entity,
                collider: handle,
                sensor,
                // Bodies of a paused world are treated like sleeping bodies.
                asleep: !running || body.is_sleeping(),
                center: start.pose.transform_point(center),
                linear,
                angular,
            });
        }
    }
    step.worlds = worlds.iter().map(|(entity, _)| *entity).collect();
    step.dt = worlds.first().map_or(0.0, |(_, dt)| *dt);
    // The lengths differ if the user has replaced the resource, because the new one has no statics.
    if fixed != *known || step.static_infos.len() != fixed.len() {
        // Rapier wakes no body when a sensor is added, removed or moved, and no sensor or kinematic body when a static changes. Pairs of these bodies are
        // searched once, so that touch messages are correct.
        let is_for_all = sensors(&fixed).ne(sensors(&known));
        for (body, _) in resting.into_iter().filter(|(_, is_told_alone)| is_for_all || *is_told_alone) {
            step.input.bodies[body].active = true;
        }
        set_statics(step, &fixed);
        *known = fixed;
    }
    let hooks = hooks.into_inner();
    step.snapshot_time = rapier.snapshot.took + clock.elapsed();
    step.run(|step, first, second| {
        let Ok(context) = contexts.get(step.context(first)) else { return Meeting::Apart };
        let pair = [first, second].map(|side| step.info(side).collider);
        let narrow_phase = &context.simulation.narrow_phase;
        hooks::meeting(&hooks, pair, &context.bodies.bodies, &context.colliders.colliders, narrow_phase)
    });
    let clock = Instant::now();
    let before = std::mem::take(&mut owed.0);
    for (world, (entity, dt)) in (0..).zip(&worlds) {
        if let Ok(context) = contexts.get_mut(*entity) {
            stop_bodies(step, &astray, world, *dt, context, &before, &mut owed.0);
        }
    }
    step.move_time = clock.elapsed();
}

/// Rebuilds the statics after one of them was added, removed or changed.
fn set_statics(step: &mut MedialStep, fixed: &[Fixed]) {
    let mut bodies = Vec::new();
    step.static_infos.clear();
    for item in fixed {
        let Some(solid) = solid(&item.shape) else { continue };
        let [groups, stop_groups] = item.groups;
        let &Fixed { entity, collider, pose, owner, types, world, sensor, passes, .. } = item;
        let (order, id) = (order(collider), Some(entity.to_bits()));
        bodies.push(StaticBody { solid, pose, order, id, owner, groups, types, stop_groups, world, passes, sensor });
        step.static_infos.push(BodyInfo { collider, sensor, ..BodyInfo::at_rest(entity) });
    }
    step.statics = Statics::new(bodies);
}

/// Moves stopped bodies back to their impacts, so that the next step solves a true contact at a true pose. The rest of the step is owed to the body, and the
/// velocity that gravity has added for this time is removed until the time is used.
///
/// Bodies whose sweep does not end at rapier's pose are moved to the end of the sweep.
fn stop_bodies(
    step: &MedialStep,
    astray: &[u32],
    world: u32,
    dt: f32,
    context: ContextItem,
    before: &HashMap<BodyKey, Owed>,
    owed: &mut HashMap<BodyKey, Owed>,
) {
    let ContextItem { entity, mut bodies, colliders, configuration, .. } = context;
    // The shapes of one body stop together, so the body is moved once.
    let mut last = None;
    let end = |&body: &u32| Stop { body, fraction: 1.0, pose: step.input.bodies[body as usize].sweep.end };
    let ends = astray.iter().filter(|body| step.output.stop_of(**body).is_none()).map(end);
    let mut stops: Vec<Stop> = step.output.stops.iter().copied().chain(ends).collect();
    stops.retain(|stop| step.input.bodies[stop.body as usize].world == world);
    stops.sort_by_key(|stop| step.input.bodies[stop.body as usize].owner);
    for stop in stops {
        let owner = step.input.bodies[stop.body as usize].owner;
        if std::mem::replace(&mut last, owner) == owner {
            continue;
        }
        let BodyInfo { collider, asleep, .. } = step.infos[stop.body as usize];
        // Do not wake a sleeping body that does not move.
        if asleep && stop.pose == step.input.bodies[stop.body as usize].sweep.start {
            continue;
        }
        let Some(collider) = colliders.colliders.get(collider) else { continue };
        let local = collider.position_wrt_parent().copied().unwrap_or(Pose3::IDENTITY);
        let Some(parent) = collider.parent() else { continue };
        if let Some(body) = bodies.bodies.get_mut(parent) {
            body.set_position(stop.pose * local.inverse(), true);
            let known = before.get(&(entity, parent)).copied().unwrap_or_default();
            let gained = gained(body, step.infos[stop.body as usize].linear, configuration.gravity * dt);
            let left = Owed { seconds: dt + known.seconds, velocity: gained + known.velocity, is_full: false };
            let rest = left.times(1.0 - stop.fraction);
            body.set_linvel(body.linvel() + known.velocity - rest.velocity, true);
            if rest.seconds > 0.0 {
                // At most one step is owed. If more is left, the body turns more slowly by the same factor, because it would gain energy otherwise.
                let kept = (dt / rest.seconds).min(1.0);
                body.set_angvel(body.angvel() * kept, true);
                owed.insert((entity, parent), Owed { is_full: kept < 1.0, ..rest.times(kept) });
            }
        }
    }
}

/// Time that is owed to bodies that stopped at an impact. Their next step is longer by this time.
///
/// This resource has to be [saved and restored](super) with a world.
#[derive(Resource, Clone, Debug, Default, Reflect)]
#[reflect(Resource, Default, Clone)]
pub struct OwedTime(#[reflect(ignore, clone)] HashMap<BodyKey, Owed>);

/// The context and the handle of a rigid body.
type BodyKey = (Entity, RigidBodyHandle);

#[derive(Clone, Copy, Debug, Default)]
struct Owed {
    seconds: f32,
    /// Velocity that gravity adds in this time, in metres per second.
    velocity: Vec3,
    /// True if more than a step would be owed without the limit.
    is_full: bool,
}

impl Owed {
    fn times(self, factor: f32) -> Self {
        Self { seconds: self.seconds * factor, velocity: self.velocity * factor, ..self }
    }

    /// Extends the motion of a body by the owed time.
    fn longer(&self, sweep: &Sweep, body: &RapierBody) -> Sweep {
        let turn = body.angvel() * self.seconds;
        let center = sweep.end.transform_point(sweep.local_center) + (body.linvel() + self.velocity) * self.seconds;
        let rotation = (Quat::from_scaled_axis(turn) * sweep.end.rotation).normalize();
        let end = Pose3::from_parts(center - rotation * sweep.local_center, rotation);
        Sweep::between(sweep.start, end, sweep.local_center, sweep.rotation + turn)
    }
}

/// Returns the part of the velocity change `fall` by gravity that shows in the velocity of a body. `before`: velocity before the step. A body that a contact
/// holds up has gained no velocity, and no body gains velocity along locked axes.
fn gained(body: &RapierBody, before: Vec3, fall: Vec3) -> Vec3 {
    let free = Vec3::select(body.mass_properties().effective_inv_mass.cmpgt(Vec3::ZERO), Vec3::ONE, Vec3::ZERO);
    let fall = free * fall * body.gravity_scale();
    let shown = (body.linvel() - before).dot(fall) / fall.length_squared();
    if shown > 0.0 { fall * shown.min(1.0) } else { Vec3::ZERO }
}
