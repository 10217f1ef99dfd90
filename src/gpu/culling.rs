//! Hybrid culling, and the narrow phase test of the remaining pairs, as compute passes.
//!
//! ```text
//!   poses, shapes, statics
//!     1 place    swept bounding spheres, and keys along a space-filling curve
//!     2 sort     bodies by their keys
//!      3 tree     boxes around the swept spheres
//!     4 broad    swept sphere against swept sphere, and against a BVH of static boxes   -> body pairs
//!     5 chords   motion of each pair as lines, for spinning bodies several               -> chords of pairs
//!     6 mid      primitive boxes against the primitive BVH, swept along the chord         -> candidate primitive pairs
//!     7 narrow   bound of their first touch; near or not at the end of the step            -> primitive pairs with bounds
//!   pairs with bounds, read back
//! ```
//!
//! The passes are the stages of the CPU, with its kernels in f32. Each pass is widened by its rounding errors, so it finds all pairs that the CPU
//! would find, and few others. The remaining pairs, a few primitive pairs for each body pair, go to the CPU's narrow phase. So impacts, stops and
//! contacts are the same as with culling on the CPU.
//!
//! Second sides are medial meshes, also deforming ones, and boxes. Pairs with other colliders are found here too. The CPU finds their primitives.

use std::time::Duration;

use bevy::log::info_once;
use bytemuck::{bytes_of, cast_slice};
use glam::Vec3;

use super::{
    GpuCapacity, GpuDevice, GpuError, bodies,
    buffers::{Buffers, Slot},
    kinds::KINDS,
    layout::{self, CANDIDATE, CHORD, Counters, DEFORMING, NODE, PAIR_CHORD, Pair, Params, SWEPT, Survivor},
    pass::Pass,
    passes::{Bound, KEY, Passes, SORT_BLOCK, TREE_BLOCK, UNIFORM, WORKGROUP, exchanges},
    readback::{Batch, Room},
    shapes::Shapes,
    space::most_of,
    timer::Timer,
};
use crate::{
    constants::LINEAR_SLOP,
    pipeline::{Candidates, KinematicReach, Statics, StepInput},
};

/// Number of passes whose times are measured.
const PASSES: u32 = 7;

/// Culls steps on a GPU.
pub struct GpuCulling {
    gpu: GpuDevice,
    passes: Passes,
    shapes: Shapes,
    buffers: Buffers,
    /// The bind groups of the passes, with the buffer generation and the number of leaves that they are for.
    bound: Option<(u64, u32, Bound)>,
    capacity: GpuCapacity,
    /// The last capacity that fitted into the device's memory.
    reserved: GpuCapacity,
    /// Number of results that are read back at once.
    expected: Room,
    /// Identifier and number of the statics that have been uploaded.
    statics: Option<(u64, u32)>,
    /// Unused buffers for readback.
    staging: Vec<wgpu::Buffer>,
    timer: Timer,
    times: Vec<(&'static str, Duration)>,
    counts: Counters,
    is_flat: bool,
}

/// Number of workgroups of a pass.
enum Work {
    Direct(u32),
    /// Index of the pass in the buffer of workgroup counts.
    Indirect(u64),
}

impl GpuCulling {
    /// Creates the passes on a device.
    ///
    /// # Errors
    /// If the device refuses them.
    pub fn new(gpu: &GpuDevice, capacity: GpuCapacity) -> Result<Self, GpuError> {
        Self::with_passes(gpu, Passes::new(gpu)?, capacity)
    }

    /// Uses passes that exist already.
    pub(crate) fn with_passes(gpu: &GpuDevice, passes: Passes, capacity: GpuCapacity) -> Result<Self, GpuError> {
        Ok(Self {
            passes,
            shapes: Shapes::default(),
            buffers: Buffers::new(),
            bound: None,
            capacity,
            reserved: capacity,
            expected: Room::LEAST,
            statics: None,
            staging: Vec::new(),
            timer: Timer::new(gpu, PASSES)?,
            times: Vec::new(),
            counts: Counters::default(),
            is_flat: false,
            gpu: gpu.clone(),
        })
    }

    /// Sets whether all primitives of a pair of bodies are tested against each other, without hierarchies, as in the paper. Default: false.
    pub fn set_flat(&mut self, is_flat: bool) {
        self.is_flat = is_flat;
    }

    /// The device.
    pub fn device(&self) -> &GpuDevice {
        &self.gpu
    }

