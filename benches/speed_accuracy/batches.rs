//! Many primitive pairs at once: times of impact on the CPU, and their lower bounds by a call of the GPU.

use std::{hint::black_box, time::Instant};

use bevy_medial::{
    geometry::Sphere,
    gpu::{GpuBounds, GpuDevice, GpuError, MovingPair},
    query::{Moving, times_of_impact},
    random::Random,
};
use glam::Vec3;
use serde::Serialize;

/// Times for a number of pairs.
#[derive(Clone, Debug, Serialize)]
pub struct BatchRow {
    pub gpu: String,
    pub pairs: usize,
    /// On one thread, in milliseconds.
    pub cpu_ms: f64,
    /// With upload, wait and readback, in milliseconds.
    pub gpu_ms: f64,
}

/// Number of runs. The min time counts.
const RUNS: usize = 5;

/// Times for slabs that fly past each other: 16 pairs, and four times as many in each further row. No rows without an adapter.
///
/// # Errors
/// If a call of the GPU fails.
pub fn rows(sizes: u32) -> Result<Vec<BatchRow>, GpuError> {
    let Ok(gpu) = GpuDevice::request() else { return Ok(Vec::new()) };
    let mut bounds = GpuBounds::new(&gpu)?;
    let mut random = Random(1);
    let mut row = |pairs: usize| {
        let pairs: Vec<_> = (0..pairs).map(|_| (slab(&mut random, -Vec3::X), slab(&mut random, Vec3::X))).collect();
        let packed: Vec<MovingPair> = pairs.iter().map(|(first, second)| MovingPair::new(first, second)).collect();
        let (mut cpu_ms, mut gpu_ms) = (f64::INFINITY, f64::INFINITY);
        for _ in 0..RUNS {
            let clock = Instant::now();
            black_box(times_of_impact(&pairs, 1.0));
            cpu_ms = cpu_ms.min(clock.elapsed().as_secs_f64() * 1e3);
            let clock = Instant::now();
            black_box(bounds.run(&packed)?);
            gpu_ms = gpu_ms.min(clock.elapsed().as_secs_f64() * 1e3);
        }
        Ok(BatchRow { gpu: gpu.name().into(), pairs: pairs.len(), cpu_ms, gpu_ms })
    };
    (2..2 + sizes).map(|size| row(4usize.pow(size))).collect()
}

/// A slab near `place` that moves to the other side of the origin.
fn slab(random: &mut Random, place: Vec3) -> Moving<3> {
    let mut vector = || 0.5 * random.in_cube();
    let start = [(); 3].map(|()| Sphere::new(place + vector(), 0.05));
    Moving { start, motion: [vector() - 2.0 * place; 3] }
}

/// The number of pairs from which the GPU is faster. `None` if it is not faster for the largest number.
pub fn crossover(rows: &[BatchRow]) -> Option<usize> {
    let slow = rows.iter().rposition(|row| row.gpu_ms >= row.cpu_ms).map_or(0, |at| at + 1);
    rows.get(slow).map(|row| row.pairs)
}
