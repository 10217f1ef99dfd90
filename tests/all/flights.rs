//! Fast impacts compared with the same app in fine steps, and near misses. Bodies are shot at a thin wall, at a resting body of the same
//! shape, and at each other.
//!
//! The *transfer* of a hit is the change of the first body's momentum in [`STEPS`] steps; 5 to 7 of them follow the first contact. A ratio of
//! transfers compares the component along the reference's transfer. A hit is *chaotic* if its reference changes by more than a tenth in steps
//! half as long. Such a hit has no valid reference.
//!
//! Rapier's gyroscopic term is off because it is explicit in time and adds energy to a body that spins fast in free flight. Without it a free
//! body keeps its angular velocity although its inertia turns with it. So the energy of an impact is computed with the inertia at the impact.

use bevy::prelude::*;
use bevy_medial::{
    geometry::{Obb, Pose3, Sweep},
    medial_axis::MedialAxis,
    pipeline::{OtherShape, Shape, contacts},
    plugin::MedialStep,
    prelude::*,
    query::Cuboid,
    scenes::{Bullet, headless_app, load_models},
};
use bevy_rapier3d::{
    plugin::context::RapierRigidBodySet,
    prelude::{CollisionGroups, GravityScale, Group, PhysicsSet, RapierRigidBodyHandle, RigidBody, Velocity},
};
use glam::DVec3;

use crate::{
    common::*,
    true_motion::{Motion, Solid, corners_of_box, distance},
};

/// Steps of the reference per step of the app.
const FINER: u32 = 100;

/// Largest number of steps until the transfer is measured, for flights with impacts in consecutive steps.
const LONGEST: u32 = 12;

/// Steps of free flight before a hit if the GPU looks ahead: its first answers come this late.
const LEAD: u32 = 10;

/// Steps until the transfer is measured.
const STEPS: u32 = 8;

/// Further steps in which no body may get behind the wall.
const FURTHER: u32 = 120;

/// A hit that transfers less than this part of the reference's transfer is lost.
const LOST: f64 = 0.2;

/// Hits that transfer less than this part of the flying body's momentum, in the reference, are grazes.
const GRAZE: f64 = 0.05;

/// Speeds of the flights, in metres per second.
pub const SPEEDS: [f32; 6] = [1.0, 10.0, 50.0, 100.0, 300.0, 1000.0];

/// Clearance of a near miss, in metres.
const CLEARANCE: f64 = 0.02;

/// Half extents of the wall in metres. It is 5 cm thick along x, the direction of flight.
const WALL: Vec3 = Vec3::new(0.025, 8.0, 8.0);

mod cells;

pub use cells::{Aim, Cell, shapes};
use cells::{Flight, Flyer};

/// Many flights in one app, each in its own collision group.
struct Range {
    app: App,
    bodies: Vec<Vec<Entity>>,
}

impl Range {
    /// Spawns the flights in an app with steps of `dt` seconds.
    fn new(cell: &Cell, flights: &[Flight], dt: f32, mut app: App) -> Self {
        assert!(flights.len() < 32);
        app.add_systems(
            PostUpdate,
            without_gyroscopic_term.after(PhysicsSet::SyncBackend).before(PhysicsSet::StepSimulation),
        );
        let mesh = mesh(&mut app, cell.shape.axis.clone());
        if cell.aim == Aim::Wall {
            app.world_mut().spawn((StaticObb { half_extents: WALL }, Transform::default()));
        }
        let mut spawn = |group: Group, flyer: &Flyer| {
            // The wall is a member of every group.
            let filter = if cell.aim == Aim::Wall { Group::GROUP_32 } else { group };
            let transform = Transform {
                translation: flyer.pose.translation,
                rotation: flyer.pose.rotation,
                scale: Vec3::splat(cell.shape.scale),
            };
            let velocity = Velocity { angular: same_turn(flyer.velocity.angular, dt), ..flyer.velocity };
            let body = (RigidBody::Dynamic, Bullet, mesh.clone(), transform, velocity, GravityScale(0.0));
            app.world_mut().spawn((body, CollisionGroups::new(group, filter))).id()
        };
        let groups = (0..).map(|i| Group::from_bits_retain(1 << i));
        let bodies = flights.iter().zip(groups).map(|(flight, g)| flight.iter().map(|f| spawn(g, f)).collect());
        let bodies = bodies.collect();
        Self { app, bodies }
    }

