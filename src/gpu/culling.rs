//! Hybrid culling, and the test of what it leaves, as compute passes.
//!
//! ```text
//!   poses, shapes, statics
//!     1 place    swept bounding spheres, and keys along a space-filling curve
//!     2 sort     bodies by their keys
//!     3 tree     boxes around what they sweep
//!     4 broad    swept sphere against swept sphere, and against a BVH of static boxes   -> body pairs
//!     5 chords   motion of each pair as lines, for spinning bodies several               -> chords of pairs
//!     6 mid      primitive boxes against the primitive BVH, swept along the chord         -> candidate primitive pairs
//!     7 narrow   time at which they first come within the prediction distance             -> primitive pairs that meet
//!   pairs that meet, read back and sorted
//! ```
//!
//! The passes are those of the CPU, stage by stage, with its kernels in f32. Each is widened by what rounding may take, so they find all that the
//! CPU would find, and little else. What is left, a few primitive pairs for each body pair, goes on to the CPU's narrow phase: impacts, stops
//! and contacts are the same as if it had culled itself.
//!
//! Pairs with other colliders than medial meshes and fixed boxes are found here; their primitives are left to the CPU.

use std::time::Duration;

use bevy::prelude::*;
use bytemuck::{Pod, bytes_of, cast_slice, pod_collect_to_vec};
use glam::Vec3;

use super::{
    GpuDevice, GpuError, bodies,
    buffers::{Buffers, Slot},
    layout::{Counters, Pair, Params, STATIC, Survivor, UNKNOWN},
    pass::Pass,
    passes::{Bound, KEY, Passes, SORT_BLOCK, TREE_BLOCK, UNIFORM, exchanges},
    shapes::Shapes,
    timer::Timer,
};
use crate::{
    geometry::{Aabb, Sphere},
    pipeline::{Candidates, Side, Statics, StepInput, Widening},
};

/// Sizes in bytes of what only the shaders write.
const SWEPT: u64 = 32;
const NODE: u64 = 32;
const PAIR_CHORD: u64 = 16;
pub(super) const CHORD: u64 = 176;
pub(super) const CANDIDATE: u64 = 12;
/// Passes of which times are told.
const PASSES: u32 = 7;

/// How many of each there is room for at first. More of them, and the buffers grow.
#[derive(Resource, Clone, Copy, Debug, PartialEq, Eq, Reflect)]
#[reflect(Resource, Default, Clone, PartialEq)]
pub struct GpuCapacity {
    /// Body pairs.
    pub pairs: u32,
    /// Chords of their motions.
    pub chords: u32,
    /// Primitive pairs that the mid phase leaves.
    pub candidates: u32,
    /// Those that the narrow phase leaves.
    pub survivors: u32,
}

impl Default for GpuCapacity {
    /// Some MiB.
    fn default() -> Self {
        Self { pairs: 1 << 12, chords: 1 << 13, candidates: 1 << 17, survivors: 1 << 15 }
    }
}

/// Culls steps on a GPU.
pub struct GpuCulling {
    gpu: GpuDevice,
    passes: Passes,
    shapes: Shapes,
    buffers: Buffers,
    /// What the passes bind, for buffers of a generation and a number of leaves.
    bound: Option<(u64, u32, Bound)>,
    capacity: GpuCapacity,
    /// Pairs and survivors that are read back at once.
    expected: [u32; 2],
    /// Those that have been uploaded, and how many.
    statics: Option<(u64, u32)>,
    /// Buffers to read from that nobody uses.
    staging: Vec<wgpu::Buffer>,
    timer: Timer,
    times: Vec<(&'static str, Duration)>,
    counts: Counters,
}

/// What is on its way from the GPU.
pub(crate) struct Batch {
    pub staging: wgpu::Buffer,
    /// Bytes of it that are of use.
    pub bytes: u64,
    /// For how many there is room.
    pairs: u32,
    survivors: u32,
    /// Passes in the order of their times.
    labels: Vec<&'static str>,
}

/// How many workgroups a pass has.
enum Work {
    Direct(u32),
    /// The number of the pass in the buffer of workgroups.
    Indirect(u64),
}

impl GpuCulling {
    /// The passes on a device.
    ///
    /// # Errors
    /// If the device refuses them.
    pub fn new(gpu: &GpuDevice, capacity: GpuCapacity) -> Result<Self, GpuError> {
        Ok(Self {
            passes: Passes::new(gpu)?,
            shapes: Shapes::default(),
            buffers: Buffers::new(),
            bound: None,
            capacity,
            expected: [256, 1024],
            statics: None,
            staging: Vec::new(),
            timer: Timer::new(gpu, PASSES),
            times: Vec::new(),
            counts: Counters::default(),
            gpu: gpu.clone(),
        })
    }

