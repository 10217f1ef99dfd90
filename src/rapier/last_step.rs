//! Bodies and statics of the last step. Bodies that still sleep keep their input.

use std::sync::Arc;

use bevy::prelude::*;
use bevy_rapier3d::{parry::shape::SharedShape, rapier::geometry::ColliderHandle};

use crate::{
    geometry::Pose3,
    pipeline::{Body, Groups},
    plugin::BodyInfo,
};

/// A collider that does not move, with all properties that the pipeline uses.
#[derive(Clone)]
pub(super) struct Fixed {
    pub entity: Entity,
    pub body: Option<Entity>,
    pub collider: ColliderHandle,
    pub shape: SharedShape,
    pub pose: Pose3,
    pub rigid_body: Option<u64>,
    pub groups: [Groups; 2],
    pub types: Groups,
    pub world: u32,
    pub sensor: bool,
    pub passes: bool,
}

impl PartialEq for Fixed {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.shape.0, &other.shape.0)
            && (self.entity, self.collider, self.pose, self.groups, self.types)
                == (other.entity, other.collider, other.pose, other.groups, other.types)
            && (self.rigid_body, self.world, self.sensor, self.passes)
                == (other.rigid_body, other.world, other.sensor, other.passes)
    }
}

/// Lists of the last step.
#[derive(Default)]
pub(super) struct LastStep {
    pub fixed: Vec<Fixed>,
    pub infos: Vec<BodyInfo>,
    pub bodies: Vec<Body>,
}

/// The bodies of the last step, in the order of their worlds and colliders.
pub(super) struct LastBodies<'l> {
    pub infos: &'l [BodyInfo],
    pub bodies: &'l [Body],
    /// The context of each world of the last step.
    pub worlds: Vec<Entity>,
    /// Index of the first body that has not been passed.
    pub next: usize,
}

impl<'l> LastBodies<'l> {
    /// Returns a body of the last step. Successive calls have to be in the order of worlds and colliders.
    pub fn find(&mut self, world: Entity, collider: ColliderHandle) -> Option<(&'l BodyInfo, &'l Body)> {
        let place = (Some(world), collider.into_raw_parts().0);
        while let Some((info, body)) = self.infos.get(self.next).zip(self.bodies.get(self.next)) {
            let world = self.worlds.get(body.world as usize).copied();
            if (world, info.collider().into_raw_parts().0) >= place {
                return Some((info, body)).filter(|_| world == place.0 && info.collider() == collider);
            }
            self.next += 1;
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        geometry::{Pose3, Sweep},
        medial_axis::MedialAxis,
        pipeline::Shape,
    };

    #[test]
    fn bodies_are_found_by_world_and_collider() {
        let mut worlds: Vec<Entity> = (1..3).map(Entity::from_raw_u32).map(Option::unwrap).collect();
        worlds.sort();
        let shape = Shape { axis: MedialAxis::sphere(1.0).unwrap(), scale: 1.0 };
        let colliders = [(0, [3, 0]), (0, [5, 1]), (1, [0, 0]), (1, [3, 2])];
        let (mut infos, mut bodies) = (Vec::new(), Vec::new());
        for (world, [index, generation]) in colliders {
            let info = BodyInfo::at_rest(Entity::from_raw_u32(10 * world + index).unwrap());
            infos.push(BodyInfo { collider: (index, generation), ..info });
            bodies.push(Body { world, ..Body::new(shape.clone(), Sweep::at_rest(Pose3::IDENTITY)) });
        }
        let mut last = LastBodies { infos: &infos, bodies: &bodies, worlds: worlds.clone(), next: 0 };
        // The first collider was removed, another one has its index, and one is new.
        let asked = [(0, [3, 7]), (0, [4, 0]), (0, [5, 1]), (1, [0, 0]), (1, [2, 0]), (1, [3, 2]), (1, [9, 0])];
        let found = asked.map(|(world, [index, generation])| {
            let found = last.find(worlds[world], ColliderHandle::from_raw_parts(index, generation));
            found.map(|(info, body)| (body.world, info.collider))
        });
        let known = |world, index, generation| Some((world, (index, generation)));
        let expected = [None, None, known(0, 5, 1), known(1, 0, 0), None, known(1, 3, 2), None];
        assert_eq!(found, expected);
    }
}
