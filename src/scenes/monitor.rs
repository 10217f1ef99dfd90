//! Measurements of a scene: times, counts, and signs of errors.

use std::{collections::HashSet, time::Duration};

use bevy::{platform::time::Instant, prelude::*};
use bevy_rapier3d::{
    plugin::context::{DefaultRapierContext, RapierContextColliders, RapierContextSimulation, RapierRigidBodySet},
    prelude::{PhysicsSet, RapierConfiguration},
    rapier::dynamics::RigidBody as RapierBody,
};
use serde::Serialize;

use super::{Bullet, Projectile, SceneEntity, WORLD_RADIUS};
use crate::{
    pipeline::{Impact, Pair, Side, Times},
    plugin::{BodyInfo, MedialContactStarted, MedialStep, MedialSystems},
};

/// Change of speed in metres per second, beyond gravity and damping, that only a contact can cause.
const UNEXPLAINED_SPEED: f32 = 0.1;

/// Measurements of all steps so far.
#[derive(Resource, Default, Reflect)]
#[reflect(Resource, Default)]
pub struct Monitor {
    /// A row for each step.
    pub rows: Vec<Row>,
    /// Deepest overlap of any pair so far, in percent of the smaller body's size.
    pub deepest_overlap_percent: f32,
    /// Number of pairs that had an impact within a step, have no contact at its end, and have passed each other.
    pub tunnelled: usize,
    /// Number of bodies whose velocity changed without a body nearby.
    pub ghosts: usize,
    /// All entities that the scene's projectile has touched.
    pub touched_by_projectile: HashSet<Entity>,
    near: HashSet<Entity>,
    #[reflect(ignore)]
    step_begin: Option<Instant>,
    response: Duration,
}

/// Measurements of one step.
#[derive(Clone, Copy, Debug, Reflect, Serialize)]
pub struct Row {
    /// Broad phase, in milliseconds.
    pub broad_ms: f64,
    /// Mid phase, in milliseconds.
    pub mid_ms: f64,
    /// Narrow phase, in milliseconds.
    pub narrow_ms: f64,
    /// Stopping bodies at impacts, in milliseconds.
    pub stop_ms: f64,
    /// Search and reduction of contacts, in milliseconds.
    pub contact_search_ms: f64,
    /// Rapier's step, in milliseconds.
    pub response_ms: f64,
    /// Body pairs after the broad phase.
    pub body_pairs: usize,
    /// Primitive pairs after the mid phase.
    pub candidates: usize,
    /// Number of time of impact queries.
    pub toi_tests: usize,
    /// Contact points.
    pub contacts: usize,
    /// Number of bodies that stopped at an impact.
    pub stopped: usize,
    /// Deepest overlap in percent of the smaller body's size.
    pub overlap_percent: f32,
    /// Kinetic energy over mass, in joules per kilogram.
    pub kinetic_energy_per_kg: f32,
    /// Lowest point of any body, in metres.
    pub lowest_y: f32,
}

/// Median and 95th percentile of the times of a stage.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct StageSummary {
    /// Median.
    pub median_ms: f64,
    /// 95th percentile.
    pub p95_ms: f64,
}

/// Times of all stages.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Stages {
    /// Broad phase.
    pub broad: StageSummary,
    /// Mid phase.
    pub mid: StageSummary,
    /// Narrow phase: first impacts.
    pub narrow: StageSummary,
    /// Stopping bodies at impacts.
    pub stop: StageSummary,
    /// Search and reduction of contacts.
    pub contact_search: StageSummary,
    /// Rapier's step.
    pub response: StageSummary,
}

/// Counts. Those that vary are medians over the steps, each followed by its maximum.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct CountSummary {
    /// Moving bodies.
    pub bodies: usize,
    /// Primitive pairs in total.
    pub primitive_pairs: usize,
    /// Body pairs after the broad phase.
    pub body_pairs: usize,
    /// Maximum of that number.
    pub body_pairs_max: usize,
    /// Primitive pairs after the mid phase.
    pub candidates: usize,
    /// Maximum of that number.
    pub candidates_max: usize,
    /// Time of impact queries.
    pub toi_tests: usize,
    /// Maximum of that number.
    pub toi_tests_max: usize,
    /// Contact points.
    pub contacts: usize,
    /// Maximum of that number.
    pub contacts_max: usize,
}

