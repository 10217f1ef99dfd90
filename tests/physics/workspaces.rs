//! Steps that go on in the same memory: they find the same, and allocate nothing.

use allocation_counter::measure;
use bevy::tasks::TaskPoolBuilder;
use bevy_medial::{
    pipeline::{Meeting, Statics, StepInput, StepOutput, Workspace, step},
    plugin::MedialStep,
    scenes::Scene,
};
use glam::Vec3;

use crate::{
    common::*,
    random_steps::{random_step, tally},
};

/// Steps of scenes, of few bodies and of many, one after the other, and random ones.
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
    steps
}

#[test]
fn a_step_finds_the_same_wherever_others_have_been_and_allocates_nothing() {
    let pool = TaskPoolBuilder::new().num_threads(0).build();
    let (mut workspace, mut output) = (Workspace::default(), StepOutput::default());
    let mut total = [0; 4];
    let rounds = [0, 1].map(|_| {
        let allocations = |(input, statics): &(StepInput, Statics)| {
            let filter = |_, _| Meeting::Stopping;
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
    assert!(rounds[0] > 100, "{rounds:?}: nothing is counted");
    assert_eq!(rounds[1], 0);
}
