//! One step of collision detection on plain data: [`StepInput`] in, [`StepOutput`] out.
//!
//! ```text
//!   poses, shapes, statics
//!     broad   swept bounding spheres against each other, and against a BVH of static boxes  -> body pairs
//!     mid     primitive BVH against primitive BVH (or box), swept over the step             -> candidate primitive pairs
//!     narrow  first impacts within the step, contacts at its end                            -> raw contacts, impacts
//!     stop    between the two: bodies that stop or slide on at impacts                      -> where they end the step
//!     reduce  a few manifolds per body pair
//!   sorted contacts, impacts, counts and times
//! ```
//!
//! Bodies are dense indices; who they are is the caller's business. All stages are pure functions of their input, split into
//! chunks that are joined in order, so the output has the same bits for any number of threads.

mod broad_phase;
pub mod contact;
mod first_impact;
mod first_touch;
mod islands;
mod mid_phase;
mod motion;
mod moving_boxes;
mod narrow_phase;
mod near;
pub(crate) mod parallel;
mod parting;
mod parts;
mod reduce;
mod seams;
mod shape;
mod stop;
mod thin;

#[cfg(feature = "gpu")]
use std::sync::atomic::{AtomicU64, Ordering};
use std::{collections::HashSet, fmt, ops::Range, sync::Arc, time::Duration};

use bevy::{platform::time::Instant, tasks::TaskPool};
use glam::Vec3;

use crate::{
    constants::{SLIDE_WAY, TOUCH_DISTANCE},
    geometry::{Aabb, Bvh, Obb, Pose3, Sphere, Sweep},
    query::Cuboid,
};

use broad_phase::BodyPair;
#[cfg(feature = "debug")]
pub(crate) use broad_phase::swept_cone;
#[cfg(feature = "gpu")]
pub(crate) use broad_phase::{Widening, near_sides};
use moving_boxes::BodyBoxes;

pub use contact::{Contact, Manifold, Second};
pub use first_touch::first_touch;
pub use parts::{ConvexParts, Core, Part};
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

    /// True if one of both collides with the other.
    pub fn test_either(&self, other: &Groups) -> bool {
        self.memberships & other.filter != 0 || other.memberships & self.filter != 0
    }
}

/// What a body is made of.
#[derive(Clone)]
pub enum Solid {
    /// A medial mesh.
    Medial(Shape),
    /// Any other collider.
    Parts(Arc<dyn ConvexParts>),
}

impl Solid {
    /// The medial mesh, if it is one.
    pub fn medial(&self) -> Option<&Shape> {
        match self {
            Solid::Medial(shape) => Some(shape),
            Solid::Parts(_) => None,
        }
    }

    /// It as the second side of a pair.
    pub fn second(&self) -> Second<'_> {
        match self {
            Solid::Medial(shape) => Second::Shape(shape),
            Solid::Parts(parts) => Second::Parts(&**parts),
        }
    }

    /// Number of primitives or parts.
    pub fn len(&self) -> usize {
        match self {
            Solid::Medial(shape) => shape.len(),
            Solid::Parts(parts) => parts.len(),
        }
    }

    /// True if it has none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Box around it, in its own frame.
    pub fn aabb(&self) -> Aabb {
        match self {
            Solid::Medial(shape) => shape.aabb(),
            Solid::Parts(parts) => parts.aabb(),
        }
    }

    /// Sphere around it, in its own frame.
    pub fn bounding_sphere(&self) -> Sphere {
        match self {
            Solid::Medial(shape) => shape.bounding_sphere(),
            Solid::Parts(parts) => parts.bounding_sphere(),
        }
    }
}

impl fmt::Debug for Solid {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Solid::Medial(shape) => f.debug_tuple("Medial").field(shape).finish(),
            Solid::Parts(parts) => f.debug_tuple("Parts").field(&parts.aabb()).finish(),
        }
    }
}

impl From<Shape> for Solid {
    fn from(shape: Shape) -> Self {
        Solid::Medial(shape)
    }
}

/// A body and its motion over the step. Pairs are made of a medial body and any other.
#[derive(Clone, Debug)]
pub struct Body {
    /// What it is made of.
    pub solid: Solid,
    /// Its motion.
    pub sweep: Sweep,
    /// Its place in the order of all bodies and statics, from which relative poses are taken: see [`relative_pose`].
    pub order: u32,
    /// Whom it collides with.
    pub groups: Groups,
    /// Its type of body, and the types that it collides with: that one of both does is enough.
    pub types: Groups,
    /// Whom it stops at, among those.
    pub stop_groups: Groups,
    /// The rigid body that it is one of several shapes of: shapes of one owner do not collide.
    pub owner: Option<u64>,
    /// What it is joined with: shapes of one rigid body, and rigid bodies on joints, stop together.
    pub assembly: Option<u64>,
    /// The world that it is in: bodies of different worlds do not meet.
    pub world: u32,
    /// False for bodies that sleep or never move: two of these are not looked at.
    pub active: bool,
    /// True if it stops where it is at an impact: a dynamic body does, a kinematic one goes on.
    pub stops: bool,
    /// True if nothing stops at it, nor it at anything: a sensor.
    pub passes: bool,
}