    /// Momenta of a flight's bodies, in kg m/s.
    fn momenta(&mut self, flight: usize) -> Vec<DVec3> {
        let momentum = |entity: &Entity| {
            let body = rigid(&mut self.app, *entity);
            body.linvel().as_dvec3() * f64::from(body.mass())
        };
        self.bodies[flight].iter().map(momentum).collect()
    }

    fn all_momenta(&mut self) -> Vec<Vec<DVec3>> {
        (0..self.bodies.len()).map(|flight| self.momenta(flight)).collect()
    }

    /// Kinetic energy of a flight's bodies before and after the last step, in joules. Both use the orientations at the start of the step.
    fn energies(&mut self, flight: usize) -> [f64; 2] {
        let mut energies = [0.0; 2];
        for &entity in &self.bodies[flight] {
            let body = rigid(&mut self.app, entity);
            let step = self.app.world().resource::<MedialStep>();
            let i = index(step, entity);
            let mass = &body.mass_properties().local_mprops;
            let frame = step.input.bodies[i].sweep.start.rotation * mass.principal_inertia_local_frame;
            let info = &step.infos[i];
            let velocities = [(info.linear, info.angular), (body.linvel(), body.angvel())];
            for (energy, (linear, angular)) in energies.iter_mut().zip(velocities) {
                let spin = frame.inverse() * angular;
                let turning = (spin * spin).dot(mass.principal_inertia());
                *energy += 0.5 * f64::from(body.mass() * linear.length_squared() + turning);
            }
        }
        energies
    }
}

/// Angular speed at which rapier turns a body in steps of `dt`. It is slightly less than `spin`.
fn rate(spin: f64, dt: f32) -> f64 {
    let substep = f64::from(dt) / 4.0;
    (spin * substep * 0.5).atan() * 2.0 / substep
}

/// The angular velocity that turns a body in steps of `dt` as fast as `angular` turns it in steps of [`DT`].
fn same_turn(angular: Vec3, dt: f32) -> Vec3 {
    let substep = f64::from(dt) / 4.0;
    let spin = (rate(angular.as_dvec3().length(), DT) * substep * 0.5).tan() * 2.0 / substep;
    angular.normalize_or_zero() * spin as f32
}

/// Energy balance of a flight.
#[derive(Clone)]
struct Work {
    /// Initial kinetic energy, in joules.
    energy: f64,
    /// Work of all impulses so far, in joules.
    work: f64,
}

fn without_gyroscopic_term(
    added: Query<&RapierRigidBodyHandle, Added<RapierRigidBodyHandle>>,
    mut set: Single<&mut RapierRigidBodySet>,
) {
    for handle in &added {
        set.bodies[handle.0].enable_gyroscopic_forces(false);
    }
}

/// Steps of free flight that the app needs before a body comes near its target.
fn lead(app: &App) -> u32 {
    if app.world().resource::<MedialSettings>().pipelined { LEAD } else { 0 }
}

/// The index of a body in the last step.
fn index(step: &MedialStep, entity: Entity) -> usize {
    step.infos.iter().position(|info| info.entity == entity).unwrap()
}

/// Results of the hits of a cell.
#[derive(Default, Debug)]
pub struct Hits {
    pub count: usize,
    /// Hits with too little transfer in the reference to compare.
    pub grazes: usize,
    /// Hits without a valid reference.
    pub chaotic: usize,
    /// Hits with too little transfer. A chaotic hit counts only if this holds for both references.
    pub lost: usize,
    /// Ratios of transfers, in ascending order.
    pub ratios: Vec<f64>,
    /// Largest change of the total momentum, in momenta of the flying body.
    pub momentum_error: f64,
    /// Hits whose impulses together add, at any time, more than a hundredth of the initial energy.
    pub gains: usize,
    /// Bodies that were behind the wall at the end of any step.
    pub behind: usize,
}

impl Hits {
    pub fn within(&self, part: f64) -> usize {
        self.ratios.iter().filter(|ratio| (**ratio - 1.0).abs() <= part).count()
    }

    pub fn median(&self) -> f64 {
        self.ratios[self.ratios.len() / 2]
    }
}

