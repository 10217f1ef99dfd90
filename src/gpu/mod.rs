//! The GPU back end: which pairs may meet, found by compute shaders.
//!
//! | item | what |
//! |---|---|
//! | [`GpuCulling`] | finds the pairs of a step, and waits for them |
//! | [`Prediction`] | several steps ahead, so that nobody has to wait |
//! | [`GpuImpacts`] | times of impact of a list of pairs, for tests and benchmarks |
//! | [`GpuDevice`] | the device that all run on |
//!
//! The shaders lie in `shaders/`, each with the name of what it does on the CPU.

mod bodies;
mod buffers;
mod culling;
mod device;
mod impacts;
mod layout;
mod pass;
mod passes;
mod prediction;
mod shapes;
mod timer;

pub(crate) use culling::Batch;
pub use culling::{GpuCapacity, GpuCulling};
pub use device::{GpuDevice, GpuError};
pub use impacts::{GpuImpacts, MovingPair};
pub use prediction::Prediction;
