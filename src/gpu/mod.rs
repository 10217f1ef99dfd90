//! The GPU back end: compute shaders find the pairs that may meet.
//!
//! | item | purpose |
//! |---|---|
//! | [`GpuCulling`] | finds the pairs of a step, and waits for the result |
//! | [`Prediction`] | predicts several steps, so that no step waits for the GPU |
//! | [`GpuBounds`] | bounds of the times of impact of a list of pairs, for tests and benchmarks |
//! | [`GpuDevice`] | the device that runs all of these |
//! | [`GpuCapacity`] | initial capacity of the buffers |
//!
//! The shaders are in `shaders/`. A shader with a counterpart on the CPU has its name.

mod bodies;
mod buffers;
mod capacity;
mod culling;
mod device;
mod kinds;
mod layout;
mod pair_bounds;
mod pass;
mod passes;
mod prediction;
mod readback;
mod shapes;
mod space;
mod timer;

pub use capacity::GpuCapacity;
pub use culling::GpuCulling;
pub(crate) use device::copy_when_mapped;
pub use device::{GpuDevice, GpuError};
pub use pair_bounds::{GpuBounds, MovingPair};
pub(crate) use pass::{Pass, entry_point};
pub(crate) use passes::{Passes, shaders};
pub use prediction::Prediction;
pub(crate) use readback::Batch;
