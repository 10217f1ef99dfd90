//! Faults of the GPU lose no contacts.

use std::{
    process::Command,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
};

use bevy::{
    prelude::*,
    render::{renderer::RenderDevice, settings::WgpuSettings},
    tasks::block_on,
};
use bevy_medial::{
    geometry::{Pose3, Sweep},
    gpu::{GpuCapacity, GpuCulling, GpuDevice, GpuError},
    pipeline::{Body, Shape, Side, StaticBody, Statics, StepInput, step},
    prelude::*,
    scenes::Scene,
};
use bevy_medial_compare::renderer::rendering_app_with;
use bevy_rapier3d::prelude::RigidBody;

use super::{
    culling::{compare, pool, run_on_gpu},
    device,
    parity::{Latencies, app, app_ahead, assert_same, culled_on_gpu, with_scene},
};
use crate::{
    common::{DT, Random, mesh, models},
    log,
    random_steps::random_step,
};

const TINY: GpuCapacity = GpuCapacity { pairs: 1, chords: 1, candidates: [1; 5], survivors: 1 };

#[test]
fn too_small_buffers_grow() {
    let Some(gpu) = device() else { return };
    let mut culling = GpuCulling::new(gpu, TINY).unwrap();
    let mut random = Random(5);
    compare(&mut culling, 10, || random_step(&mut random, 12, 5, 2.0, Vec3::ZERO));
    let grown = culling.capacity();
    println!("{grown:?}");
    assert!(
        grown.pairs > 1 && grown.chords > 1 && grown.candidates.iter().all(|count| *count > 1) && grown.survivors > 1
    );
}

#[test]
fn apps_set_the_initial_size_of_buffers() {
    if device().is_none() {
        return;
    }
    let [mut cpu, mut gpu] = [MedialBackend::Cpu, MedialBackend::Gpu].map(|backend| app("rods", backend));
    gpu.insert_resource(TINY);
    for step in 0..80 {
        cpu.update();
        gpu.update();
        assert_same(&cpu, &gpu, &format!("step {step}"));
    }
    let grown = gpu.world().resource::<MedialStep>().gpu_culling().unwrap().capacity();
    assert!(grown.pairs > 1 && grown.pairs < GpuCapacity::default().pairs, "{grown:?}");
    let lines = log::lines("`GpuCapacity` sets their initial size");
    assert_eq!(lines.len(), 1, "{lines:?}");
}

/// A device that allows `bytes` bytes in a buffer.
fn small_device(bytes: u64) -> GpuDevice {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let adapter = block_on(instance.request_adapter(&Default::default())).unwrap();
    let required_limits = wgpu::Limits { max_storage_buffer_binding_size: bytes, ..adapter.limits() };
    let descriptor = wgpu::DeviceDescriptor { required_limits, ..Default::default() };
    let (device, queue) = block_on(adapter.request_device(&descriptor)).unwrap();
    GpuDevice::new(device, queue, adapter.get_info()).unwrap()
}

#[test]
fn an_oversized_step_does_not_affect_other_steps() {
    if device().is_none() {
        return;
    }
    // This limit is not a multiple of the granularity of buffer sizes.
    let mut culling = GpuCulling::new(&small_device(2_000_004), TINY).unwrap();
    let mut random = Random(8);
    let mut small = |culling: &mut GpuCulling| compare(culling, 5, || random_step(&mut random, 12, 5, 2.0, Vec3::ZERO));
    small(&mut culling);

    // The bodies need more than half of the limit, and the chords more than the whole limit.
    let (input, statics) = random_step(&mut Random(9), 10_000, 20, 20.0, Vec3::ZERO);
    for _ in 0..2 {
        let error = culling.cull(&input, &statics).unwrap_err();
        assert!(matches!(error, GpuError::Limit { limit: "bytes in a buffer", .. }), "{error}");
    }
    small(&mut culling);

    // A single shape needs more than the limit.
    let shape = Shape::new(MedialAxis::torus(0.5, 0.1, 200_000).unwrap());
    let bodies = [0.0, 0.7].map(|x| Body::new(shape.clone(), Sweep::at_rest(Pose3::from_translation(Vec3::X * x))));
    let input = StepInput { bodies: bodies.into(), prediction: 0.01, ..default() };
    for _ in 0..2 {
        let error = culling.cull(&input, &Statics::default()).unwrap_err();
        assert!(matches!(error, GpuError::Limit { .. }), "{error}");
    }
    small(&mut culling);
}

