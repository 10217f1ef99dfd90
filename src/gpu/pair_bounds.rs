use std::time::Duration;

use bytemuck::{Pod, Zeroable, cast_slice, pod_collect_to_vec};

use super::{
    GpuDevice, GpuError,
    kinds::Kind,
    pass::{BOUNDS, NEARER, NEAREST, Pass, shader_of_kind},
    passes::WORKGROUP,
    timer::Timer,
};
use crate::query::{Cuboid, Moving};

/// Label and entry point of the kernels.
pub(super) const LABEL: &str = "pairs_of_kind";

/// Source that runs a kernel for each pair of a list.
const PAIRS: &str = include_str!("../../shaders/pairs.wgsl");

/// A moving primitive, and another one or a box at rest at the origin.
#[derive(Clone, Copy, Debug)]
pub struct MovingPair {
    kind: Kind,
    sides: [Side; 2],
}

/// `Moving` in `bounds.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct Side {
    /// Spheres at the start as `x y z radius`, in metres. For a box the first entry is its half extents.
    pub start: [[f32; 4]; 3],
    /// Displacements of the spheres, in metres.
    pub motion: [[f32; 4]; 3],
}

impl<const N: usize> From<&Moving<N>> for Side {
    fn from(moving: &Moving<N>) -> Self {
        let index = |i: usize| i.min(N - 1);
        Self {
            start: [0, 1, 2].map(|i| moving.start[index(i)]).map(|sphere| sphere.center.extend(sphere.radius).into()),
            motion: [0, 1, 2].map(|i| moving.motion[index(i)].extend(0.0).into()),
        }
    }
}

impl MovingPair {
    /// A pair of two primitives.
    pub fn new<const N: usize, const M: usize>(first: &Moving<N>, second: &Moving<M>) -> Self {
        let sides = [first.into(), second.into()];
        let is_slab_second = N < 3 || M == 3;
        Self { kind: Kind::of([N, M]), sides: if is_slab_second { sides } else { [sides[1], sides[0]] } }
    }

    /// A pair of a primitive and a box, in the box's frame.
    pub fn with_cuboid<const N: usize>(first: &Moving<N>, cuboid: &Cuboid) -> Self {
        let mut second = Side::zeroed();
        second.start[0] = cuboid.half.extend(0.0).into();
        Self { kind: Kind::with_box(N), sides: [first.into(), second] }
    }
}

/// Lower bounds of the times of impact of lists of pairs: the kernel of the narrow phase by itself, for tests and benchmarks. Or the times of the published
/// alternation, for comparison.
pub struct GpuBounds {
    gpu: GpuDevice,
    /// One pass for each kind of pairs.
    passes: Vec<Pass>,
    timer: Timer,
    time: Option<Duration>,
}

impl GpuBounds {
    /// Creates the kernels of the narrow phase on a device.
    ///
    /// # Errors
    /// If the device refuses a shader.
    pub fn new(gpu: &GpuDevice) -> Result<Self, GpuError> {
        Self::of(gpu, text)
    }

    /// Creates the kernels of the published [alternation](crate::query::alternating()). Their times are not bounds: they may be late or missing. The
    /// result of a pair with a box is unspecified.
    ///
    /// # Errors
    /// If the device refuses a shader.
    pub fn alternating(gpu: &GpuDevice) -> Result<Self, GpuError> {
        Self::of(gpu, alternating_text)
    }

    fn of(gpu: &GpuDevice, text: impl Fn(Kind) -> String) -> Result<Self, GpuError> {
        let passes = Kind::ALL.into_iter().map(|kind| Pass::new(gpu, LABEL, text(kind))).collect::<Result<_, _>>()?;
        Ok(Self { passes, timer: Timer::new(gpu, 1)?, time: None, gpu: gpu.clone() })
    }

    /// Time of the last call on the device, without upload and readback. None if the device cannot measure times.
    pub fn time(&self) -> Option<Duration> {
        self.time
    }

