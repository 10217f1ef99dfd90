//! Random walks through all operations of a game on bodies. After each step no body is lost, no message is repeated, and all values are finite.

use std::collections::{BTreeSet, HashSet};

use bevy::prelude::*;
use bevy_medial::{
    medial_axis::MedialAxis,
    plugin::MedialStep,
    prelude::*,
    rapier::{ContactTable, MedialShape},
};
use bevy_rapier3d::{
    plugin::context::{RapierContextColliders, RapierRigidBodySet},
    prelude::{
        Collider, ColliderDisabled, CollisionGroups, ExternalForce, Group, RapierColliderHandle, RapierConfiguration,
        RapierRigidBodyHandle, RigidBody, RigidBodyDisabled, Sensor, TimestepMode, Velocity,
    },
    rapier::geometry::Collider as RapierCollider,
};

use crate::common::*;

mod operations;

use operations::OPERATIONS;

/// Half of the room's size, in metres. Half of the thickness of its walls is the same.
const ROOM: f32 = 3.0;

/// Largest number of entities at a time.
const CROWD: usize = 24;

/// Pairs that observers received in the last update.
#[derive(Resource, Default)]
struct Observed {
    started: Vec<(Entity, Entity)>,
    ended: Vec<(Entity, Entity)>,
}

/// State of a random walk.
struct Walk {
    app: App,
    random: Random,
    record: Record,
    shapes: Vec<MedialMesh>,
    walls: Vec<Entity>,
    /// Entities that may be despawned.
    things: Vec<Entity>,
    /// Entities that could pass through walls, and so may be anywhere.
    strays: HashSet<Entity>,
    touching: BTreeSet<(Entity, Entity)>,
    paused: bool,
    /// Operations and their entities, printed after a failure.
    history: Vec<String>,
    /// Number of times that each operation was done.
    done: [usize; OPERATIONS.len()],
    /// Number of touches that started.
    touches: usize,
    /// Number of invalid transforms at the ends of all steps.
    spoiled: usize,
}

fn shape(number: usize, variant: f32) -> MedialAxis {
    let size = 0.15 + 0.1 * variant;
    match number {
        0 => MedialAxis::sphere(size),
        1 => MedialAxis::capsule(Vec3::X * -size, Vec3::X * size, 0.1),
        2 => MedialAxis::torus(size, 0.08, 4),
        _ => MedialAxis::rounded_box(Vec3::new(size, 0.1, size), 0.03),
    }
    .unwrap()
}

impl Walk {
    fn new(seed: u64) -> Self {
        let mut app = app_with(MedialPhysicsPlugins::default(), &assets());
        app.init_resource::<Observed>()
            .add_observer(|on: On<MedialContactStarted>, mut reported: ResMut<Observed>| {
                // Events propagate to parents.
                if on.entity1 == on.original_event_target() {
                    reported.started.push((on.entity1, on.entity2));
                }
            })
            .add_observer(|on: On<MedialContactEnded>, mut reported: ResMut<Observed>| {
                if on.entity1 == on.original_event_target() {
                    reported.ended.push((on.entity1, on.entity2));
                }
            });
        let shapes = (0..4).map(|number| mesh(&mut app, shape(number, 0.5))).collect();
        let mut walls = Vec::new();
        for axis in [Vec3::X, Vec3::Y, Vec3::Z] {
            for side in [-1.0, 1.0] {
                let half = Vec3::splat(3.0 * ROOM) - axis * (2.0 * ROOM);
                let at = Transform::from_translation(axis * (side * 2.0 * ROOM));
                walls.push(app.world_mut().spawn((StaticObb { half_extents: half }, at)).id());
            }
        }
        app.update();
        Self {
            app,
            random: Random(seed),
            record: Record::default(),
            shapes,
            walls,
            things: Vec::new(),
            strays: HashSet::new(),
            touching: BTreeSet::new(),
            paused: false,
            history: Vec::new(),
            done: [0; OPERATIONS.len()],
            touches: 0,
            spoiled: 0,
        }
    }

    fn step(&mut self) {
        for _ in 0..1 + self.random.below(2) {
            // Pauses are short.
            let number = if self.paused && self.random.below(4) == 0 {
                OPERATIONS.iter().position(|(name, _)| name.starts_with("pause")).unwrap()
            } else {
                self.random.below(OPERATIONS.len())
            };
            self.done[number] += 1;
            self.history.push(OPERATIONS[number].0.to_string());
            OPERATIONS[number].1(self);
        }
        self.update();
    }

