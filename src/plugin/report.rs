use std::{
    cell::LazyCell,
    collections::{BTreeMap, HashMap},
};

use bevy::prelude::*;

use super::{MedialContactEnded, MedialContactStarted, MedialStep, TouchPoint};
use crate::{constants::LINEAR_SLOP, pipeline::Pair};

/// The touching entities. Keys have the entities in ascending order, because the sides of a pair may change places. Values have the order of the first message.
type Touching = BTreeMap<[Entity; 2], [Entity; 2]>;

fn key(entities: [Entity; 2]) -> [Entity; 2] {
    let [a, b] = entities;
    [a.min(b), a.max(b)]
}

/// Writes a message and triggers events for each pair that began or ceased to touch in the last step.
pub(super) fn tell_contacts(
    mut commands: Commands,
    step: Res<MedialStep>,
    existing: Query<()>,
    mut touching: Local<Touching>,
    mut started: MessageWriter<MedialContactStarted>,
    mut ended: MessageWriter<MedialContactEnded>,
) {
    let mut now = Touching::new();
    for pair in &step.output.pairs {
        let (info1, info2) = (step.info(pair.first), step.info(pair.second));
        let entities = [info1.entity, info2.entity];
        let Some(touch) = touch_point(&step, pair) else { continue };
        let known = touching.get(&key(entities)).copied();
        if known.is_none() && pair.impact.is_none() && touch.separation > LINEAR_SLOP * step.input.length_unit {
            continue;
        }
        now.insert(key(entities), known.unwrap_or(entities));
        if known.is_none() {
            let [entity1, entity2] = entities;
            let message = MedialContactStarted { entity1, entity2, touch, sensor: info1.sensor || info2.sensor };
            started.write(message);
            [message, message.swapped()].into_iter().for_each(|event| commands.trigger(event));
        }
    }
    // A sleeping body is not tested unless the other side moves. It still touches.
    let states: LazyCell<HashMap<Entity, (bool, bool)>, _> = LazyCell::new(|| {
        let bodies = step.input.bodies.iter().zip(&step.infos);
        let statics = step.static_infos.iter().map(|info| (info.entity, (false, false)));
        bodies.map(|(body, info)| (info.entity, (body.active, info.asleep))).chain(statics).collect()
    });
    for (&key, &[entity1, entity2]) in touching.iter() {
        if now.contains_key(&key) {
            continue;
        }
        if let [Some(&(active1, asleep1)), Some(&(active2, asleep2))] = key.map(|entity| states.get(&entity))
            && (asleep1 || asleep2)
            && !(active1 || active2)
        {
            now.insert(key, [entity1, entity2]);
            continue;
        }
        ended.write(MedialContactEnded { entity1, entity2 });
        for (entity1, entity2) in [(entity1, entity2), (entity2, entity1)] {
            if existing.contains(entity1) {
                commands.trigger(MedialContactEnded { entity1, entity2 });
            }
        }
    }
    *touching = now;
}

/// Returns the first impact of the pair, or else its deepest contact.
fn touch_point(step: &MedialStep, pair: &Pair) -> Option<TouchPoint> {
    let end = step.final_pose(pair.first);
    let contacts = step.output.manifolds[pair.manifolds.clone()].iter().flat_map(|manifold| manifold.contacts());
    let deepest = contacts.min_by(|a, b| a.distance.total_cmp(&b.distance));
    let (fraction, point, normal, separation, primitives) = match (pair.impact, deepest) {
        (Some(impact), _) => {
            (impact.fraction, impact.point, impact.normal, 0.0, (impact.primitive1, impact.primitive2))
        }
        (None, Some(contact)) => {
            let point = end.transform_point(contact.point1 + contact.normal1 * (0.5 * contact.distance));
            let normal = end.rotation * contact.normal1;
            (1.0, point, normal, contact.distance, (contact.primitive1, contact.primitive2))
        }
        (None, None) => return None,
    };
    let [velocity1, velocity2] = [pair.first, pair.second].map(|side| step.info(side).velocity_at(point));
    Some(TouchPoint {
        fraction,
        point,
        normal,
        separation,
        approach_speed: (velocity1 - velocity2).dot(normal),
        primitive1: primitives.0,
        primitive2: primitives.1,
    })
}