    /// Returns a lower bound of the time of the first touch of each pair, as a fraction of the step. It exceeds 1 if the pair does not touch.
    ///
    /// # Errors
    /// If the device has not enough memory, or if it is lost.
    pub fn run(&mut self, pairs: &[MovingPair]) -> Result<Vec<f32>, GpuError> {
        let mut bounds = vec![0.0; pairs.len()];
        self.time = None;
        for kind in Kind::ALL {
            let of_kind = || pairs.iter().enumerate().filter(|(_, pair)| pair.kind == kind);
            let sides: Vec<[Side; 2]> = of_kind().map(|(_, pair)| pair.sides).collect();
            let most = self.gpu.device.limits().max_storage_buffer_binding_size as usize / size_of::<[Side; 2]>();
            let mut found = Vec::with_capacity(sides.len());
            for chunk in sides.chunks(most) {
                found.extend(self.run_kind(kind, chunk)?);
            }
            of_kind().zip(found).for_each(|((index, _), bound)| bounds[index] = bound);
        }
        Ok(bounds)
    }

    fn run_kind(&mut self, kind: Kind, pairs: &[[Side; 2]]) -> Result<Vec<f32>, GpuError> {
        let (gpu, limits) = (&self.gpu, self.gpu.device.limits());
        let bytes = size_of_val(pairs) as u64;
        let groups = pairs.len().div_ceil(WORKGROUP as usize) as u32;
        let wide = groups.min(limits.max_compute_workgroups_per_dimension);
        let size = (pairs.len() * size_of::<f32>()) as u64;
        use wgpu::BufferUsages as Usage;
        let input = gpu.buffer("pairs", bytes, Usage::STORAGE | Usage::COPY_DST)?;
        let output = gpu.buffer("bounds", size, Usage::STORAGE | Usage::COPY_SRC)?;
        let staging = gpu.staging(size.next_multiple_of(8) + self.timer.bytes())?;
        let times_at = size.next_multiple_of(8);
        let submission = gpu.checked(format_args!("{} pairs", pairs.len()), |device| {
            gpu.queue.write_buffer(&input, 0, cast_slice(pairs));
            let mut encoder = device.create_command_encoder(&Default::default());
            let pass = &self.passes[kind as usize];
            let group =
                pass.bind(gpu, &[(0, input.as_entire_buffer_binding()), (1, output.as_entire_buffer_binding())]);
            let timestamp_writes = self.timer.writes(0);
            let descriptor = wgpu::ComputePassDescriptor { label: Some(LABEL), timestamp_writes };
            let mut compute = encoder.begin_compute_pass(&descriptor);
            pass.set(&mut compute, &group);
            compute.dispatch_workgroups(wide, groups.div_ceil(wide), 1);
            drop(compute);
            encoder.copy_buffer_to_buffer(&output, 0, &staging, 0, size);
            self.timer.resolve(&mut encoder, 1, &staging, times_at);
            gpu.queue.submit([encoder.finish()])
        })?;
        let data = gpu.read(&staging, times_at + self.timer.bytes(), submission)?;
        if let Some(time) = self.timer.durations(&data[times_at as usize..]).first() {
            self.time = Some(self.time.unwrap_or_default() + *time);
        }
        Ok(pod_collect_to_vec(&data[..size as usize]))
    }
}

/// Text of the shader of the alternation for one kind of pairs.
fn alternating_text(kind: Kind) -> String {
    shader_of_kind(kind, [include_str!("../../shaders/alternating.wgsl"), NEAREST, BOUNDS, PAIRS])
}

/// Text of the shader for one kind of pairs.
pub(super) fn text(kind: Kind) -> String {
    shader_of_kind(kind, [NEARER, NEAREST, BOUNDS, include_str!("../../shaders/pair_bounds.wgsl"), PAIRS])
}
