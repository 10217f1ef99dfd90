//! Collision of **concave dynamic bodies** for Bevy: accurate, tunnel-free, joined with rapier.
//!
//! A body's shape is a *medial mesh*: a few dozen to a few hundred spheres, joined into medial cones (the convex hull of two spheres) and medial
//! slabs (of three). They fill the body's volume and fit it closely. Hybrid culling and continuous collision detection between these primitives find
//! the collisions; rapier computes the response.
//!
//! ```no_run
//! use bevy::prelude::*;
//! use bevy_medial::prelude::*;
//! use bevy_rapier3d::prelude::RigidBody;
//!
//! fn main() {
//!     App::new().add_plugins((DefaultPlugins, MedialPhysicsPlugins::default())).add_systems(Startup, setup).run();
//! }
//!
//! fn setup(mut commands: Commands, assets: Res<AssetServer>) {
//!     commands.spawn((StaticObb::new(10.0, 0.5, 10.0), Transform::from_xyz(0.0, -0.5, 0.0)));
//!     commands.spawn((RigidBody::Dynamic, MedialMesh(assets.load("models/bear.medial")), Transform::from_xyz(0.0, 3.0, 0.0)));
//! }
//! ```
//!
//! Cameras, lights and rendering are Bevy's own. The *quick start* of the README has a whole program, beginning with `cargo add`. The folder `docs`
//! of the repository contains a guide.
//!
//! # Stages of a step
//!
//! | | stage | file | from | to |
//! |---|---|---|---|---|
//! | 1 | snapshot | `rapier/gather.rs`, `plugin/skeletons.rs` | rapier's poses before and after its step | [`StepInput`](pipeline::StepInput) |
//! | 2 | broad | `pipeline/broad/` | swept bounding spheres, BVH of static boxes | body pairs |
//! | 3 | mid | `pipeline/sweep/mid_phase.rs` | primitive BVH against primitive BVH or box | candidate primitive pairs |
//! | 4 | narrow | `pipeline/sweep/`, `respond/` | time of impact, distance | impacts, stops, raw contacts |
//! | 5 | reduce | `pipeline/contacts/` | raw contacts | a few manifolds per pair |
//! | 6 | write back | `rapier/table.rs`, `plugin/report.rs` | [`StepOutput`](pipeline::StepOutput) | contact table, messages and events, diagnostics |
//! | 7 | response | rapier | the table, by `rapier/dispatcher.rs` | new poses |
//!
//! Stages 2 to 5 are one function on plain data, [`pipeline::step`]. It runs once per step, right *after* rapier's solver. The motion of each body is
//! known then, so its impacts are those of the actual motion. The next solve starts from the contacts at the end of that motion. A body that would
//! pass through another one stops at the first touch of their cores and keeps its velocity. The next step solves a true contact there. For the body,
//! that step is longer by the time that it has not moved.
//!
//! # Modules
//!
//! A module uses only modules above it.
//!
//! | module | content |
//! |---|---|
//! | [`constants`] | tolerances and limits, with unit and reason |
//! | [`geometry`] | spheres, primitives, boxes, sweeps, the BVH |
//! | [`query`] | kernels on two primitives: separation, time of impact, ray |
//! | [`medial_axis`] | the asset: `.ma` files, clean-up, mass, packed form, surface |
//! | [`pipeline`] | one step on plain data |
//! | `gpu` | culling on the GPU, with the shaders in `shaders/` |
//! | [`builder`] | from triangle meshes to medial meshes: files, flaws, building, levels of detail, errors |
//! | [`plugin`] | components, messages, settings, diagnostics, debug view, picking |
//! | [`rapier`] | custom shape, dispatcher, contact table, scene queries |
//! | [`MedialPhysicsPlugins`] | the plugins of physics, as one group |
//! | [`scenes`] | the demo scenes, for examples, tests and benchmarks |
//!
//! # Plugins
//!
//! | plugin | feature | purpose | added |
//! |---|---|---|---|
//! | [`MedialPhysicsPlugins`] | | collision; response with `rapier` | after `DefaultPlugins` or `AssetPlugin`, and after the app's own rapier plugin |
//! | `MedialBuildPlugin` | `bevy_mesh` | builds the shapes of entities with a `BuildMedialMesh` | after `AssetPlugin` |
//! | `MedialProcessPlugin` | `asset_processor` | builds shapes from mesh files when Bevy processes the app's assets | after `AssetPlugin` |
//! | `MedialDebugPlugin` | `debug` | the debug view | at any time |
//! | `MedialPickingPlugin` | `picking` | pointers pick medial bodies | after `DefaultPlugins` |
//!
//! # Units and frames
//!
//! SI units: metres, seconds, radians, kilograms. A *fraction* is time within a step, from 0 to 1. `pose12` is the pose of body 2 in the frame of
//! body 1, as in parry. Names that end in 1 or 2 belong to that side of a pair, and normals point from side 1 to side 2. Kernels use coordinates
//! relative to the pair, so a scene may be kilometres from the origin if the resolution of its f32 poses is sufficient.
//!
//! # Features
//!
//! | feature | default | content |
//! |---|---|---|
//! | `rapier` | yes | response through `bevy_rapier3d`; without it transforms move the bodies, and messages report impacts and contacts |
//! | `debug` | no | `MedialGizmos` and `MedialGizmo`: shapes, boxes, swept cones, candidates, contacts and stops as lines |
//! | `picking` | no | `MedialPickingPlugin`: pointers pick medial bodies |
//! | `gpu` | yes | bounds of impacts by compute shaders, where a GPU is faster |
//! | `serialize` | no | serde for all components except `MedialMesh`, for settings, messages, layers of the debug view and geometry |
//! | `bevy_mesh` | no | conversion of Bevy's meshes to triangle meshes, and building of medial meshes while the app runs |
//! | `gltf_scenes` | no | shapes of the meshes in Bevy's glTF scenes: `MedialScene` |
//! | `mesh_files` | no | triangle meshes from OBJ, glTF, STL and PLY files |
//! | `asset_processor` | no | `MedialProcessPlugin`: medial meshes from mesh files, built by Bevy's asset processor |
//! | `cli` | no | the program `medial` |
//!
//! # Versions
//!
//! | bevy_medial | bevy | bevy_rapier3d | Rust |
//! |---|---|---|---|
//! | 0.1 | 0.19.1 | 0.36 | 1.95 |
//!
//! Built and tested on Linux. `wasm32` is neither built nor tested. Waiting for the GPU cannot work there.
#![forbid(unsafe_code)]
#![warn(missing_docs)]

