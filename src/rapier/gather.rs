//! Input of a step: the bodies and statics of all worlds.

use std::sync::Arc;

use bevy::{platform::collections::HashMap, prelude::*};
use bevy_rapier3d::rapier::{
    dynamics::{RigidBody as RapierBody, RigidBodyHandle, RigidBodyType},
    geometry::{Collider as RapierCollider, ColliderHandle},
};

use super::{
    context::{Context, ContextReadOnlyItem, collider_pose, displacement, skin},
    joints::{joint_islands, kept_apart},
    last_step::{Fixed, LastBodies, LastStep},
    motion::motion,
    owed::OwedTime,
    parts::{shape_id, solid},
    snapshot::{RapierStep, Start, to_come},
};
use crate::{
    geometry::{Pose3, Sweep},
    pipeline::{Body, ContactMargin, Deforming, Displacement, Groups, Solid, StaticBody, Statics},
    plugin::{BodyInfo, MedialCcd, MedialStep},
};

/// Lists of a step that is being gathered.
#[derive(Default)]
pub(super) struct Gathered {
    /// The context of each world, and the time that rapier has simulated for it, in seconds.
    pub worlds: Vec<(Entity, f32)>,
    fixed: Vec<Fixed>,
    /// Bodies that sleep at the same pose as in the last step. True for sensors and for bodies that are not dynamic.
    resting: Vec<(usize, bool)>,
    /// Bodies whose sweep does not end at rapier's pose.
    pub astray: Vec<u32>,
}

/// Returns the linear and the angular velocity of a body in the step. Rapier computes those of a kinematic body within the step, so they follow from its
/// sweep. `dt`: the time that rapier has simulated, in seconds.
fn velocities(body: &RapierBody, start: &Start, sweep: &Sweep, dt: Option<f32>) -> [Vec3; 2] {
    match dt.filter(|_| body.is_kinematic()) {
        Some(dt) => [sweep.translation / dt, sweep.rotation / dt],
        None => [start.linear, start.angular],
    }
}

/// Returns true if a body is a link of a multibody.
fn is_link(context: &ContextReadOnlyItem, body: RigidBodyHandle) -> bool {
    context.joints.multibody_joints.rigid_body_link(body).is_some()
}

/// Gathers the input of a step.
pub(super) struct Gather<'a, 'w, 's> {
    pub step: &'a mut MedialStep,
    pub rapier: &'a RapierStep<'w>,
    pub ccd: &'a Query<'w, 's, &'static MedialCcd>,
    pub owed: &'a OwedTime,
}

/// A world that is being gathered.
struct World<'a, 'c> {
    index: u32,
    context: &'a ContextReadOnlyItem<'c, 'c>,
    /// True if rapier has simulated the world.
    running: bool,
    /// The time that rapier has simulated, in seconds.
    dt: f32,
    joint_islands: HashMap<RigidBodyHandle, RigidBodyHandle>,
}

