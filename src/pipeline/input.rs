//! Input of a step: bodies and their motion, statics, settings.

#[cfg(feature = "gpu")]
use std::sync::atomic::{AtomicU64, Ordering};
use std::{collections::HashSet, sync::Arc};

use glam::{BVec3, Vec3};

use super::{Displacement, Solid, solid::count};
use crate::{
    constants::CORE_DEPTH,
    geometry::{Aabb, Bvh, Obb, Pose3, Sweep},
    query::Cuboid,
};

/// Collision groups. Two bodies may collide if the memberships of each one share a bit with the filter of the other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Groups {
    /// Groups of the body, one per bit.
    pub memberships: u32,
    /// Groups that the body collides with.
    pub filter: u32,
}

impl Groups {
    /// In every group, collides with every group.
    pub const ALL: Groups = Groups { memberships: u32::MAX, filter: u32::MAX };

    /// Returns true if each body accepts the other.
    pub fn test(&self, other: &Groups) -> bool {
        self.memberships & other.filter != 0 && other.memberships & self.filter != 0
    }

    /// Returns true if at least one body accepts the other.
    pub fn test_either(&self, other: &Groups) -> bool {
        self.memberships & other.filter != 0 || other.memberships & self.filter != 0
    }
}

/// A body and its motion over the step. At least one body of each pair is medial.
#[derive(Clone, Debug)]
pub struct Body {
    /// The shape.
    pub solid: Solid,
    /// The motion over the step.
    pub sweep: Sweep,
    /// Index in the order of all bodies and statics, which fixes the rounding of relative poses: see [`StepInput::pose12`].
    pub order: u32,
    /// Identity of the body in successive steps, unique among all bodies and statics. Pairs without it keep no [contacts](super::ContactCache).
    pub id: Option<u64>,
    /// Collision groups.
    pub groups: Groups,
    /// Type of the body, and the types that it collides with. A pair collides if at least one body accepts the type of the other.
    pub types: Groups,
    /// Solver groups: bodies stop only at bodies with matching solver groups.
    pub stop_groups: Groups,
    /// The rigid body that this shape belongs to. Shapes of one rigid body do not collide.
    pub rigid_body: Option<u64>,
    /// The joint island of the body. Shapes of one rigid body, and rigid bodies on joints, share a joint island and stop together.
    pub joint_island: Option<u64>,
    /// The world of the body. Bodies of different worlds do not collide.
    pub world: u32,
    /// False for bodies that sleep or never move. Pairs of inactive bodies are skipped unless a third body may push one of them.
    pub active: bool,
    /// True if the body stops at impacts. Dynamic bodies stop; kinematic bodies do not.
    pub stops: bool,
    /// True if the body stops at no other body and no body stops at it: a sensor, or a collider with `MedialCcd::DISABLED`.
    pub passes: bool,
    /// True for a sensor. Sensors detect bodies even if a joint disables the collisions with these bodies.
    pub sensor: bool,
    /// World axes along which no push moves the body.
    pub locked: BVec3,
    /// How much smaller the core is than the body, in bounding radii of the smaller body of a pair.
    pub core_depth: f32,
    /// Displacement in the next step, if a solver acts on contacts. The solver needs [fewer contacts](super::ContactMargin::of_pair) then.
    pub next_displacement: Option<Displacement>,
}

impl Body {
    /// Creates a moving body that collides with all bodies and stops at impacts, without a solver.
    pub fn new(solid: impl Into<Solid>, sweep: Sweep) -> Self {
        Self {
            solid: solid.into(),
            sweep,
            order: 0,
            id: None,
            groups: Groups::ALL,
            types: Groups::ALL,
            stop_groups: Groups::ALL,
            rigid_body: None,
            joint_island: None,
            world: 0,
            active: true,
            stops: true,
            passes: false,
            sensor: false,
            locked: BVec3::FALSE,
            core_depth: CORE_DEPTH,
            next_displacement: None,
        }
    }

