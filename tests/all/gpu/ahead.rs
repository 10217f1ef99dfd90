//! The GPU looks ahead: it culls future steps, and no step waits for it.

use bevy::{
    diagnostic::{DiagnosticPath, DiagnosticsStore},
    prelude::*,
    reflect::serde::{TypedReflectDeserializer, TypedReflectSerializer},
    render::renderer::RenderDevice,
};
use bevy_medial::{gpu::GpuCapacity, plugin::diagnostic_paths, prelude::*};
use bevy_medial_compare::renderer::rendering_app;
use bevy_rapier3d::prelude::{Collider, GravityScale, RigidBody, Sleeping, Velocity};
use serde::de::DeserializeSeed;

use super::{
    device,
    parity::{Latencies, app, app_ahead, assert_same, culled_on_gpu},
};
use crate::{
    common::{DT, mesh, spawn_ground},
    log,
};

/// Spinning bodies in free flight that never touch each other. They alternate between medial cones, whose centre of mass is off their origin, and
/// balls of rapier.
fn spawn_flight(app: &mut App) -> Vec<Entity> {
    let head = |x: f32, radius: f32| bevy_medial::geometry::Sphere::new(Vec3::X * x, radius);
    let mesh = mesh(app, MedialAxis::cone(head(0.1, 0.2), head(0.7, 0.1)).unwrap());
    let spawn = |i: usize| {
        let angular = Vec3::new(0.3, 1.0, -0.4) * i as f32;
        let velocity = Velocity { linear: Vec3::new(3.0, 0.5, -1.0), angular };
        let flyer = (RigidBody::Dynamic, velocity, GravityScale(0.0), Transform::from_xyz(0.0, 3.0 * i as f32, 0.0));
        let mut entity = app.world_mut().spawn(flyer);
        if i.is_multiple_of(2) {
            entity.insert(mesh.clone())
        } else {
            entity.insert(Collider::ball(0.3))
        };
        entity.id()
    };
    (0..8).map(spawn).collect()
}

#[test]
fn bodies_on_their_predicted_path_are_not_culled_again() {
    if device().is_none() {
        return;
    }
    let mut app = rendering_app(DT);
    app.insert_resource(MedialSettings { backend: MedialBackend::Gpu, pipelined: true, ..default() });
    let bodies = spawn_flight(&mut app);
    let mut answered = 0;
    for _ in 0..40 {
        app.update();
        let step = app.world().resource::<MedialStep>();
        if step.gpu_latency.is_some() {
            assert_eq!((step.infos.len(), step.gpu_departed), (bodies.len(), 0));
            answered += 1;
        }
    }
    assert!(answered > 30, "{answered}");

    // Two bodies get another velocity and leave their predicted path.
    for &body in &bodies[2..4] {
        app.world_mut().get_mut::<Velocity>(body).unwrap().linear = Vec3::Y * -30.0;
    }
    app.update();
    let step = app.world().resource::<MedialStep>();
    assert!(step.gpu_latency.is_some());
    assert_eq!(step.gpu_departed, 2);
}

#[test]
fn a_stack_is_identical_on_cpu_and_gpu() {
    check_stack(200);
}

#[test]
#[ignore = "exhaustive"]
fn exhaustive_a_stack_is_identical_on_cpu_and_gpu() {
    check_stack(400);
}

fn check_stack(steps: usize) {
    if device().is_none() {
        return;
    }
    let mut apps = [MedialBackend::Cpu, MedialBackend::Gpu].map(|backend| {
        let mut app = rendering_app(DT);
        app.insert_resource(MedialSettings { backend, pipelined: true, ..default() });
        spawn_ground(&mut app);
        let mesh = mesh(&mut app, MedialAxis::rounded_box(Vec3::new(0.3, 0.15, 0.3), 0.02).unwrap());
        for layer in 0..10 {
            let aside = 0.005 * Vec3::new((3.0 * layer as f32).sin(), 0.0, (5.0 * layer as f32).cos());
            let place = Transform::from_translation(Vec3::Y * (0.15 + 0.301 * layer as f32) + aside);
            let turned = place.with_rotation(Quat::from_rotation_y(0.2 * (7.0 * layer as f32).sin()));
            app.world_mut().spawn((RigidBody::Dynamic, Sleeping::disabled(), mesh.clone(), turned));
        }
        app
    });
    let mut latencies = Latencies::default();
    let (mut touching, mut departed) = (0, 0);
    for step in 0..steps {
        apps.iter_mut().for_each(App::update);
        let [cpu, ahead] = &apps;
        assert_same(cpu, ahead, &format!("step {step}"));
        latencies.note(ahead);
        let step = ahead.world().resource::<MedialStep>();
        touching += usize::from(step.output.pairs.iter().filter(|pair| !pair.manifolds.is_empty()).count() >= 10);
        departed += step.gpu_departed;
    }
    println!("{latencies:?}, {touching} steps with all bodies in contact, {departed} bodies off their predicted path");
    assert!(latencies.answered() * 8 > steps * 7 && touching * 4 > steps * 3 && departed < steps);
}

