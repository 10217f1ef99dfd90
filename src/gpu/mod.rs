//! The GPU back end: which pairs may meet, found by compute shaders.
//!
//! | item | what |
//! |---|---|
//! | [`GpuCulling`] | finds the pairs of a step, and waits for them |
//! | [`Prediction`] | several steps ahead, so that nobody has to wait |
//! | [`GpuImpacts`] | times of impact of a list of pairs, for tests and benchmarks |
//! | [`GpuDevice`] | the device that all run on |
//! | [`GpuCapacity`] | for how much there is room at first |
//!
//! The shaders lie in `shaders/`, each with the name of what it does on the CPU.

mod bodies;
mod buffers;
mod capacity;
mod culling;
mod device;
mod impacts;
mod layout;
mod pass;
mod passes;
mod prediction;
mod readback;
mod shapes;
mod timer;

pub use capacity::GpuCapacity;
pub use culling::GpuCulling;
pub(crate) use device::copy_when_mapped;
pub use device::{GpuDevice, GpuError};
pub use impacts::{GpuImpacts, MovingPair};
pub(crate) use pass::Pass;
pub(crate) use passes::{Passes, shaders};
pub use prediction::Prediction;
pub(crate) use readback::Batch;
