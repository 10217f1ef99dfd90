use wgpu::BufferUsages as Usage;

use super::{GpuDevice, GpuError};

/// A buffer of the back end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Slot {
    Params,
    Bodies,
    Statics,
    StaticNodes,
    Shapes,
    Spheres,
    Primitives,
    ShapeNodes,
    Swept,
    Keys,
    Exchanges,
    Tree,
    Counters,
    Pairs,
    PairChords,
    Chords,
    Candidates,
    Survivors,
    Groups,
}

const SLOTS: usize = Slot::Groups as usize + 1;

impl Slot {
    fn usage(self) -> Usage {
        match self {
            Slot::Params | Slot::Exchanges => Usage::UNIFORM | Usage::COPY_DST,
            Slot::Counters => Usage::STORAGE | Usage::COPY_DST | Usage::COPY_SRC,
            Slot::Pairs | Slot::Survivors => Usage::STORAGE | Usage::COPY_SRC,
            Slot::Groups => Usage::STORAGE | Usage::INDIRECT,
            _ => Usage::STORAGE | Usage::COPY_DST,
        }
    }
}

/// All buffers. They grow on demand, to powers of two.
pub(super) struct Buffers {
    buffers: [Option<wgpu::Buffer>; SLOTS],
    /// Increases with each new buffer. Bind groups with the old buffer have to be replaced then.
    pub generation: u64,
    /// Number of bytes written so far.
    pub written: u64,
}

/// Smallest size in bytes: that of the largest element, because a shader may need one element in each buffer.
const LEAST: u64 = 256;

impl Buffers {
    pub fn new() -> Self {
        Self { buffers: [const { None }; SLOTS], generation: 0, written: 0 }
    }

    /// Reserves this many bytes. A buffer that grows loses its content.
    pub fn reserve(&mut self, gpu: &GpuDevice, slot: Slot, bytes: u64) -> Result<(), GpuError> {
        let known = &mut self.buffers[slot as usize];
        if known.as_ref().is_some_and(|buffer| buffer.size() >= bytes) {
            return Ok(());
        }
        let limits = gpu.limits();
        let bytes = bytes.max(LEAST);
        let most = limits.max_buffer_size.min(limits.max_storage_buffer_binding_size);
        // Sizes are multiples of 16.
        let most = most - most % 16;
        gpu.require("bytes in a buffer", most, bytes)?;
        *known = Some(gpu.buffer(&format!("{slot:?}"), bytes.next_power_of_two().min(most), slot.usage())?);
        self.generation += 1;
        Ok(())
    }

    /// Writes from the start of a buffer.
    pub fn write(&mut self, gpu: &GpuDevice, slot: Slot, bytes: &[u8]) -> Result<(), GpuError> {
        self.append(gpu, slot, bytes, 0)
    }

    /// Makes a buffer hold these bytes. It has the first `known` bytes already.
    pub fn append(&mut self, gpu: &GpuDevice, slot: Slot, bytes: &[u8], known: usize) -> Result<(), GpuError> {
        let generation = self.generation;
        self.reserve(gpu, slot, bytes.len() as u64)?;
        let known = if self.generation == generation { known } else { 0 };
        gpu.queue.write_buffer(self.get(slot), known as u64, &bytes[known..]);
        self.written += (bytes.len() - known) as u64;
        Ok(())
    }

    /// Returns a buffer, which must have been reserved.
    pub fn get(&self, slot: Slot) -> &wgpu::Buffer {
        self.buffers[slot as usize].as_ref().expect("the buffer was reserved before")
    }
}
