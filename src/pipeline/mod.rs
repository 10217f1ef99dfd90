//! One step of collision detection on plain data: [`StepInput`] in, [`StepOutput`] out.
//!
//! ```text
//!   poses, shapes, statics
//!     broad   swept bounding spheres against each other, and against a BVH of static boxes  -> body pairs
//!     mid     primitive BVH against primitive BVH (or box), swept over the step             -> candidate primitive pairs
//!     narrow  first impacts within the step, the bodies that stop there, contacts at the end -> raw contacts, impacts
//!     reduce  a few manifolds per body pair
//!   sorted contacts, impacts, counts and times
//! ```
//!
//! Bodies are dense indices; who they are is the caller's business. All stages are pure functions of their input, split into
//! chunks that are joined in order, so the output has the same bits for any number of threads.

mod broad_phase;
pub mod contact;
mod mid_phase;
mod motion;
mod narrow_phase;
mod parallel;
mod reduce;
mod shape;
mod stop;

use std::{
    collections::HashSet,
    ops::Range,
    time::{Duration, Instant},
};

use bevy::tasks::TaskPool;
use glam::Vec3;

use crate::geometry::{Aabb, Bvh, Obb, Pose3, Sweep};

pub use contact::{Contact, Manifold, Second};
pub(crate) use shape::with_spheres;
pub use shape::{Hull, Shape};

/// Which pairs of bodies may collide: each one's memberships must meet the other's filter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Groups {
    /// Groups that the body is in, one per bit.
    pub memberships: u32,
    /// Groups that it collides with.
    pub filter: u32,
}

impl Groups {
    /// In every group, collides with every group.
    pub const ALL: Groups = Groups { memberships: u32::MAX, filter: u32::MAX };

    /// True if both may collide.
    pub fn test(&self, other: &Groups) -> bool {
        self.memberships & other.filter != 0 && other.memberships & self.filter != 0
    }
}

/// A medial body and its motion over the step.
#[derive(Clone, Debug)]
pub struct Body {
    /// Its shape.
    pub shape: Shape,
    /// Its motion.
    pub sweep: Sweep,
    /// Whom it collides with.
    pub groups: Groups,
    /// Whom it stops at, among those.
    pub stop_groups: Groups,
    /// The rigid body that it is one of several shapes of: shapes of one owner do not collide, and stop together.
    pub owner: Option<u32>,
    /// False for bodies that sleep or never move: two of these are not looked at.
    pub active: bool,
    /// True if it stops where it is at an impact: a dynamic body does, a kinematic one goes on.
    pub stops: bool,
    /// True if nothing stops at it, nor it at anything: a sensor.
    pub passes: bool,
}

impl Body {
    /// A moving body that collides with all and stops at impacts.
    pub fn new(shape: Shape, sweep: Sweep) -> Self {
        let (groups, stop_groups) = (Groups::ALL, Groups::ALL);
        Self { shape, sweep, groups, stop_groups, owner: None, active: true, stops: true, passes: false }
    }
}

/// A body that never moves by itself: a box, or a shape with its box.
#[derive(Clone, Debug)]
pub struct StaticBody {
    /// The solid box, or the box around the shape.
    pub obb: Obb,
    /// The shape and its pose. None: the box is the shape.
    pub shape: Option<(Shape, Pose3)>,
    /// Whom it collides with.
    pub groups: Groups,
    /// Whom it stops, among those.
    pub stop_groups: Groups,
    /// True if nothing stops at it: a sensor.
    pub passes: bool,
}

impl StaticBody {
    /// A box that collides with all.
    pub fn solid_box(obb: Obb) -> Self {
        Self { obb, shape: None, groups: Groups::ALL, stop_groups: Groups::ALL, passes: false }
    }

    /// A shape that collides with all.
    pub fn solid_shape(shape: Shape, pose: Pose3) -> Self {
        let aabb = shape.aabb();
        let obb = Obb { pose: pose * Pose3::from_translation(aabb.center()), half_extents: aabb.half_extents() };
        Self { shape: Some((shape, pose)), ..Self::solid_box(obb) }
    }

    /// What others collide with, and its pose.
    fn side(&self) -> (Second<'_>, Pose3) {
        match &self.shape {
            Some((shape, pose)) => (Second::Shape(shape), *pose),
            None => (Second::Cuboid(self.obb.half_extents), self.obb.pose),
        }
    }
}

/// The static bodies and the hierarchy over their boxes, rebuilt only when one of them changes.
#[derive(Clone, Debug, Default)]
pub struct Statics {
    bodies: Vec<StaticBody>,
    bvh: Bvh,
}

impl Statics {
    /// Statics from their list, whose positions are the indices of [`Target::Static`].
    pub fn new(bodies: Vec<StaticBody>) -> Self {
        let boxes: Vec<Aabb> = bodies.iter().map(|body| body.obb.aabb()).collect();
        Self { bvh: Bvh::new(&boxes), bodies }
    }

    /// The bodies.
    pub fn bodies(&self) -> &[StaticBody] {
        &self.bodies
    }
}

/// Which pairs reach the narrow phase.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Culling {
    /// Hybrid culling: swept spheres, BVH of static boxes, primitive BVHs.
    #[default]
    Hybrid,
    /// Every primitive pair of every body pair: the reference to measure against.
    None,
}

