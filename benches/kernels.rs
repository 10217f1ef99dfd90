//! Benchmarks of kernels, and of hierarchies over primitives:
//!
//! - separation and time of impact of random pairs of each kind, one at a time and many at once; the share of hits is printed;
//! - time of impact of the pairs of a file, for each kind and category in it. The default is `../shared/pairs/moving_pairs.txt`, if it exists.
//!   The environment variable `MOVING_PAIRS` selects another file. `examples/pairs.rs` documents the format;
//! - rays against each kind of primitive; the share of hits is printed;
//! - construction of a hierarchy over the primitives of each model, and a search for overlaps between two copies of it;
//! - the max rate of products and sums of f32 of a core.

use std::{collections::BTreeMap, hint::black_box, path::Path, time::Duration};

use bevy_medial::{
    geometry::{Aabb, Bvh, Pose3, Sphere, Values},
    query::{
        Cuboid, Moving, MovingConvex, MovingPair, TimeOfImpact, TimeOfImpactStatus, Touch, ray_cast, separation,
        time_of_impact, times_of_impact,
    },
    random::Random,
    scenes::load_models,
};
use bevy_medial_compare::pairs::{self, Pair, Primitive, Second};
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use fearless_simd::{Level, Simd, dispatch, f32x16, prelude::*};
use glam::{DVec3, Vec3};

const PAIRS: u64 = 1024;

/// A primitive of about unit size near `center` that moves by about `motion`.
fn moving<const N: usize>(random: &mut Random, center: Vec3, motion: Vec3) -> Moving<N> {
    Moving {
        start: std::array::from_fn(|_| Sphere::new(center + 0.5 * random.in_cube(), 0.15 + 0.1 * random.signed())),
        motion: std::array::from_fn(|_| motion + 0.1 * random.in_cube()),
    }
}

/// Random pairs. About half of them hit.
fn approaching<const N: usize, B>(mut second: impl FnMut(&mut Random) -> B) -> Vec<(Moving<N>, B)> {
    let mut random = Random(1);
    let mut pair = || {
        let offset = random.in_cube().normalize_or(Vec3::X) * 3.0;
        let motion = -offset * 1.2 + random.in_cube() * 1.5;
        (moving(&mut random, offset, motion), second(&mut random))
    };
    (0..PAIRS).map(|_| pair()).collect()
}

