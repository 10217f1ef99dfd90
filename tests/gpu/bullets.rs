//! Fast impacts and near misses where the GPU culls: none is lost, none leaves a trace.

use bevy::prelude::*;
use bevy_medial::{prelude::*, scenes::headless_app};

use crate::{device, flights, renderer::rendering_app};

fn waiting(dt: f32) -> App {
    with_settings(headless_app(dt), false)
}

fn ahead(dt: f32) -> App {
    with_settings(rendering_app(dt), true)
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
fn bullets_hit_where_the_gpu_is_waited_for() {
    if device().is_some() {
        check(waiting, (0..12).step_by(2));
    }
}

#[test]
fn bullets_hit_where_the_gpu_looks_ahead() {
    if device().is_some() {
        check(ahead, (1..12).step_by(2));
    }
}

/// `cargo test --release --test gpu -- --ignored all_bullets`.
#[test]
#[ignore = "minutes"]
fn all_bullets_hit_on_all_back_ends() {
    if device().is_some() {
        check(waiting, 0..12);
        check(ahead, 0..12);
    }
}
