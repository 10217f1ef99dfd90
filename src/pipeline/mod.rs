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
mod input;
mod islands;
mod mid_phase;
mod motion;
mod moving_boxes;
mod narrow_phase;
mod near;
mod output;
pub(crate) mod parallel;
mod parting;
mod parts;
mod reduce;
mod seams;
mod shape;
mod stop;
mod thin;

use std::time::Duration;

use bevy::{platform::time::Instant, tasks::TaskPool};

use broad_phase::BodyPair;
#[cfg(feature = "debug")]
pub(crate) use broad_phase::swept_cone;
#[cfg(feature = "gpu")]
pub(crate) use broad_phase::{Widening, near_sides};
use moving_boxes::BodyBoxes;

pub use contact::{Contact, Manifold, Second};
pub use first_touch::{first_touch, search_parts};
pub use input::{Body, Culling, Groups, Meeting, Side, Solid, StaticBody, Statics, StepInput, relative_pose};
pub use output::{Candidates, Counts, Impact, Pair, StepOutput, Stop, Times};
pub use parts::{ConvexParts, Core, Part};
pub(crate) use shape::with_spheres;
pub use shape::{Hull, Shape};

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

/// Runs what follows culling, where that was done elsewhere. The filter is asked once about each pair that may collide, in their order.
///
/// Of the candidates, pairs of bodies that may not collide are left out. Whatever is found by searching again within the step, where
/// bodies spin fast, go far or have stopped, is culled as in any other step.
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

    let stops = stop::run(input, statics, pairs, boxes, &mut results, pool);
    output.times.stop = lap();

    let contacts = narrow_phase::contacts(input, statics, pairs, candidates, &stops, pool);
    output.times.narrow += lap();

    output.counts = Counts {
        bodies: input.bodies.len(),
        primitive_pairs: broad_phase::primitive_pairs(input, statics),
        body_pairs: pairs.len(),
        candidates: candidates.iter().flatten().map(Vec::len).sum(),
        toi_tests: results.iter().map(|r| r.toi_tests).sum(),
        unresolved: results.iter().map(|r| r.unresolved).sum(),
        contacts: 0,
    };
    if input.report_candidates {
        let of_pair = |(pair, motions): (&BodyPair, &Vec<mid_phase::Candidates>)| Candidates {
            sides: [pair.first, pair.second],
            primitives: Some(motions.iter().flatten().copied().collect()),
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