impl Gather<'_, '_, '_> {
    /// Gathers all worlds with a medial collider.
    pub fn run(&mut self, contexts: &Query<Context>, LastStep { fixed, infos, bodies }: &mut LastStep) -> Gathered {
        let step = &mut *self.step;
        let worlds = std::mem::take(&mut step.worlds);
        std::mem::swap(&mut step.input.bodies, bodies);
        std::mem::swap(&mut step.infos, infos);
        step.input.bodies.clear();
        step.infos.clear();
        let mut last = LastBodies { infos, bodies, worlds, next: 0 };
        step.input.prediction = 0.0;
        step.input.length_unit = 0.0;
        step.input.core_depth = step.settings.core_depth;
        step.input.apart.clear();
        let mut gathered = Gathered::default();
        for context in contexts.iter().sort::<Entity>().filter(|context| context.is_medial()) {
            let world = World {
                index: gathered.worlds.len() as u32,
                running: self.rapier.runs(&context),
                dt: self.rapier.simulated(&context),
                joint_islands: joint_islands(context.joints, &context.bodies.bodies),
                context: &context,
            };
            gathered.worlds.push((context.entity, world.dt));
            self.add_world(&world, &mut last, &mut gathered);
        }
        self.step.worlds = gathered.worlds.iter().map(|(entity, _)| *entity).collect();
        self.step.dt = gathered.worlds.first().map_or(0.0, |(_, dt)| *dt);
        self.update_statics(&mut gathered, fixed);
        gathered
    }

    fn add_world(&mut self, world: &World, last: &mut LastBodies, gathered: &mut Gathered) {
        let context = world.context;
        let input = &mut self.step.input;
        let ContactMargin { prediction, length_unit, .. } = context.reach();
        input.prediction = input.prediction.max(prediction);
        input.length_unit = input.length_unit.max(length_unit);
        input.apart.extend(kept_apart(context.joints).into_iter().map(|pair| {
            let [a, b] = pair.map(|body| rigid_body_id(world.index, body));
            [a.min(b), a.max(b)]
        }));
        // Iterate in the order of the handles, because rapier orders pairs by them.
        for (handle, collider) in context.colliders.colliders.iter().filter(|(_, collider)| collider.is_enabled()) {
            let Some(entity) = context.colliders.collider_entity(handle) else { continue };
            let body = context.body(collider);
            if let Some(skin) = skin(collider) {
                let last = last.find(context.entity, handle);
                self.add_skin(world, entity, (handle, collider), skin, last);
                continue;
            }
            match body.zip(collider.parent()).filter(|(body, _)| !body.is_fixed()) {
                Some((body, parent)) => {
                    let last = last.find(context.entity, handle);
                    self.add_body(world, entity, (handle, collider), (parent, body), last, gathered);
                }
                None => gathered.fixed.push(Fixed {
                    entity,
                    body: collider.parent().and_then(|body| context.bodies.rigid_body_entity(body)),
                    collider: handle,
                    shape: collider.shared_shape().clone(),
                    pose: collider_pose(collider, body),
                    rigid_body: collider.parent().map(|body| rigid_body_id(world.index, body)),
                    groups: groups(collider),
                    types: types(collider, body),
                    world: world.index,
                    sensor: collider.is_sensor(),
                    passes: self.passes(entity, collider),
                }),
            }
        }
    }

    /// Returns true if no body stops at a collider.
    fn passes(&self, entity: Entity, collider: &RapierCollider) -> bool {
        collider.is_sensor() || self.ccd.get(entity).is_ok_and(|ccd| !ccd.enabled)
    }

    /// Returns the core depth of a collider, per metre of the bounding radius.
    fn core_depth(&self, entity: Entity) -> f32 {
        self.ccd.get(entity).ok().and_then(|ccd| ccd.core_depth).unwrap_or(self.step.settings.core_depth)
    }

    /// Adds a collider of a body that is not fixed.
    fn add_body(
        &mut self,
        world: &World,
        entity: Entity,
        (handle, collider): (ColliderHandle, &RapierCollider),
        (parent, body): (RigidBodyHandle, &RapierBody),
        last: Option<(&BodyInfo, &Body)>,
        gathered: &mut Gathered,
    ) {
        let World { index, context, running, dt, ref joint_islands } = *world;
        let (end, sensor) = (collider_pose(collider, Some(body)), collider.is_sensor());
        let slept_at = last.filter(|(info, _)| info.asleep).map(|(_, body)| body.sweep.end);
        let last = last.map(|(_, body)| body).filter(|body| body.solid.id() == shape_id(collider.shared_shape()));
        let resting = last.map(|body| body.sweep).filter(|sweep| slept_at == Some(end) && sweep.start == end);
        let Some(solid) = last.map(|body| body.solid.clone()).or_else(|| solid(collider.shared_shape())) else {
            return;
        };
        let start = self.start(world, handle, body, [slept_at.unwrap_or(end), end]);
        let simulated = running && body.is_enabled();
        // A body that sleeps at another pose was moved there, e.g. by restoring a context, so its pairs are searched once.
        let active = simulated && (!body.is_sleeping() || slept_at != Some(end));
        let number = self.step.input.bodies.len();
        gathered.resting.extend((simulated && !active).then_some((number, sensor || !body.is_dynamic())));
        // A fast kinematic body would pass through sleeping bodies before rapier finds a contact. A link of a multibody cannot be moved by itself.
        let stops = simulated && body.is_dynamic() && !is_link(context, parent);
        let sweep = resting.filter(|_| !active);
        let sweep = sweep.unwrap_or_else(|| self.sweep(world, (parent, body), [start.pose, end], stops, active));
        gathered.astray.extend((sweep.end != end).then_some(number as u32));
        let [linear, angular] = velocities(body, &start, &sweep, running.then_some(dt));
        let [groups, stop_groups] = groups(collider);
        let next_dt = to_come(&self.rapier.mode, &self.rapier.time);
        let (core_depth, passes) = (self.core_depth(entity), self.passes(entity, collider));
        self.step.input.bodies.push(Body {
            solid,
            sweep,
            order: order(handle),
            id: Some(entity.to_bits()),
            groups,
            types: types(collider, Some(body)),
            stop_groups,
            rigid_body: Some(rigid_body_id(index, parent)),
            joint_island: Some(rigid_body_id(index, joint_islands.get(&parent).copied().unwrap_or(parent))),
            world: index,
            active,
            stops,
            passes,
            sensor,
            locked: locked(body),
            core_depth,
            next_displacement: Some(displacement(collider, body, context.configuration.gravity, next_dt)),
        });
        let collider = handle.into_raw_parts();
        // Bodies of a paused world are treated like sleeping bodies.
        let asleep = !running || body.is_sleeping();
        let (body, center) = (context.bodies.rigid_body_entity(parent), start.pose.transform_point(sweep.local_center));
        self.step.infos.push(BodyInfo { entity, body, collider, sensor, asleep, center, linear, angular });
    }

    /// Returns pose and velocities of a collider before rapier's step. `slept_at`: its pose in the last step if its body slept, and otherwise that after
    /// rapier's step.
    fn start(&self, world: &World, handle: ColliderHandle, body: &RapierBody, [slept_at, end]: [Pose3; 2]) -> Start {
        let known = self.rapier.snapshot.starts.get(&(world.context.entity, handle)).filter(|_| world.running);
        // Rapier may have woken the body within the step.
        let woken = world.running && !body.is_sleeping();
        known.copied().unwrap_or(Start::at_rest(if woken { slept_at } else { end }))
    }

    /// Adds a skinned shape. Its spheres move in the frame of its collider, which is at rest within the step.
    fn add_skin(
        &mut self,
        world: &World,
        entity: Entity,
        (handle, collider): (ColliderHandle, &RapierCollider),
        skin: &Arc<Deforming>,
        last: Option<(&BodyInfo, &Body)>,
    ) {
        let World { index, context, running, .. } = *world;
        let body = context.body(collider);
        let (pose, moves) = (collider_pose(collider, body), skin.is_moving());
        let is_known = last.is_some_and(|(info, body)| info.asleep && body.sweep.end == pose);
        let next_dt = to_come(&self.rapier.mode, &self.rapier.time);
        let next = body.map(|body| displacement(collider, body, context.configuration.gravity, next_dt));
        let [groups, stop_groups] = groups(collider);
        self.step.input.bodies.push(Body {
            order: order(handle),
            id: Some(entity.to_bits()),
            groups,
            types: types(collider, body),
            stop_groups,
            rigid_body: collider.parent().map(|parent| rigid_body_id(index, parent)),
            world: index,
            active: running && (moves || !is_known),
            stops: false,
            passes: self.passes(entity, collider),
            sensor: collider.is_sensor(),
            next_displacement: Some(next.unwrap_or(Displacement::REST)),
            ..Body::new(Solid::Deforming(skin.clone()), Sweep::at_rest(pose))
        });
        self.step.infos.push(BodyInfo {
            body: collider.parent().and_then(|parent| context.bodies.rigid_body_entity(parent)),
            collider: handle.into_raw_parts(),
            sensor: collider.is_sensor(),
            asleep: !running || !moves,
            ..BodyInfo::at_rest(entity)
        });
    }

    /// Returns the motion of a body between two poses, extended by the time that is owed to it.
    fn sweep(
        &self,
        world: &World,
        (parent, body): (RigidBodyHandle, &RapierBody),
        [start, end]: [Pose3; 2],
        stops: bool,
        active: bool,
    ) -> Sweep {
        let motion = if stops { motion } else { Sweep::between };
        let sweep = motion(start, end, end.inverse_transform_point(body.center_of_mass()), body.angvel() * world.dt);
        match self.owed.get(world.context.entity, parent).filter(|_| active && stops) {
            Some(owed) => owed.longer(&sweep, body),
            None => sweep,
        }
    }

    /// Rebuilds the statics if one of them was added, removed or changed.
    fn update_statics(&mut self, Gathered { fixed, resting, .. }: &mut Gathered, known: &mut Vec<Fixed>) {
        // The lengths differ if the user has replaced the resource, because the new one has no statics.
        if *fixed == *known && self.step.static_infos.len() == fixed.len() {
            return;
        }
        // Rapier wakes no body when a sensor is added, removed or moved, and no sensor or kinematic body when a static changes. Pairs of these bodies are
        // searched once, so that touch messages are correct.
        let is_for_all = sensors(fixed).ne(sensors(known));
        for (body, _) in resting.drain(..).filter(|(_, only_reports)| is_for_all || *only_reports) {
            self.step.input.bodies[body].active = true;
        }
        set_statics(self.step, fixed);
        std::mem::swap(known, fixed);
    }
}

fn sensors(fixed: &[Fixed]) -> impl Iterator<Item = &Fixed> {
    fixed.iter().filter(|item| item.sensor)
}

/// Rebuilds the statics after one of them was added, removed or changed.
fn set_statics(step: &mut MedialStep, fixed: &[Fixed]) {
    let mut bodies = Vec::new();
    step.static_infos.clear();
    for item in fixed {
        let Some(solid) = solid(&item.shape) else { continue };
        let [groups, stop_groups] = item.groups;
        let &Fixed { entity, body, collider, pose, rigid_body, types, world, sensor, passes, .. } = item;
        let (order, id) = (order(collider), Some(entity.to_bits()));
        bodies.push(StaticBody {
            solid,
            pose,
            order,
            id,
            rigid_body,
            groups,
            types,
            stop_groups,
            world,
            passes,
            sensor,
        });
        step.static_infos.push(BodyInfo {
            body,
            collider: collider.into_raw_parts(),
            sensor,
            ..BodyInfo::at_rest(entity)
        });
    }
    step.statics = Statics::new(bodies);
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
fn rigid_body_id(world: u32, body: RigidBodyHandle) -> u64 {
    u64::from(world) << 32 | u64::from(body.into_raw_parts().0)
}
