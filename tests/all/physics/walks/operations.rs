//! The operations of a game on bodies.

use super::*;

pub(super) type Operation = (&'static str, fn(&mut Walk));

pub(super) const OPERATIONS: [Operation; 27] = [
    ("spawn", |w| _ = w.spawn()),
    ("spawn", |w| _ = w.spawn()),
    ("spawn a static", |w| w.spawn_static()),
    ("spawn a parent", |w| w.spawn_parent()),
    ("spawn and despawn", |w| {
        let entity = w.spawn();
        w.despawn(entity);
    }),
    ("despawn", |w| w.edit_any(|w, entity| w.despawn(entity))),
    ("scale", |w| {
        let scale = [0.5, 1.0, 1.5, 1.0 + w.random.unit()][w.random.below(4)];
        w.edit_any(|w, entity| w.transform(entity).scale = Vec3::splat(scale));
    }),
    ("scale unevenly", |w| {
        let scale =
            [Vec3::ZERO, Vec3::new(1.0, 2.0, 1.0), Vec3::NAN, Vec3::splat(-1.0), Vec3::splat(1e20)][w.random.below(5)];
        w.edit_any(|w, entity| w.transform(entity).scale = scale);
    }),
    ("swap the shape", |w| {
        let mesh = w.mesh();
        w.edit_shaped(|w, entity| w.insert(entity, mesh));
    }),
    ("take away or give a shape", |w| {
        let mesh = w.mesh();
        w.edit_any(|w, entity| w.toggle(entity, mesh));
    }),
    ("type", |w| {
        let kinds = [
            RigidBody::Dynamic,
            RigidBody::Dynamic,
            RigidBody::Fixed,
            RigidBody::KinematicPositionBased,
            RigidBody::KinematicVelocityBased,
        ];
        let kind = kinds[w.random.below(kinds.len())];
        w.edit_body(|w, entity| w.insert(entity, kind));
    }),
    ("groups", |w| {
        let group = |w: &mut Walk| Group::from_bits_retain([0b1, 0b11, u32::MAX, 0][w.random.below(4)]);
        let groups = CollisionGroups::new(group(w), group(w));
        w.edit_shaped(|w, entity| w.insert(entity, groups));
    }),
    ("sensor", |w| w.edit_shaped(|w, entity| w.toggle(entity, Sensor))),
    ("disable a collider", |w| w.edit_shaped(|w, entity| w.toggle(entity, ColliderDisabled))),
    ("disable a body", |w| w.edit_body(|w, entity| w.toggle(entity, RigidBodyDisabled))),
    ("teleport", |w| {
        w.edit_any(|w, entity| {
            let to = w.place();
            w.transform(entity).translation = to;
        })
    }),
    ("kick", |w| {
        w.edit_body(|w, entity| {
            let velocity = Velocity { linear: w.random.in_ball() * 200.0, angular: w.random.in_ball() * 100.0 };
            w.insert(entity, velocity);
        })
    }),
    ("spoil", |w| w.edit_any(|w, entity| w.spoil(entity))),
    ("repair", |w| w.repair()),
    ("repair", |w| w.repair()),
    ("continuous collision", |w| w.edit_body(|w, entity| w.toggle(entity, MedialCcd::DISABLED))),
    ("static or not", |w| w.edit_shaped(|w, entity| w.toggle(entity, StaticObb::new(0.2, 0.2, 0.2)))),
    ("pause or go on", |w| w.pause()),
    ("length of a step", |w| {
        let dt = [1.0 / 240.0, DT, 1.0 / 30.0][w.random.below(3)];
        let substeps = 1 + w.random.below(2);
        w.app.insert_resource(match w.random.below(2) {
            0 => TimestepMode::Fixed { dt, substeps },
            _ => TimestepMode::Variable { max_dt: dt, time_scale: 0.5 + w.random.unit(), substeps },
        });
    }),
    ("settings", |w| {
        let mut settings = w.app.world_mut().resource_mut::<MedialSettings>();
        settings.brute_force = !settings.brute_force;
    }),
    ("a shape that is still on its way", |w| {
        let mesh = MedialMesh(w.app.world().resource::<Assets<MedialAxis>>().reserve_handle());
        w.edit_shaped(|w, entity| w.insert(entity, mesh));
    }),
    ("load anew", |w| {
        let number = w.random.below(w.shapes.len());
        let axis = shape(number, w.random.unit());
        let id = w.shapes[number].0.id();
        w.app.world_mut().resource_mut::<Assets<MedialAxis>>().insert(id, axis).unwrap();
    }),
];

impl Walk {
    /// A position in the room, well away from its walls.
    pub(super) fn place(&mut self) -> Vec3 {
        self.random.in_ball() * (ROOM - 0.8)
    }

    pub(super) fn mesh(&mut self) -> MedialMesh {
        let number = self.random.below(self.shapes.len());
        self.shapes[number].clone()
    }

    pub(super) fn spawn(&mut self) -> Entity {
        self.make_room();
        let (mesh, at) = (self.mesh(), Transform::from_translation(self.place()).with_rotation(self.random.rotation()));
        let entity = self.app.world_mut().spawn((RigidBody::Dynamic, Velocity::zero(), mesh, at)).id();
        self.things.push(entity);
        entity
    }

    pub(super) fn spawn_static(&mut self) {
        self.make_room();
        let (mesh, at) = (self.mesh(), Transform::from_translation(self.place()));
        let world = self.app.world_mut();
        let entity = if self.random.below(2) == 0 {
            world.spawn((StaticObb::new(0.2, 0.1, 0.2), at)).id()
        } else {
            world.spawn((StaticObb::default(), RigidBody::Fixed, mesh, at)).id()
        };
        self.things.push(entity);
    }

    pub(super) fn spawn_parent(&mut self) {
        self.make_room();
        let parent = self.spawn();
        for side in [-0.3, 0.3] {
            let mesh = self.mesh();
            let child = (mesh, Transform::from_xyz(side, 0.0, 0.1), ChildOf(parent));
            let child = self.app.world_mut().spawn(child).id();
            self.things.push(child);
        }
    }

    pub(super) fn make_room(&mut self) {
        while self.things.len() >= CROWD {
            let entity = self.things[self.random.below(self.things.len())];
            self.despawn(entity);
        }
    }

    pub(super) fn despawn(&mut self, entity: Entity) {
        self.app.world_mut().despawn(entity);
        let world = self.app.world();
        self.things.retain(|&entity| world.get_entity(entity).is_ok());
    }

    pub(super) fn edit_where(&mut self, filter: impl Fn(EntityRef) -> bool, edit: impl FnOnce(&mut Walk, Entity)) {
        let world = self.app.world();
        let candidates: Vec<Entity> =
            self.things.iter().copied().filter(|&entity| filter(world.entity(entity))).collect();
        if !candidates.is_empty() {
            let entity = candidates[self.random.below(candidates.len())];
            self.history.push(format!("to {entity}"));
            edit(self, entity);
        }
    }

    pub(super) fn edit_any(&mut self, edit: impl FnOnce(&mut Walk, Entity)) {
        self.edit_where(|_| true, edit);
    }

    pub(super) fn edit_shaped(&mut self, edit: impl FnOnce(&mut Walk, Entity)) {
        self.edit_where(|entity| entity.contains::<MedialMesh>(), edit);
    }

    pub(super) fn edit_body(&mut self, edit: impl FnOnce(&mut Walk, Entity)) {
        self.edit_where(|entity| entity.contains::<RigidBody>() && entity.contains::<MedialMesh>(), edit);
    }

    pub(super) fn insert(&mut self, entity: Entity, component: impl Bundle) {
        self.app.world_mut().entity_mut(entity).insert(component);
    }

    /// Inserts the component, or removes it if the entity has it.
    pub(super) fn toggle<C: Component>(&mut self, entity: Entity, component: C) {
        let mut entity = self.app.world_mut().entity_mut(entity);
        if entity.contains::<C>() {
            entity.remove::<C>();
        } else {
            entity.insert(component);
        }
    }

    pub(super) fn transform(&mut self, entity: Entity) -> Mut<'_, Transform> {
        self.app.world_mut().get_mut::<Transform>(entity).unwrap()
    }

    pub(super) fn spoil(&mut self, entity: Entity) {
        match self.random.below(7) {
            0 => self.transform(entity).translation.x = f32::NAN,
            1 => self.transform(entity).translation.y = f32::INFINITY,
            2 => self.transform(entity).rotation.w = f32::NAN,
            3 => self.transform(entity).translation.z = 1e30,
            4 => self.insert(entity, Velocity::linear(Vec3::NAN)),
            5 => self.insert(entity, Velocity::angular(Vec3::X * 1e30)),
            _ => self.insert(entity, ExternalForce { force: Vec3::NAN, torque: Vec3::ZERO }),
        }
    }

    /// Repairs an entity that has an invalid value or has left the room.
    pub(super) fn repair(&mut self) {
        let filter = |entity: EntityRef| {
            let transform = entity.get::<Transform>().unwrap();
            let force = entity.get::<ExternalForce>().is_some_and(|force| !force.force.is_finite());
            let velocity =
                entity.get::<Velocity>().is_some_and(|v| !(v.linear.length() + v.angular.length()).is_finite());
            !transform.is_finite()
                || transform.translation.is_nan()
                || transform.translation.length() >= ROOM
                || force
                || velocity
                || transform.scale.min_element() <= 0.0
        };
        self.edit_where(filter, |w, entity| {
            let to = w.place();
            *w.transform(entity) = Transform::from_translation(to);
            let mut entity = w.app.world_mut().entity_mut(entity);
            if entity.contains::<Velocity>() {
                entity.insert(Velocity::zero());
            }
            entity.remove::<ExternalForce>();
        });
    }

    pub(super) fn pause(&mut self) {
        self.paused = !self.paused;
        let active = !self.paused;
        let mut configuration = self.app.world_mut().query::<&mut RapierConfiguration>();
        configuration.single_mut(self.app.world_mut()).unwrap().physics_pipeline_active = active;
    }
}
