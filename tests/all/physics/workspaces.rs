//! Steps that reuse a workspace have the same results and allocate no memory.

use allocation_counter::measure;
use bevy::tasks::TaskPoolBuilder;
use bevy_medial::{
    geometry::{Pose3, Sweep},
    medial_axis::MedialAxis,
    pipeline::{Body, PairFilter, Shape, Statics, StepInput, StepOutput, Workspace, step},
    plugin::MedialStep,
    scenes::Scene,
};
use glam::Vec3;

use crate::{
    common::*,
    random_steps::{random_step, tally},
};

/// Steps of scenes with few and with many bodies, and random steps.
fn steps() -> Vec<(StepInput, Statics)> {
    let mut steps = Vec::new();
    for name in ["dinosaur", "tori", "bullets"] {
        let mut app = app();
        Scene::by_name(name).unwrap().spawn(app.world_mut(), models(), 1);
        for number in 0..120 {
            app.update();
            if number % 3 == 0 {
                let step = app.world().resource::<MedialStep>();
                steps.push((step.input.clone(), step.statics.clone()));
            }
        }
    }
    let mut random = Random(8);
    steps.extend((0..100).map(|_| random_step(&mut random, 80, 20, 5.0, Vec3::ZERO)));
    // Contacts from other steps would change the result.
    steps.iter_mut().for_each(|(input, _)| input.recycle_contacts = false);
    steps
}

#[test]
fn a_reused_workspace_changes_no_result_and_allocates_nothing() {
    let pool = TaskPoolBuilder::new().num_threads(0).build();
    let (mut workspace, mut output) = (Workspace::default(), StepOutput::default());
    let mut total = [0; 4];
    let rounds = [0, 1].map(|_| {
        let allocations = |(input, statics): &(StepInput, Statics)| {
            let filter = |_, _| PairFilter::Stopping;
            let counted = measure(|| workspace.step(input, statics, filter, &pool, &mut output));
            let alone = step(input, statics, &pool);
            assert_eq!(output.pairs, alone.pairs);
            assert_eq!(output.manifolds, alone.manifolds);
            assert_eq!(output.stops, alone.stops);
            assert_eq!(output.counts, alone.counts);
            total.iter_mut().zip(tally(&output)).for_each(|(sum, count)| *sum += count);
            counted.count_total
        };
        steps().iter().map(allocations).sum::<u64>()
    });
    let [impacts, contacts, stops, _] = total;
    assert!(impacts > 5000 && contacts > 10_000 && stops > 3000, "{total:?}");
    assert!(rounds[0] > 100, "{rounds:?}: no allocations are counted");
    assert_eq!(rounds[1], 0);
}

/// Rings that move side by side, `apart` metres from each other. Returns the bytes that remain allocated after two steps, and the number of pairs
/// of rings that are near each other.
fn bytes_of(rings: usize, apart: f32) -> (f64, usize) {
    let ring = Shape::new(MedialAxis::torus(0.2, 0.05, 12).unwrap());
    let body = |index: usize| {
        let [start, end] = [0.0, 0.1].map(|z| Pose3::from_translation(Vec3::new(0.0, index as f32 * apart, z)));
        let sweep = Sweep::between(start, end, Vec3::ZERO, Vec3::ZERO);
        Body { id: Some(index as u64), ..Body::new(ring.clone(), sweep) }
    };
    let input = StepInput { bodies: (0..rings).map(body).collect(), stop_at_impact: true, ..Default::default() };
    let (mut workspace, mut output) = (Workspace::default(), StepOutput::default());
    let pool = TaskPoolBuilder::new().num_threads(0).build();
    let statics = Statics::default();
    let mut step = || workspace.step(&input, &statics, |_, _| PairFilter::Stopping, &pool, &mut output);
    let counted = measure(|| {
        step();
        step();
    });
    assert!(output.pairs.is_empty(), "some rings touch");
    (counted.bytes_current as f64, output.counts.body_pairs)
}

#[test]
fn a_body_takes_512_bytes_and_a_near_pair_700_at_most() {
    let more = |apart: f32| {
        let [(less, _), (more, pairs)] = [1024, 4096].map(|rings| bytes_of(rings, apart));
        ((more - less) / 3072.0, pairs)
    };
    let ((alone, none), (near, some)) = (more(1.0), more(0.4));
    assert_eq!((none, some), (0, 4095));
    let body = size_of::<Body>() as f64 + alone;
    assert!(body > 300.0 && body <= 512.0, "{body} bytes per body");
    let pair = near - alone;
    assert!(pair > 50.0 && pair <= 700.0, "{pair} bytes per pair");
}