    /// The device.
    pub fn device(&self) -> &GpuDevice {
        &self.gpu
    }

    /// Time of each pass of the last step on the GPU, if it can tell.
    pub fn times(&self) -> &[(&'static str, Duration)] {
        &self.times
    }

    /// How many body pairs, chords, candidates and primitive pairs that meet the last step had.
    pub fn counts(&self) -> [u32; 4] {
        let Counters { pairs, chords, candidates, survivors } = self.counts;
        [pairs, chords, candidates, survivors]
    }

    /// How many of each there is room for by now.
    pub fn capacity(&self) -> GpuCapacity {
        self.capacity
    }

    /// The pairs that may meet within the step; waits for the GPU. Where a buffer is too small, it grows, and the step is culled once more.
    ///
    /// # Errors
    /// If the scene is more than the device can take, or the device is lost. Nothing is found then.
    pub fn cull(&mut self, input: &StepInput, statics: &Statics) -> Result<Vec<Candidates>, GpuError> {
        let mut widening = Widening::new(input);
        loop {
            self.upload(input, statics, |body| [widening.margin(input, body), 0.0])?;
            let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
            let batch = self.encode(&mut encoder)?;
            let submission = self.gpu.queue.submit([encoder.finish()]);
            let data = self.gpu.read(&batch.staging, batch.bytes, submission)?;
            if let Some(found) = self.take(batch, &data)
                && !widening.widen(input, found.iter().map(|pair| pair.sides))
            {
                return Ok(found);
            }
        }
    }

    /// Writes what a step depends on, and makes room. `margins` of each body in metres: how far outside of its bounding sphere it may meet
    /// something, and how far it may leave its way.
    ///
    /// # Errors
    /// If the scene is more than the device can take.
    pub(crate) fn upload(
        &mut self,
        input: &StepInput,
        statics: &Statics,
        margins: impl Fn(usize) -> [f32; 2],
    ) -> Result<(), GpuError> {
        if self.shapes.tidy() {
            self.statics = None;
        }
        let (gpu, buffers) = (&self.gpu, &mut self.buffers);
        let leaves = (input.bodies.len() as u32).next_power_of_two();
        let most = gpu.limits().max_compute_workgroups_per_dimension;
        gpu.require("workgroups", most.into(), leaves.div_ceil(64).into())?;
        let bodies: Vec<_> = (0..)
            .zip(&input.bodies)
            .map(|(index, body)| bodies::body(body, margins(index), &mut self.shapes))
            .collect();
        buffers.write(gpu, Slot::Bodies, cast_slice(&bodies))?;
        let known = (statics.id(), statics.bodies().len() as u32);
        if self.statics != Some(known) {
            let still: Vec<_> = statics.bodies().iter().map(|body| bodies::still(body, &mut self.shapes)).collect();
            buffers.write(gpu, Slot::Statics, cast_slice(&still))?;
            buffers.write(gpu, Slot::StaticNodes, statics.bvh().bytes())?;
            self.statics = Some(known);
        }
        self.shapes.upload(gpu, buffers)?;

        let space = Aabb::from_spheres(bodies.iter().map(|body| Sphere::new(body.position, 0.0)));
        let size = (space.max - space.min).max(Vec3::splat(f32::MIN_POSITIVE));
        let GpuCapacity { pairs, chords, candidates, survivors } = self.capacity;
        let params = Params {
            bodies: bodies.len() as u32,
            leaves,
            static_nodes: (statics.bvh().bytes().len() / NODE as usize) as u32,
            prediction: input.prediction,
            low: space.min,
            max_pairs: pairs,
            cells: Vec3::splat(1023.0) / size,
            max_chords: chords,
            max_candidates: candidates,
            max_survivors: survivors,
            unused: [0; 2],
        };
        buffers.write(gpu, Slot::Params, bytes_of(&params))?;
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
            (Slot::Groups, 9, 4),
        ] {
            buffers.reserve(gpu, slot, u64::from(count) * size)?;
        }
        // What no step has needed yet.
        for slot in [Slot::Shapes, Slot::Spheres, Slot::Primitives, Slot::ShapeNodes] {
            buffers.reserve(gpu, slot, 0)?;
        }
        self.bind(leaves);
        Ok(())
    }

