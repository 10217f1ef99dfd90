//! The flat method on a GPU, if there is one.

use std::time::Instant;

use bevy_medial::{
    gpu::{GpuDevice, GpuImpacts},
    pipeline::{Statics, StepInput},
};
use bevy_medial_compare::paper::flat::Flat;

/// Times of impact of all primitive pairs that the culling of bodies leaves in the frame with most of them.
pub struct DeviceRow {
    pub scene: &'static str,
    pub frame: usize,
    pub pairs: usize,
    /// With upload, wait and readback, in milliseconds.
    pub call_ms: f64,
    /// On the device alone. `None` if it cannot measure times.
    pub device_ms: Option<f64>,
}

/// An adapter with the kernel.
pub struct Device {
    pub name: String,
    impacts: GpuImpacts,
}

/// Max number of pairs of a call.
const PART: usize = 1 << 17;

impl Device {
    /// The default adapter. `None` without an adapter, or if it lacks a feature.
    pub fn request() -> Option<Self> {
        let gpu = GpuDevice::request().ok()?;
        Some(Self { name: gpu.name().into(), impacts: GpuImpacts::new(&gpu).ok()? })
    }

    /// Runs the pairs of a frame. The second run counts.
    ///
    /// # Errors
    /// If a body is not supported or a call fails.
    pub fn run(
        &mut self,
        (scene, frame): (&'static str, usize),
        (input, statics): &(StepInput, Statics),
    ) -> Result<DeviceRow, String> {
        let pairs = Flat::default().moving_pairs(input, statics)?;
        let (mut call_ms, mut device_ms) = (0.0, None);
        for _ in 0..2 {
            (call_ms, device_ms) = (0.0, None);
            for part in pairs.chunks(PART) {
                let clock = Instant::now();
                self.impacts.run(part).map_err(|error| error.to_string())?;
                call_ms += clock.elapsed().as_secs_f64() * 1e3;
                let time = self.impacts.time().map(|time| time.as_secs_f64() * 1e3);
                device_ms = time.map(|time| device_ms.unwrap_or(0.0) + time);
            }
        }
        Ok(DeviceRow { scene, frame, pairs: pairs.len(), call_ms, device_ms })
    }
}
