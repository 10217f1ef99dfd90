//! Rapier gets contacts by two routes: from the table of the last step, or computed on request. Both give the same contacts.

use bevy::prelude::*;
use bevy_medial::{
    constants::LINEAR_SLOP,
    geometry::Pose3,
    medial_axis::MedialAxis,
    pipeline::{ContactMargin, Shape, contacts},
    plugin::{MedialSettings, MedialStep, MedialSystems},
    prelude::{MedialMesh, StaticObb},
    rapier::{ContactTable, MedialDispatcher, MedialShape},
    scenes::Scene,
};
use bevy_rapier3d::{
    parry::{
        query::{ContactManifold, PersistentQueryDispatcher},
        shape::Shape as ParryShape,
    },
    plugin::context::{RapierContextColliders, RapierContextSimulation, RapierRigidBodySet},
    prelude::{self, PhysicsSet, RigidBody},
    rapier::geometry::{Collider, ColliderHandle, ContactData, ContactManifoldData},
};

use crate::common::*;

type Manifold = ContactManifold<ContactManifoldData, ContactData>;

/// State of an app's physics.
struct Physics<'w> {
    bodies: &'w RapierRigidBodySet,
    colliders: &'w RapierContextColliders,
    simulation: &'w RapierContextSimulation,
    step: &'w MedialStep,
    table: &'w ContactTable,
}

impl Physics<'_> {
    fn with<R>(world: &mut World, function: impl FnOnce(Physics) -> R) -> R {
        let mut context = world.query::<(&RapierRigidBodySet, &RapierContextColliders, &RapierContextSimulation)>();
        let world = &*world;
        let (bodies, colliders, simulation) = context.single(world).unwrap();
        let (step, table) = (world.resource::<MedialStep>(), world.resource::<ContactTable>());
        function(Physics { bodies, colliders, simulation, step, table })
    }

    fn collider(&self, handle: ColliderHandle) -> &Collider {
        &self.colliders.colliders[handle]
    }

    /// Pose of a collider after the step. The collider of a stopped body follows only in rapier's next step.
    fn pose(&self, handle: ColliderHandle) -> Pose3 {
        let collider = self.collider(handle);
        match (collider.parent(), collider.position_wrt_parent()) {
            (Some(parent), Some(local)) => self.bodies.bodies[parent].position() * local,
            _ => *collider.position(),
        }
    }
}

/// An app that searches all contacts in every step.
fn searching_app() -> App {
    let mut app = app();
    app.world_mut().resource_mut::<MedialSettings>().recycle_contacts = false;
    app
}

#[test]
fn contacts_of_a_step_equal_those_computed_at_its_end() {
    let (mut bodies, mut statics, mut contacts, mut fast) = (0, 0, 0, 0);
    for (name, steps) in [("rods", 150), ("dinosaur", 40), ("tori", 100)] {
        let mut app = searching_app();
        Scene::by_name(name).unwrap().spawn(app.world_mut(), models(), 3);
        for _ in 0..steps {
            app.update();
            let step = app.world().resource::<MedialStep>();
            for pair in &step.output.pairs {
                let [first, second] = [pair.first, pair.second].map(|side| step.solid(side));
                *if pair.second.body().is_some() { &mut bodies } else { &mut statics } += 1;
                let (shape1, second) = (first.medial().unwrap(), second.second());
                let touch = pair.reach.touch();
                let found = &step.output.manifolds[pair.manifolds.clone()];
                // The contacts of a fast pair that is apart depend on its motion too.
                let points: Vec<_> = found.iter().flat_map(|manifold| manifold.contacts()).collect();
                if pair.reach.is_fast && points.iter().all(|contact| contact.distance > touch) {
                    let mut all = Vec::new();
                    contacts::find(shape1, second, &step.final_pose12(pair), pair.reach, &mut all);
                    assert!(points.iter().all(|contact| all.contains(contact)), "{name}: {pair:?}");
                    fast += 1;
                    continue;
                }
                let computed = contacts::manifolds(shape1, second, &step.final_pose12(pair), pair.reach);
                assert_eq!(found, computed, "{name}: {pair:?}");
                contacts += found.iter().map(|manifold| manifold.contacts().len()).sum::<usize>();
            }
        }
    }
    println!("{bodies} pairs of bodies, {statics} with statics, {contacts} contacts");
    assert!(bodies > 1000 && statics > 1000 && contacts > 10_000 && fast > 10, "{fast} fast pairs");
}