    fn update(&mut self) {
        *self.app.world_mut().resource_mut::<Observed>() = Observed::default();
        self.record.run(&mut self.app, 1);
        self.check_messages();
        self.check_bodies();
        self.record.started.clear();
        self.record.ended.clear();
    }

    fn check_messages(&mut self) {
        let world = self.app.world();
        let exists = |entity: Entity| world.get_entity(entity).is_ok();
        let (mut started, mut ended) = (Vec::new(), Vec::new());
        // A pair that ends and starts within an update would end first.
        for (_, message) in &self.record.ended {
            let (a, b) = (message.entity1, message.entity2);
            assert!(self.touching.remove(&(a.min(b), a.max(b))), "{a} and {b} end what has not started");
            ended.extend([(a, b), (b, a)].into_iter().filter(|&(entity, _)| exists(entity)));
        }
        for (_, message) in &self.record.started {
            let (a, b) = (message.entity1, message.entity2);
            assert!(self.touching.insert((a.min(b), a.max(b))), "{a} and {b} start again");
            started.extend([(a, b), (b, a)]);
            self.touches += 1;
            let touch = message.touch;
            assert!(touch.point.is_finite() && touch.normal.is_normalized(), "{touch:?}");
        }
        let reported = world.resource::<Observed>();
        assert_eq!(reported.started, started);
        assert_eq!(reported.ended, ended);
        if !self.paused {
            for &(a, b) in &self.touching {
                for entity in [a, b] {
                    assert!(world.get::<RapierColliderHandle>(entity).is_some(), "{entity} touches without a collider");
                }
            }
        }
    }

    fn check_bodies(&mut self) {
        let world = self.app.world_mut();
        let mut contexts = world.query::<(&RapierRigidBodySet, &RapierContextColliders)>();
        let mut all = world.query::<(
            Entity,
            &Transform,
            &GlobalTransform,
            Option<&MedialMesh>,
            Option<&Collider>,
            Option<&RapierColliderHandle>,
            Option<&RapierRigidBodyHandle>,
        )>();
        let world = &*world;
        let (bodies, colliders) = contexts.single(world).unwrap();
        let assets = world.resource::<Assets<MedialAxis>>();
        let (mut with_collider, mut with_body, mut medial, mut spoiled) = (0, 0, 0, 0);
        for (entity, transform, global, mesh, collider, handle, body) in all.iter(world) {
            with_collider += usize::from(collider.is_some());
            with_body += usize::from(body.is_some());
            assert_eq!(collider.is_some(), handle.is_some(), "{entity}");
            spoiled += usize::from(!transform.is_finite());
            if !self.paused
                && let Some(handle) = handle
            {
                // Disabled colliders have a component that states it.
                let collider = &colliders.colliders[handle.0];
                let body = collider.parent().map(|parent| bodies.rigid_body_entity(parent).unwrap());
                let disabled = world.get::<ColliderDisabled>(entity).is_some()
                    || body.is_some_and(|body| world.get::<RigidBodyDisabled>(body).is_some());
                // A collider is disabled a step after its body.
                let parent = collider.parent().is_none_or(|parent| bodies.bodies[parent].is_enabled());
                assert_eq!(collider.is_enabled() && parent, !disabled, "{entity} of {body:?}");
            }
            if let Some(body) = body {
                let body = &bodies.bodies[body.0];
                let finite = body.position().is_finite() && body.linvel().is_finite() && body.angvel().is_finite();
                assert!(finite || !body.is_enabled(), "{entity}: {:?} {:?}", body.position(), body.vels());
                if body.is_enabled() && !self.paused {
                    assert!(transform.is_finite(), "{entity}: {transform:?}");
                }
            }
            let scale = if world.get::<ChildOf>(entity).is_some() { global.scale() } else { transform.scale };
            let uniform = scale.min_element() > 0.0
                && scale.max_element() < 1e3
                && scale.max_element() - scale.min_element() < 1e-6;
            if let Some(mesh) = mesh
                && assets.contains(&mesh.0)
                && uniform
            {
                let collider = &colliders.colliders[handle.unwrap_or_else(|| panic!("{entity} has no collider")).0];
                let shape = collider.shape().as_shape::<MedialShape>().expect("a medial shape");
                assert!((shape.shape.scale / scale.x - 1.0).abs() < 1e-3, "{entity}: {scale}");
            }
            // A shape stays until its replacement has loaded.
            let collider = handle.map(|handle| &colliders.colliders[handle.0]);
            let is_medial = |collider: &&RapierCollider| collider.shape().as_shape::<MedialShape>().is_some();
            medial += usize::from(collider.filter(is_medial).is_some_and(RapierCollider::is_enabled));
        }
        self.spoiled += spoiled;
        assert_eq!(colliders.colliders.len(), with_collider);
        assert_eq!(bodies.bodies.len(), with_body);
        if self.paused {
            return;
        }
        let step = world.resource::<MedialStep>();
        assert_eq!(step.infos.len(), step.input.bodies.len());
        assert_eq!(step.static_infos.len(), step.statics.bodies().len());
        let moving = step.input.bodies.iter().filter(|body| body.solid.medial().is_some()).count();
        let still = step.statics.bodies().iter().filter(|body| body.solid.medial().is_some()).count();
        assert!(moving + still == medial, "{moving} bodies and {still} statics, not {medial}");
        assert!(step.contacts().len() <= step.output.counts.body_pairs);
        for info in step.infos.iter().chain(&step.static_infos) {
            assert_eq!(world.get::<RapierColliderHandle>(info.entity).map(|handle| handle.0), Some(info.collider()));
        }
        self.check_walls();
    }

