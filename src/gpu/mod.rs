//! The GPU back end.

mod bodies;
mod buffers;
mod culling;
mod device;
mod impacts;
mod layout;
mod pass;
mod shapes;

pub use culling::{GpuCapacity, GpuCulling};
pub use device::{GpuDevice, GpuError};
pub use impacts::{GpuImpacts, MovingPair};
