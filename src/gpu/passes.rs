//! The compute passes of a step, and their bindings.

use std::collections::HashMap;

use super::{
    GpuDevice, GpuError,
    buffers::{Buffers, Slot},
    kinds::{KINDS, Kind},
    layout::Exchange,
    pass::{BOUNDS, NEARER, NEAREST, Pass, shader, shader_of_kind},
};

/// Invocations in a workgroup, except in the passes that sort, build the tree or dispatch.
pub(super) const WORKGROUP: u32 = 64;
/// Size of a key, in bytes.
pub(super) const KEY: u64 = 8;
/// Number of keys that a workgroup sorts, and number of leaves whose tree it builds.
pub(super) const SORT_BLOCK: u32 = 512;
pub(super) const TREE_BLOCK: u32 = 256;
/// Distance of two uniforms in one buffer, in bytes.
pub(super) const UNIFORM: u64 = 256;

/// Source that the passes share.
const STEP: &[&str] = &[include_str!("../../shaders/motion.wgsl"), include_str!("../../shaders/step.wgsl")];
const SORT: &[&str] = &[include_str!("../../shaders/sort.wgsl")];
const TREE: &[&str] = &[include_str!("../../shaders/tree.wgsl")];
const KINDS_FILE: &[&str] = &[include_str!("../../shaders/kinds.wgsl")];
const CHORD: &[&str] = &[include_str!("../../shaders/chord.wgsl")];

/// The labels of the passes, and the source of their shaders. Labels of the narrow phase are listed in [`NARROW`].
const ENTRIES: [(&str, &[&[&str]]); 10] = [
    ("place", &[STEP, &[include_str!("../../shaders/swept_sphere.wgsl")]]),
    ("sort_blocks", &[SORT]),
    ("sort_far", &[SORT]),
    ("sort_near", &[SORT]),
    ("tree_bottom", &[STEP, TREE]),
    ("tree_top", &[STEP, TREE]),
    ("broad_phase", &[&[NEARER, NEAREST], STEP, &[include_str!("../../shaders/broad_phase.wgsl")]]),
    ("dispatch", &[STEP, KINDS_FILE, &[include_str!("../../shaders/dispatch.wgsl")]]),
    ("place_chords", &[STEP, CHORD, &[include_str!("../../shaders/place_chords.wgsl")]]),
    ("mid_phase", &[STEP, KINDS_FILE, CHORD, &[include_str!("../../shaders/mid_phase.wgsl")]]),
];

/// Labels of the narrow phase for each kind of primitive pairs.
const NARROW: [&str; KINDS] = [
    "narrow_phase:cone_cone",
    "narrow_phase:cone_slab",
    "narrow_phase:slab_slab",
    "narrow_phase:cone_box",
    "narrow_phase:slab_box",
];

/// Returns the labels of the passes, and the texts of their shaders.
pub(crate) fn shaders() -> impl Iterator<Item = (&'static str, String)> {
    let entries = ENTRIES.iter().map(|(label, files)| (*label, shader(files.concat())));
    let narrow = NARROW.into_iter().zip(Kind::ALL).map(|(label, kind)| {
        let own = &[NEARER, NEAREST, BOUNDS, include_str!("../../shaders/narrow_phase.wgsl")];
        (label, shader_of_kind(kind, [STEP, KINDS_FILE, CHORD, own].concat()))
    });
    entries.chain(narrow)
}

/// All passes.
pub(crate) struct Passes {
    pub(super) place: Pass,
    pub(super) sort_blocks: Pass,
    pub(super) sort_far: Pass,
    pub(super) sort_near: Pass,
    pub(super) tree_bottom: Pass,
    pub(super) tree_top: Pass,
    pub(super) broad_phase: Pass,
    pub(super) dispatch: Pass,
    pub(super) place_chords: Pass,
    pub(super) mid_phase: Pass,
    /// One pass for each kind of primitive pairs.
    pub(super) narrow_phase: Vec<Pass>,
}

impl Passes {
    /// Creates the passes on a device, and waits for them.
    pub fn new(gpu: &GpuDevice) -> Result<Self, GpuError> {
        let mut texts: HashMap<&str, String> = shaders().collect();
        Self::each(|label| Pass::new(gpu, label, texts.remove(label).unwrap_or_default()))
    }