fn points(manifolds: &[Manifold]) -> Vec<(Vec3, Vec3, Vec3, Vec3, f32)> {
    let points = manifolds.iter().flat_map(|m| m.points.iter().map(move |p| (m.local_n1, m.local_n2, p)));
    points.map(|(n1, n2, p)| (n1, n2, p.local_p1, p.local_p2, p.dist)).collect()
}

fn ask(dispatcher: &MedialDispatcher, pose12: &Pose3, shapes: [&dyn ParryShape; 2], prediction: f32) -> Vec<Manifold> {
    let mut manifolds = Vec::new();
    dispatcher.contact_manifolds(pose12, shapes[0], shapes[1], prediction, &mut manifolds, &mut None).unwrap();
    manifolds
}

/// Another shape with the key of the collider's shape. A computation finds no contact for it, but the table returns contacts by the key.
fn disguised(shape: &dyn ParryShape, other: &Shape) -> Option<MedialShape> {
    shape.as_shape::<MedialShape>().map(|medial| MedialShape::new(other.clone(), medial.key))
}

/// Counts of pairs: with contacts from the table, by bodies and statics; with computed contacts; and with another reach than at rest.
#[derive(Resource, Clone, Default, Debug)]
struct Routes {
    with_bodies: usize,
    with_statics: usize,
    misses: usize,
    moving: usize,
    /// Pairs of two medial shapes that the step and rapier order differently.
    turned: usize,
}

/// Compares the routes before each step of rapier, from the next update on.
fn compare(app: &mut App, routes: &Routes, what: &'static str) {
    let compare = move |world: &mut World| {
        world.resource_scope(|world, mut routes: Mut<Routes>| routes.compare(world, what));
    };
    app.insert_resource(routes.clone());
    app.add_systems(PostUpdate, compare.after(MedialSystems::Snapshot).before(PhysicsSet::StepSimulation));
}

impl Routes {
    /// Compares both routes for all pairs with contacts at their current poses.
    fn compare(&mut self, world: &mut World, what: &str) {
        // Far away from the other side, and from each other for any rotation of nearby bodies.
        let far_away = [500.0, 900.0]
            .map(|at| Shape::new(MedialAxis::capsule(Vec3::splat(at), Vec3::splat(at + 1.0), 0.1).unwrap()));
        Physics::with(world, |physics| {
            let prediction = physics.simulation.integration_parameters.prediction_distance();
            let known = MedialDispatcher { table: physics.table.clone() };
            let unknown = MedialDispatcher { table: ContactTable::default() };
            let near = physics.step.output.pairs.iter().filter(|pair| !pair.manifolds.is_empty());
            assert!(physics.table.len() >= near.clone().count());
            for pair in near {
                // Rapier passes the lower handle first.
                let mut handles = [pair.first, pair.second].map(|side| physics.step.info(side).collider());
                handles.sort_by_key(|handle| handle.into_raw_parts());
                let pose12 = physics.pose(handles[0]).inv_mul(&physics.pose(handles[1]));
                let shapes = handles.map(|handle| physics.collider(handle).shape());
                let sides = [pair.first, pair.second].map(|side| physics.step.info(side).collider());
                let from_first = sides.map(|handle| physics.collider(handle).shape());
                let computed = |reach: f32| {
                    // Without a table the pair counts as resting, and the dispatcher uses a quarter of the prediction distance.
                    let found = ask(&unknown, &physics.step.final_pose12(pair), from_first, 4.0 * reach);
                    let mut computed = points(&found);
                    if handles != sides {
                        computed.iter_mut().for_each(|(n1, n2, p1, p2, _)| {
                            std::mem::swap(n1, n2);
                            std::mem::swap(p1, p2);
                        });
                    }
                    computed
                };
                if handles != sides && shapes.iter().all(|shape| shape.as_shape::<MedialShape>().is_some()) {
                    self.turned += 1;
                }
                self.moving += usize::from(pair.reach.prediction != 0.25 * prediction);

                // If the contacts come from the table, the disguised shapes get them as well.
                let disguises: [_; 2] = std::array::from_fn(|side| disguised(shapes[side], &far_away[side]));
                let disguises: [&dyn ParryShape; 2] =
                    [0, 1].map(|i| disguises[i].as_ref().map_or(shapes[i], |shape| shape as &dyn ParryShape));
                assert!(points(&ask(&unknown, &pose12, disguises, prediction)).is_empty());
                let answer = points(&ask(&known, &pose12, shapes, prediction));
                let found = points(&ask(&known, &pose12, disguises, prediction));
                if found.is_empty() {
                    // A stopped body has another velocity, and perhaps another reach.
                    let halved = (0..8).map(|times| prediction * 0.5f32.powi(times)).chain([LINEAR_SLOP]);
                    assert!(halved.into_iter().any(|reach| computed(reach) == answer), "{what}");
                    self.misses += 1;
                    continue;
                }
                let ContactMargin { prediction, is_fast, .. } = pair.reach;
                let is_apart = answer.iter().all(|(.., distance)| *distance > pair.reach.touch());
                assert!((is_fast && is_apart) || computed(prediction) == answer, "{what}");
                assert_eq!(found, answer, "{what}");
                *if pair.second.body().is_some() { &mut self.with_bodies } else { &mut self.with_statics } += 1;
            }
        });
    }
}