/// Summary of a run.
#[derive(Clone, Debug, Serialize)]
pub struct Summary {
    /// Name of the scene.
    pub scene: String,
    /// Number of steps.
    pub steps: usize,
    /// Moving bodies.
    pub bodies: usize,
    /// Primitive pairs in total, which brute force would test in each step.
    pub primitive_pairs: usize,
    /// Times of the stages.
    pub stages: Stages,
    /// Counts.
    pub counts: CountSummary,
    /// Deepest overlap in any step, in percent of the smaller body's size.
    pub deepest_overlap_percent: f32,
    /// Lowest point of any body in any step, in metres.
    pub lowest_y: f32,
    /// Kinetic energy over mass at the end, in joules per kilogram.
    pub kinetic_energy_per_kg: f32,
    /// Bodies outside of the world at the end.
    pub escaped: usize,
    /// See [`Monitor::tunnelled`].
    pub tunnelled: usize,
    /// See [`Monitor::ghosts`].
    pub ghosts: usize,
    /// Bodies asleep at the end.
    pub asleep: usize,
    /// The seed.
    pub seed: u64,
}

/// Adds the monitor to an app whose physics runs in `PostUpdate`, and registers the components of scenes for reflection.
pub fn add_monitor(app: &mut App) {
    app.init_resource::<Monitor>()
        .register_type::<Monitor>()
        .register_type::<SceneEntity>()
        .register_type::<Projectile>()
        .register_type::<Bullet>()
        .add_systems(
            PostUpdate,
            (
                begin_response.after(MedialSystems::Snapshot).before(PhysicsSet::StepSimulation),
                end_response.after(PhysicsSet::StepSimulation).before(MedialSystems::Detect),
                watch.after(MedialSystems::Report),
            ),
        );
}

fn begin_response(mut monitor: ResMut<Monitor>) {
    monitor.step_begin = Some(Instant::now());
}

fn end_response(mut monitor: ResMut<Monitor>) {
    monitor.response = monitor.step_begin.take().map_or(Duration::ZERO, |begin| begin.elapsed());
}

fn watch(
    mut monitor: ResMut<Monitor>,
    step: Res<MedialStep>,
    projectiles: Query<(), With<Projectile>>,
    mut started: MessageReader<MedialContactStarted>,
    context: Single<
        (&RapierRigidBodySet, &RapierContextColliders, &RapierContextSimulation, &RapierConfiguration),
        With<DefaultRapierContext>,
    >,
) {
    let (bodies, colliders, _, configuration) = *context;
    if !configuration.physics_pipeline_active || step.input.bodies.is_empty() {
        return;
    }
    let monitor = monitor.as_mut();
    for message in started.read() {
        for (one, other) in [(message.entity1, message.entity2), (message.entity2, message.entity1)] {
            if projectiles.contains(one) {
                monitor.touched_by_projectile.insert(other);
            }
        }
    }
    let was_near = std::mem::take(&mut monitor.near);
    let overlap_percent = monitor.watch_pairs(&step);
    monitor.deepest_overlap_percent = monitor.deepest_overlap_percent.max(overlap_percent);
    let dynamic = dynamic_bodies(&step, bodies, colliders);
    monitor.watch_velocities(&step, &dynamic, &was_near, configuration.gravity);
    monitor.rows.push(Row::new(&step, monitor.response, overlap_percent, &dynamic));
}

