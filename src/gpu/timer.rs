use std::time::Duration;

use bytemuck::pod_collect_to_vec;

use super::{GpuDevice, GpuError};

/// Times of passes, told by the device itself.
pub(super) struct Timer {
    /// None if the device cannot tell.
    queries: Option<(wgpu::QuerySet, wgpu::Buffer)>,
    passes: u32,
    nanoseconds_per_tick: f64,
}

impl Timer {
    /// A timer of so many passes at most.
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

    /// What a pass, by its number, has to write.
    pub fn writes(&self, pass: u32) -> Option<wgpu::ComputePassTimestampWrites<'_>> {
        self.queries.as_ref().map(|(query_set, _)| wgpu::ComputePassTimestampWrites {
            query_set,
            beginning_of_pass_write_index: Some(2 * pass),
            end_of_pass_write_index: Some(2 * pass + 1),
        })
    }

    /// Bytes that are copied to where they are read.
    pub fn bytes(&self) -> u64 {
        if self.queries.is_some() { 16 * u64::from(self.passes) } else { 0 }
    }

    /// Records the copy of the times of the first passes to a place in a buffer.
    pub fn resolve(&self, encoder: &mut wgpu::CommandEncoder, passes: u32, staging: &wgpu::Buffer, at: u64) {
        if let Some((set, buffer)) = &self.queries {
            encoder.resolve_query_set(set, 0..2 * passes, buffer, 0);
            encoder.copy_buffer_to_buffer(buffer, 0, staging, at, self.bytes());
        }
    }

    /// The times in what was copied: one for each pass, or none at all.
    pub fn durations(&self, bytes: &[u8]) -> Vec<Duration> {
        let ticks: Vec<u64> = pod_collect_to_vec(bytes);
        let duration = |ticks: &[u64]| {
            Duration::from_nanos((ticks[1].saturating_sub(ticks[0]) as f64 * self.nanoseconds_per_tick) as u64)
        };
        ticks.chunks_exact(2).map(duration).collect()
    }
}