/// A scene in which rapier gets the colliders of one type of medial body before those of the others.
fn scene_with_first(name: &str, kind: RigidBody) -> App {
    let mut app = searching_app();
    Scene::by_name(name).unwrap().spawn(app.world_mut(), models(), 3);
    let mut all = app.world_mut().query::<(Entity, &RigidBody, &MedialMesh)>();
    let later = all.iter(app.world()).filter(|(_, body, _)| **body != kind);
    let later: Vec<(Entity, MedialMesh)> = later.map(|(entity, _, mesh)| (entity, mesh.clone())).collect();
    for (entity, _) in &later {
        app.world_mut().entity_mut(*entity).remove::<MedialMesh>();
    }
    app.update();
    for (entity, mesh) in later {
        app.world_mut().entity_mut(entity).insert(mesh);
    }
    app
}

#[test]
fn contacts_from_the_table_equal_computed_contacts() {
    let mut routes = Routes::default();
    for kind in [RigidBody::Dynamic, RigidBody::Fixed] {
        for (name, steps) in [("rods", 150), ("dinosaur", 40), ("tori", 100), ("bullets", 30)] {
            let mut app = scene_with_first(name, kind);
            compare(&mut app, &routes, name);
            run(&mut app, steps);
            routes = app.world().resource::<Routes>().clone();
        }
    }
    println!("{routes:?}");
    let Routes { with_bodies, with_statics, misses, moving, turned } = routes;
    assert!(with_bodies > 1000 && with_statics > 1000, "{routes:?}");
    assert!(misses < (with_bodies + with_statics) / 30, "{routes:?}");
    assert!(turned > 100, "{turned}");
    assert!(moving > 0 && moving < with_bodies + with_statics, "{moving}");
}

/// The inverse of a pose is rounded, so the order of a pair matters.
#[test]
fn both_routes_agree_for_any_order_of_the_pair() {
    for floor_first in [false, true] {
        let mut app = searching_app();
        let tilt = Quat::from_euler(EulerRot::XYZ, 0.3, 0.4, 0.2);
        let floor = (StaticObb::new(5.0, 0.5, 5.0), Transform::from_xyz(0.1, -0.5, 0.2).with_rotation(tilt));
        let lump = (RigidBody::Dynamic, prelude::Collider::ball(0.2), Transform::from_xyz(1.0, 0.8, 0.0));
        let spawn_others = |app: &mut App| {
            app.world_mut().spawn(floor);
            app.world_mut().spawn(lump.clone());
            app.update();
        };
        if floor_first {
            spawn_others(&mut app);
        }
        for i in 0..4 {
            let at = Transform::from_xyz(0.6 * i as f32 - 0.9, 0.5, 0.3).with_rotation(Quat::from_rotation_x(i as f32));
            spawn_body(&mut app, model("torus"), at);
        }
        app.update();
        if !floor_first {
            spawn_others(&mut app);
        }
        compare(&mut app, &Routes::default(), "a tilted floor");
        run(&mut app, 150);
        let routes = app.world().resource::<Routes>();
        println!("{routes:?}");
        assert!(routes.with_statics > 100 && 50 * routes.misses < routes.with_statics, "{routes:?}");
    }
}

#[test]
fn a_moved_body_gets_contacts_at_its_current_pose() {
    let mut app = searching_app();
    spawn_ground(&mut app);
    let body = spawn_body(&mut app, model("torus"), Transform::from_xyz(0.0, 0.06, 0.0));
    run(&mut app, 200);
    assert!(is_at_rest(&mut app, body));
    // Sleeping pairs are not in the table. The body wakes because it is moved slightly into the ground, and must come out.
    for height in [0.0525 - 0.02, 0.0525 - 0.03] {
        app.world_mut().get_mut::<Transform>(body).unwrap().translation.y = height;
        run(&mut app, 300);
        let found = position(&mut app, body).y;
        assert!((found - 0.0525).abs() < 2e-3, "{height}: {found}");
    }
}
