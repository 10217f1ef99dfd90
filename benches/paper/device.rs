//! The flat methods on a GPU, if there is one.

use std::time::Instant;

use bevy_medial::{
    gpu::{GpuBounds, GpuCapacity, GpuCulling, GpuDevice},
    pipeline::{Statics, StepInput},
};
use bevy_medial_compare::paper::flat::Flat;

/// All primitive pairs that the culling of bodies leaves, in the frame with most of them: bounds of their times of impact, or the published alternation.
pub struct DeviceRow {
    pub scene: &'static str,
    pub frame: usize,
    pub method: &'static str,
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
    alternation: GpuBounds,
}

impl Device {
    /// The default adapter. `None` without an adapter, or if it lacks a feature.
    pub fn request() -> Option<Self> {
        let gpu = GpuDevice::request().ok()?;
        let mut culling = GpuCulling::new(&gpu, GpuCapacity::default()).ok()?;
        culling.set_flat(true);
        let alternation = GpuBounds::alternating(&gpu).ok()?;
        Some(Self { name: gpu.name().into(), culling, alternation })
    }

    /// Runs the pairs of a frame by both methods. The alternation gets a list of pairs from the CPU, whose culling its time does not include.
    ///
    /// # Errors
    /// If a call fails.
    pub fn run(&mut self, frame: (&'static str, usize), data: &(StepInput, Statics)) -> Result<[DeviceRow; 2], String> {
        Ok([self.bounds(frame, data)?, self.alternate(frame, data)?])
    }

    /// The third run counts, because the first ones may grow the buffers.
    fn bounds(
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
        let pairs = self.culling.counts()[2] as usize;
        Ok(DeviceRow { scene, frame, method: "advancement: culling and bounds", pairs, call_ms, device_ms })
    }

    fn alternate(
        &mut self,
        (scene, frame): (&'static str, usize),
        (input, statics): &(StepInput, Statics),
    ) -> Result<DeviceRow, String> {
        let pairs = Flat::default().moving_pairs(input, statics)?;
        let clock = Instant::now();
        self.alternation.run(&pairs).map_err(|error| error.to_string())?;
        let call_ms = clock.elapsed().as_secs_f64() * 1e3;
        let device_ms = self.alternation.time().map(|time| time.as_secs_f64() * 1e3);
        Ok(DeviceRow { scene, frame, method: "alternation: times of impact", pairs: pairs.len(), call_ms, device_ms })
    }
}