#[test]
fn unsuitable_devices_are_errors() {
    let Some(gpu) = device() else { return };
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let adapter = block_on(instance.request_adapter(&Default::default())).unwrap();
    let required_limits = wgpu::Limits { max_storage_buffers_per_shader_stage: 4, ..adapter.limits() };
    let descriptor = wgpu::DeviceDescriptor { required_limits, ..Default::default() };
    let (device, queue) = block_on(adapter.request_device(&descriptor)).unwrap();
    let error = GpuDevice::new(device, queue, adapter.get_info()).unwrap_err().to_string();
    assert_eq!(error, format!("the GPU `{}` allows 4 storage buffers in a pass, 8 are needed", gpu.name()));
}

#[test]
fn non_finite_numbers_are_errors_that_name_the_body() {
    let Some(gpu) = device() else { return };
    let mut culling = GpuCulling::new(gpu, GpuCapacity::default()).unwrap();
    let mut random = Random(10);
    let mut sound = || random_step(&mut random, 12, 5, 2.0, Vec3::ZERO);
    let spoils: [fn(&mut Sweep); 4] = [
        |sweep| sweep.start.translation.x = f32::NAN,
        |sweep| sweep.start.rotation.w = f32::NAN,
        |sweep| sweep.translation.y = f32::INFINITY,
        |sweep| sweep.rotation.z = f32::NAN,
    ];
    for (body, spoil) in (3..).zip(spoils) {
        let (mut input, statics) = sound();
        spoil(&mut input.bodies[body].sweep);
        let error = culling.cull(&input, &statics).unwrap_err();
        assert!(matches!(error, GpuError::NotFinite(Side::Body(found)) if found as usize == body), "{error}");
        assert_eq!(error.to_string(), format!("Body({body}): its place, motion or size is not finite"));
    }
    let (input, statics) = sound();
    let mut bodies = statics.bodies().to_vec();
    bodies[1] = StaticBody { pose: Pose3::from_translation(Vec3::splat(f32::NAN)), ..bodies[1].clone() };
    let error = culling.cull(&input, &Statics::new(bodies)).unwrap_err();
    assert!(matches!(error, GpuError::NotFinite(Side::Static(1))), "{error}");
    compare(&mut culling, 5, sound);
}

#[test]
fn bodies_without_finite_position_are_logged_and_skipped() {
    if device().is_none() {
        return;
    }
    let [mut cpu, mut gpu] = [MedialBackend::Cpu, MedialBackend::Gpu].map(|backend| app("rods", backend));
    for number in 0..60 {
        for app in [&mut cpu, &mut gpu] {
            if number == 20 {
                let mesh = mesh(app, MedialAxis::sphere(0.2).unwrap());
                let nowhere = Transform::from_xyz(0.0, f32::NAN, 0.0);
                app.world_mut().spawn((Name::new("a body that is nowhere"), RigidBody::Dynamic, mesh, nowhere));
            }
            if number == 40 {
                // A body that had a finite position.
                let mut bodies = app.world_mut().query_filtered::<(&RigidBody, &mut Transform), With<MedialMesh>>();
                let mut bodies = bodies.iter_mut(app.world_mut());
                let is_somewhere = |(body, transform): &(&RigidBody, Mut<Transform>)| {
                    **body == RigidBody::Dynamic && transform.translation.is_finite()
                };
                bodies.find(is_somewhere).unwrap().1.translation.z = f32::NAN;
            }
            app.update();
        }
        assert_same(&cpu, &gpu, &format!("step {number}"));
    }
    assert!(culled_on_gpu(&gpu));
    assert_eq!(log::lines("a body that is nowhere").len(), 2);
    assert_eq!(gpu.world().resource::<MedialStep>().infos.len(), 8);
}

