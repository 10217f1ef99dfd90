//! The methods, all driven the same way.

mod alternating;
mod avian;
mod medial;
mod rapier;
#[path = "../../common/renderer.rs"]
mod renderer;

use bevy_medial::geometry::Pose3;

use crate::world::{Body, Setup, State};

/// A world of some engine.
pub trait Engine {
    /// Puts a body into it, and gives its number: as many as were put in before.
    ///
    /// # Errors
    /// If the engine has no such shape.
    fn spawn(&mut self, body: &Body) -> Result<(), String>;

    /// Runs a step of `dt` seconds.
    fn step(&mut self, dt: f32);

    /// Where a body is. Nobody asks about one that has been taken away.
    fn state(&self, body: usize) -> State;

    /// Puts a body to another place, at rest.
    fn teleport(&mut self, body: usize, pose: Pose3);

    /// Gives a body a velocity.
    fn push(&mut self, body: usize, linear: glam::Vec3);

    /// Takes a body away.
    fn despawn(&mut self, body: usize);

    /// Makes a body as large as `description` says, where it is.
    ///
    /// # Errors
    /// If the engine has no such shape.
    fn resize(&mut self, body: usize, description: &Body) -> Result<(), String>;
}

/// A way to find collisions, in an engine.
#[derive(Clone, Copy)]
pub struct Method {
    pub name: &'static str,
    /// What it is, in a sentence.
    pub about: &'static str,
    /// Makes an empty world.
    pub make: fn(Setup) -> Result<Box<dyn Engine>, String>,
    /// True if it asks for a graphics adapter.
    pub needs_adapter: bool,
    /// True for this crate as it is.
    pub is_ours: bool,
}

/// All of them.
pub const METHODS: &[Method] = &[
    Method {
        name: "medial, CPU",
        about: "this crate, culling on the CPU",
        make: |setup| Ok(Box::new(medial::Medial::new(setup, medial::Variant::Cpu))),
        needs_adapter: false,
        is_ours: true,
    },
    Method {
        name: "medial, GPU",
        about: "this crate, culling on the GPU in the same step",
        make: |setup| Ok(Box::new(medial::Medial::new(setup, medial::Variant::Gpu))),
        needs_adapter: true,
        is_ours: true,
    },
    Method {
        name: "medial, GPU ahead",
        about: "this crate, the GPU looks ahead and nobody waits for it (`MedialSettings::pipelined`)",
        make: |setup| Ok(Box::new(medial::Medial::new(setup, medial::Variant::GpuAhead))),
        needs_adapter: true,
        is_ours: true,
    },
    Method {
        name: "alternating",
        about: "this crate, but bodies stop where the published alternating time of impact says",
        make: |setup| Ok(Box::new(medial::Medial::new(setup, medial::Variant::Alternating))),
        needs_adapter: false,
        is_ours: false,
    },
    Method {
        name: "rapier",
        about: "rapier 0.35 as it is: sweeps fast bodies against fixed ones",
        make: |setup| Ok(Box::new(rapier::Rapier::new(setup, rapier::Care::None))),
        needs_adapter: false,
        is_ours: false,
    },
    Method {
        name: "rapier, Ccd",
        about: "rapier with `ccd_enabled` for bullets",
        make: |setup| Ok(Box::new(rapier::Rapier::new(setup, rapier::Care::Ccd))),
        needs_adapter: false,
        is_ours: false,
    },
    Method {
        name: "rapier, soft CCD",
        about: "rapier with a `soft_ccd_prediction` for bullets of their way in a step",
        make: |setup| Ok(Box::new(rapier::Rapier::new(setup, rapier::Care::SoftCcd))),
        needs_adapter: false,
        is_ours: false,
    },
    Method {
        name: "rapier, triangles",
        about: "rapier, moving bodies as triangle meshes, with `ccd_enabled` for bullets",
        make: |setup| Ok(Box::new(rapier::Rapier::new(setup, rapier::Care::Triangles))),
        needs_adapter: false,
        is_ours: false,
    },
    Method {
        name: "avian",
        about: "avian 0.7 with speculative contacts, and with `SweptCcd` for bullets",
        make: |setup| Ok(Box::new(avian::Avian::new(setup))),
        needs_adapter: false,
        is_ours: false,
    },
];
