//! Skinned shapes on the GPU: their moved spheres are uploaded in each step.

use std::sync::Arc;

use bevy::prelude::App;
use bevy_medial::{
    geometry::Sweep,
    gpu::{GpuCapacity, GpuCulling},
    medial_axis::MedialAxis,
    pipeline::{Body, Deforming, Primitives, Side, Solid, StepInput},
    prelude::*,
};
use bevy_medial_compare::renderer::rendering_app;
use glam::Vec3;

use super::{
    culling::{compare, run_on_gpu, uploaded},
    device,
};
use crate::{
    common::{DT, Random, app},
    physics::skeletons::fight,
    random_steps::random_step,
};

const SPHERES: u32 = 8;

/// Returns a kinematic body at rest in place of another one. It is a ring whose spheres move on random polylines with up to five knots.
fn ring(random: &mut Random, body: &Body) -> Body {
    let axis = MedialAxis::torus(0.4, 0.1, SPHERES).unwrap();
    let mut spheres = axis.spheres().to_vec();
    let mut knots = vec![spheres.clone()];
    for _ in 0..random.below(5) {
        for sphere in &mut spheres {
            sphere.center += random.in_cube() * 0.05;
            sphere.radius *= 1.0 + 0.1 * random.signed();
        }
        knots.push(spheres.clone());
    }
    Body {
        solid: Solid::Deforming(Arc::new(Deforming::new(&axis, knots))),
        sweep: Sweep::at_rest(body.sweep.start),
        stops: false,
        ..body.clone()
    }
}

fn is_ring(input: &StepInput, side: Side) -> bool {
    side.body().is_some_and(|body| input.bodies[body as usize].solid.deforming().is_some())
}

#[test]
fn skinned_shapes_are_second_sides() {
    let Some(gpu) = device() else { return };
    let [mut culling, mut own] = [(); 2].map(|()| GpuCulling::new(gpu, GpuCapacity::default()).unwrap());
    let mut random = Random(14);
    let (mut bounded, mut impacts, mut moving) = (0, 0, 0);
    let total = compare(&mut culling, 60, || {
        let (mut input, statics) = random_step(&mut random, 12, 2, 1.5, Vec3::ZERO);
        for index in (0..input.bodies.len()).step_by(2) {
            input.bodies[index] = ring(&mut random, &input.bodies[index]);
        }
        for pair in own.cull(&input, &statics).unwrap().iter() {
            if is_ring(&input, pair.sides[1]) {
                assert!(matches!(pair.primitives, Primitives::Bounded(_)), "{pair:?}");
                bounded += pair.primitives.indices().count();
                let body = pair.sides[1].body().unwrap() as usize;
                moving += usize::from(input.bodies[body].solid.deforming().unwrap().path() > 0.03);
            }
        }
        let found = run_on_gpu(&mut own, &input, &statics);
        let hits = found.pairs.iter().filter(|pair| is_ring(&input, pair.second) && pair.impact.is_some());
        impacts += hits.count();
        (input, statics)
    });
    assert!(bounded > 300 && impacts > 50 && moving > 100, "{bounded} {impacts} {moving}; in total {total:?}");
}

#[test]
fn a_step_uploads_only_the_skinned_shapes_again() {
    let Some(gpu) = device() else { return };
    let mut culling = GpuCulling::new(gpu, GpuCapacity::default()).unwrap();
    let mut random = Random(15);
    let (mut input, statics) = random_step(&mut random, 40, 10, 2.0, Vec3::ZERO);
    // Otherwise bodies push each other along, and a step is culled more than once.
    input.bodies.iter_mut().for_each(|body| body.stops = body.active);
    let mut uploaded = |input: &StepInput| uploaded(&mut culling, input, &statics);
    uploaded(&input);
    let poses = uploaded(&input);
    // Spheres, primitives and nodes of the hierarchy, and their positions in the table.
    let size = u64::from(SPHERES * (16 + 12) + (2 * SPHERES - 1) * 32 + 20);
    for count in [1, 2, 1, 0] {
        let mut input = input.clone();
        for index in 0..count {
            input.bodies[index] = ring(&mut random, &input.bodies[index]);
        }
        // Larger buffers are written as a whole.
        uploaded(&input);
        assert_eq!(uploaded(&input), poses + count as u64 * size, "{count} skinned shapes");
    }
}

#[test]
fn a_fight_with_a_skinned_shape_has_the_same_bits_as_on_the_cpu() {
    if device().is_none() {
        return;
    }
    let run = |mut app: App, backend: MedialBackend, pipelined: bool| {
        let mut settings = app.world_mut().resource_mut::<MedialSettings>();
        (settings.backend, settings.pipelined) = (backend, pipelined);
        let end = fight(&mut app);
        let step = app.world().resource::<MedialStep>();
        (end, step.gpu_latency, step.gpu_departed)
    };
    let (cpu, ..) = run(app(), MedialBackend::Cpu, false);
    let (waiting, latency, _) = run(app(), MedialBackend::Gpu, false);
    assert!(cpu == waiting && latency == Some(0), "{latency:?}");
    // The CPU finds the pairs of a character that moves.
    let (ahead, latency, departed) = run(rendering_app(DT), MedialBackend::Gpu, true);
    assert!(cpu == ahead && latency.is_some_and(|steps| steps > 0) && departed > 0, "{latency:?}, {departed}");
}
