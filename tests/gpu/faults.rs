//! What may go wrong on a GPU loses nothing.

use std::process::Command;

use bevy::prelude::*;
use bevy_medial::{
    gpu::{GpuCapacity, GpuCulling, GpuError},
    pipeline::{Statics, StepInput, step},
    prelude::*,
    scenes::{SCENES, Scene, headless_app},
};

use crate::{
    common::{Random, models},
    culling::{compare, pool, run_on_gpu},
    device,
    random_steps::random_step,
};

/// An app with a scene.
fn app(scene: &str, backend: MedialBackend) -> App {
    let mut app = headless_app(1.0 / 60.0);
    app.world_mut().resource_mut::<MedialSettings>().backend = backend;
    Scene::by_name(scene).unwrap().spawn(app.world_mut(), models(), 1);
    app
}

/// Asserts that two apps have had the same step, to the bit.
pub fn assert_same(cpu: &App, gpu: &App, what: &str) {
    let [cpu, gpu] = [cpu, gpu].map(|app| app.world().resource::<MedialStep>());
    assert_eq!(cpu.output.pairs, gpu.output.pairs, "{what}");
    assert_eq!(cpu.output.manifolds, gpu.output.manifolds, "{what}");
    assert_eq!(cpu.output.stops, gpu.output.stops, "{what}");
}

/// Steps in which the GPU has culled, so far.
fn culled_on_gpu(app: &App) -> bool {
    app.world().resource::<MedialStep>().gpu_culling().is_some()
}

#[test]
fn scenes_go_the_same_way() {
    if device().is_none() {
        return;
    }
    for scene in SCENES {
        let [mut cpu, mut gpu] = [MedialBackend::Cpu, MedialBackend::Gpu].map(|backend| app(scene.name, backend));
        let mut contacts = 0;
        for step in 0..scene.steps.min(300) {
            cpu.update();
            gpu.update();
            assert_same(&cpu, &gpu, &format!("{}, step {step}", scene.name));
            contacts += cpu.world().resource::<MedialStep>().output.counts.contacts;
        }
        assert!(culled_on_gpu(&gpu) && !culled_on_gpu(&cpu));
        assert!(contacts > 100, "{}: {contacts} contacts", scene.name);
    }
}

#[test]
fn buffers_that_are_too_small_grow() {
    let Some(gpu) = device() else { return };
    let tiny = GpuCapacity { pairs: 1, chords: 1, candidates: 1, survivors: 1 };
    let mut culling = GpuCulling::new(gpu, tiny).unwrap();
    let mut random = Random(5);
    compare(&mut culling, 10, || random_step(&mut random, 12, 5, 2.0, Vec3::ZERO));
    let grown = culling.capacity();
    println!("{grown:?}");
    assert!(grown.pairs > 1 && grown.chords > 1 && grown.candidates > 1 && grown.survivors > 1);
}

#[test]
fn few_bodies_are_no_special_case() {
    let Some(gpu) = device() else { return };
    let mut culling = GpuCulling::new(gpu, GpuCapacity::default()).unwrap();
    let nothing = run_on_gpu(&mut culling, &StepInput::default(), &Statics::default());
    assert!(nothing.pairs.is_empty());
    let mut random = Random(6);
    let mut pairs = 0;
    for bodies in [1, 2, 3] {
        for statics in [0, 1] {
            let found = compare(&mut culling, 20, || random_step(&mut random, bodies, statics, 1.0, Vec3::ZERO));
            pairs += found[3];
        }
    }
    assert!(pairs > 20);
}

#[test]
fn bodies_in_one_place_meet_each_other() {
    let Some(gpu) = device() else { return };
    let mut culling = GpuCulling::new(gpu, GpuCapacity::default()).unwrap();
    let mut random = Random(7);
    let (mut input, statics) = random_step(&mut random, 40, 0, 1.0, Vec3::ZERO);
    let sweep = input.bodies[0].sweep;
    input.bodies.iter_mut().for_each(|body| body.sweep = bevy_medial::geometry::Sweep::at_rest(sweep.start));
    let cpu = step(&input, &statics, pool());
    let found = run_on_gpu(&mut culling, &input, &statics);
    assert_eq!(cpu.pairs, found.pairs);
    assert!(cpu.pairs.len() > 100, "{}", cpu.pairs.len());
}

#[test]
fn a_lost_device_loses_no_contact() {
    if device().is_none() {
        return;
    }
    let [mut cpu, mut gpu] = [MedialBackend::Cpu, MedialBackend::Gpu].map(|backend| app("rods", backend));
    for number in 0..120 {
        if number == 60 {
            let step = gpu.world().resource::<MedialStep>();
            step.gpu_culling().expect("it has run by now").device().wgpu_device().destroy();
        }
        cpu.update();
        gpu.update();
        assert_same(&cpu, &gpu, &format!("step {number}"));
    }
    assert!(!culled_on_gpu(&gpu), "it goes on on a device that is lost");
}

#[test]
fn shapes_may_go_while_they_are_in_use() {
    if device().is_none() {
        return;
    }
    let [mut cpu, mut gpu] = [MedialBackend::Cpu, MedialBackend::Gpu].map(|backend| app("tori", backend));
    for number in 0..60 {
        for app in [&mut cpu, &mut gpu] {
            if number == 20 {
                let mut axes = app.world_mut().resource_mut::<Assets<MedialAxis>>();
                let ids: Vec<_> = axes.ids().collect();
                ids.into_iter().for_each(|id| {
                    axes.remove(id);
                });
            }
            if number == 40 {
                // Others, which the GPU does not know yet.
                Scene::by_name("rods").unwrap().spawn(app.world_mut(), models(), 1);
            }
            app.update();
        }
        assert_same(&cpu, &gpu, &format!("step {number}"));
    }
    assert!(culled_on_gpu(&gpu));
}

#[test]
fn without_an_adapter_the_cpu_does_it() {
    let child = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "faults::runs_where_there_is_no_adapter", "--ignored", "--nocapture"])
        .envs([("VK_DRIVER_FILES", "/nonexistent"), ("VK_ICD_FILENAMES", "/nonexistent"), ("WGPU_BACKEND", "vulkan")])
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&child.stdout);
    assert!(child.status.success() && text.contains("1 passed"), "{text}");
}

/// Run by [`without_an_adapter_the_cpu_does_it`].
#[test]
#[ignore = "wants a machine without an adapter"]
fn runs_where_there_is_no_adapter() {
    assert!(matches!(bevy_medial::gpu::GpuDevice::request(), Err(GpuError::NoAdapter(_))));
    let [mut cpu, mut gpu] = [MedialBackend::Cpu, MedialBackend::Gpu].map(|backend| app("rods", backend));
    for step in 0..30 {
        cpu.update();
        gpu.update();
        assert_same(&cpu, &gpu, &format!("step {step}"));
    }
    assert!(!culled_on_gpu(&gpu));
}
