//! The GPU back end finds what the CPU finds.
//!
//! Without an adapter the tests say so and pass; with `MEDIAL_REQUIRE_GPU=1` they fail.

#[path = "../physics/common.rs"]
#[allow(dead_code)]
mod common;
mod culling;
mod faults;
mod kernels;
mod pipelined;
#[path = "../physics/random_steps.rs"]
#[allow(dead_code)]
mod random_steps;

use std::sync::OnceLock;

use bevy_medial::gpu::GpuDevice;

/// The device, if there is one.
fn device() -> Option<&'static GpuDevice> {
    static DEVICE: OnceLock<Option<GpuDevice>> = OnceLock::new();
    DEVICE
        .get_or_init(|| match GpuDevice::request() {
            Ok(gpu) => {
                println!("GPU: {}", gpu.name());
                Some(gpu)
            }
            Err(error) if std::env::var_os("MEDIAL_REQUIRE_GPU").is_some() => panic!("{error}"),
            Err(error) => {
                println!("skipped: {error}");
                None
            }
        })
        .as_ref()
}