pub fn run_hits(cell: &Cell, seed: u64, count: usize, stop_at_impact: bool) -> Hits {
    let app = (cell.app)(DT);
    let lead = lead(&app);
    let [flights, earlier] = cell.hits(&mut Random(seed), count, lead);
    let references = [FINER, 2 * FINER].map(|finer| {
        let mut fine = Range::new(cell, &flights, DT / finer as f32, headless_app(DT / finer as f32));
        // The bodies take part from the second update on.
        run(&mut fine.app, 1);
        // The momenta after each step at which a flight may be measured; the first one is step `STEPS`.
        let mut after = |steps: u32| {
            run(&mut fine.app, steps);
            fine.all_momenta()
        };
        let first = after(STEPS * finer - 1);
        std::iter::once(first).chain((STEPS..LONGEST).map(|_| after(finer))).collect::<Vec<_>>()
    });
    let mut coarse = Range::new(cell, &earlier, DT, app);
    coarse.app.world_mut().resource_mut::<MedialSettings>().stop_at_impact = stop_at_impact;
    run(&mut coarse.app, 1 + lead);
    // No body touches anything this early.
    let before = coarse.all_momenta();
    let mut hits = Hits { count, ..default() };
    let mut gained = vec![false; count];
    let mut works: Vec<Option<Work>> = vec![None; count];
    let mut behind = vec![false; count];
    // Number of steps of each flight, and its momenta after them.
    let mut measured = vec![None; count];
    for steps in 2..=LONGEST {
        run(&mut coarse.app, 1);
        note_behind_the_wall(cell, &mut coarse, &mut behind);
        for i in 0..count {
            let [energy_before, energy_after] = coarse.energies(i);
            let Work { energy, work } = works[i].get_or_insert(Work { energy: energy_before, work: 0.0 });
            *work += energy_after - energy_before;
            gained[i] |= *work > 0.01 * *energy;
            // The solver acts on an impact in the step after it.
            let step = coarse.app.world().resource::<MedialStep>();
            let stops = step.output.stop_of(index(step, coarse.bodies[i][0]) as u32).is_some();
            if measured[i].is_none() && steps >= STEPS && (!stops || steps == LONGEST) {
                measured[i] = Some((steps, coarse.momenta(i)));
            }
        }
    }

    for (i, (steps, after)) in measured.iter().flatten().enumerate() {
        let [fine, finer] = references.each_ref().map(|reference| &reference[(steps - STEPS) as usize][i]);
        let before = &before[i];
        let flying = before[0].length();
        if cell.aim != Aim::Wall {
            let total = |momenta: &[DVec3]| momenta.iter().sum::<DVec3>();
            hits.momentum_error = hits.momentum_error.max(total(after).distance(total(before)) / flying);
        }
        hits.gains += usize::from(gained[i]);
        let [truth, finer, transfer] = [fine, finer, after].map(|momenta| momenta[0] - before[0]);
        let ratio = |truth: DVec3| transfer.dot(truth) / truth.length_squared();
        if truth.length() < GRAZE * flying {
            hits.grazes += 1;
        } else if truth.distance(finer) > 0.1 * truth.length() {
            hits.chaotic += 1;
            hits.lost += usize::from(ratio(truth) < LOST && ratio(finer) < LOST);
        } else {
            hits.lost += usize::from(ratio(truth) < LOST);
            hits.ratios.push(ratio(truth));
        }
    }
    hits.ratios.sort_by(f64::total_cmp);
    if cell.aim == Aim::Wall {
        for _ in 0..FURTHER {
            run(&mut coarse.app, 1);
            note_behind_the_wall(cell, &mut coarse, &mut behind);
        }
    }
    hits.behind = behind.iter().filter(|behind| **behind).count();
    hits
}

/// Notes which bodies have a sphere's centre behind the wall's middle, if there is a wall.
fn note_behind_the_wall(cell: &Cell, range: &mut Range, behind: &mut [bool]) {
    if cell.aim != Aim::Wall {
        return;
    }
    for (bodies, behind) in range.bodies.iter().zip(behind) {
        let pose = *rigid(&mut range.app, bodies[0]).position();
        let spheres = cell.shape.axis.spheres().iter();
        let mut centers = spheres.map(|sphere| pose.transform_point(sphere.center * cell.shape.scale));
        *behind |= centers.any(|center| center.x > 0.0 && center.yz().abs().max_element() < WALL.y);
    }
}

