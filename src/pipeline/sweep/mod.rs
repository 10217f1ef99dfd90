//! The first impact of a pair within the step: candidates by moving boxes, then times of impact along chords.

pub(in crate::pipeline) mod first_impact;
mod first_touch;
pub(in crate::pipeline) mod mid_phase;
pub(in crate::pipeline) mod motion;
pub(in crate::pipeline) mod moving_boxes;
mod separating_axis;
mod touch;

pub use first_touch::first_touch;
