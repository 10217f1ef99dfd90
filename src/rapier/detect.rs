//! The step of the pipeline around rapier's: poses before it, the motion that it has solved, and what comes of that.

use std::collections::HashMap;

use bevy::prelude::*;
use bevy_rapier3d::{
    plugin::context::{
        DefaultRapierContext, RapierContextColliders, RapierContextJoints, RapierContextSimulation, RapierRigidBodySet,
        SimulationToRenderTime,
    },
    prelude::{
        Collider, ColliderDisabled, CollisionGroups, RapierColliderHandle, RapierConfiguration, RigidBodyDisabled,
        Sensor, SolverGroups, TimestepMode,
    },
    rapier::{
        dynamics::{RigidBody as RapierBody, RigidBodyHandle},
        geometry::{Collider as RapierCollider, ColliderHandle},
    },
};

use super::{
    shape::MedialShape,
    table::{ContactTable, PairKey, SecondKey},
};
use crate::{
    geometry::{Obb, Pose3, Sweep},
    pipeline::{Body, Groups, StaticBody, Statics, Target},
    plugin::{BodyInfo, MedialCcd, MedialSettings, MedialStep, StaticObb},
};

/// Where bodies were, and how fast, before rapier's step.
#[derive(Resource, Default)]
pub(super) struct Snapshot {
    starts: HashMap<ColliderHandle, Start>,
    /// How far the simulation was ahead of the time of the last frame, in seconds.
    ahead: f32,
}

#[derive(Clone, Copy)]
struct Start {
    pose: Pose3,
    linear: Vec3,
    angular: Vec3,
}

/// Pose of a collider by its body's, which is newer than the collider's own after a change by the user.
fn collider_pose(collider: &RapierCollider, body: Option<&RapierBody>) -> Pose3 {
    match (body, collider.position_wrt_parent()) {
        (Some(body), Some(local)) => body.position() * local,
        _ => *collider.position(),
    }
}

fn medial(collider: &RapierCollider) -> Option<&MedialShape> {
    collider.shape().as_shape::<MedialShape>()
}

pub(super) fn snapshot(
    mut starts: ResMut<Snapshot>,
    context: Single<
        (&RapierRigidBodySet, &RapierContextColliders, &SimulationToRenderTime),
        With<DefaultRapierContext>,
    >,
) {
    let (bodies, colliders, time) = *context;
    starts.ahead = -time.diff;
    starts.starts.clear();
    for (handle, collider) in colliders.colliders.iter().filter(|(_, collider)| medial(collider).is_some()) {
        let body = collider.parent().and_then(|parent| bodies.bodies.get(parent));
        let start = Start {
            pose: collider_pose(collider, body),
            linear: body.map_or(Vec3::ZERO, RapierBody::linvel),
            angular: body.map_or(Vec3::ZERO, RapierBody::angvel),
        };
        starts.starts.insert(handle, start);
    }
}

/// Collision groups and solver groups.
fn groups(collider: &RapierCollider) -> [Groups; 2] {
    [collider.collision_groups(), collider.solver_groups()]
        .map(|groups| Groups { memberships: groups.memberships.bits(), filter: groups.filter.bits() })
}

/// A number for a rigid body: none that exist at a time share theirs.
fn owner(body: RigidBodyHandle) -> u32 {
    body.into_raw_parts().0
}

