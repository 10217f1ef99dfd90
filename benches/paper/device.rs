//! The flat method on a GPU, if there is one.

use std::time::Instant;

use bevy_medial::{
    gpu::{GpuCapacity, GpuCulling, GpuDevice},
    pipeline::{Statics, StepInput},
};

/// Bounds of the times of impact of all primitive pairs that the culling of bodies leaves, in the frame with most of them.
pub struct DeviceRow {
    pub scene: &'static str,
    pub frame: usize,
    pub pairs: usize,
    /// With upload, wait and readback, in milliseconds.
    pub call_ms: f64,
    /// On the device alone. `None` if it cannot measure times.
    pub device_ms: Option<f64>,
}

/// An adapter with the passes.
pub struct Device {
    pub name: String,
    culling: GpuCulling,
}

impl Device {
    /// The default adapter. `None` without an adapter, or if it lacks a feature.
    pub fn request() -> Option<Self> {
        let gpu = GpuDevice::request().ok()?;
        let mut culling = GpuCulling::new(&gpu, GpuCapacity::default()).ok()?;
        culling.set_flat(true);
        Some(Self { name: gpu.name().into(), culling })
    }

    /// Runs the pairs of a frame. The third run counts, because the first ones may grow the buffers.
    ///
    /// # Errors
    /// If a call fails.
    pub fn run(
        &mut self,
        (scene, frame): (&'static str, usize),
        (input, statics): &(StepInput, Statics),
    ) -> Result<DeviceRow, String> {
        let mut call_ms = 0.0;
        for _ in 0..3 {
            let clock = Instant::now();
            self.culling.cull(input, statics).map_err(|error| error.to_string())?;
            call_ms = clock.elapsed().as_secs_f64() * 1e3;
        }
        let times = self.culling.times();
        let device_ms = times.iter().map(|(_, time)| time.as_secs_f64() * 1e3).sum();
        let device_ms = (!times.is_empty()).then_some(device_ms);
        Ok(DeviceRow { scene, frame, pairs: self.culling.counts()[2] as usize, call_ms, device_ms })
    }
}
