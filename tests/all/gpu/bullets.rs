//! Fast impacts and near misses with culling on the GPU: no impact is lost, and near misses change no motion.

use std::sync::Mutex;

use bevy::prelude::*;
use bevy_medial::{prelude::*, scenes::headless_app};
use bevy_medial_compare::renderer::rendering_app;

use super::device;
use crate::flights;

/// Counts over all apps in which the GPU looks ahead.
static AHEAD: Mutex<Seen> = Mutex::new(Seen { steps: 0, answered: 0, impacts: 0 });

#[derive(Clone, Copy, Debug)]
struct Seen {
    /// Steps with impacts.
    steps: usize,
    /// Steps with impacts that used an answer of the GPU.
    answered: usize,
    /// Impacts in the answered steps in which no body had left its predicted path, so the CPU culled nothing.
    impacts: usize,
}

fn waiting(dt: f32) -> App {
    let mut app = with_settings(headless_app(dt), false);
    app.add_systems(Last, |step: Res<MedialStep>| assert!(step.infos.is_empty() || step.gpu_latency == Some(0)));
    app
}

fn ahead(dt: f32) -> App {
    let mut app = with_settings(rendering_app(dt), true);
    app.add_systems(Last, |step: Res<MedialStep>| {
        let impacts = step.output.pairs.iter().filter(|pair| pair.impact.is_some()).count();
        if impacts > 0 {
            let mut seen = AHEAD.lock().unwrap();
            seen.steps += 1;
            seen.answered += usize::from(step.gpu_latency.is_some());
            seen.impacts += if step.gpu_latency.is_some() && step.gpu_departed == 0 { impacts } else { 0 };
        }
    });
    app
}

fn with_settings(mut app: App, pipelined: bool) -> App {
    app.insert_resource(MedialSettings { backend: MedialBackend::Gpu, pipelined, ..default() });
    app
}

fn check(app: fn(f32) -> App, cells: impl Iterator<Item = usize>) {
    let [close, compared] = flights::check(app, cells);
    assert!(close * 10 >= compared * 9, "{close} of {compared}");
}

#[test]
fn bullets_hit_when_steps_wait_for_the_gpu() {
    if device().is_some() {
        check(waiting, 0..4);
    }
}

#[test]
#[ignore = "exhaustive"]
fn exhaustive_bullets_hit_when_steps_wait_for_the_gpu() {
    if device().is_some() {
        check(waiting, 0..12);
    }
}

#[test]
fn bullets_hit_when_the_gpu_looks_ahead() {
    if device().is_some() {
        // References of hits on walls (0 and 3) are never chaotic.
        check_ahead([0, 3].into_iter().chain(8..12), 10);
    }
}

#[test]
#[ignore = "exhaustive"]
fn exhaustive_bullets_hit_when_the_gpu_looks_ahead() {
    if device().is_some() {
        check_ahead(0..12, 30);
    }
}

/// The GPU must have answered for more than half of the steps with impacts, and for more than `impacts` impacts in total.
fn check_ahead(cells: impl Iterator<Item = usize>, impacts: usize) {
    check(ahead, cells);
    let seen = *AHEAD.lock().unwrap();
    println!("{seen:?}");
    assert!(seen.answered * 2 > seen.steps && seen.impacts > impacts, "{seen:?}");
}
