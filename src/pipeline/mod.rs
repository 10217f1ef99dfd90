//! One step of collision detection on plain data: [`StepInput`] in, [`StepOutput`] out.
//!
//! ```text
//!   poses, shapes, statics
//!     broad   swept bounding spheres against each other, and against a BVH of static boxes  -> body pairs
//!     mid     pair by pair: primitive BVH against primitive BVH (or box), over the step      -> candidate primitive pairs
//!     narrow  first impacts of the candidates within the step                               -> impacts
//!     respond bodies that stop at impacts or are pushed                                     -> final poses
//!     narrow  contacts at the final poses                                                   -> raw contacts
//!     reduce  a few manifolds per body pair                                                 -> manifolds
//!   sorted contacts, impacts, counts and times
//! ```
//!
//! Bodies are dense indices, and the caller maps them to entities. All stages are pure functions of their input. Their work is split into
//! chunks whose results are joined in order, so the output has the same bits for any number of threads.

mod broad;
pub mod contacts;
mod deforming;
mod directions;
mod found;
mod input;
mod joint_islands;
mod narrow_phase;
mod output;
mod pairs;
pub(crate) mod parallel;
mod parts;
mod respond;
mod shape;
mod shares;
mod solid;
mod sweep;
mod tolerances;
mod workspace;

use bevy::tasks::TaskPool;

#[cfg(feature = "debug")]
pub(crate) use broad::swept_cone;
#[cfg(feature = "gpu")]
pub(crate) use broad::{KinematicReach, near_sides};

pub use contacts::{CachedPair, Contact, ContactCache, ContactMargin, Displacement, Manifold};
pub use deforming::Deforming;
pub use input::{Body, Culling, Groups, PairFilter, Side, StaticBody, Statics, StepInput};
pub use output::{BoundedPair, Candidates, Counts, Impact, Pair, Primitives, StepOutput, Stop, Times};
pub use parts::{ConvexParts, Core, Part, Parts};
pub(crate) use shape::with_spheres;
pub use shape::{Hull, Shape};
pub use solid::{OtherShape, ShapeId, Solid};
pub use sweep::first_touch;
pub use workspace::Workspace;

/// Runs all stages of a single step, from the broad phase to the reduction of contacts. For a sequence of steps, keep a [`Workspace`].
pub fn step(input: &StepInput, statics: &Statics, pool: &TaskPool) -> StepOutput {
    let mut output = StepOutput::default();
    Workspace::default().step(input, statics, |_, _| PairFilter::Stopping, pool, &mut output);
    output
}

/// Runs the stages after culling of a single step, with candidates from an external search: see [`Workspace::step_from_candidates`].
///
/// # Panics
/// If an index is out of range.
pub fn step_from_candidates(
    input: &StepInput,
    statics: &Statics,
    candidates: Vec<Candidates>,
    filter: impl Fn(Side, Side) -> PairFilter,
    pool: &TaskPool,
) -> StepOutput {
    let mut output = StepOutput::default();
    Workspace::default().step_from_candidates(input, statics, candidates, filter, pool, &mut output);
    output
}