impl Body {
    /// A moving body that collides with all and stops at impacts.
    pub fn new(solid: impl Into<Solid>, sweep: Sweep) -> Self {
        Self {
            solid: solid.into(),
            sweep,
            order: 0,
            groups: Groups::ALL,
            types: Groups::ALL,
            stop_groups: Groups::ALL,
            owner: None,
            assembly: None,
            world: 0,
            active: true,
            stops: true,
            passes: false,
        }
    }
}

/// A body that never moves by itself.
#[derive(Clone, Debug)]
pub struct StaticBody {
    /// What it is made of.
    pub solid: Solid,
    /// Where it is.
    pub pose: Pose3,
    /// Its place in the order of all bodies and statics, from which relative poses are taken: see [`relative_pose`].
    pub order: u32,
    /// The rigid body that it is a shape of.
    pub owner: Option<u64>,
    /// Whom it collides with.
    pub groups: Groups,
    /// Its type of body, and the types that it collides with: that one of both does is enough.
    pub types: Groups,
    /// Whom it stops, among those.
    pub stop_groups: Groups,
    /// The world that it is in.
    pub world: u32,
    /// True if nothing stops at it: a sensor.
    pub passes: bool,
}

impl StaticBody {
    /// A body that collides with all.
    pub fn new(solid: impl Into<Solid>, pose: Pose3) -> Self {
        let all = Groups::ALL;
        let solid = solid.into();
        Self { solid, pose, order: 0, owner: None, groups: all, types: all, stop_groups: all, world: 0, passes: false }
    }

    /// A box that collides with all.
    pub fn solid_box(obb: Obb) -> Self {
        Self::new(Solid::Parts(Arc::new(Cuboid { half: obb.half_extents })), obb.pose)
    }

    /// The box around it.
    pub fn obb(&self) -> Obb {
        let aabb = self.solid.aabb();
        Obb { pose: self.pose * Pose3::from_translation(aabb.center()), half_extents: aabb.half_extents() }
    }
}

/// Pose of the second side of a pair in the frame of the first, by their poses and [`Body::order`]: that of the later in the frame of the
/// earlier, or its inverse. Rapier's narrow phase does so, and contacts have the same bits whoever asks for them.
pub fn relative_pose([(pose1, order1), (pose2, order2)]: [(Pose3, u32); 2]) -> Pose3 {
    if order1 <= order2 { pose1.inv_mul(&pose2) } else { pose2.inv_mul(&pose1).inverse() }
}

/// The static bodies and the hierarchy over their boxes, rebuilt only when one of them changes. Clones share them.
#[derive(Clone, Debug, Default)]
pub struct Statics {
    /// No other statics have it, but clones and those that are empty by default.
    #[cfg(feature = "gpu")]
    id: u64,
    bodies: Arc<[StaticBody]>,
    boxes: Arc<[Obb]>,
    bvh: Arc<Bvh>,
    /// Number of primitives and parts, and how many of them are medial.
    primitives: [usize; 2],
}

impl Statics {
    /// Statics from their list, whose positions are the indices of [`Side::Static`].
    pub fn new(bodies: Vec<StaticBody>) -> Self {
        let boxes: Vec<Obb> = bodies.iter().map(StaticBody::obb).collect();
        let aabbs: Vec<Aabb> = boxes.iter().map(Obb::aabb).collect();
        let primitives = broad_phase::count(bodies.iter().map(|body| &body.solid));
        #[cfg(feature = "gpu")]
        static NEXT: AtomicU64 = AtomicU64::new(1);
        Self {
            #[cfg(feature = "gpu")]
            id: NEXT.fetch_add(1, Ordering::Relaxed),
            bvh: Arc::new(Bvh::new(&aabbs)),
            boxes: boxes.into(),
            bodies: bodies.into(),
            primitives,
        }
    }

    /// The bodies.
    pub fn bodies(&self) -> &[StaticBody] {
        &self.bodies
    }

    /// Tells these statics from others.
    #[cfg(feature = "gpu")]
    pub(crate) fn id(&self) -> u64 {
        self.id
    }

