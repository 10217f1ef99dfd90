//! What is uploaded and read back, as the shaders have it.

use bytemuck::{Pod, Zeroable};
use glam::{Quat, Vec3, Vec4};

/// No shape that the GPU knows.
pub(super) const OTHER_SHAPE: u32 = u32::MAX;
/// A plain box.
pub(super) const BOX_SHAPE: u32 = u32::MAX - 1;
/// Of bodies that are the only shape of theirs.
pub(super) const NO_OWNER: u64 = u64::MAX;
/// Marks statics among the sides of pairs.
pub(super) const STATIC: u32 = 1 << 31;
/// Marks the second side of pairs whose primitives the CPU finds.
pub(super) const UNKNOWN: u32 = 1 << 30;

/// `Params` in `motion.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct Params {
    pub bodies: u32,
    pub leaves: u32,
    pub static_nodes: u32,
    pub prediction: f32,
    pub low: Vec3,
    pub max_pairs: u32,
    pub cells: Vec3,
    pub max_chords: u32,
    pub max_candidates: u32,
    pub max_survivors: u32,
    pub unused: [u32; 2],
}

/// `Body` in `motion.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct Body {
    pub position: Vec3,
    pub shape: u32,
    pub rotation: Quat,
    pub translation: Vec3,
    pub scale: f32,
    pub turn: Vec3,
    pub arm: f32,
    pub local_center: Vec3,
    pub margin: f32,
    pub bound: Vec4,
    pub memberships: u32,
    pub collides_with: u32,
    pub owner: [u32; 2],
    pub world: u32,
    pub is_active: u32,
    pub slack: f32,
    pub unused: u32,
}

/// `Static` in `motion.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct Static {
    pub center: Vec3,
    pub shape: u32,
    pub rotation: Quat,
    pub half: Vec3,
    pub rounding: f32,
    pub position: Vec3,
    pub scale: f32,
    pub radius: f32,
    pub memberships: u32,
    pub collides_with: u32,
    pub world: u32,
    pub owner: [u32; 2],
    pub unused: [u32; 2],
}

/// `Shape` in `chord.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct Shape {
    pub spheres: u32,
    pub primitives: u32,
    pub primitive_count: u32,
    pub nodes: u32,
    pub node_count: u32,
}

/// `Counters` in `motion.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub(super) struct Counters {
    pub pairs: u32,
    pub chords: u32,
    pub candidates: u32,
    pub survivors: u32,
}

/// `Pair` in `motion.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct Pair {
    pub first: u32,
    pub second: u32,
}

/// `Survivor` in `narrow_phase.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct Survivor {
    pub pair: u32,
    pub first: u32,
    pub second: u32,
    pub fraction: f32,
}

/// `Exchange` in `sort.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct Exchange {
    pub size: u32,
    pub distance: u32,
}
