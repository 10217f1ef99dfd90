use std::collections::{BTreeSet, HashSet};

use bevy::prelude::*;

use super::{MedialContactEnded, MedialContactStarted, MedialStep, TouchPoint};
use crate::{constants::TOUCH_DISTANCE, pipeline::Pair};

/// The entities that touch.
type Touching = BTreeSet<(Entity, Entity)>;

/// Writes a message for each pair that has begun or ceased to touch in the last step.
pub(super) fn write_messages(
    step: Res<MedialStep>,
    mut touching: Local<Touching>,
    mut started: MessageWriter<MedialContactStarted>,
    mut ended: MessageWriter<MedialContactEnded>,
) {
    let mut now = Touching::new();
    for pair in &step.output.pairs {
        let (info1, info2) = (step.info(pair.first), step.info(pair.second));
        let entities = (info1.entity, info2.entity);
        let Some(touch) = touch_point(&step, pair) else { continue };
        let known = touching.contains(&entities);
        if known || pair.impact.is_some() || touch.separation <= TOUCH_DISTANCE {
            now.insert(entities);
            if !known {
                let sensor = info1.sensor || info2.sensor;
                started.write(MedialContactStarted { entity1: entities.0, entity2: entities.1, touch, sensor });
            }
        }
    }
    // Pairs at rest are not looked at and touch as before.
    let active: HashSet<Entity> = active_entities(&step);
    let all: HashSet<Entity> = step.infos.iter().chain(&step.static_infos).map(|info| info.entity).collect();
    for &(entity1, entity2) in touching.iter() {
        let gone = !all.contains(&entity1) || !all.contains(&entity2);
        let looked_at = active.contains(&entity1) || active.contains(&entity2);
        if now.contains(&(entity1, entity2)) {
            continue;
        }
        if gone || looked_at {
            ended.write(MedialContactEnded { entity1, entity2 });
        } else {
            now.insert((entity1, entity2));
        }
    }
    *touching = now;
}

fn active_entities(step: &MedialStep) -> HashSet<Entity> {
    let bodies = step.input.bodies.iter().zip(&step.infos);
    bodies.filter(|(body, _)| body.active).map(|(_, info)| info.entity).collect()
}

/// The first impact of the pair, or else its deepest contact.
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