/// Rebuilds the statics when one of them has come, gone or changed.
pub(super) fn gather_statics(
    mut step: ResMut<MedialStep>,
    changed: Query<
        (),
        (
            With<StaticObb>,
            Or<(
                Changed<StaticObb>,
                Changed<GlobalTransform>,
                Changed<RapierColliderHandle>,
                Changed<Collider>,
                Changed<CollisionGroups>,
                Changed<SolverGroups>,
                Changed<Sensor>,
                Changed<ColliderDisabled>,
                Changed<RigidBodyDisabled>,
            )>,
        ),
    >,
    mut removed: (RemovedComponents<Sensor>, RemovedComponents<ColliderDisabled>, RemovedComponents<RigidBodyDisabled>),
    statics: Query<(Entity, &RapierColliderHandle), With<StaticObb>>,
    mut known: Local<(usize, bool)>,
    context: Single<(&RapierRigidBodySet, &RapierContextColliders, &RapierConfiguration), With<DefaultRapierContext>>,
) {
    let (bodies, colliders, configuration) = *context;
    if !configuration.physics_pipeline_active {
        // The last step's pairs are of the statics of then. Whatever changes meanwhile counts from the next step on.
        *known = (usize::MAX, true);
        return;
    }
    let removals = removed.0.read().count() + removed.1.read().count() + removed.2.read().count();
    let count = statics.iter().len();
    // In a fixed schedule rapier takes over removals at the end of the frame, and they count in the next step.
    let (known_count, removals_before) = std::mem::replace(&mut *known, (count, removals > 0));
    if changed.is_empty() && removals == 0 && !removals_before && count == known_count {
        return;
    }
    let mut found: Vec<(ColliderHandle, Entity, StaticBody, bool)> = Vec::new();
    for (entity, handle) in &statics {
        let Some(collider) = colliders.colliders.get(handle.0).filter(|collider| collider.is_enabled()) else {
            continue;
        };
        let pose = collider_pose(collider, collider.parent().and_then(|parent| bodies.bodies.get(parent)));
        let solid = if let Some(medial) = medial(collider) {
            StaticBody::solid_shape(medial.shape.clone(), pose)
        } else if let Some(cuboid) = collider.shape().as_cuboid() {
            StaticBody::solid_box(Obb { pose, half_extents: cuboid.half_extents })
        } else {
            continue;
        };
        let [groups, stop_groups] = groups(collider);
        let body = StaticBody { groups, stop_groups, passes: collider.is_sensor(), ..solid };
        found.push((handle.0, entity, body, collider.is_sensor()));
    }
    found.sort_by_key(|(handle, ..)| handle.into_raw_parts());
    step.static_infos = found
        .iter()
        .map(|(handle, entity, _, sensor)| BodyInfo { sensor: *sensor, ..BodyInfo::at_rest(*entity, *handle) })
        .collect();
    step.statics = Statics::new(found.into_iter().map(|(_, _, body, _)| body).collect());
}

/// Runs the pipeline over the motion that rapier has solved, stops bodies at their first impact and fills the table.
pub(super) fn detect(
    mut step: ResMut<MedialStep>,
    starts: Res<Snapshot>,
    table: Res<ContactTable>,
    statics: Query<(), With<StaticObb>>,
    ccd: Query<&MedialCcd>,
    settings: Res<MedialSettings>,
    context: Single<
        (
            &mut RapierRigidBodySet,
            &RapierContextColliders,
            &RapierContextJoints,
            &RapierContextSimulation,
            &RapierConfiguration,
            &SimulationToRenderTime,
        ),
        With<DefaultRapierContext>,
    >,
    (mode, time): (Res<TimestepMode>, Res<Time>),
) {
    let (mut bodies, colliders, joints, simulation, configuration, ahead) = context.into_inner();
    if !configuration.physics_pipeline_active {
        return;
    }
    let step = step.as_mut();
    // Rapier may have made none or several steps to keep up with the frame's time.
    let dt = match *mode {
        TimestepMode::Interpolated { time_scale, .. } => (time.delta_secs() - starts.ahead - ahead.diff) * time_scale,
        _ => simulation.integration_parameters.dt,
    };
    step.settings = *settings;
    step.dt = dt;
    step.input.prediction = simulation.integration_parameters.prediction_distance();
    step.input.allowed_overlap = simulation.integration_parameters.allowed_linear_error();
    step.input.apart.clear();
    for (_, joint) in joints.impulse_joints.iter().filter(|(_, joint)| !joint.data.contacts_enabled) {
        let [a, b] = [joint.body1(), joint.body2()].map(owner);
        step.input.apart.insert([a.min(b), a.max(b)]);
    }
    step.input.bodies.clear();
    step.infos.clear();
    // In the order of their handles, as rapier orders pairs.
    for (handle, collider) in colliders.colliders.iter() {
        let Some(medial) = medial(collider).filter(|_| collider.is_enabled()) else { continue };
        let Some(entity) = colliders.collider_entity(handle).filter(|entity| !statics.contains(*entity)) else {
            continue;
        };
        let body = collider.parent().and_then(|parent| bodies.bodies.get(parent));
        let end = collider_pose(collider, body);
        let start =
            starts.starts.get(&handle).copied().unwrap_or(Start { pose: end, linear: Vec3::ZERO, angular: Vec3::ZERO });
        let center = body.map_or(Vec3::ZERO, |body| end.inverse_transform_point(body.center_of_mass()));
        let active = body.is_some_and(|body| body.is_enabled() && !body.is_fixed() && !body.is_sleeping());
        let [groups, stop_groups] = groups(collider);
        step.input.bodies.push(Body {
            shape: medial.shape.clone(),
            sweep: Sweep::between(start.pose, end, center, body.map_or(Vec3::ZERO, |body| body.angvel() * dt)),
            groups,
            stop_groups,
            owner: collider.parent().map(owner),
            active,
            stops: active && body.is_some_and(RapierBody::is_dynamic),
            passes: collider.is_sensor() || ccd.get(entity).is_ok_and(|ccd| !ccd.enabled),
        });
        step.infos.push(BodyInfo {
            entity,
            collider: handle,
            sensor: collider.is_sensor(),
            asleep: body.is_some_and(|body| body.is_sleeping() && !body.is_fixed()),
            center: start.pose.transform_point(center),
            linear: start.linear,
            angular: start.angular,
        });
    }
    step.run();
    stop_bodies(step, &mut bodies, colliders, configuration.gravity);
    table.fill(table_entries(step, colliders));
}