fn bench_pair<const N: usize, B: MovingConvex>(
    criterion: &mut Criterion,
    kind: &str,
    second: impl FnMut(&mut Random) -> B,
) {
    let pairs: Vec<(Moving<N>, B)> = approaching(second);
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

/// Times of impact of many pairs at once.
fn bench_pairs<const N: usize, const M: usize>(criterion: &mut Criterion, kind: &str) {
    let pairs: Vec<MovingPair<N, M>> = approaching(|random| moving::<M>(random, Vec3::ZERO, Vec3::ZERO));
    let mut group = criterion.benchmark_group(kind);
    group.throughput(Throughput::Elements(PAIRS));
    group.bench_function(BenchmarkId::from_parameter("times of impact at once"), |bencher| {
        bencher.iter(|| times_of_impact(black_box(&pairs), 1.0));
    });
    group.finish();
}

fn kernels(criterion: &mut Criterion) {
    let sphere = |random: &mut Random| moving::<1>(random, Vec3::ZERO, Vec3::ZERO);
    let cone = |random: &mut Random| moving::<2>(random, Vec3::ZERO, Vec3::ZERO);
    let slab = |random: &mut Random| moving::<3>(random, Vec3::ZERO, Vec3::ZERO);
    let cuboid = |random: &mut Random| Cuboid { half: 0.5 * random.in_cube().abs() + 0.1 };
    bench_pair::<1, _>(criterion, "sphere-sphere", sphere);
    bench_pair::<1, _>(criterion, "sphere-cone", cone);
    bench_pair::<1, _>(criterion, "sphere-slab", slab);
    bench_pair::<2, _>(criterion, "cone-cone", cone);
    bench_pair::<2, _>(criterion, "cone-slab", slab);
    bench_pair::<3, _>(criterion, "slab-slab", slab);
    bench_pairs::<1, 1>(criterion, "sphere-sphere");
    bench_pairs::<1, 2>(criterion, "sphere-cone");
    bench_pairs::<1, 3>(criterion, "sphere-slab");
    bench_pairs::<2, 2>(criterion, "cone-cone");
    bench_pairs::<2, 3>(criterion, "cone-slab");
    bench_pairs::<3, 3>(criterion, "slab-slab");
    bench_pair::<1, _>(criterion, "sphere-box", cuboid);
    bench_pair::<2, _>(criterion, "cone-box", cuboid);
    bench_pair::<3, _>(criterion, "slab-box", cuboid);
}

/// A function that solves many pairs.
type Solve = Box<dyn Fn() -> Vec<Touch>>;

/// Solvers for pairs of one kind: one pair at a time, and many at once if the kind supports it.
fn solvers(pairs: &[Pair]) -> (Solve, Option<Solve>) {
    fn touch(found: TimeOfImpact) -> Touch {
        Touch { status: found.status, fraction: found.fraction }
    }
    fn single<const N: usize, B: MovingConvex + 'static>(pairs: Vec<(Moving<N>, B)>) -> Solve {
        Box::new(move || pairs.iter().map(|(a, b)| touch(time_of_impact(black_box(a), b, 1.0))).collect())
    }
    fn hulls<const N: usize, const M: usize>(pairs: &[Pair]) -> (Solve, Option<Solve>) {
        let pairs = pairs::of_kind::<N, M>(pairs);
        (single(pairs.clone()), Some(Box::new(move || times_of_impact(black_box(&pairs), 1.0))))
    }
    fn against<const N: usize>(pairs: &[Pair]) -> (Solve, Option<Solve>) {
        match pairs[0].second {
            Second::Box { .. } => (single(pairs::against_boxes::<N>(pairs)), None),
            Second::Primitive(Primitive::Sphere(_)) => hulls::<N, 1>(pairs),
            Second::Primitive(Primitive::Cone(_)) => hulls::<N, 2>(pairs),
            Second::Primitive(Primitive::Slab(_)) => hulls::<N, 3>(pairs),
        }
    }
    match pairs[0].first {
        Primitive::Sphere(_) => against::<1>(pairs),
        Primitive::Cone(_) => against::<2>(pairs),
        Primitive::Slab(_) => against::<3>(pairs),
    }
}

