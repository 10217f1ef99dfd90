//! Skinned shapes are culled on the CPU, beside bodies on the GPU.

use bevy_medial::prelude::*;

use super::device;
use crate::{common::app, physics::skeletons::fight};

#[test]
fn a_fight_with_a_skinned_shape_has_the_same_bits_as_on_the_cpu() {
    if device().is_none() {
        return;
    }
    let [cpu, gpu] = [MedialBackend::Cpu, MedialBackend::Gpu].map(|backend| {
        let mut app = app();
        app.world_mut().resource_mut::<MedialSettings>().backend = backend;
        let end = fight(&mut app);
        assert_eq!(app.world().resource::<MedialStep>().gpu_latency.is_some(), backend == MedialBackend::Gpu);
        end
    });
    assert!(cpu == gpu);
}
