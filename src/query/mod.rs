//! Narrow-phase kernels on two primitives: pure functions on plain data, f32 inside.
//!
//! A primitive is passed as the array of its spheres, `[Sphere; N]` with `N` = 1 (sphere), 2 (medial cone) or 3
//! (medial slab), a box as a [`Cuboid`] in its own frame. A triangle is a slab of radius 0, a capsule is a cone. Both sides
//! of a pair are given in one frame, preferably with its origin near the pair: coordinates of the pair's own size keep
//! f32 exact to a few parts in ten million of that size.
//!
//! The kernels rest on one fact: the distance of two primitives is the minimum of the convex function
//! `|c2(w2) - c1(w1)| - r1(w1) - r2(w2)` of the barycentric weights, and for *any* unit direction `n` the gap between
//! the two support planes, `min_j (c2_j . n - r2_j) - max_i (c1_i . n + r1_i)`, is a lower bound of it. The best
//! direction attains this bound. [`separation`] searches for the weights, [`time_of_impact`] follows the gap over time.

mod alternating;
mod batch;
mod branchless;
mod moving;
mod nearest;
pub(crate) mod number;
mod ray;
mod rigid;
mod separation;
mod support;
mod time_of_impact;

pub use alternating::alternating;
// For measurements only: a step searches its pairs one by one.
#[doc(hidden)]
pub use batch::{MovingPair, Touch, times_of_impact};
pub use moving::{Moving, MovingConvex};
pub use ray::{RayHit, ray_cast};
pub use rigid::{Chord, Rigid, RigidStart, rigid_end, rigid_impact, rigid_start};
pub use separation::{Convex, Cuboid, Separation, separation};
pub use support::{Support, SupportShape};
pub use time_of_impact::{TimeOfImpact, TimeOfImpactStatus, time_of_impact};