/// Returns the dynamic bodies of a step: their indices and their rapier bodies.
fn dynamic_bodies<'a>(
    step: &MedialStep,
    bodies: &'a RapierRigidBodySet,
    colliders: &RapierContextColliders,
) -> Vec<(usize, &'a RapierBody)> {
    let rigid = |info: &BodyInfo| bodies.bodies.get(colliders.colliders.get(info.collider())?.parent()?);
    let all = step.infos.iter().enumerate();
    all.filter_map(|(index, info)| Some((index, rigid(info).filter(|rigid| rigid.is_dynamic())?))).collect()
}

impl Monitor {
    /// Counts pairs that have passed each other, and notes the bodies of all pairs as near another one. Returns the deepest overlap in percent of the smaller
    /// body's size.
    fn watch_pairs(&mut self, step: &MedialStep) -> f32 {
        let mut overlap_percent = 0.0f32;
        for pair in &step.output.pairs {
            let [info1, info2] = [pair.first, pair.second].map(|side| step.info(side));
            self.near.extend([info1.entity, info2.entity]);
            let moving = [pair.first, pair.second].into_iter().filter(|side| side.body().is_some());
            let size = 2.0 * moving.map(|side| step.solid(side).bounding_sphere().radius).fold(f32::INFINITY, f32::min);
            let manifolds = &step.output.manifolds[pair.manifolds.clone()];
            let deepest = manifolds.iter().map(|m| -m.contacts()[0].distance).fold(0.0, f32::max);
            overlap_percent = overlap_percent.max(100.0 * deepest / size);
            let parted = manifolds.is_empty() && !info1.sensor && !info2.sensor;
            if pair.impact.is_some_and(|impact| parted && has_passed(step, pair, &impact, PASSED * size)) {
                self.tunnelled += 1;
            }
        }
        overlap_percent
    }

    /// Counts bodies whose velocity has changed by more than gravity and damping, although no body was near at the start of the step.
    fn watch_velocities(
        &mut self,
        step: &MedialStep,
        dynamic: &[(usize, &RapierBody)],
        was_near: &HashSet<Entity>,
        gravity: Vec3,
    ) {
        for &(index, rigid) in dynamic {
            let info = &step.infos[index];
            if !step.input.bodies[index].active {
                // The cause of its waking up is not reported.
                self.near.insert(info.entity);
                continue;
            }
            let explained = info.linear + gravity * rigid.gravity_scale() * step.dt;
            let damped = explained / (1.0 + step.dt * rigid.linear_damping());
            let stopped = step.output.stop_of(index as u32).is_some();
            if !stopped && !was_near.contains(&info.entity) && rigid.linvel().distance(damped) > UNEXPLAINED_SPEED {
                self.ghosts += 1;
            }
        }
    }
}

impl Row {
    fn new(step: &MedialStep, response: Duration, overlap_percent: f32, dynamic: &[(usize, &RapierBody)]) -> Self {
        let (mut energy, mut mass, mut lowest_y) = (0.0, 0.0, f32::INFINITY);
        for &(index, rigid) in dynamic {
            energy += rigid.kinetic_energy();
            mass += rigid.mass();
            let Some(shape) = step.input.bodies[index].solid.medial() else { continue };
            for sphere in shape.axis.spheres().iter().map(|sphere| sphere.scaled(shape.scale)) {
                lowest_y = lowest_y.min(rigid.position().transform_point(sphere.center).y - sphere.radius);
            }
        }
        let ms = |duration: Duration| duration.as_secs_f64() * 1e3;
        let Times { broad, mid, narrow, stop, contacts } = step.output.times;
        let counts = &step.output.counts;
        Self {
            broad_ms: ms(broad),
            mid_ms: ms(mid),
            narrow_ms: ms(narrow),
            stop_ms: ms(stop),
            contact_search_ms: ms(contacts),
            response_ms: ms(response),
            body_pairs: counts.body_pairs,
            candidates: counts.candidates,
            toi_tests: counts.toi_tests,
            contacts: counts.contacts,
            stopped: step.output.stops.len(),
            overlap_percent,
            kinetic_energy_per_kg: if mass > 0.0 { energy / mass } else { 0.0 },
            lowest_y,
        }
    }
}

