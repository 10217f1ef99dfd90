//! The methods that are compared.

use crate::{
    body::Setup,
    engines::{Ccd, Engine, Medial, Rapier, Variant},
};

/// A collision method of an engine.
#[derive(Clone, Copy)]
pub struct Method {
    pub name: &'static str,
    /// A description in one sentence.
    pub about: &'static str,
    /// Makes an empty world.
    pub make: fn(Setup) -> Result<Box<dyn Engine>, String>,
    /// True if the method needs a graphics adapter.
    pub needs_adapter: bool,
    /// True for this crate without changes.
    pub is_ours: bool,
}

/// All methods.
pub const METHODS: &[Method] = &[
    Method {
        name: "medial, CPU",
        about: "this crate, culling on the CPU",
        make: |setup| Ok(Box::new(Medial::new(setup, Variant::Cpu))),
        needs_adapter: false,
        is_ours: true,
    },
    Method {
        name: "medial, GPU",
        about: "this crate, the GPU culls for later steps and no step waits for it (`MedialSettings::pipelined`)",
        make: |setup| Ok(Box::new(Medial::new(setup, Variant::Gpu))),
        needs_adapter: true,
        is_ours: true,
    },
    Method {
        name: "alternating",
        about: "this crate, except that bodies stop at the times of the published alternating time of impact",
        make: |setup| Ok(Box::new(Medial::new(setup, Variant::Alternating))),
        needs_adapter: false,
        is_ours: false,
    },
    Method {
        name: "rapier",
        about: "rapier 0.35 with its default settings: fast bodies are swept against fixed ones",
        make: |setup| Ok(Box::new(Rapier::new(setup, Ccd::Default))),
        needs_adapter: false,
        is_ours: false,
    },
    Method {
        name: "rapier, Ccd",
        about: "rapier with `ccd_enabled` for bullets",
        make: |setup| Ok(Box::new(Rapier::new(setup, Ccd::Bullets))),
        needs_adapter: false,
        is_ours: false,
    },
    Method {
        name: "rapier, soft CCD",
        about: "rapier with a `soft_ccd_prediction` for bullets: their displacement in a step and their size",
        make: |setup| Ok(Box::new(Rapier::new(setup, Ccd::Soft))),
        needs_adapter: false,
        is_ours: false,
    },
    Method {
        name: "rapier, triangles",
        about: "rapier, moving bodies as triangle meshes, with `ccd_enabled` for bullets",
        make: |setup| Ok(Box::new(Rapier::new(setup, Ccd::Bullets).hollow())),
        needs_adapter: false,
        is_ours: false,
    },
    #[cfg(feature = "peers")]
    Method {
        name: "avian",
        about: "avian 0.7 with speculative contacts, and with `SweptCcd` for bullets",
        make: |setup| Ok(Box::new(crate::engines::Avian::new(setup))),
        needs_adapter: false,
        is_ours: false,
    },
];