    /// Returns an upper bound of the path length of any point of the body. A kinematic body pushes other bodies at most that far, in metres.
    pub(super) fn push_reach(&self) -> f32 {
        let radius = self.solid.bounding_sphere().farthest(self.sweep.local_center);
        // A body in a fold between two primitives is pushed by both in turn.
        self.sweep.reach(radius) + self.solid.deforming().map_or(0.0, |shape| 2.0 * shape.path())
    }

    /// Returns the displacement without its components along locked axes, in metres.
    pub(super) fn free_path(&self, displacement: Vec3) -> Vec3 {
        Vec3::select(self.locked, Vec3::ZERO, displacement)
    }
}

/// A body that does not move in the step.
#[derive(Clone, Debug)]
pub struct StaticBody {
    /// The shape.
    pub solid: Solid,
    /// Pose in the world.
    pub pose: Pose3,
    /// Index in the order of all bodies and statics, which fixes the rounding of relative poses: see [`StepInput::pose12`].
    pub order: u32,
    /// Identity of the body in successive steps, as [`Body::id`].
    pub id: Option<u64>,
    /// The rigid body that this shape belongs to.
    pub rigid_body: Option<u64>,
    /// Collision groups.
    pub groups: Groups,
    /// Type of the body, and the types that it collides with. A pair collides if at least one body accepts the type of the other.
    pub types: Groups,
    /// Solver groups: bodies stop only at bodies with matching solver groups.
    pub stop_groups: Groups,
    /// The world of the body.
    pub world: u32,
    /// True if no body stops at it: a sensor, or a collider with `MedialCcd::DISABLED`.
    pub passes: bool,
    /// True for a sensor. Sensors detect bodies even if a joint disables the collisions with these bodies.
    pub sensor: bool,
}

impl StaticBody {
    /// Creates a body that collides with all bodies.
    pub fn new(solid: impl Into<Solid>, pose: Pose3) -> Self {
        let all = Groups::ALL;
        let solid = solid.into();
        let (groups, types, stop_groups) = (all, all, all);
        let (order, world, id, rigid_body) = (0, 0, None, None);
        Self { solid, pose, order, id, rigid_body, groups, types, stop_groups, world, passes: false, sensor: false }
    }

    /// Creates a box that collides with all bodies.
    pub fn solid_box(obb: Obb) -> Self {
        Self::new(Solid::Parts(Arc::new(Cuboid { half: obb.half_extents })), obb.pose)
    }

    /// Returns the oriented bounding box, in the world.
    pub fn obb(&self) -> Obb {
        let aabb = self.solid.aabb();
        Obb { pose: self.pose * Pose3::from_translation(aabb.center()), half_extents: aabb.half_extents() }
    }
}

/// The static bodies and the BVH of their bounding boxes. Rebuilt only when a static body changes. Clones share the data.
#[derive(Clone, Debug, Default)]
pub struct Statics {
    /// Unique id, shared only by clones. Statics made by `default` have id 0.
    #[cfg(feature = "gpu")]
    id: u64,
    pub(super) bodies: Arc<[StaticBody]>,
    pub(super) boxes: Arc<[Obb]>,
    pub(super) bvh: Arc<Bvh>,
    /// Number of primitives and parts, and number of medial primitives among them.
    pub(super) primitives: [usize; 2],
}

impl Statics {
    /// Creates statics from a list. The positions in the list are the indices of [`Side::Static`].
    pub fn new(bodies: Vec<StaticBody>) -> Self {
        let boxes: Vec<Obb> = bodies.iter().map(StaticBody::obb).collect();
        let aabbs: Vec<Aabb> = boxes.iter().map(Obb::aabb).collect();
        let primitives = count(bodies.iter().map(|body| &body.solid));
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

    /// Returns the static bodies.
    pub fn bodies(&self) -> &[StaticBody] {
        &self.bodies
    }

    /// Returns the id that distinguishes these statics from others.
    #[cfg(feature = "gpu")]
    pub(crate) fn id(&self) -> u64 {
        self.id
    }

    /// Returns the BVH of the bounding boxes.
    #[cfg(any(feature = "debug", feature = "gpu"))]
    pub(crate) fn bvh(&self) -> &Bvh {
        &self.bvh
    }
}

/// How candidate pairs for the narrow phase are found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Culling {
    /// Hybrid culling: swept spheres, BVH of static boxes, primitive BVHs.
    #[default]
    Hybrid,
    /// No culling: every primitive pair of every body pair. This is the reference for measurements.
    None,
}