    /// Asserts that bodies held by the walls stay within them. Other bodies may press them in.
    fn check_walls(&mut self) {
        let world = self.app.world();
        for &entity in &self.things {
            let entity_ref = world.entity(entity);
            let at = entity_ref.get::<Transform>().unwrap().translation;
            let groups = entity_ref.get::<CollisionGroups>().copied().unwrap_or_default();
            let held = entity_ref.get::<RigidBody>() == Some(&RigidBody::Dynamic)
                && entity_ref.contains::<Collider>()
                && !entity_ref.contains::<Sensor>()
                && !entity_ref.contains::<ColliderDisabled>()
                && !entity_ref.contains::<RigidBodyDisabled>()
                && !entity_ref.contains::<MedialCcd>()
                && !entity_ref.contains::<StaticObb>()
                && groups.memberships != Group::NONE
                && groups.filters != Group::NONE;
            let within = at.abs().max_element() < 1.5 * ROOM;
            if !held {
                self.strays.insert(entity);
            } else if within && at.abs().max_element() < ROOM - 0.7 {
                self.strays.remove(&entity);
            }
            assert!(within || self.strays.contains(&entity), "{entity} has left the room: {at}");
        }
    }
}

fn walk(seed: u64, steps: usize) -> Walk {
    let mut walk = Walk::new(seed);
    for step in 0..steps {
        let result = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| walk.step()));
        if let Err(panic) = result {
            eprintln!("seed {seed}, step {step}: {:?}", &walk.history[walk.history.len().saturating_sub(200)..]);
            std::panic::resume_unwind(panic);
        }
    }
    // After all entities are despawned, no contact is left.
    while let Some(&entity) = walk.things.first() {
        walk.despawn(entity);
    }
    if walk.paused {
        walk.pause();
    }
    walk.update();
    assert!(walk.touching.iter().all(|(a, b)| walk.walls.contains(a) && walk.walls.contains(b)));
    assert!(walk.app.world().resource::<ContactTable>().is_empty());
    walk
}

fn walks(seeds: std::ops::Range<u64>, steps: usize) {
    let (mut done, mut touches, mut spoiled) = ([0; OPERATIONS.len()], 0, 0);
    for seed in seeds {
        let walk = walk(seed, steps);
        done.iter_mut().zip(walk.done).for_each(|(sum, count)| *sum += count);
        touches += walk.touches;
        spoiled += walk.spoiled;
    }
    println!("{touches} touches, {spoiled} spoiled at the end of a step, operations {done:?}");
    assert!(touches > steps / 2 && spoiled > steps / 10 && done.iter().all(|&count| count > steps / 100));
}

#[test]
fn random_walks_keep_all_bodies_and_repeat_no_message() {
    walks(0..6, 1000);
}

#[test]
#[ignore = "exhaustive"]
fn exhaustive_random_walks_keep_all_bodies_and_repeat_no_message() {
    walks(100..150, 2000);
}

#[test]
fn a_random_walk_is_reproducible() {
    let hash = |seed| {
        let mut walk = Walk::new(seed);
        let mut text = String::new();
        for _ in 0..500 {
            walk.step();
            for &entity in &walk.things {
                text += &format!("{:?}", walk.app.world().get::<Transform>(entity).unwrap());
            }
        }
        text
    };
    for seed in 0..2 {
        assert!(hash(seed) == hash(seed));
    }
}