/// Everything that a step depends on.
#[derive(Clone, Debug, Default)]
pub struct StepInput {
    /// The bodies.
    pub bodies: Vec<Body>,
    /// Owners that do not collide, the lesser first: bodies that a joint keeps from it.
    pub apart: HashSet<[u32; 2]>,
    /// Contacts are reported up to this distance, in metres.
    pub prediction: f32,
    /// Overlap that the solver leaves at a contact on purpose, in metres: no reason to stop.
    pub allowed_overlap: f32,
    /// Bodies stop at their first impact.
    pub stop_at_impact: bool,
    /// Which pairs reach the narrow phase.
    pub culling: Culling,
}

/// The second side of a pair.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Target {
    /// A body, of a higher index than the first.
    Body(u32),
    /// A static body.
    Static(u32),
}

/// First impact of a pair within the step: they touch, and would overlap by more than a slop if nothing stopped them; or they are in
/// touch at the start and would overlap by more than a slop beyond that.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Impact {
    /// When, as a fraction of the step.
    pub fraction: f32,
    /// Where, in the world, at that instant.
    pub point: Vec3,
    /// Unit normal from the first body to the second, in the world.
    pub normal: Vec3,
    /// Primitive of the first body.
    pub primitive1: u32,
    /// Primitive of the second; 0 for a box.
    pub primitive2: u32,
}

/// A pair of bodies that touch, touched within the step, or are within the prediction distance at its end.
#[derive(Clone, Debug, PartialEq)]
pub struct Pair {
    /// The first body.
    pub body1: u32,
    /// The second.
    pub target: Target,
    /// Its manifolds where the bodies end the step: a range of [`StepOutput::manifolds`].
    pub manifolds: Range<usize>,
    /// Their first impact, if there is one.
    pub impact: Option<Impact>,
}

/// A body that stops within the step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stop {
    /// The body.
    pub body: u32,
    /// When, as a fraction of the step.
    pub fraction: f32,
    /// Its pose from then on.
    pub pose: Pose3,
}

/// What a step yields, sorted by body indices.
#[derive(Clone, Debug, Default)]
pub struct StepOutput {
    /// Bodies that stop at an impact.
    pub stops: Vec<Stop>,
    /// Pairs with something to tell.
    pub pairs: Vec<Pair>,
    /// Their manifolds.
    pub manifolds: Vec<Manifold>,
    /// What was counted.
    pub counts: Counts,
    /// What it took.
    pub times: Times,
}

impl StepOutput {
    /// The stop of a body, if it has one.
    pub fn stop_of(&self, body: u32) -> Option<&Stop> {
        self.stops.binary_search_by_key(&body, |stop| stop.body).ok().map(|i| &self.stops[i])
    }
}

/// Counts of one step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Bodies.
    pub bodies: usize,
    /// Primitive pairs of all body pairs that may collide: what brute force would test.
    pub primitive_pairs: usize,
    /// Body pairs that the broad phase leaves.
    pub body_pairs: usize,
    /// Primitive pairs that the mid phase leaves.
    pub candidates: usize,
    /// Time of impact queries.
    pub toi_tests: usize,
    /// Contact points after reduction.
    pub contacts: usize,
    /// Time of impact queries that ran out of rounds.
    pub unresolved: usize,
}

/// Wall time of the stages of one step.
#[derive(Clone, Copy, Debug, Default)]
pub struct Times {
    /// Broad phase.
    pub broad: Duration,
    /// Mid phase.
    pub mid: Duration,
    /// Narrow phase.
    pub narrow: Duration,
    /// Reduction.
    pub reduce: Duration,
}

impl Times {
    /// All stages.
    pub fn total(&self) -> Duration {
        self.broad + self.mid + self.narrow + self.reduce
    }
}

/// Runs stages 2 to 5 of a step.
pub fn step(input: &StepInput, statics: &Statics, pool: &TaskPool) -> StepOutput {
    let mut output = StepOutput::default();
    let mut clock = Instant::now();
    let mut lap = || {
        let now = Instant::now();
        now - std::mem::replace(&mut clock, now)
    };

    let pairs = broad_phase::run(input, statics, pool);
    output.times.broad = lap();

    let candidates = mid_phase::run(input, statics, &pairs, pool);
    output.times.mid = lap();

    let mut results = narrow_phase::impacts(input, statics, &pairs, &candidates, pool);
    let stops = stop::run(input, statics, &pairs, &mut results);
    let contacts = narrow_phase::contacts(input, statics, &pairs, &candidates, &stops, pool);
    output.times.narrow = lap();

    output.counts = Counts {
        bodies: input.bodies.len(),
        primitive_pairs: broad_phase::primitive_pairs(input, statics),
        body_pairs: pairs.len(),
        candidates: candidates.iter().map(Vec::len).sum(),
        toi_tests: results.iter().map(|r| r.toi_tests).sum(),
        unresolved: results.iter().map(|r| r.unresolved).sum(),
        contacts: 0,
    };
    output.stops =
        stops.iter().map(|(body, fraction)| Stop { body, fraction, pose: stops.final_pose(input, body) }).collect();
    let impacts = results.iter().map(|result| result.impact);
    reduce::run(&pairs, impacts, contacts, &mut output);
    output.times.reduce = lap();
    output
}
