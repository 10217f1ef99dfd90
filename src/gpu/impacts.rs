use std::time::Duration;

use bytemuck::{Pod, Zeroable};
use glam::Vec3;

use super::{
    GpuDevice, GpuError,
    pass::{KERNELS, Pass, shader},
    passes::WORKGROUP,
    timer::Timer,
};
use crate::query::{Cuboid, Moving, Separation, TimeOfImpact, TimeOfImpactStatus};

/// A moving primitive, and another one or a box at rest at the origin: `Pair` in `impacts.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct MovingPair {
    pub(super) first: Side,
    pub(super) second: Side,
}

/// `Moving` in `time_of_impact.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct Side {
    /// Spheres at the start as `x y z radius`, in metres. For a box the first entry is its half extents.
    pub spheres: [[f32; 4]; 3],
    /// Number of spheres, 0 for a box.
    pub count: u32,
    _unused: [u32; 3],
    /// Displacements of the spheres, in metres.
    pub motion: [[f32; 4]; 3],
}

impl<const N: usize> From<&Moving<N>> for Side {
    fn from(moving: &Moving<N>) -> Self {
        let mut side = Self { count: N as u32, ..Self::zeroed() };
        for (i, (sphere, motion)) in moving.start.iter().zip(&moving.motion).enumerate() {
            side.spheres[i] = sphere.center.extend(sphere.radius).into();
            side.motion[i] = motion.extend(0.0).into();
        }
        side
    }
}

impl MovingPair {
    /// A pair of two primitives.
    pub fn new<const N: usize, const M: usize>(first: &Moving<N>, second: &Moving<M>) -> Self {
        Self { first: first.into(), second: second.into() }
    }

    /// A pair of a primitive and a box, in the box's frame.
    pub fn with_cuboid<const N: usize>(first: &Moving<N>, cuboid: &Cuboid) -> Self {
        let mut second = Side::zeroed();
        second.spheres[0] = cuboid.half.extend(0.0).into();
        Self { first: first.into(), second }
    }
}

/// `Result` in `impacts.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
pub(super) struct Answer {
    pub normal: Vec3,
    pub distance: f32,
    pub point1: Vec3,
    pub fraction: f32,
    pub status: u32,
    pub rounds: u32,
    pub feature: u32,
    _unused: u32,
}

/// Times of impact of lists of pairs: the narrow phase kernel by itself, for tests and benchmarks.
pub struct GpuImpacts {
    gpu: GpuDevice,
    pass: Pass,
    timer: Timer,
    time: Option<Duration>,
}

impl GpuImpacts {
    /// Creates the kernel on a device.
    ///
    /// # Errors
    /// If the device refuses the shader.
    pub fn new(gpu: &GpuDevice) -> Result<Self, GpuError> {
        Ok(Self { pass: Pass::new(gpu, "impacts", text())?, timer: Timer::new(gpu, 1)?, time: None, gpu: gpu.clone() })
    }

    /// Time of the last call on the device, without upload and readback. None if the device cannot measure times.
    pub fn time(&self) -> Option<Duration> {
        self.time
    }

    /// Computes the result of [`time_of_impact`](crate::query::time_of_impact) for each pair over the whole step, up to the rounding of f32. Points
    /// are relative to the first sphere of the first side at that time, or to the box.
    ///
    /// # Errors
    /// If there are more pairs than the device can process at once, or if it is lost.
    pub fn run(&mut self, pairs: &[MovingPair]) -> Result<Vec<TimeOfImpact>, GpuError> {
        let (gpu, limits) = (&self.gpu, self.gpu.device.limits());
        let bytes = size_of_val(pairs) as u64;
        gpu.require("bytes in a storage buffer", limits.max_storage_buffer_binding_size, bytes)?;
        let groups = pairs.len().div_ceil(WORKGROUP as usize) as u32;
        gpu.require("workgroups", limits.max_compute_workgroups_per_dimension.into(), groups.into())?;
        if pairs.is_empty() {
            return Ok(Vec::new());
        }
        let size = (pairs.len() * size_of::<Answer>()) as u64;
        use wgpu::BufferUsages as Usage;
        let input = gpu.buffer("pairs", bytes, Usage::STORAGE | Usage::COPY_DST)?;
        let output = gpu.buffer("results", size, Usage::STORAGE | Usage::COPY_SRC)?;
        let staging = gpu.staging(size + self.timer.bytes())?;
        let submission = gpu.checked(format_args!("{} pairs", pairs.len()), |device| {
            gpu.queue.write_buffer(&input, 0, bytemuck::cast_slice(pairs));
            let mut encoder = device.create_command_encoder(&Default::default());
            let group =
                self.pass.bind(gpu, &[(0, input.as_entire_buffer_binding()), (1, output.as_entire_buffer_binding())]);
            let timestamp_writes = self.timer.writes(0);
            let descriptor = wgpu::ComputePassDescriptor { label: Some("impacts"), timestamp_writes };
            let mut pass = encoder.begin_compute_pass(&descriptor);
            self.pass.set(&mut pass, &group);
            pass.dispatch_workgroups(groups, 1, 1);
            drop(pass);
            encoder.copy_buffer_to_buffer(&output, 0, &staging, 0, size);
            self.timer.resolve(&mut encoder, 1, &staging, size);
            gpu.queue.submit([encoder.finish()])
        })?;
        let data = gpu.read(&staging, size + self.timer.bytes(), submission)?;
        let (answers, times) = data.split_at(size as usize);
        self.time = self.timer.durations(times).first().copied();
        Ok(bytemuck::pod_collect_to_vec::<u8, Answer>(answers).iter().map(Answer::decoded).collect())
    }
}

/// Text of the shader.
pub(super) fn text() -> String {
    shader(&[KERNELS, &[include_str!("../../shaders/impacts.wgsl")]].concat())
}

impl Answer {
    pub fn decoded(&self) -> TimeOfImpact {
        TimeOfImpact {
            status: match self.status {
                0 => TimeOfImpactStatus::Separated,
                1 => TimeOfImpactStatus::Hit,
                2 => TimeOfImpactStatus::Overlapping,
                _ => TimeOfImpactStatus::IterationLimit,
            },
            fraction: self.fraction,
            contact: Separation {
                distance: self.distance,
                normal: self.normal,
                point1: self.point1,
                point2: self.point1 + self.normal * self.distance,
                feature: self.feature as usize,
            },
            rounds: self.rounds,
        }
    }
}