    /// The hierarchy over their boxes.
    #[cfg(any(feature = "debug", feature = "gpu"))]
    pub(crate) fn bvh(&self) -> &Bvh {
        &self.bvh
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
#[derive(Clone, Debug)]
pub struct StepInput {
    /// The bodies.
    pub bodies: Vec<Body>,
    /// Owners that do not collide, the lesser first: bodies that a joint keeps from it.
    pub apart: HashSet<[u64; 2]>,
    /// Contacts are reported up to this distance, in metres.
    pub prediction: f32,
    /// Size of a typical body in metres, 1 if nothing is said: lengths that no shape tells, such as how near is a touch, are in proportion to it.
    pub length_unit: f32,
    /// Overlap that the solver leaves at a contact on purpose, in metres: no reason to stop.
    pub allowed_overlap: f32,
    /// How far gravity alone moves a body in the step, in metres: what goes into another by no more slides on, and does not stop.
    pub fall: f32,
    /// Bodies stop at their first impact.
    pub stop_at_impact: bool,
    /// Which pairs reach the narrow phase.
    pub culling: Culling,
    /// The pairs that the mid phase leaves are part of the output.
    pub report_candidates: bool,
}

impl Default for StepInput {
    fn default() -> Self {
        Self {
            bodies: Vec::new(),
            apart: HashSet::new(),
            prediction: 0.0,
            length_unit: 1.0,
            allowed_overlap: 0.0,
            fall: 0.0,
            stop_at_impact: false,
            culling: Culling::default(),
            report_candidates: false,
        }
    }
}

impl StepInput {
    /// True for a body that impacts stop.
    fn is_stopping(&self, body: u32) -> bool {
        self.stop_at_impact && self.bodies[body as usize].stops
    }

    /// How far a body may leave its way to slide on, in metres.
    fn slide_way(&self) -> f32 {
        self.fall.max(SLIDE_WAY * self.prediction)
    }

    /// How far apart bodies that slide may end the step, in metres: what turns in a long step comes off the ground, and falls back in the next.
    fn parting_way(&self) -> f32 {
        TOUCH_DISTANCE * self.length_unit + (self.fall - SLIDE_WAY * self.prediction).max(0.0)
    }
}

/// One side of a pair.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Side {
    /// A body, by its index.
    Body(u32),
    /// A static body.
    Static(u32),
}

impl Side {
    /// The index of a body.
    pub fn body(self) -> Option<u32> {
        match self {
            Side::Body(body) => Some(body),
            Side::Static(_) => None,
        }
    }
}

/// What a pair of bodies that may collide is to each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Meeting {
    /// They do not collide: nothing is found.
    Apart,
    /// Contacts and impacts are found, and neither stops at the other.
    Passing,
    /// They stop at an impact, as far as each by itself does.
    Stopping,
}

/// First impact of a pair within the step: they touch, and would overlap by more than a slop if nothing stopped them; or they are in
/// touch at the start and would overlap by more than a slop beyond that.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Impact {
    /// When, as a fraction of the step.
    pub fraction: f32,
    /// Where, in the world, at that instant.
    pub point: Vec3,
    /// Unit normal from the first side to the second, in the world.
    pub normal: Vec3,
    /// Primitive of the first side.
    pub primitive1: u32,
    /// Primitive of the second, or its part.
    pub primitive2: u32,
}

/// A pair of bodies that touch, touched within the step, or are within the prediction distance at its end.
#[derive(Clone, Debug, PartialEq)]
pub struct Pair {
    /// The first side, which is medial.
    pub first: Side,
    /// The second; if it is medial as well, a body of a higher index or a static.
    pub second: Side,
    /// Its manifolds where the bodies end the step: a range of [`StepOutput::manifolds`].
    pub manifolds: Range<usize>,
    /// Their first impact, if there is one.
    pub impact: Option<Impact>,
}

/// A body that does not end the step where its motion would take it: it stops at an impact, slides on along what it touches, or is carried along.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stop {
    /// The body.
    pub body: u32,
    /// When it has left its way, as a fraction of the step; 1 if it slides, and so loses no time.
    pub fraction: f32,
    /// Its pose at the end of the step.
    pub pose: Pose3,
}

/// What a step yields, sorted by body indices.
#[derive(Clone, Debug, Default)]
pub struct StepOutput {
    /// Bodies that stop at an impact, slide on or are carried along.
    pub stops: Vec<Stop>,
    /// Pairs with something to tell.
    pub pairs: Vec<Pair>,
    /// Their manifolds.
    pub manifolds: Vec<Manifold>,
    /// What the mid phase has left, if it was to be reported. Of a second side that is not medial, the number of the part is not told: it is 0.
    pub candidates: Vec<Candidates>,
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
    /// Narrow phase: first impacts, and contacts.
    pub narrow: Duration,
    /// Where bodies stop, and what that changes.
    pub stop: Duration,
    /// Reduction.
    pub reduce: Duration,
}

