//! Every scene has the same bits on all back ends.

use bevy::prelude::*;
use bevy_medial::{
    medial_axis::MedialAxis,
    prelude::*,
    scenes::{SCENES, Scene, headless_app},
};
use bevy_medial_compare::renderer::rendering_app;
use bevy_rapier3d::prelude::{Collider, RigidBody, Velocity};

use super::device;
use crate::common::{DT, models, position, spawn_flying};

const STEPS: usize = 300;

/// An app with a scene and without a renderer: each step waits for the GPU.
pub fn app(scene: &str, backend: MedialBackend) -> App {
    with_scene(headless_app(DT), scene, backend)
}

/// An app with a scene and a renderer. The GPU looks ahead if it is the back end.
pub fn app_ahead(scene: &str, backend: MedialBackend) -> App {
    let mut app = with_scene(rendering_app(DT), scene, backend);
    app.world_mut().resource_mut::<MedialSettings>().pipelined = true;
    app
}

/// Spawns a scene and selects the back end that culls it.
pub fn with_scene(mut app: App, scene: &str, backend: MedialBackend) -> App {
    app.world_mut().resource_mut::<MedialSettings>().backend = backend;
    Scene::by_name(scene).unwrap().spawn(app.world_mut(), models(), 1);
    app
}

/// Asserts that the last steps of two apps have the same bits: pairs with their impacts and fractions, contacts, stops.
pub fn assert_same(cpu: &App, gpu: &App, what: &str) {
    let [cpu, gpu] = [cpu, gpu].map(|app| app.world().resource::<MedialStep>());
    assert_same_items(&cpu.output.pairs, &gpu.output.pairs, &format!("{what}: pair"));
    assert_same_items(&cpu.output.manifolds, &gpu.output.manifolds, &format!("{what}: manifold"));
    assert_same_items(&cpu.output.stops, &gpu.output.stops, &format!("{what}: stop"));
}

/// Asserts that two lists are equal, and names the first item that differs.
pub fn assert_same_items<T: PartialEq + std::fmt::Debug>(cpu: &[T], gpu: &[T], what: &str) {
    for (index, (cpu, gpu)) in cpu.iter().zip(gpu).enumerate() {
        assert_eq!(cpu, gpu, "{what} {index}");
    }
    assert_eq!(cpu.len(), gpu.len(), "{what}s");
}

/// True if the GPU has culled the last step.
pub fn culled_on_gpu(app: &App) -> bool {
    app.world().resource::<MedialStep>().gpu_latency.is_some()
}

/// Number of steps culled on the CPU, and of steps culled by GPU answers that were 0 to 4 steps late.
#[derive(Debug, Default)]
pub struct Latencies {
    cpu: usize,
    gpu: [usize; 5],
}

impl Latencies {
    /// Counts the last step of an app.
    pub fn note(&mut self, app: &App) {
        match app.world().resource::<MedialStep>().gpu_latency {
            Some(steps) => self.gpu[steps as usize] += 1,
            None => self.cpu += 1,
        }
    }

    /// Number of steps that waited for the GPU.
    pub fn waited(&self) -> usize {
        self.gpu[0]
    }

    /// Number of steps that used the answer of an earlier step.
    pub fn answered(&self) -> usize {
        self.gpu[1..].iter().sum()
    }
}

/// A plate in a compound with a very small tilt. Over the length of the plate the tilt is still many times its thickness.
#[test]
fn a_nearly_level_plate_is_culled_with_its_tilt() {
    if device().is_none() {
        return;
    }
    let [cpu, gpu] = [MedialBackend::Cpu, MedialBackend::Gpu].map(|backend| {
        let mut app = headless_app(DT);
        app.world_mut().resource_mut::<MedialSettings>().backend = backend;
        let plate = vec![(Vec3::ZERO, Quat::from_rotation_z(0.0025), Collider::cuboid(50.0, 0.01, 50.0))];
        app.world_mut().spawn((RigidBody::Fixed, Collider::compound(plate)));
        let ball = MedialAxis::sphere(0.05).unwrap();
        let at = Transform::from_xyz(45.0, 0.26, 0.0);
        let ball = spawn_flying(&mut app, ball, at, Velocity::linear(Vec3::Y * -10.0));
        let mut stops = 0;
        for _ in 0..4 {
            app.update();
            stops += app.world().resource::<MedialStep>().output.stops.len();
        }
        assert_eq!(culled_on_gpu(&app), backend == MedialBackend::Gpu);
        (position(&mut app, ball), stops)
    });
    assert!(cpu.1 > 0, "the ball hits nothing");
    assert_eq!(cpu, gpu);
}

/// Every scene except the largest: on the CPU, on the GPU with each step waiting, and on the GPU looking ahead.
#[test]
fn scenes_are_identical_on_all_back_ends() {
    check_scenes(SCENES.iter().filter(|scene| scene.name != "pile"), 80);
}

#[test]
#[ignore = "exhaustive"]
fn exhaustive_scenes_are_identical_on_all_back_ends() {
    check_scenes(SCENES.iter(), STEPS);
}

fn check_scenes(scenes: impl Iterator<Item = &'static Scene>, steps: usize) {
    if device().is_none() {
        return;
    }
    for scene in scenes {
        let [mut cpu, mut gpu] = [MedialBackend::Cpu, MedialBackend::Gpu].map(|backend| app(scene.name, backend));
        // These two apps differ only in their back end.
        let [mut cpu_beside, mut ahead] = [MedialBackend::Cpu, MedialBackend::Gpu].map(|b| app_ahead(scene.name, b));
        let [mut on_cpu, mut waited, mut looked_ahead] = [const { Latencies { cpu: 0, gpu: [0; 5] } }; 3];
        let (mut contacts, mut impacts, mut departed, mut bodies) = (0, 0, 0, 0);
        for step in 0..steps {
            cpu.update();
            gpu.update();
            cpu_beside.update();
            ahead.update();
            assert_same(&cpu, &gpu, &format!("{}, step {step}, waited for", scene.name));
            assert_same(&cpu_beside, &ahead, &format!("{}, step {step}, ahead", scene.name));
            on_cpu.note(&cpu);
            waited.note(&gpu);
            looked_ahead.note(&ahead);
            let step = ahead.world().resource::<MedialStep>();
            contacts += step.output.counts.contacts;
            impacts += step.output.pairs.iter().filter(|pair| pair.impact.is_some()).count();
            if step.gpu_latency.is_some() {
                departed += step.gpu_departed;
                bodies += step.infos.len();
            }
        }
        println!(
            "{}: {steps} steps, {contacts} contacts, {impacts} impacts; waited for {waited:?}, ahead {looked_ahead:?}, {departed} of {bodies} \
             bodies off their predicted path",
            scene.name
        );
        assert_eq!((on_cpu.cpu, waited.waited()), (steps, steps), "{}", scene.name);
        assert!(looked_ahead.answered() > steps * 9 / 10 && departed < bodies, "{}: {looked_ahead:?}", scene.name);
        assert!(contacts > steps, "{}: {contacts} contacts", scene.name);
    }
}