/// The complete input of a step, except for the [`Statics`].
#[derive(Clone, Debug)]
pub struct StepInput {
    /// The bodies.
    pub bodies: Vec<Body>,
    /// Pairs of rigid bodies whose collisions a joint disables, the lower one first.
    pub apart: HashSet<[u64; 2]>,
    /// Largest distance of reported contacts, in metres. For bodies with a [displacement](Body::next_displacement),
    /// [`ContactMargin::of_pair`](super::ContactMargin::of_pair) gives the distance.
    pub prediction: f32,
    /// Size of a typical body, in metres. Tolerances that do not depend on a shape, such as the touch distance, are proportional to it. Default: 1.
    pub length_unit: f32,
    /// [`Body::core_depth`] of statics.
    pub core_depth: f32,
    /// True if bodies stop at their first impact.
    pub stop_at_impact: bool,
    /// How candidate pairs for the narrow phase are found.
    pub culling: Culling,
    /// True if pairs keep [contacts and lists of near primitives](super::ContactCache) from step to step.
    pub recycle_contacts: bool,
    /// True if the output lists the candidate pairs of the mid phase.
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
            recycle_contacts: true,
            report_candidates: false,
        }
    }
}

impl StepInput {
    /// Returns true if the body stops at impacts.
    pub(super) fn is_stopping(&self, body: u32) -> bool {
        self.stop_at_impact && self.bodies[body as usize].stops
    }

    /// Returns the shape of a side of a pair, and its motion over the step.
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

    /// Returns the pose of the second side of a pair in the frame of the first. `pose_of`: the pose of a body.
    ///
    /// Computes the pose of the side with the higher [`Body::order`] in the frame of the other, and inverts it if necessary. Rapier's narrow phase does the
    /// same, so contacts have the same bits in the step and in rapier.
    pub fn pose12(&self, statics: &Statics, sides: [Side; 2], pose_of: impl Fn(u32) -> Pose3) -> Pose3 {
        let [(pose1, order1), (pose2, order2)] = sides.map(|side| match side {
            Side::Body(body) => (pose_of(body), self.bodies[body as usize].order),
            Side::Static(body) => (statics.bodies[body as usize].pose, statics.bodies[body as usize].order),
        });
        if order1 <= order2 { pose1.inv_mul(&pose2) } else { pose2.inv_mul(&pose1).inverse() }
    }

    /// Returns the identity of a side in successive steps.
    pub(super) fn id(&self, statics: &Statics, side: Side) -> Option<u64> {
        match side {
            Side::Body(body) => self.bodies[body as usize].id,
            Side::Static(body) => statics.bodies[body as usize].id,
        }
    }

    /// Returns the core depth of a side, per metre of the smaller body's bounding radius: 0 for a body without a medial mesh, because it has no core.
    pub(super) fn core_depth(&self, statics: &Statics, side: Side) -> f32 {
        let (depth, solid) = match side {
            Side::Body(body) => (self.bodies[body as usize].core_depth, &self.bodies[body as usize].solid),
            Side::Static(body) => (self.core_depth, &statics.bodies[body as usize].solid),
        };
        solid.medial().map_or(0.0, |_| depth)
    }
}

/// One side of a pair.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Side {
    /// Index of a body in [`StepInput::bodies`].
    Body(u32),
    /// Index of a static body in [`Statics::bodies()`].
    Static(u32),
}

impl Side {
    /// Returns the index of a body; `None` for a static body.
    pub fn body(self) -> Option<u32> {
        match self {
            Side::Body(body) => Some(body),
            Side::Static(_) => None,
        }
    }
}

/// The kind of interaction of a pair of bodies, as the filter decides.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PairFilter {
    /// The bodies do not collide. No contacts or impacts are computed.
    Apart,
    /// Contacts and impacts are computed, but no body stops at the other.
    Passing,
    /// Contacts and impacts are computed. Bodies with [`Body::stops`] stop at the impact.
    Stopping,
}