/// Returns the number of proven near misses, and how many of them stopped or deflected a body.
pub fn run_misses(cell: &Cell, seed: u64, count: usize) -> [usize; 2] {
    let app = (cell.app)(DT);
    let lead = lead(&app);
    let flights = cell.misses(&mut Random(seed), count, lead);
    let mut range = Range::new(cell, &flights, DT, app);
    let mut clear = vec![true; count];
    let mut changed = vec![false; count];
    for _ in 0..lead + (cell.passage() / f64::from(DT)).ceil() as u32 + 3 {
        run(&mut range.app, 1);
        let step = range.app.world().resource::<MedialStep>();
        for (i, (bodies, flight)) in range.bodies.iter().zip(&flights).enumerate() {
            if changed[i] {
                continue;
            }
            let sweeps: Vec<Sweep> = bodies.iter().map(|b| step.input.bodies[index(step, *b)].sweep).collect();
            let solid = |sweep: &Sweep| Solid::of_shape(&cell.shape, Motion::new(sweep, DVec3::ZERO));
            let second = sweeps.get(1).map_or_else(
                || {
                    let obb = Obb { pose: Pose3::IDENTITY, half_extents: WALL };
                    let still = Motion::new(&Sweep::at_rest(obb.pose), DVec3::ZERO);
                    Solid::new(std::iter::once(corners_of_box(&obb)), still)
                },
                solid,
            );
            clear[i] &= stays_clear(&solid(&sweeps[0]), &second);
            changed[i] = bodies.iter().zip(&sweeps).zip(flight).any(|((body, sweep), flyer)| {
                let difference = sweep.translation / DT - flyer.velocity.linear;
                // Positions are rounded to micrometres.
                let rounding = 1e-3 * (1.0 + cell.speed);
                step.output.stop_of(index(step, *body) as u32).is_some() || difference.length() > rounding
            });
        }
    }
    let proven = clear.iter().filter(|clear| **clear).count();
    [proven, clear.iter().zip(&changed).filter(|(clear, changed)| **clear && **changed).count()]
}

/// True if two solids stay apart by at least [`CLEARANCE`] during the whole step.
fn stays_clear(first: &Solid, second: &Solid) -> bool {
    let limit = 0.1;
    let reach = first.reach() + second.reach();
    let mut fraction = 0.0;
    while fraction <= 1.0 {
        let above = distance(first, second, fraction, limit) - CLEARANCE;
        if above < 0.0 {
            return false;
        }
        fraction += above.max(1e-4) / reach;
    }
    true
}

/// Checks the cells with the given numbers. The numbers 0 to 11 cover every speed with and without spin, and every shape at every target.
/// Returns how many transfers are within 25 % of the reference, and how many were compared.
pub fn check(app: fn(f32) -> App, cells: impl Iterator<Item = usize>) -> [usize; 2] {
    let aims = [Aim::Wall, Aim::Resting, Aim::HeadOn];
    let shapes = shapes();
    let (mut close, mut ratios, mut misses, mut flown) = (0, Vec::new(), 0, [0; 2]);
    for i in cells {
        let (name, shape) = shapes[i % 4].clone();
        let spin = if (i + i / 6) % 2 == 0 { 0.0 } else { 100.0 };
        let cell = Cell { shape, aim: aims[i % 3], speed: SPEEDS[i % 6], spin, app };
        let hits = run_hits(&cell, 1, 20, true);
        println!("{name} {:?} {} {spin}: {hits:?}", cell.aim, cell.speed);
        assert_eq!((hits.lost, hits.behind, hits.gains), (0, 0, 0));
        assert!(hits.momentum_error < 0.01);
        close += hits.within(0.25);
        ratios.extend(hits.ratios);
        flown[0] += hits.count;
        if cell.speed > 1.0 {
            let [proven, ghosts] = run_misses(&cell, 1, 10);
            assert_eq!(ghosts, 0);
            misses += proven;
            flown[1] += 10;
        }
    }
    ratios.sort_by(f64::total_cmp);
    let (compared, median) = (ratios.len(), ratios[ratios.len() / 2]);
    assert!(
        5 * compared >= 4 * flown[0] && 10 * misses > 9 * flown[1],
        "{compared} hits, {misses} misses of {flown:?}"
    );
    assert!((median - 1.0).abs() < 0.02, "median {median}");
    [close, compared]
}
