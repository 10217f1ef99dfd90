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
#[path = "../kernels/pairs.rs"]
#[allow(dead_code)]
mod pairs;
mod parity;
#[path = "../physics/random_steps.rs"]
#[allow(dead_code)]
mod random_steps;
#[path = "../kernels/reference.rs"]
#[allow(dead_code)]
mod reference;
#[path = "../../examples/common/renderer.rs"]
mod renderer;
#[path = "../kernels/score.rs"]
mod score;
#[path = "../physics/true_motion.rs"]
#[allow(dead_code)]
mod true_motion;

use std::{io::Write, sync::OnceLock};

use bevy_medial::gpu::GpuDevice;

/// The device, if there is one; otherwise the test says that it is skipped. From the first call on what is logged is kept.
fn device() -> Option<&'static GpuDevice> {
    static DEVICE: OnceLock<Result<GpuDevice, String>> = OnceLock::new();
    let device = DEVICE.get_or_init(|| {
        log::keep_from(bevy::log::Level::INFO);
        GpuDevice::request().map_err(|error| error.to_string())
    });
    match device {
        Ok(gpu) => Some(gpu),
        Err(error) if std::env::var_os("MEDIAL_REQUIRE_GPU").is_some() => panic!("{error}"),
        Err(error) => {
            // What `eprintln` prints is shown of tests only that fail.
            let test = std::thread::current();
            let _ = writeln!(std::io::stderr(), "skipped: {}: {error}", test.name().unwrap_or_default());
            None
        }
    }
}