    /// Time of each pass of the last step on the GPU. Empty if the device cannot measure times.
    pub fn times(&self) -> &[(&'static str, Duration)] {
        &self.times
    }

    /// Numbers of body pairs, chords, candidates and surviving primitive pairs in the last step.
    pub fn counts(&self) -> [u32; 4] {
        let Counters { pairs, chords, candidates, survivors } = self.counts;
        [pairs, chords, candidates.iter().sum(), survivors]
    }

    /// Current capacity of the buffers.
    pub fn capacity(&self) -> GpuCapacity {
        self.capacity
    }

    /// Number of bytes uploaded so far: in each step the bodies with their motion and the deforming shapes, and new shapes and statics.
    pub fn uploaded(&self) -> u64 {
        self.buffers.written
    }

    /// Returns the pairs that may meet within the step, with their primitives and bounds, in any order. It waits for the GPU. If a buffer is too
    /// small, it grows and the step is culled again.
    ///
    /// # Errors
    /// If a position or motion is not finite, if the scene exceeds the limits of the device, or if the device is lost. Nothing is found then.
    pub fn cull(&mut self, input: &StepInput, statics: &Statics) -> Result<Vec<Candidates>, GpuError> {
        let mut widening = KinematicReach::new(input);
        loop {
            self.upload(input, statics, &widening, |_| 0.0)?;
            let gpu = self.gpu.clone();
            let (batch, submission) = gpu.checked(format_args!("the passes of a step"), |device| {
                let mut encoder = device.create_command_encoder(&Default::default());
                let batch = self.encode(&mut encoder)?;
                Ok::<_, GpuError>((batch, gpu.queue.submit([encoder.finish()])))
            })??;
            let data = self.gpu.read(&batch.staging, batch.bytes, submission)?;
            if let Some(found) = self.take(batch, &data)
                && !widening.widen(input, found.iter().map(|pair| pair.sides))
            {
                return Ok(found);
            }
        }
    }

    /// Uploads the input of a step and reserves the buffers. `slack`: largest deviation of each body from its path, in metres, besides its margin.
    ///
    /// # Errors
    /// If a position or motion is not finite, or if the scene exceeds the limits of the device.
    pub(crate) fn upload(
        &mut self,
        input: &StepInput,
        statics: &Statics,
        widening: &KinematicReach,
        slack: impl Fn(usize) -> f32,
    ) -> Result<(), GpuError> {
        let new_statics = (self.statics != Some(key(statics))).then(|| statics.bodies());
        if let Some(side) = bodies::not_finite(&input.bodies, new_statics.unwrap_or_default()) {
            return Err(GpuError::NotFinite(side));
        }
        let gpu = self.gpu.clone();
        let written = gpu
            .checked(format_args!("the bodies of a step"), |_| {
                let bodies = self.write_bodies(input, statics, widening, slack)?;
                self.write_params(input, statics, &bodies)
            })
            .flatten();
        if written.is_err() {
            // The content of the device's buffers is unknown. The next step may be smaller.
            (self.shapes, self.statics, self.bound) = (Shapes::default(), None, None);
            self.capacity = self.reserved;
        }
        self.reserved = self.capacity;
        written
    }

    /// Writes the parameters of the passes, and reserves and binds their buffers.
    fn write_params(&mut self, input: &StepInput, statics: &Statics, bodies: &[layout::Body]) -> Result<(), GpuError> {
        let (gpu, buffers) = (&self.gpu, &mut self.buffers);
        let leaves = (bodies.len() as u32).next_power_of_two();
        let most = gpu.limits().max_compute_workgroups_per_dimension;
        gpu.require("workgroups", most.into(), leaves.div_ceil(WORKGROUP).into())?;
        let space = most_of(bodies.len(), |index| bodies[index].position);
        // If all bodies are at one place, the cells are as small as possible with a finite number per metre.
        let size = (space.max - space.min).max(Vec3::splat(1e-30));
        let GpuCapacity { pairs, chords, survivors, .. } = self.capacity;
        let primitives = input.bodies.iter().filter_map(|body| body.solid.medial()).map(|shape| shape.len() as u32);
        let tiles = primitives.max().unwrap_or(1).div_ceil(WORKGROUP);
        gpu.require("workgroups", most.into(), tiles.into())?;
        let begins = self.capacity.candidate_begins();
        gpu.require("candidates", u32::MAX.into(), begins[KINDS])?;
        let params = Params {
            bodies: bodies.len() as u32,
            leaves,
            static_nodes: (statics.bvh().bytes().len() / NODE as usize) as u32,
            prediction: input.prediction,
            low: space.min,
            max_pairs: pairs,
            cells: Vec3::splat(1023.0) / size,
            max_chords: chords,
            max_survivors: survivors,
            touch: LINEAR_SLOP * input.length_unit,
            is_flat: self.is_flat.into(),
            tiles,
            candidates: std::array::from_fn(|index| begins.get(index).copied().unwrap_or_default() as u32),
        };
        buffers.write(gpu, Slot::Params, bytes_of(&params))?;
        self.reserve(leaves)?;
        self.bind(leaves);
        Ok(())
    }

    /// Writes bodies, new statics and new shapes. The shapes of deforming bodies are written after all others, because they change in each step.
    fn write_bodies(
        &mut self,
        input: &StepInput,
        statics: &Statics,
        widening: &KinematicReach,
        slack: impl Fn(usize) -> f32,
    ) -> Result<Vec<layout::Body>, GpuError> {
        let known = key(statics);
        let Self { gpu, buffers, shapes, .. } = self;
        shapes.begin_step();
        if shapes.tidy() {
            self.statics = None;
        }
        let laid_out = (0..).zip(&input.bodies).map(|(index, body)| {
            let margins = [widening.margin(input, index), slack(index)];
            bodies::body(body, widening.is_awake(input, index), margins, shapes)
        });
        let mut laid_out: Vec<_> = laid_out.collect();
        if self.statics != Some(known) {
            let still: Vec<_> = statics.bodies().iter().map(|body| bodies::still(body, shapes)).collect();
            buffers.write(gpu, Slot::Statics, cast_slice(&still))?;
            buffers.write(gpu, Slot::StaticNodes, statics.bvh().bytes())?;
            self.statics = Some(known);
        }
        for (body, laid_out) in input.bodies.iter().zip(&mut laid_out) {
            if let Some(shape) = body.solid.deforming() {
                laid_out.shape = DEFORMING | shapes.add_deforming(shape);
            }
        }
        buffers.write(gpu, Slot::Bodies, cast_slice(&laid_out))?;
        shapes.upload(gpu, buffers)?;
        Ok(laid_out)
    }

    /// Reserves the buffers that the passes write.
    fn reserve(&mut self, leaves: u32) -> Result<(), GpuError> {
        let GpuCapacity { pairs, chords, survivors, .. } = self.capacity;
        let candidates = self.capacity.candidate_begins()[KINDS] as u32;
        for (slot, count, size) in [
            (Slot::Swept, leaves, SWEPT),
            (Slot::Keys, leaves, KEY),
            (Slot::Tree, 2 * leaves, NODE),
            (Slot::Exchanges, exchanges(leaves).len() as u32, UNIFORM),
            (Slot::Counters, 1, size_of::<Counters>() as u64),
            (Slot::Pairs, pairs, size_of::<Pair>() as u64),
            (Slot::PairChords, chords, PAIR_CHORD),
            (Slot::Chords, chords, CHORD),
            (Slot::Candidates, candidates, CANDIDATE),
            (Slot::Survivors, survivors, size_of::<Survivor>() as u64),
            (Slot::Groups, 3 * (2 + KINDS as u32), 4),
            // These may be empty so far, but the passes bind them.
            (Slot::Shapes, 0, 0),
            (Slot::Spheres, 0, 0),
            (Slot::Primitives, 0, 0),
            (Slot::ShapeNodes, 0, 0),
        ] {
            self.buffers.reserve(&self.gpu, slot, u64::from(count) * size)?;
        }
        Ok(())
    }

    /// Records the passes for the uploaded step, and the copy of as many results as are expected.
    ///
    /// # Errors
    /// If the scene exceeds the limits of the device.
    pub(crate) fn encode(&mut self, encoder: &mut wgpu::CommandEncoder) -> Result<Batch, GpuError> {
        let room = Room {
            pairs: self.expected.pairs.min(self.capacity.pairs),
            survivors: self.expected.survivors.min(self.capacity.survivors),
        };
        let bytes = room.times_at() + self.timer.bytes();
        let staging = self.staging.pop().filter(|staging| staging.size() >= bytes);
        let staging = staging.map_or_else(|| self.gpu.staging(bytes), Ok)?;
        let (buffers, passes, timer) = (&self.buffers, &self.passes, &self.timer);
        let Some((_, leaves, bound)) = &self.bound else { unreachable!("`upload` creates the bind groups") };
        let mut labels = Vec::new();
        let mut run =
            |encoder: &mut wgpu::CommandEncoder, label: &'static str, steps: &[(&Pass, &wgpu::BindGroup, Work)]| {
                let timestamp_writes = timer.writes(labels.len() as u32);
                labels.push(label);
                let descriptor = wgpu::ComputePassDescriptor { label: Some(label), timestamp_writes };
                let mut pass = encoder.begin_compute_pass(&descriptor);
                for (step, group, work) in steps {
                    step.set(&mut pass, group);
                    match work {
                        Work::Direct(groups) => pass.dispatch_workgroups(*groups, 1, 1),
                        Work::Indirect(number) => {
                            pass.dispatch_workgroups_indirect(buffers.get(Slot::Groups), 12 * number);
                        }
                    }
                }
            };
        encoder.clear_buffer(buffers.get(Slot::Counters), 0, None);
        let (wide, blocks) = (leaves.div_ceil(WORKGROUP), leaves.div_ceil(SORT_BLOCK));
        run(encoder, "place", &[(&passes.place, &bound.place, Work::Direct(wide))]);
        let mut sort = vec![(&passes.sort_blocks, &bound.sort_blocks, Work::Direct(blocks))];
        for (is_near, group) in &bound.exchanges {
            sort.push((if *is_near { &passes.sort_near } else { &passes.sort_far }, group, Work::Direct(blocks)));
        }
        run(encoder, "sort", &sort);
        let mut tree = vec![(&passes.tree_bottom, &bound.tree_bottom, Work::Direct(leaves.div_ceil(TREE_BLOCK)))];
        if *leaves > TREE_BLOCK {
            tree.push((&passes.tree_top, &bound.tree_top, Work::Direct(1)));
        }
        run(encoder, "tree", &tree);
        let dispatch = || (&passes.dispatch, &bound.dispatch, Work::Direct(1));
        run(encoder, "broad", &[(&passes.broad_phase, &bound.broad_phase, Work::Direct(wide)), dispatch()]);
        run(encoder, "chords", &[(&passes.place_chords, &bound.place_chords, Work::Indirect(0))]);
        run(encoder, "mid", &[(&passes.mid_phase, &bound.mid_phase, Work::Indirect(1)), dispatch()]);
        let narrow = passes.narrow_phase.iter().zip(&bound.narrow_phase);
        let narrow: Vec<_> =
            narrow.zip(2..).map(|((pass, group), index)| (pass, group, Work::Indirect(index))).collect();
        run(encoder, "narrow", &narrow);

        let mut copy = |slot, at, size| {
            if size > 0 {
                encoder.copy_buffer_to_buffer(buffers.get(slot), 0, &staging, at, size);
            }
        };
        copy(Slot::Counters, 0, Room::PAIRS_AT);
        copy(Slot::Pairs, Room::PAIRS_AT, room.survivors_at() - Room::PAIRS_AT);
        copy(Slot::Survivors, room.survivors_at(), room.times_at() - room.survivors_at());
        timer.resolve(encoder, PASSES, &staging, room.times_at());
        Ok(Batch { staging, bytes, room, capacity: self.capacity, labels })
    }

