//! The GPU back end has the results of the CPU.
//!
//! Without an adapter the tests print that they are skipped, and pass. With `MEDIAL_REQUIRE_GPU=1` they fail.

mod ahead;
mod bullets;
mod culling;
mod faults;
mod kernels;
mod parity;

use std::{io::Write, sync::OnceLock};

use bevy_medial::gpu::GpuDevice;

use crate::log;

/// The device, if there is one; otherwise the test says that it is skipped. From the first call on what is logged is kept.
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
            // What `eprintln` prints is shown of tests only that fail.
            let test = std::thread::current();
            let _ = writeln!(std::io::stderr(), "skipped: {}: {error}", test.name().unwrap_or_default());
            None
        }
    }
}