#[test]
fn few_bodies_are_culled_correctly() {
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
fn bodies_at_one_position_all_meet() {
    let Some(gpu) = device() else { return };
    let mut culling = GpuCulling::new(gpu, GpuCapacity::default()).unwrap();
    let mut random = Random(7);
    let (mut input, statics) = random_step(&mut random, 40, 0, 1.0, Vec3::ZERO);
    let sweep = input.bodies[0].sweep;
    input.bodies.iter_mut().for_each(|body| body.sweep = Sweep::at_rest(sweep.start));
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
    let reported = || log::lines("medial meshes are culled on the CPU from now on").len();
    let of_own = |app: &App| app.world().resource::<MedialStep>().gpu_culling().unwrap().device().wgpu_device().clone();
    let of_renderer = |app: &App| app.world().resource::<RenderDevice>().wgpu_device().clone();
    let setups: [(fn(&str, MedialBackend) -> App, &dyn Fn(&App) -> wgpu::Device); 2] =
        [(app, &of_own), (app_ahead, &of_renderer)];
    for (index, (app, device_of)) in setups.into_iter().enumerate() {
        let [mut cpu, mut gpu] = [MedialBackend::Cpu, MedialBackend::Gpu].map(|backend| app("rods", backend));
        let mut after = Latencies::default();
        for number in 0..120 {
            if number == 60 {
                assert!(culled_on_gpu(&gpu) && reported() == index);
                device_of(&gpu).destroy();
            }
            cpu.update();
            gpu.update();
            assert_same(&cpu, &gpu, &format!("step {number}"));
            // Some earlier answers may still arrive.
            if number > 65 {
                after.note(&gpu);
            }
        }
        assert_eq!(after.waited() + after.answered(), 0, "the lost device is still used");
        assert_eq!(reported(), index + 1);
    }
}

#[test]
fn shapes_may_change_or_disappear_while_in_use() {
    if device().is_none() {
        return;
    }
    for app in [app, app_ahead] {
        let [mut cpu, mut gpu] = [MedialBackend::Cpu, MedialBackend::Gpu].map(|backend| app("tori", backend));
        let mut latencies = Latencies::default();
        for number in 0..60 {
            for app in [&mut cpu, &mut gpu] {
                match number {
                    10 => load_smaller_tori(app),
                    20 => remove_shapes(app),
                    // New shapes that are not on the GPU yet.
                    40 => Scene::by_name("rods").unwrap().spawn(app.world_mut(), models(), 1),
                    _ => {}
                }
                app.update();
            }
            assert_same(&cpu, &gpu, &format!("step {number}"));
            latencies.note(&gpu);
        }
        println!("{latencies:?}");
        assert!(latencies.waited() + latencies.answered() > 50, "{latencies:?}");
        assert!(culled_on_gpu(&gpu));
    }
}

fn load_smaller_tori(app: &mut App) {
    let mut axes = app.world_mut().resource_mut::<Assets<MedialAxis>>();
    let ids: Vec<_> = axes.ids().collect();
    for id in ids {
        axes.insert(id, MedialAxis::torus(0.3, 0.1, 12).unwrap()).unwrap();
    }
}

fn remove_shapes(app: &mut App) {
    let mut axes = app.world_mut().resource_mut::<Assets<MedialAxis>>();
    let ids: Vec<_> = axes.ids().collect();
    for id in ids {
        axes.remove(id);
    }
}

#[test]
fn out_of_memory_does_not_reach_the_error_handler() {
    if device().is_none() {
        return;
    }
    let child = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "gpu::faults::child_process_with_full_memory", "--ignored", "--nocapture"])
        .output()
        .unwrap();
    let [out, err] = [child.stdout, child.stderr].map(|bytes| String::from_utf8_lossy(&bytes).into_owned());
    assert!(child.status.success() && out.contains("1 passed"), "{out}{err}");
}

