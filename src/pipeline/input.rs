//! What a step depends on: bodies and their motion, statics, settings.

#[cfg(feature = "gpu")]
use std::sync::atomic::{AtomicU64, Ordering};
use std::{collections::HashSet, fmt, sync::Arc};

use glam::{BVec3, Vec3};

use super::{ConvexParts, Pace, Reach, Second, Shape, broad_phase};
use crate::{
    constants::CORE_DEPTH,
    geometry::{Aabb, Bvh, Obb, Pose3, Sphere, Sweep},
    query::Cuboid,
};

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
    /// False for bodies that sleep or never move: two of these are not looked at, unless something else may carry one along.
    pub active: bool,
    /// True if it stops where it is at an impact: a dynamic body does, a kinematic one goes on.
    pub stops: bool,
    /// True if nothing stops at it, nor it at anything: a sensor.
    pub passes: bool,
    /// True for a sensor, which is told of what joints keep from colliding with it as well.
    pub sensor: bool,
    /// Axes of the world along which it does not move, whatever pushes it.
    pub locked: BVec3,
    /// True if impacts have held it up for a whole step.
    pub held: bool,
    /// Its core is that much smaller than the body, in bounding radii of the smaller body of a pair.
    pub core_depth: f32,
    /// Its pace in the next step, if a solver acts on contacts: it has use for [fewer](Reach::of_pair) of them.
    pub pace: Option<Pace>,
}

impl Body {
    /// A moving body that collides with all and stops at impacts, without a solver.
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
            sensor: false,
            locked: BVec3::FALSE,
            held: false,
            core_depth: CORE_DEPTH,
            pace: None,
        }
    }

    /// How far any point of a body that impacts do not stop can push others, in metres.
    pub(super) fn push_reach(&self) -> f32 {
        let radius = self.solid.bounding_sphere().farthest(self.sweep.local_center);
        self.sweep.reach(radius)
    }

    /// The part of a displacement that its locked axes allow, in metres.
    pub(super) fn free_path(&self, displacement: Vec3) -> Vec3 {
        Vec3::select(self.locked, Vec3::ZERO, displacement)
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
    /// True for a sensor, which is told of what joints keep from colliding with it as well.
    pub sensor: bool,
}

impl StaticBody {
    /// A body that collides with all.
    pub fn new(solid: impl Into<Solid>, pose: Pose3) -> Self {
        let all = Groups::ALL;
        let solid = solid.into();
        let (groups, types, stop_groups) = (all, all, all);
        Self { solid, pose, order: 0, owner: None, groups, types, stop_groups, world: 0, passes: false, sensor: false }
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
    pub(super) bodies: Arc<[StaticBody]>,
    pub(super) boxes: Arc<[Obb]>,
    pub(super) bvh: Arc<Bvh>,
    /// Number of primitives and parts, and how many of them are medial.
    pub(super) primitives: [usize; 2],
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
    /// Contacts are reported up to this distance, in metres; of bodies with a [pace](Body::pace) up to [`Reach::of_pair`].
    pub prediction: f32,
    /// Size of a typical body in metres, 1 if nothing is said: lengths that no shape tells, such as how near is a touch, are in proportion to it.
    pub length_unit: f32,
    /// The same for statics. Impacts are first touches of cores.
    pub core_depth: f32,
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
            core_depth: CORE_DEPTH,
            stop_at_impact: false,
            culling: Culling::default(),
            report_candidates: false,
        }
    }
}

impl StepInput {
    /// True for a body that impacts stop.
    pub(super) fn is_stopping(&self, body: u32) -> bool {
        self.stop_at_impact && self.bodies[body as usize].stops
    }

    /// What a side of a pair is made of, and its motion over the step.
    pub(super) fn side<'a>(&'a self, statics: &'a Statics, side: Side) -> (&'a Solid, Sweep) {
        match side {
            Side::Body(body) => {
                let body = &self.bodies[body as usize];
                (&body.solid, body.sweep)
            }
            Side::Static(body) => {
                let body = &statics.bodies[body as usize];
                (&body.solid, Sweep::at_rest(body.pose))
            }
        }
    }

    /// How far contacts of a pair are searched after the step. `moved_until`: the fraction of the step for which a body has moved; the next step is longer for
    /// the body by the rest.
    pub(super) fn reach(&self, sides: [Side; 2], moved_until: impl Fn(u32) -> f32) -> Reach {
        let reach = Reach::new(self.prediction, self.length_unit);
        let pace = |body: u32| {
            let times = 2.0 - moved_until(body);
            self.bodies[body as usize].pace.map(|pace| pace.times(times))
        };
        way(sides, pace).map_or(reach, |way| reach.of_pair(way))
    }

    /// The depth of the core of a side, per metre of the smaller body's bounding radius. Bodies without a medial mesh have no core.
    pub(super) fn core_depth(&self, statics: &Statics, side: Side) -> f32 {
        let (depth, solid) = match side {
            Side::Body(body) => (self.bodies[body as usize].core_depth, &self.bodies[body as usize].solid),
            Side::Static(body) => (self.core_depth, &statics.bodies[body as usize].solid),
        };
        solid.medial().map_or(0.0, |_| depth)
    }
}

/// How far a pair goes in a step, in metres, if the paces of its bodies are known.
fn way(sides: [Side; 2], pace: impl Fn(u32) -> Option<Pace>) -> Option<f32> {
    let [pace1, pace2] = sides.map(|side| side.body().map_or(Some(Pace::REST), &pace));
    Some(pace1?.against(&pace2?))
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