    /// Records the passes for what was uploaded, and the copy of what they find, as far as it is expected.
    ///
    /// # Errors
    /// If the scene is more than the device can take.
    pub(crate) fn encode(&mut self, encoder: &mut wgpu::CommandEncoder) -> Result<Batch, GpuError> {
        let [pairs, survivors] =
            [self.expected[0].min(self.capacity.pairs), self.expected[1].min(self.capacity.survivors)];
        let counters_size = size_of::<Counters>() as u64;
        let pairs_size = u64::from(pairs) * size_of::<Pair>() as u64;
        let survivors_size = u64::from(survivors) * size_of::<Survivor>() as u64;
        let times_at = counters_size + pairs_size + survivors_size;
        let bytes = times_at + self.timer.bytes();
        let staging = self.staging.pop().filter(|staging| staging.size() >= bytes);
        let staging = staging.map_or_else(|| self.gpu.staging(bytes), Ok)?;
        let (buffers, passes) = (&self.buffers, &self.passes);
        let Some((_, leaves, bound)) = &self.bound else { unreachable!("uploading binds") };

        let mut labels = Vec::new();
        let timer = &self.timer;
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
        let wide = leaves.div_ceil(64);
        run(encoder, "place", &[(&passes.place, &bound.place, Work::Direct(wide))]);
        let blocks = leaves.div_ceil(SORT_BLOCK);
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
        run(encoder, "narrow", &[(&passes.narrow_phase, &bound.narrow_phase, Work::Indirect(2))]);

        let mut copy = |slot, at, size| {
            if size > 0 {
                encoder.copy_buffer_to_buffer(buffers.get(slot), 0, &staging, at, size);
            }
        };
        copy(Slot::Counters, 0, counters_size);
        copy(Slot::Pairs, counters_size, pairs_size);
        copy(Slot::Survivors, counters_size + pairs_size, survivors_size);
        timer.resolve(encoder, PASSES, &staging, times_at);
        Ok(Batch { staging, bytes, pairs, survivors, labels })
    }

    /// Takes what the passes have found, the bytes of the batch's staging buffer; nothing if a buffer was too small and has grown.
    pub(crate) fn take(&mut self, batch: Batch, data: &[u8]) -> Option<Vec<Candidates>> {
        let pairs_at = size_of::<Counters>();
        let survivors_at = pairs_at + batch.pairs as usize * size_of::<Pair>();
        let times_at = survivors_at + batch.survivors as usize * size_of::<Survivor>();
        let counts = list::<Counters>(data, 1)[0];
        if let Some(larger) = self.capacity.for_counts(&counts) {
            info!("GPU buffers grow from {:?} to {larger:?}; `GpuCapacity` sets where they begin", self.capacity);
            self.capacity = larger;
            return None;
        }
        self.counts = counts;
        self.times = batch.labels.into_iter().zip(self.timer.durations(&data[times_at..])).collect();
        self.staging.push(batch.staging);
        // A quarter more than what there is now.
        self.expected = [counts.pairs, counts.survivors].map(|count| (count + count / 4).next_multiple_of(256));
        if counts.pairs > batch.pairs || counts.survivors > batch.survivors {
            return None;
        }
        Some(candidates(&list(&data[pairs_at..], counts.pairs), &list(&data[survivors_at..], counts.survivors)))
    }

    /// Makes the bind groups, if buffers have been made anew.
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

impl GpuCapacity {
    /// What there has to be room for, if that is more.
    fn for_counts(&self, counts: &Counters) -> Option<Self> {
        let larger = |room: u32, count: u32| if count > room { count.saturating_add(count / 4) } else { room };
        let needed = Self {
            pairs: larger(self.pairs, counts.pairs),
            chords: larger(self.chords, counts.chords),
            candidates: larger(self.candidates, counts.candidates),
            survivors: larger(self.survivors, counts.survivors),
        };
        (needed != *self).then_some(needed)
    }
}

impl Pair {
    fn sides(&self) -> [Side; 2] {
        let index = self.second & !(STATIC | UNKNOWN);
        let second = if self.second & STATIC == 0 { Side::Body(index) } else { Side::Static(index) };
        [Side::Body(self.first), second]
    }
}

/// The first elements of a list.
fn list<T: Pod>(bytes: &[u8], count: u32) -> Vec<T> {
    pod_collect_to_vec(&bytes[..count as usize * size_of::<T>()])
}

/// Gathers the primitives of each pair. The order is that of the GPU; whoever goes on sorts them.
fn candidates(pairs: &[Pair], survivors: &[Survivor]) -> Vec<Candidates> {
    let mut found: Vec<Candidates> = pairs
        .iter()
        .map(|pair| {
            let primitives = if pair.second & UNKNOWN == 0 { Some(Vec::new()) } else { None };
            Candidates { sides: pair.sides(), primitives }
        })
        .collect();
    for survivor in survivors {
        if let Some(primitives) = &mut found[survivor.pair as usize].primitives {
            primitives.push([survivor.first, survivor.second]);
        }
    }
    found
}