/// Run by [`out_of_memory_does_not_reach_the_error_handler`] because the limit applies to the whole process.
#[test]
#[ignore = "limits the memory of the process"]
fn child_process_with_full_memory() {
    let gpu = small_device(1 << 27);
    let reported = Arc::new(AtomicBool::new(false));
    let handler = reported.clone();
    gpu.wgpu_device().on_uncaptured_error(Arc::new(move |_| handler.store(true, Ordering::Relaxed)));
    let mut random = Random(8);
    let mut small = |culling: &mut GpuCulling| compare(culling, 5, || random_step(&mut random, 12, 5, 2.0, Vec3::ZERO));
    let mut culling = GpuCulling::new(&gpu, TINY).unwrap();
    small(&mut culling);

    let many = GpuCapacity { candidates: [7_000_000, 1, 1, 1, 1], ..TINY };
    let mut large = GpuCulling::new(&gpu, many).unwrap();
    let (input, statics) = random_step(&mut Random(9), 12, 5, 2.0, Vec3::ZERO);
    // The first number is the size in pages of 4 KiB.
    let used: u64 = std::fs::read_to_string("/proc/self/statm").unwrap().split(' ').next().unwrap().parse().unwrap();
    let limit = |bytes: &str| {
        let args = ["--pid", &std::process::id().to_string(), &format!("--as={bytes}")];
        assert!(Command::new("prlimit").args(args).status().unwrap().success());
    };
    // Only the soft limit changes, so that it can be raised again: without memory a test cannot report its failure.
    limit(&format!("{}:unlimited", used * 4096 + (48 << 20)));
    let errors: Vec<GpuError> = (0..2).map(|_| large.cull(&input, &statics).unwrap_err()).collect();
    limit("unlimited:unlimited");
    for error in errors {
        assert!(error.is_of_one_step() && error.to_string().contains("has no memory left for"), "{error}");
    }
    small(&mut culling);
    assert!(!reported.load(Ordering::Relaxed), "the error handler of the device was called");
}

/// If the renderer's device lacks storage buffers, no other device replaces it.
#[test]
fn the_cpu_culls_if_the_renderer_is_unsuitable() {
    let Some(gpu) = device() else { return };
    let reported = || log::lines("allows 4 storage buffers in a pass, 8 are needed");
    for (index, pipelined) in [false, true].into_iter().enumerate() {
        let [mut cpu, mut refused] = [MedialBackend::Cpu, MedialBackend::Gpu].map(|backend| {
            let limits = wgpu::Limits { max_storage_buffers_per_shader_stage: 4, ..default() };
            let device = WgpuSettings { constrained_limits: Some(limits), ..default() };
            let mut app = with_scene(rendering_app_with(DT, device), "rods", backend);
            app.world_mut().resource_mut::<MedialSettings>().pipelined = pipelined;
            app
        });
        for number in 0..60 {
            cpu.update();
            refused.update();
            assert_same(&cpu, &refused, &format!("step {number}"));
            assert!(!culled_on_gpu(&refused));
        }
        assert!(refused.world().resource::<MedialStep>().gpu_culling().is_none());
        let lines = reported();
        assert_eq!(lines.len(), index + 1, "{lines:?}");
        assert!(lines[index].contains("culled on the CPU") && lines[index].contains(gpu.name()), "{lines:?}");
    }
}

#[test]
fn the_cpu_culls_without_an_adapter() {
    let child = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "gpu::faults::child_process_without_an_adapter", "--ignored", "--nocapture"])
        .envs([("VK_DRIVER_FILES", "/nonexistent"), ("VK_ICD_FILENAMES", "/nonexistent"), ("WGPU_BACKEND", "vulkan")])
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&child.stdout);
    assert!(child.status.success() && text.contains("1 passed"), "{text}");
}

/// Run by [`the_cpu_culls_without_an_adapter`].
#[test]
#[ignore = "needs a process without an adapter"]
fn child_process_without_an_adapter() {
    assert!(matches!(bevy_medial::gpu::GpuDevice::request(), Err(GpuError::NoAdapter(_))));
    let [mut cpu, mut gpu] = [MedialBackend::Cpu, MedialBackend::Gpu].map(|backend| app("rods", backend));
    for step in 0..30 {
        cpu.update();
        gpu.update();
        assert_same(&cpu, &gpu, &format!("step {step}"));
    }
    assert!(!culled_on_gpu(&gpu));
}
