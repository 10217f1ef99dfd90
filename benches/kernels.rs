//! Separation and time of impact for each kind of pair, over random pairs of which the share that hits is printed.

use std::hint::black_box;

use bevy_medial::{
    geometry::Sphere,
    query::{Cuboid, Moving, MovingConvex, TimeOfImpactStatus, separation, time_of_impact},
};
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use glam::{DVec3, Vec3};

const PAIRS: u64 = 1024;

/// A small seeded generator, uniform from -1 to 1.
struct Random(u64);

impl Random {
    fn signed(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 40) as f32) / (1u64 << 23) as f32 - 1.0
    }

    fn vector(&mut self, scale: f32) -> Vec3 {
        Vec3::new(self.signed(), self.signed(), self.signed()) * scale
    }

    /// A primitive of about unit size near `center` that moves by about `motion`.
    fn moving<const N: usize>(&mut self, center: Vec3, motion: Vec3) -> Moving<N> {
        Moving {
            start: std::array::from_fn(|_| Sphere::new(center + self.vector(0.5), 0.15 + 0.1 * self.signed())),
            motion: std::array::from_fn(|_| motion + self.vector(0.1)),
        }
    }
}

fn bench_pair<const N: usize, B: MovingConvex>(
    criterion: &mut Criterion,
    kind: &str,
    mut second: impl FnMut(&mut Random) -> B,
) {
    let mut random = Random(1);
    let pairs: Vec<(Moving<N>, B)> = (0..PAIRS)
        .map(|_| {
            let offset = random.vector(1.0).normalize_or(Vec3::X) * 3.0;
            let motion = -offset * 1.2 + random.vector(1.5);
            (random.moving(offset, motion), second(&mut random))
        })
        .collect();
    let hits = pairs.iter().filter(|(a, b)| time_of_impact(a, b, 1.0).status != TimeOfImpactStatus::Separated).count();
    println!("{kind}: {} % of {PAIRS} pairs hit", 100 * hits as u64 / PAIRS);

    let mut group = criterion.benchmark_group(kind);
    group.throughput(Throughput::Elements(PAIRS));
    group.bench_function(BenchmarkId::from_parameter("separation"), |bencher| {
        let placed: Vec<([Sphere; N], B::Shape)> =
            pairs.iter().map(|(a, b)| (a.at(0.5, DVec3::ZERO), b.at(0.5, DVec3::ZERO))).collect();
        bencher.iter(|| placed.iter().map(|(a, b)| separation(black_box(a), b, 0).distance).sum::<f32>());
    });
    group.bench_function(BenchmarkId::from_parameter("time of impact"), |bencher| {
        bencher.iter(|| pairs.iter().map(|(a, b)| time_of_impact(black_box(a), b, 1.0).fraction).sum::<f32>());
    });
    group.finish();
}

fn kernels(criterion: &mut Criterion) {
    let sphere = |random: &mut Random| random.moving::<1>(Vec3::ZERO, Vec3::ZERO);
    let cone = |random: &mut Random| random.moving::<2>(Vec3::ZERO, Vec3::ZERO);
    let slab = |random: &mut Random| random.moving::<3>(Vec3::ZERO, Vec3::ZERO);
    let cuboid = |random: &mut Random| Cuboid { half: random.vector(0.5).abs() + 0.1 };
    bench_pair::<1, _>(criterion, "sphere-sphere", sphere);
    bench_pair::<1, _>(criterion, "sphere-cone", cone);
    bench_pair::<1, _>(criterion, "sphere-slab", slab);
    bench_pair::<2, _>(criterion, "cone-cone", cone);
    bench_pair::<2, _>(criterion, "cone-slab", slab);
    bench_pair::<3, _>(criterion, "slab-slab", slab);
    bench_pair::<1, _>(criterion, "sphere-box", cuboid);
    bench_pair::<2, _>(criterion, "cone-box", cuboid);
    bench_pair::<3, _>(criterion, "slab-box", cuboid);
}

criterion_group!(benches, kernels);
criterion_main!(benches);
