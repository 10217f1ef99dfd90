use std::time::Duration;

use bytemuck::pod_collect_to_vec;

use super::{GpuDevice, GpuError};

/// Times of passes, measured by the device.
pub(super) struct Timer {
    /// None if the device has no timestamps.
    queries: Option<(wgpu::QuerySet, wgpu::Buffer)>,
    passes: u32,
    nanoseconds_per_tick: f64,
}

impl Timer {
    /// Creates a timer for at most this many passes.
    pub fn new(gpu: &GpuDevice, passes: u32) -> Result<Self, GpuError> {
        let mut queries = None;
        if gpu.device.features().contains(wgpu::Features::TIMESTAMP_QUERY) {
            let (ty, count) = (wgpu::QueryType::Timestamp, 2 * passes);
            let descriptor = wgpu::QuerySetDescriptor { label: Some("passes"), ty, count };
            let set = gpu.checked(format_args!("timestamps"), |device| device.create_query_set(&descriptor))?;
            let usage = wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC;
            queries = Some((set, gpu.buffer("times", 16 * u64::from(passes), usage)?));
        }
        Ok(Self { queries, passes, nanoseconds_per_tick: gpu.queue.get_timestamp_period().into() })
    }

    /// Returns the timestamps that a pass, given by its index, has to write.
    pub fn writes(&self, pass: u32) -> Option<wgpu::ComputePassTimestampWrites<'_>> {
        self.queries.as_ref().map(|(query_set, _)| wgpu::ComputePassTimestampWrites {
            query_set,
            beginning_of_pass_write_index: Some(2 * pass),
            end_of_pass_write_index: Some(2 * pass + 1),
        })
    }

    /// Number of bytes that are copied to the readback buffer.
    pub fn bytes(&self) -> u64 {
        if self.queries.is_some() { 16 * u64::from(self.passes) } else { 0 }
    }

    /// Records the copy of the times of the first passes to an offset in a buffer.
    pub fn resolve(&self, encoder: &mut wgpu::CommandEncoder, passes: u32, staging: &wgpu::Buffer, at: u64) {
        if let Some((set, buffer)) = &self.queries {
            encoder.resolve_query_set(set, 0..2 * passes, buffer, 0);
            encoder.copy_buffer_to_buffer(buffer, 0, staging, at, self.bytes());
        }
    }

    /// Converts the copied bytes to times: one for each pass, or none without timestamps.
    pub fn durations(&self, bytes: &[u8]) -> Vec<Duration> {
        let ticks: Vec<u64> = pod_collect_to_vec(bytes);
        let duration = |ticks: &[u64]| {
            Duration::from_nanos((ticks[1].saturating_sub(ticks[0]) as f64 * self.nanoseconds_per_tick) as u64)
        };
        ticks.chunks_exact(2).map(duration).collect()
    }
}
