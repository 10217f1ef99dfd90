use std::{cell::LazyCell, collections::BTreeMap};

use bevy::{ecs::entity::EntityHashMap, prelude::*};

use super::{MedialContactEnded, MedialContactStarted, MedialStep, TouchPoint};
use crate::{
    constants::LINEAR_SLOP,
    pipeline::{Contact, Impact, Pair},
};

/// The touching entities. Keys have the entities in ascending order, because the sides of a pair may change places. Values are the messages to send when the
/// touch ends, in the order of the first message, and the number of the last step with a contact or an impact.
type Touching = BTreeMap<[Entity; 2], (MedialContactEnded, u64)>;

fn key(entities: [Entity; 2]) -> [Entity; 2] {
    let [a, b] = entities;
    [a.min(b), a.max(b)]
}

/// Writes a message and triggers events for each pair that began or ceased to touch in the last step.
pub(super) fn report_contacts(
    mut commands: Commands,
    step: Res<MedialStep>,
    existing: Query<()>,
    (mut touching, mut number, mut known): (Local<Touching>, Local<u64>, Local<Vec<Entity>>),
    mut started: MessageWriter<MedialContactStarted>,
    mut ended: MessageWriter<MedialContactEnded>,
) {
    // If no body is active and none has come or gone, no touch has begun or ended.
    let entities = || step.infos.iter().chain(&step.static_infos).map(|info| info.entity);
    if entities().eq(known.iter().copied()) && !step.input.bodies.iter().any(|body| body.active) {
        return;
    }
    known.clear();
    known.extend(entities());
    *number += 1;
    let now = *number;
    for pair in &step.output.pairs {
        let (info1, info2) = (step.info(pair.first), step.info(pair.second));
        let (entity1, entity2, body1, body2) = (info1.entity, info2.entity, info1.body, info2.body);
        let key = key([entity1, entity2]);
        let Some(touch) = touch_point(&step, pair) else { continue };
        let known = touching.get_mut(&key);
        if known.is_none() && pair.impact.is_none() && touch.separation > LINEAR_SLOP * step.input.length_unit {
            continue;
        }
        if let Some((_, last)) = known {
            *last = now;
        } else {
            touching.insert(key, (MedialContactEnded { entity1, entity2, body1, body2 }, now));
            let sensor = info1.sensor || info2.sensor;
            let message = MedialContactStarted { entity1, entity2, body1, body2, touch, sensor };
            started.write(message);
            [message, message.swapped()].into_iter().for_each(|event| commands.trigger(event));
        }
    }
    // A sleeping body is not tested unless the other side moves. It still touches.
    let states: LazyCell<EntityHashMap<(bool, bool)>, _> = LazyCell::new(|| {
        let bodies = step.input.bodies.iter().zip(&step.infos);
        let statics = step.static_infos.iter().map(|info| (info.entity, (false, false)));
        bodies.map(|(body, info)| (info.entity, (body.active, info.asleep))).chain(statics).collect()
    });
    touching.retain(|key, (message, last)| {
        if *last == now {
            return true;
        }
        if let [Some(&(active1, asleep1)), Some(&(active2, asleep2))] = key.map(|entity| states.get(&entity))
            && (asleep1 || asleep2)
            && !(active1 || active2)
        {
            return true;
        }
        ended.write(*message);
        for event in [*message, message.swapped()].into_iter().filter(|event| existing.contains(event.entity1)) {
            commands.trigger(event);
        }
        false
    });
}

/// Returns the first impact of the pair, or else its deepest contact.
fn touch_point(step: &MedialStep, pair: &Pair) -> Option<TouchPoint> {
    if let Some(Impact { fraction, point, normal, primitive1, primitive2 }) = pair.impact {
        return Some(touch(step, pair, [fraction, 0.0], [point, normal], [primitive1, primitive2]));
    }
    contact_points(step, pair).min_by(|a, b| a.separation.total_cmp(&b.separation))
}

/// Returns the contacts of the pair at the end of the step.
pub(super) fn contact_points(step: &MedialStep, pair: &Pair) -> impl Iterator<Item = TouchPoint> {
    let end = step.final_pose(pair.first);
    let contacts = step.output.manifolds[pair.manifolds.clone()].iter().flat_map(|manifold| manifold.contacts());
    contacts.map(move |contact| {
        let &Contact { normal1, distance: separation, primitive1, primitive2, .. } = contact;
        let point = end.transform_point(contact.point1 + normal1 * (0.5 * separation));
        let normal = end.rotation * normal1;
        touch(step, pair, [1.0, separation], [point, normal], [primitive1, primitive2])
    })
}

/// Returns a touch of two primitives at a point with a normal, both in the world.
fn touch(
    step: &MedialStep,
    pair: &Pair,
    [fraction, separation]: [f32; 2],
    [point, normal]: [Vec3; 2],
    [primitive1, primitive2]: [u32; 2],
) -> TouchPoint {
    let sides = [(pair.first, primitive1), (pair.second, primitive2)];
    let [velocity1, velocity2] = sides.map(|(side, primitive)| step.velocity_at(side, primitive, point, fraction));
    let [joint1, joint2] = sides.map(|(side, primitive)| step.joint_at(side, primitive, point, fraction));
    let approach_speed = (velocity1 - velocity2).dot(normal);
    TouchPoint { fraction, point, normal, separation, approach_speed, primitive1, primitive2, joint1, joint2 }
}