/// Moves bodies back to where they stop, with the velocities that they have there: the next step then resolves a true contact at a
/// true pose. Gravity has not acted on them for the rest of the step; left in, it would feed bodies that rock to and fro.
fn stop_bodies(step: &MedialStep, bodies: &mut RapierRigidBodySet, colliders: &RapierContextColliders, gravity: Vec3) {
    // The shapes of one body stop together, and it is moved once.
    let mut last = None;
    let mut stops: Vec<_> = step.output.stops.iter().collect();
    stops.sort_by_key(|stop| step.input.bodies[stop.body as usize].owner);
    for stop in stops {
        let owner = step.input.bodies[stop.body as usize].owner;
        if owner.is_some() && std::mem::replace(&mut last, owner) == owner {
            continue;
        }
        let Some(collider) = colliders.colliders.get(step.infos[stop.body as usize].collider) else { continue };
        let local = collider.position_wrt_parent().copied().unwrap_or(Pose3::IDENTITY);
        if let Some(body) = collider.parent().and_then(|parent| bodies.bodies.get_mut(parent)) {
            body.set_position(stop.pose * local.inverse(), true);
            // Nor has it acted along locked axes at all.
            let free = Vec3::select(body.mass_properties().effective_inv_mass.cmpgt(Vec3::ZERO), Vec3::ONE, Vec3::ZERO);
            let early = free * gravity * body.gravity_scale() * (1.0 - stop.fraction) * step.dt;
            body.set_linvel(body.linvel() - early, true);
        }
    }
}

/// The manifolds of the step under the keys that the dispatcher will look them up by.
fn table_entries<'a>(
    step: &'a MedialStep,
    colliders: &'a RapierContextColliders,
) -> impl Iterator<Item = (PairKey, Vec<crate::pipeline::Manifold>)> + 'a {
    step.output.pairs.iter().filter_map(move |pair| {
        let info1 = &step.infos[pair.body1 as usize];
        let info2 = step.info(pair.target);
        let medial1 = medial(colliders.colliders.get(info1.collider)?)?;
        let collider2 = colliders.colliders.get(info2.collider)?;
        let end1 = step.final_pose(pair.body1);
        let end2 = match pair.target {
            Target::Body(body) => step.final_pose(body),
            Target::Static(_) => *collider2.position(),
        };
        let second = SecondKey::of(collider2.shape())?;
        // As the dispatcher will have it from rapier, which puts the lower handle first.
        let pose12 = if info1.collider.into_raw_parts() < info2.collider.into_raw_parts() {
            end1.inv_mul(&end2)
        } else {
            end2.inv_mul(&end1).inverse()
        };
        let key = PairKey::new(medial1.key, second, &pose12, step.input.prediction);
        Some((key, step.output.manifolds[pair.manifolds.clone()].to_vec()))
    })
}