fn file(criterion: &mut Criterion) {
    let named = std::env::var("MOVING_PAIRS");
    let path = named.as_deref().unwrap_or(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/pairs/moving_pairs.txt"));
    let Ok(text) = std::fs::read_to_string(path) else {
        return println!("{path}: not found, so no pairs of a file are timed; set MOVING_PAIRS to another file");
    };
    let mut groups: BTreeMap<[String; 2], Vec<Pair>> = BTreeMap::new();
    for pair in pairs::read(&text) {
        match pair {
            Ok(pair) => groups.entry(pair.labels.clone()).or_default().push(pair),
            Err((line, error)) => return println!("{path}:{line}: {error}"),
        }
    }
    for ([kind, category], pairs) in &groups {
        let (single, at_once) = solvers(pairs);
        let hits = single().iter().filter(|touch| touch.status != TimeOfImpactStatus::Separated).count();
        println!("{kind}, {category}: {} % of {} pairs hit", 100 * hits / pairs.len(), pairs.len());
        let mut group = criterion.benchmark_group(format!("file {kind}"));
        group.throughput(Throughput::Elements(pairs.len() as u64));
        // Short times, because there are about a hundred groups.
        group.warm_up_time(Duration::from_millis(300)).measurement_time(Duration::from_secs(1)).sample_size(20);
        group.bench_function(BenchmarkId::from_parameter(category), |bencher| bencher.iter(&single));
        if let Some(at_once) = at_once {
            group.bench_function(BenchmarkId::new(category, "at once"), |bencher| bencher.iter(&at_once));
        }
        group.finish();
    }
}

fn bench_rays<const N: usize>(criterion: &mut Criterion, kind: &str) {
    let mut random = Random(2);
    let rays: Vec<([Sphere; N], Vec3, Vec3)> = (0..PAIRS)
        .map(|_| {
            let spheres = moving::<N>(&mut random, Vec3::ZERO, Vec3::ZERO).start;
            let origin = random.in_cube().normalize_or(Vec3::X) * 3.0;
            (spheres, origin, -origin + random.in_cube() * 0.5)
        })
        .collect();
    let cast = |(spheres, origin, direction): &([Sphere; N], Vec3, Vec3)| ray_cast(spheres, *origin, *direction, 2.0);
    let hits = rays.iter().filter(|ray| cast(ray).is_some()).count();
    println!("ray-{kind}: {} % of {PAIRS} rays hit", 100 * hits as u64 / PAIRS);
    let mut group = criterion.benchmark_group("ray");
    group.throughput(Throughput::Elements(PAIRS));
    group.bench_function(BenchmarkId::from_parameter(kind), |bencher| {
        bencher.iter(|| rays.iter().filter_map(|ray| cast(black_box(ray))).map(|hit| hit.time).sum::<f32>());
    });
    group.finish();
}

fn rays(criterion: &mut Criterion) {
    bench_rays::<1>(criterion, "sphere");
    bench_rays::<2>(criterion, "cone");
    bench_rays::<3>(criterion, "slab");
}

/// Hierarchies of two copies of each model. The second copy is rotated, and overlaps the first by a third of its size.
fn hierarchies(criterion: &mut Criterion) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/models");
    let models = match load_models(&folder) {
        Ok(models) => models,
        Err(error) => return println!("{error}"),
    };
    let mut group = criterion.benchmark_group("hierarchy");
    for model in &models {
        let spheres = model.axis.spheres();
        let of_primitive = |primitive: &bevy_medial::geometry::Primitive| {
            Aabb::from_spheres(primitive.indices().iter().map(|&i| spheres[i as usize]))
        };
        let boxes: Vec<Aabb> = model.axis.primitives().iter().map(of_primitive).collect();
        let bvh = Bvh::new(&boxes);
        let aside = Vec3::X * bvh.aabb().half_extents().x * 4.0 / 3.0;
        let pose = Pose3::from_parts(aside, glam::Quat::from_rotation_y(2.0));
        let merge = |a: &Aabb, b: &Aabb| a.merge(*b);
        let [mut here, mut there] = [Values::default(), Values::default()];
        let all = bvh.aabb();
        bvh.values(&all, Aabb::EMPTY, |i| boxes[i as usize], merge, &mut here);
        bvh.values(&all, Aabb::EMPTY, |i| boxes[i as usize].transformed(&pose, 1.0), merge, &mut there);
        let pairs = || {
            let mut pairs = 0u32;
            bvh.visit_pairs(&bvh, |i, j| here[i].overlaps(&there[j]), |_, _| pairs += 1);
            pairs
        };
        println!("{}: {} primitives, {} pairs of them found", model.name, boxes.len(), pairs());
        group.bench_function(BenchmarkId::new("build", &model.name), |bencher| {
            bencher.iter(|| Bvh::new(black_box(&boxes)));
        });
        group.bench_function(BenchmarkId::new("against itself", &model.name), |bencher| bencher.iter(pairs));
    }
    group.finish();
}

/// The max rate of a core with vectors of sixteen numbers. Products and sums are separate operations, because the bits of fused ones would depend on
/// the machine.
fn rate(criterion: &mut Criterion) {
    const ROUNDS: usize = 1000;
    /// Number of independent chains: enough to hide the latency of an operation, and few enough for the registers.
    const CHAINS: usize = 6;
    #[inline(always)]
    fn chains<S: Simd>(simd: S, start: f32) -> f32 {
        let (factor, summand) = (f32x16::splat(simd, 0.999), f32x16::splat(simd, 0.001));
        let mut chains = [summand; CHAINS];
        for (i, chain) in chains.iter_mut().enumerate() {
            *chain = f32x16::splat(simd, start + i as f32);
        }
        for _ in 0..ROUNDS {
            for chain in &mut chains {
                *chain = *chain * factor + summand;
            }
        }
        let mut sum = chains[0];
        for chain in &chains[1..] {
            sum += *chain;
        }
        <[f32; 16]>::from(sum).iter().sum()
    }
    let level = Level::new();
    let mut group = criterion.benchmark_group("rate");
    group.throughput(Throughput::Elements((2 * 16 * CHAINS * ROUNDS) as u64));
    group.bench_function(BenchmarkId::from_parameter("products and sums"), |bencher| {
        bencher.iter(|| dispatch!(level, simd => chains(simd, black_box(1.0))));
    });
    group.finish();
}

criterion_group!(benches, kernels, file, rays, hierarchies, rate);
criterion_main!(benches);
