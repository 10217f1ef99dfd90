//! The GPU back end finds what the CPU finds.
//!
//! Without an adapter the tests say so and pass; with `MEDIAL_REQUIRE_GPU=1` they fail.

mod ahead;
mod bullets;
#[path = "../physics/common.rs"]
#[allow(dead_code)]
mod common;
mod culling;
mod faults;
#[path = "../physics/flights.rs"]
#[allow(dead_code)]
mod flights;
mod kernels;
#[path = "../physics/log.rs"]
#[allow(dead_code)]
mod log;
mod parity;
#[path = "../physics/random_steps.rs"]
#[allow(dead_code)]
mod random_steps;
#[path = "../kernels/reference.rs"]
#[allow(dead_code)]
mod reference;
#[path = "../../examples/common/renderer.rs"]
mod renderer;
#[path = "../physics/true_motion.rs"]
#[allow(dead_code)]
mod true_motion;

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