    /// Takes the results of the passes from `data`, the bytes of the batch's staging buffer. None if a buffer was too small; it has grown then.
    pub(crate) fn take(&mut self, batch: Batch, data: &[u8]) -> Option<Vec<Candidates>> {
        let counts = Room::counts(data);
        // The buffers may have grown since the batch was recorded.
        if let Some(larger) = batch.capacity.for_counts(&counts) {
            info_once!("GPU buffers grow beyond {:?}; `GpuCapacity` sets their initial size", batch.capacity);
            self.capacity = self.capacity.max(larger);
            return None;
        }
        self.counts = counts;
        self.times =
            batch.labels.into_iter().zip(self.timer.durations(&data[batch.room.times_at() as usize..])).collect();
        self.staging.push(batch.staging);
        self.expected = self.expected.followed_by(Room::for_counts(&counts));
        batch.room.candidates(data)
    }

    /// Creates the bind groups again if buffers have been replaced.
    fn bind(&mut self, leaves: u32) {
        let generation = self.buffers.generation;
        if self.bound.as_ref().is_some_and(|(known, count, _)| (*known, *count) == (generation, leaves)) {
            return;
        }
        let steps = exchanges(leaves);
        for (i, step) in (0..).zip(&steps) {
            self.gpu.queue.write_buffer(self.buffers.get(Slot::Exchanges), i * UNIFORM, bytes_of(step));
        }
        let bound = Bound::new(&self.gpu, &self.passes, &self.buffers, leaves, &steps);
        self.bound = Some((generation, leaves, bound));
    }
}

/// Returns the identifier and the number of statics.
fn key(statics: &Statics) -> (u64, u32) {
    (statics.id(), statics.bodies().len() as u32)
}

#[cfg(test)]
mod tests;