#[cfg(feature = "rapier")]
pub use bevy_rapier3d;
pub use plugin_group::MedialPhysicsPlugins;

pub mod builder;
pub mod constants;
mod disjoint_sets;
pub mod geometry;
#[cfg(feature = "gpu")]
pub mod gpu;
pub mod medial_axis;
pub mod pipeline;
pub mod plugin;
mod plugin_group;
pub mod query;
#[doc(hidden)]
pub mod random;
#[cfg(feature = "rapier")]
pub mod rapier;
#[cfg(feature = "rapier")]
pub mod scenes;
#[doc(hidden)]
pub mod whole_file;

/// Common imports for apps.
pub mod prelude {
    #[cfg(feature = "asset_processor")]
    pub use crate::plugin::MedialProcessPlugin;
    #[cfg(feature = "debug")]
    pub use crate::plugin::{MedialDebugPlugin, MedialGizmo, MedialGizmoLayer, MedialGizmos};
    #[cfg(feature = "picking")]
    pub use crate::plugin::{MedialPickingCamera, MedialPickingPlugin, MedialPickingSettings};
    #[cfg(feature = "rapier")]
    pub use crate::rapier::MedialQueries;
    pub use crate::{
        MedialPhysicsPlugins,
        medial_axis::MedialAxis,
        plugin::{
            MedialBackend, MedialBudget, MedialCcd, MedialContactEnded, MedialContactStarted, MedialContacts,
            MedialFocus, MedialImportance, MedialLevel, MedialMesh, MedialSettings, MedialStep, MedialSystems,
            SkinPose, SkinnedMedialMesh, StaticObb, TouchPoint,
        },
    };
    #[cfg(feature = "bevy_mesh")]
    pub use crate::{
        builder::FitOptions,
        plugin::{BuildMedialMesh, MedialBuildPlugin, MedialBuildStatus},
    };
    #[cfg(feature = "gltf_scenes")]
    pub use crate::{builder::NodeBody, plugin::MedialScene};
}

/// Compiles the programs of the README and of the guide.
#[cfg(doctest)]
mod pages {
    macro_rules! compile {
        ($($page:ident: $file:literal,)*) => { $(#[doc = include_str!($file)] struct $page;)* };
    }
    compile! {
        Readme: "../README.md",
        Shape: "../docs/choosing-a-shape.md",
        Budget: "../docs/choosing-a-budget.md",
        Step: "../docs/step.md",
        Gpu: "../docs/gpu.md",
        Rapier: "../docs/rapier.md",
        Determinism: "../docs/determinism.md",
        Troubleshooting: "../docs/troubleshooting.md",
        Animated: "../docs/animated.md",
    }
}