    /// Creates each pass from its label.
    pub fn each<E>(mut pass: impl FnMut(&'static str) -> Result<Pass, E>) -> Result<Self, E> {
        Ok(Self {
            place: pass("place")?,
            sort_blocks: pass("sort_blocks")?,
            sort_far: pass("sort_far")?,
            sort_near: pass("sort_near")?,
            tree_bottom: pass("tree_bottom")?,
            tree_top: pass("tree_top")?,
            broad_phase: pass("broad_phase")?,
            dispatch: pass("dispatch")?,
            place_chords: pass("place_chords")?,
            mid_phase: pass("mid_phase")?,
            narrow_phase: NARROW.into_iter().map(pass).collect::<Result<_, E>>()?,
        })
    }
}

/// The bind groups of the passes.
pub(super) struct Bound {
    pub place: wgpu::BindGroup,
    pub sort_blocks: wgpu::BindGroup,
    /// Bind groups of the merge steps, in order. True for steps within blocks.
    pub exchanges: Vec<(bool, wgpu::BindGroup)>,
    pub tree_bottom: wgpu::BindGroup,
    pub tree_top: wgpu::BindGroup,
    pub broad_phase: wgpu::BindGroup,
    pub dispatch: wgpu::BindGroup,
    pub place_chords: wgpu::BindGroup,
    pub mid_phase: wgpu::BindGroup,
    pub narrow_phase: Vec<wgpu::BindGroup>,
}

impl Bound {
    pub fn new(gpu: &GpuDevice, passes: &Passes, buffers: &Buffers, leaves: u32, exchanges: &[Exchange]) -> Self {
        use Slot::*;
        let whole = |slot: Slot| buffers.get(slot).as_entire_buffer_binding();
        let part = |slot: Slot, offset: u64, size: u64| wgpu::BufferBinding {
            buffer: buffers.get(slot),
            offset,
            size: std::num::NonZeroU64::new(size),
        };
        // The sort takes the number of keys from the size of this binding.
        let keys = || (0, part(Keys, 0, u64::from(leaves) * KEY));
        let bind = |pass: &Pass, slots: &[Slot]| {
            let buffers: Vec<_> = (0..).zip(slots).map(|(i, slot)| (i, whole(*slot))).collect();
            pass.bind(gpu, &buffers)
        };
        let exchange = |(i, exchange): (u64, &Exchange)| {
            let is_near = exchange.distance < SORT_BLOCK;
            let pass = if is_near { &passes.sort_near } else { &passes.sort_far };
            (is_near, pass.bind(gpu, &[keys(), (1, part(Exchanges, i * UNIFORM, size_of::<Exchange>() as u64))]))
        };
        Self {
            place: bind(&passes.place, &[Params, Bodies, Swept, Keys]),
            sort_blocks: passes.sort_blocks.bind(gpu, &[keys()]),
            exchanges: (0..).zip(exchanges).map(exchange).collect(),
            tree_bottom: bind(&passes.tree_bottom, &[Params, Swept, Keys, Tree]),
            tree_top: passes.tree_top.bind(gpu, &[(0, whole(Params)), (3, whole(Tree))]),
            broad_phase: bind(
                &passes.broad_phase,
                &[Params, Bodies, Swept, Tree, Statics, StaticNodes, Counters, Pairs, PairChords],
            ),
            dispatch: bind(&passes.dispatch, &[Params, Counters, Groups]),
            place_chords: bind(&passes.place_chords, &[Params, Bodies, Statics, Counters, Pairs, PairChords, Chords]),
            mid_phase: bind(
                &passes.mid_phase,
                &[Params, Shapes, Spheres, Primitives, ShapeNodes, Chords, Counters, Candidates],
            ),
            narrow_phase: (passes.narrow_phase.iter())
                .map(|pass| bind(pass, &[Params, Shapes, Spheres, Primitives, Chords, Candidates, Counters, Survivors]))
                .collect(),
        }
    }
}

/// Returns the merge steps that join sorted blocks into one sequence.
pub(super) fn exchanges(leaves: u32) -> Vec<Exchange> {
    let mut steps = Vec::new();
    let mut size = 2 * SORT_BLOCK;
    while size <= leaves {
        let mut distance = size / 2;
        while distance >= SORT_BLOCK {
            steps.push(Exchange { size, distance });
            distance /= 2;
        }
        steps.push(Exchange { size, distance });
        size *= 2;
    }
    steps
}
