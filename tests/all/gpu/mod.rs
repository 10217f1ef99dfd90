//! The GPU back end has the same results as the CPU.
//!
//! Without an adapter the tests print that they are skipped, and pass. With `MEDIAL_REQUIRE_GPU=1` they fail.

mod ahead;
mod bullets;
mod culling;
mod faults;
mod kernels;
mod parity;
mod skinned;

use std::{io::Write, sync::OnceLock};

use bevy_medial::gpu::GpuDevice;

use crate::log;

/// The GPU device. Without one, prints that the test is skipped. The first call also starts to record the log.
fn device() -> Option<&'static GpuDevice> {
    static DEVICE: OnceLock<Result<GpuDevice, String>> = OnceLock::new();
    let device = DEVICE.get_or_init(|| {
        log::keep();
        GpuDevice::request().map_err(|error| error.to_string())
    });
    match device {
        Ok(gpu) => Some(gpu),
        Err(error) if std::env::var_os("MEDIAL_REQUIRE_GPU").is_some() => panic!("{error}"),
        Err(error) => {
            // The test harness hides the output of `eprintln` unless the test fails.
            let test = std::thread::current();
            let _ = writeln!(std::io::stderr(), "skipped: {}: {error}", test.name().unwrap_or_default());
            None
        }
    }
}