impl Times {
    /// All stages.
    pub fn total(&self) -> Duration {
        self.broad + self.mid + self.narrow + self.stop + self.reduce
    }
}

/// Runs stages 2 to 5 of a step.
pub fn step(input: &StepInput, statics: &Statics, pool: &TaskPool) -> StepOutput {
    step_filtered(input, statics, |_, _| Meeting::Stopping, pool)
}

/// Runs stages 2 to 5 of a step. The filter is asked once about each pair that the broad phase finds, in their order.
pub fn step_filtered(
    input: &StepInput,
    statics: &Statics,
    filter: impl Fn(Side, Side) -> Meeting,
    pool: &TaskPool,
) -> StepOutput {
    let mut output = StepOutput::default();
    let mut lap = laps();

    let pairs = broad_phase::run(input, statics, filter, pool);
    output.times.broad = lap();

    let boxes = BodyBoxes::new(input, statics, &pairs, pool);
    let candidates = mid_phase::run(input, statics, &pairs, &boxes, pool);
    output.times.mid = lap();

    finish(input, statics, &pairs, (&candidates, &boxes), output, pool)
}

/// Two bodies that may meet within the step, wherever each stops, and those of their primitives that may come within the
/// prediction distance of each other if none does.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Candidates {
    /// The bodies, in any order. One of them at least is medial.
    pub sides: [Side; 2],
    /// Primitives of the first side and the second, in any order; of a side that is not medial the parts. None if they are not known: the mid
    /// phase finds them.
    pub primitives: Option<Vec<[u32; 2]>>,
}

/// Runs what follows culling, where that was done elsewhere. The filter is asked once about each pair that may collide, in their order.
///
/// Of the candidates, pairs of bodies that may not collide are left out. Whatever is found by searching again within the step, where
/// bodies spin fast or have stopped, is culled as in any other step.
///
/// # Panics
/// If an index is out of range.
pub fn step_from_candidates(
    input: &StepInput,
    statics: &Statics,
    candidates: Vec<Candidates>,
    filter: impl Fn(Side, Side) -> Meeting,
    pool: &TaskPool,
) -> StepOutput {
    let mut output = StepOutput::default();
    let mut lap = laps();

    let (pairs, primitives): (Vec<_>, Vec<_>) =
        broad_phase::from_candidates(input, statics, candidates, filter).into_iter().unzip();
    output.times.broad = lap();

    let boxes = BodyBoxes::new(input, statics, &pairs, pool);
    let candidates = mid_phase::from_candidates(input, statics, &pairs, primitives, &boxes);
    output.times.mid = lap();

    finish(input, statics, &pairs, (&candidates, &boxes), output, pool)
}

/// A clock that tells the time since it was last asked.
fn laps() -> impl FnMut() -> Duration {
    let mut clock = Instant::now();
    move || {
        let now = Instant::now();
        now - std::mem::replace(&mut clock, now)
    }
}

/// Runs stages 4 and 5.
fn finish(
    input: &StepInput,
    statics: &Statics,
    pairs: &[BodyPair],
    (candidates, boxes): (&[Vec<mid_phase::Candidates>], &BodyBoxes),
    mut output: StepOutput,
    pool: &TaskPool,
) -> StepOutput {
    let mut lap = laps();
    let mut results = narrow_phase::impacts(input, statics, pairs, candidates, pool);
    output.times.narrow = lap();

    let stops = stop::run(input, statics, pairs, candidates, boxes, &mut results, pool);
    output.times.stop = lap();

    let contacts = narrow_phase::contacts(input, statics, pairs, candidates, &stops, pool);
    output.times.narrow += lap();

    output.counts = Counts {
        bodies: input.bodies.len(),
        primitive_pairs: broad_phase::primitive_pairs(input, statics),
        body_pairs: pairs.len(),
        candidates: candidates.iter().flatten().map(|candidates| candidates.pairs.len()).sum(),
        toi_tests: results.iter().map(|r| r.toi_tests).sum(),
        unresolved: results.iter().map(|r| r.unresolved).sum(),
        contacts: 0,
    };
    if input.report_candidates {
        let of_pair = |(pair, motions): (&BodyPair, &Vec<mid_phase::Candidates>)| Candidates {
            sides: [pair.first, pair.second],
            primitives: Some(
                motions.iter().flat_map(|motion| motion.pairs.iter().map(|pair| pair.primitives)).collect(),
            ),
        };
        output.candidates = pairs.iter().zip(candidates).map(of_pair).collect();
    }
    output.stops =
        stops.iter().map(|(body, fraction)| Stop { body, fraction, pose: stops.final_pose(input, body) }).collect();
    let impacts = results.iter().map(|result| result.impact);
    reduce::run(pairs, impacts, &contacts, input.length_unit, &mut output, pool);
    output.times.reduce = lap();
    output
}
