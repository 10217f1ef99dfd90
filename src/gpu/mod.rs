//! The GPU back end.

mod bodies;
mod buffers;
mod culling;
mod device;
mod impacts;
mod layout;
mod pass;
mod prediction;
mod shapes;
mod timer;

pub(crate) use culling::Batch;
pub use culling::{GpuCapacity, GpuCulling};
pub use device::{GpuDevice, GpuError};
pub use impacts::{GpuImpacts, MovingPair};
pub use prediction::Prediction;
