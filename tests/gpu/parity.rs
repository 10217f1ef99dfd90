//! Every scene goes the same way on all back ends, to the bit.

use bevy::prelude::*;
use bevy_medial::{
    prelude::*,
    scenes::{SCENES, Scene, headless_app},
};

use crate::{
    common::{DT, models},
    device,
    renderer::rendering_app,
};

/// An app with a scene, without a renderer: the GPU is waited for.
pub fn app(scene: &str, backend: MedialBackend) -> App {
    with_scene(headless_app(DT), scene, backend)
}

/// An app with a scene in which the GPU looks ahead, if it is the back end.
pub fn app_ahead(scene: &str, backend: MedialBackend) -> App {
    let mut app = with_scene(rendering_app(DT), scene, backend);
    app.world_mut().resource_mut::<MedialSettings>().pipelined = true;
    app
}

fn with_scene(mut app: App, scene: &str, backend: MedialBackend) -> App {
    app.world_mut().resource_mut::<MedialSettings>().backend = backend;
    Scene::by_name(scene).unwrap().spawn(app.world_mut(), models(), 1);
    app
}

/// Asserts that two apps have had the same step, to the bit: pairs with their impacts and fractions, contacts, stops.
pub fn assert_same(cpu: &App, gpu: &App, what: &str) {
    let [cpu, gpu] = [cpu, gpu].map(|app| app.world().resource::<MedialStep>());
    assert_eq!(cpu.output.pairs, gpu.output.pairs, "{what}");
    assert_eq!(cpu.output.manifolds, gpu.output.manifolds, "{what}");
    assert_eq!(cpu.output.stops, gpu.output.stops, "{what}");
}

/// True if the GPU has culled, and has been waited for.
pub fn culled_on_gpu(app: &App) -> bool {
    app.world().resource::<MedialStep>().gpu_culling().is_some()
}

/// Steps culled on the CPU, and by answers that were one to four steps late.
#[derive(Debug, Default)]
pub struct Latencies([usize; 5]);

impl Latencies {
    /// Takes note of the last step of an app.
    pub fn note(&mut self, app: &App) {
        self.0[app.world().resource::<MedialStep>().gpu_latency.unwrap_or(0) as usize] += 1;
    }

    /// Steps that went by an answer.
    pub fn answered(&self) -> usize {
        self.0[1..].iter().sum()
    }
}

/// Runs every scene for so many steps on the CPU, with the GPU waited for, and with the GPU looking ahead.
fn compare(steps: usize) {
    if device().is_none() {
        return;
    }
    for scene in SCENES {
        let [mut cpu, mut gpu] = [MedialBackend::Cpu, MedialBackend::Gpu].map(|backend| app(scene.name, backend));
        // Set up alike, but for the back end.
        let [mut cpu_beside, mut ahead] = [MedialBackend::Cpu, MedialBackend::Gpu].map(|b| app_ahead(scene.name, b));
        let mut latencies = Latencies::default();
        let (mut contacts, mut impacts, mut departed, mut bodies) = (0, 0, 0, 0);
        for step in 0..steps {
            cpu.update();
            gpu.update();
            cpu_beside.update();
            ahead.update();
            assert_same(&cpu, &gpu, &format!("{}, step {step}, waited for", scene.name));
            assert_same(&cpu_beside, &ahead, &format!("{}, step {step}, ahead", scene.name));
            latencies.note(&ahead);
            let step = ahead.world().resource::<MedialStep>();
            contacts += step.output.counts.contacts;
            impacts += step.output.pairs.iter().filter(|pair| pair.impact.is_some()).count();
            if step.gpu_latency.is_some() {
                departed += step.gpu_departed;
                bodies += step.infos.len();
            }
        }
        println!(
            "{}: {steps} steps, {contacts} contacts, {impacts} impacts; ahead: steps on the CPU and by answers 1 to 4 steps late {latencies:?}, \
             {departed} of {bodies} bodies off their way",
            scene.name
        );
        assert!(culled_on_gpu(&gpu) && !culled_on_gpu(&cpu) && !culled_on_gpu(&ahead));
        assert!(latencies.answered() > steps / 2 && departed < bodies);
        assert!(contacts > steps, "{}: {contacts} contacts", scene.name);
    }
}

#[test]
fn scenes_go_the_same_way() {
    compare(80);
}

/// `cargo test --release --test gpu -- --ignored --nocapture scenes_go_the_same_way_for_long`.
#[test]
#[ignore = "minutes"]
fn scenes_go_the_same_way_for_long() {
    compare(300);
}
