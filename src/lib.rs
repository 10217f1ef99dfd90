//! Collision of concave dynamic bodies for Bevy.
#![forbid(unsafe_code)]
#![warn(missing_docs)]

pub mod constants;
pub mod geometry;
pub mod medial_axis;
pub mod pipeline;
pub mod plugin;
pub mod query;
#[cfg(feature = "rapier")]
pub mod rapier;
#[cfg(feature = "rapier")]
pub mod scenes;

/// What an app needs.
pub mod prelude {
    pub use crate::{
        medial_axis::MedialAxis,
        plugin::{
            MedialCcd, MedialContactEnded, MedialContactStarted, MedialMesh, MedialPhysicsPlugin, MedialSettings,
            MedialStep, MedialSystems, StaticObb, TouchPoint,
        },
    };
}