/// Asserts that the serialised text of a value can be deserialised, because worlds are saved as text.
fn assert_comes_back_from_text(value: &impl Reflect, world: &World) {
    let registry = world.resource::<AppTypeRegistry>().read();
    let registration = registry.get(value.type_id()).unwrap();
    let text = serde_json::to_string(&TypedReflectSerializer::new(value.as_partial_reflect(), &registry)).unwrap();
    let seed = TypedReflectDeserializer::new(registration, &registry);
    seed.deserialize(&mut serde_json::Deserializer::from_str(&text)).unwrap();
}

#[test]
fn diagnostics_report_gpu_times_and_latency() {
    if device().is_none() {
        return;
    }
    let (mut waiting, mut ahead) = (app("rods", MedialBackend::Gpu), app_ahead("rods", MedialBackend::Gpu));
    for app in [&mut waiting, &mut ahead] {
        (0..20).for_each(|_| app.update());
    }
    let diagnostic = |app: &App, path: &DiagnosticPath| {
        let store = app.world().resource::<DiagnosticsStore>();
        store.get(path).map(|diagnostic| (diagnostic.history_len(), diagnostic.value())).unwrap()
    };
    let value = |app: &App, path: DiagnosticPath| diagnostic(app, &path).1;
    assert_eq!(value(&waiting, diagnostic_paths::GPU_LATENCY), Some(0.0));
    assert!((1.0..=4.0).contains(&value(&ahead, diagnostic_paths::GPU_LATENCY).unwrap()));
    assert!(value(&ahead, diagnostic_paths::GPU_DEPARTED).is_some());
    let times = wgpu::Features::TIMESTAMP_QUERY;
    let of_own = waiting.world().resource::<MedialStep>().gpu_culling().unwrap().device().wgpu_device().features();
    let of_renderer = ahead.world().resource::<RenderDevice>().features();
    for (app, features) in [(&mut waiting, of_own), (&mut ahead, of_renderer)] {
        let can_tell = features.contains(times);
        assert_eq!(!app.world().resource::<MedialStep>().gpu_times().is_empty(), can_tell);
        for path in diagnostic_paths::GPU {
            assert_eq!(value(app, path.clone()).is_some_and(|time| time > 0.0), can_tell, "{path}");
        }
        assert_comes_back_from_text(app.world().resource::<MedialStep>(), app.world());

        // Steps culled on the CPU add no values to the diagnostics of the GPU.
        let reported = |app: &App| {
            let of_steps = [diagnostic_paths::GPU_LATENCY, diagnostic_paths::GPU_DEPARTED];
            diagnostic_paths::GPU.into_iter().chain(of_steps).map(|path| diagnostic(app, &path)).collect::<Vec<_>>()
        };
        let before = reported(app);
        app.world_mut().resource_mut::<MedialSettings>().backend = MedialBackend::Cpu;
        (0..5).for_each(|_| app.update());
        assert_eq!(reported(app), before);
        assert!(app.world().resource::<MedialStep>().gpu_times().is_empty() && !culled_on_gpu(app));
    }
}

#[test]
fn buffers_grow_while_the_gpu_looks_ahead() {
    if device().is_none() {
        return;
    }
    let [mut cpu, mut ahead] = [MedialBackend::Cpu, MedialBackend::Gpu].map(|backend| app_ahead("tori", backend));
    ahead.insert_resource(GpuCapacity { pairs: 1, chords: 1, candidates: [1; 5], survivors: 1 });
    let mut latencies = Latencies::default();
    let mut steps = 0;
    // The number of steps until the answers arrive depends on the machine.
    while latencies.answered() < 20 {
        assert!(steps < 600, "{latencies:?}");
        cpu.update();
        ahead.update();
        assert_same(&cpu, &ahead, &format!("step {steps}"));
        latencies.note(&ahead);
        steps += 1;
    }
    // Answers are lost until the buffers are large enough. The CPU culls these steps.
    assert!(steps > 20 + 2, "{latencies:?}");
}

/// `MedialBackend::Auto` chooses a back end, and the log contains the reason.
#[test]
fn the_automatic_choice_is_logged() {
    let Some(gpu) = device() else { return };
    let mut app = app_ahead("dinosaur", MedialBackend::Auto);
    // A step of less than a millisecond is not tried.
    (0..120).for_each(|_| app.update());
    let lines = log::lines("medial meshes are culled on the ");
    println!("{lines:?}");
    if gpu.is_software() {
        let why = format!("culled on the CPU: `{}` is a software renderer", gpu.name());
        assert!(lines.iter().any(|line| line.contains(&why)), "{lines:?}");
        assert!(!culled_on_gpu(&app));
    } else {
        assert!(lines.iter().any(|line| line.contains("a step of")), "{lines:?}");
    }
}
