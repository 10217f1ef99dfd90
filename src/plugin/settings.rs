//! Settings for all medial bodies.

use bevy::prelude::*;

use crate::constants::CORE_DEPTH;

/// Back end that finds the pairs that may meet. Impacts and contacts are always computed on the CPU, so results are the same.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Reflect)]
#[cfg_attr(feature = "serialize", derive(serde::Serialize, serde::Deserialize), reflect(Serialize, Deserialize))]
#[reflect(Default, Clone, PartialEq)]
pub enum MedialBackend {
    /// The faster back end, by trial. It is the CPU in small scenes, without the feature `gpu`, and without a hardware GPU. With a renderer no step waits
    /// for the GPU, as with `pipelined`.
    #[default]
    Auto,
    /// The CPU.
    Cpu,
    /// The GPU, even if it is a software implementation: that of the renderer, or else the fastest. Without one the CPU is used, after a warning.
    Gpu,
}

/// Settings for all medial bodies.
#[derive(Resource, Clone, Copy, Debug, PartialEq, Reflect)]
#[cfg_attr(feature = "serialize", derive(serde::Serialize, serde::Deserialize), reflect(Serialize, Deserialize))]
#[reflect(Resource, Default, Clone, PartialEq)]
pub struct MedialSettings {
    /// Bodies stop at their first impact within a step. Without the feature `rapier` no body stops. Default: true.
    pub stop_at_impact: bool,
    /// Skips all culling and tests every primitive pair on the CPU, to measure the benefit of culling. Default: false.
    pub brute_force: bool,
    /// Pairs that hardly move keep their contacts from step to step, and slow pairs keep lists of near primitives. Turn it off to compare. Default: true.
    pub recycle_contacts: bool,
    /// Depth of a body's core below its surface, in bounding radii of the smaller body of a pair. A body stops within a step only where its core
    /// touches another one. The depth is the largest overlap that one step can add, per body. Smaller values are more accurate; with larger ones
    /// fewer bodies stop. Thin primitives have cores at a smaller depth: at most 30 % of their radius. Default: 0.0075.
    pub core_depth: f32,
    /// Back end that finds the pairs that may meet. Default: [`MedialBackend::Auto`].
    pub backend: MedialBackend,
    /// The renderer's GPU looks some steps ahead, so that no step waits for it. Bodies that have left their predicted path are culled on the CPU.
    /// Default: false.
    pub pipelined: bool,
}

impl Default for MedialSettings {
    fn default() -> Self {
        Self {
            stop_at_impact: true,
            core_depth: CORE_DEPTH,
            recycle_contacts: true,
            brute_force: false,
            backend: MedialBackend::Auto,
            pipelined: false,
        }
    }
}