/// Largest allowed distance between points that have met and passed each other, in sizes of the smaller body. Bodies that slide along each other turn a little.
const PASSED: f32 = 5e-3;

/// Returns true if the points that met at an impact have passed each other by more than `slack` metres at the end of the step.
fn has_passed(step: &MedialStep, pair: &Pair, impact: &Impact, slack: f32) -> bool {
    let end_of = |side: Side| {
        let Side::Body(index) = side else { return impact.point };
        let then = match step.output.stop_of(index) {
            Some(stop) if stop.fraction <= impact.fraction => stop.pose,
            _ => step.input.bodies[index as usize].sweep.pose_at(impact.fraction),
        };
        step.final_pose(side).transform_point(then.inverse_transform_point(impact.point))
    };
    (end_of(pair.second) - end_of(pair.first)).dot(impact.normal) < -slack
}

/// Returns the element at a fraction of the sorted values, or the default if there is no value.
fn quantile<T: Copy + Default + PartialOrd>(values: impl Iterator<Item = T>, fraction: f64) -> T {
    let mut values: Vec<T> = values.collect();
    values.sort_by(|a, b| a.partial_cmp(b).unwrap_or(std::cmp::Ordering::Equal));
    let last = values.len().saturating_sub(1);
    values.get((last as f64 * fraction).round() as usize).copied().unwrap_or_default()
}

impl Monitor {
    /// Returns a summary of the run so far.
    pub fn summary(&self, scene: &str, seed: u64, world: &mut World) -> Summary {
        let stage = |value: fn(&Row) -> f64| StageSummary {
            median_ms: quantile(self.rows.iter().map(value), 0.5),
            p95_ms: quantile(self.rows.iter().map(value), 0.95),
        };
        let median = |value: fn(&Row) -> usize| quantile(self.rows.iter().map(value), 0.5);
        let most = |value: fn(&Row) -> usize| self.rows.iter().map(value).max().unwrap_or(0);
        let (mut asleep, mut escaped) = (0, 0);
        let mut context = world.query::<&RapierRigidBodySet>();
        for set in context.iter(world) {
            for (_, body) in set.bodies.iter().filter(|(_, body)| body.is_dynamic()) {
                asleep += usize::from(body.is_sleeping());
                // A position that is NaN has escaped as well.
                let inside = body.translation().length() <= WORLD_RADIUS;
                escaped += usize::from(!inside);
            }
        }
        let step = world.resource::<MedialStep>();
        let counts = &step.output.counts;
        Summary {
            scene: scene.into(),
            steps: self.rows.len(),
            bodies: counts.bodies,
            primitive_pairs: counts.primitive_pairs,
            stages: Stages {
                broad: stage(|row| row.broad_ms),
                mid: stage(|row| row.mid_ms),
                narrow: stage(|row| row.narrow_ms),
                stop: stage(|row| row.stop_ms),
                contact_search: stage(|row| row.contact_search_ms),
                response: stage(|row| row.response_ms),
            },
            counts: CountSummary {
                bodies: counts.bodies,
                primitive_pairs: counts.primitive_pairs,
                body_pairs: median(|row| row.body_pairs),
                body_pairs_max: most(|row| row.body_pairs),
                candidates: median(|row| row.candidates),
                candidates_max: most(|row| row.candidates),
                toi_tests: median(|row| row.toi_tests),
                toi_tests_max: most(|row| row.toi_tests),
                contacts: median(|row| row.contacts),
                contacts_max: most(|row| row.contacts),
            },
            deepest_overlap_percent: self.deepest_overlap_percent,
            lowest_y: self.rows.iter().map(|row| row.lowest_y).fold(f32::INFINITY, f32::min),
            kinetic_energy_per_kg: self.rows.last().map_or(0.0, |row| row.kinetic_energy_per_kg),
            escaped,
            tunnelled: self.tunnelled,
            ghosts: self.ghosts,
            asleep,
            seed,
        }
    }
}
