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

/// Sizes in bytes of what only the shaders write: `Swept`, `TreeNode`, an item of `pair_chords`, `Chord`, `Candidate`.
pub(super) const SWEPT: u64 = 32;
pub(super) const NODE: u64 = 32;
pub(super) const PAIR_CHORD: u64 = 16;
pub(super) const CHORD: u64 = 176;
pub(super) const CANDIDATE: u64 = 12;

/// `Params` in `step.wgsl`.
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

/// `Counters` in `step.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub(super) struct Counters {
    pub pairs: u32,
    pub chords: u32,
    pub candidates: u32,
    pub survivors: u32,
}

/// `Pair` in `step.wgsl`.
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

#[cfg(test)]
mod tests {
    use std::mem::offset_of;

    use wgpu::naga::{Expression, Literal, Module, TypeInner, front::wgsl::parse_str};

    use super::*;
    use crate::gpu::{
        pass::{KERNELS, shader},
        passes::{SORT_BLOCK, TREE_BLOCK},
    };

    const STEP: &[&str] = &[include_str!("../../shaders/motion.wgsl"), include_str!("../../shaders/step.wgsl")];
    const CHORDS: &[&str] = &[include_str!("../../shaders/chord.wgsl")];
    const SORT: &[&str] = &[include_str!("../../shaders/sort.wgsl")];
    const TREE: &[&str] = &[include_str!("../../shaders/tree.wgsl")];

    fn module(files: &[&[&str]]) -> Module {
        parse_str(&shader(&files.concat())).unwrap()
    }

    /// Size of a struct in the shaders, and where its members are.
    fn in_shader(module: &Module, name: &str) -> (u32, Vec<(String, u32)>) {
        let found = module.types.iter().find_map(|(_, ty)| match (&ty.name, &ty.inner) {
            (Some(found), TypeInner::Struct { members, span }) if found == name => {
                Some((*span, members.iter().map(|m| (m.name.clone().unwrap(), m.offset)).collect()))
            }
            _ => None,
        });
        found.unwrap_or_else(|| panic!("{name} is not there"))
    }

    /// A whole number in the shaders; of a vector of equal ones, that.
    fn number(module: &Module, name: &str) -> u32 {
        let constant = module.constants.iter().find(|(_, constant)| constant.name.as_deref() == Some(name));
        let mut expression = constant.unwrap_or_else(|| panic!("{name} is not there")).1.init;
        loop {
            match &module.global_expressions[expression] {
                Expression::Literal(Literal::U32(value)) => return *value,
                Expression::Splat { value, .. } => expression = *value,
                Expression::Compose { components, .. } => expression = components[0],
                other => panic!("{name} is {other:?}"),
            }
        }
    }

    macro_rules! assert_layout {
        ($module:expr, $name:ident { $($member:ident)* }) => {
            let (size, members) = in_shader($module, stringify!($name));
            assert_eq!(size as usize, size_of::<$name>(), stringify!($name));
            let own = vec![$((stringify!($member).to_owned(), offset_of!($name, $member) as u32)),*];
            assert_eq!(members, own, stringify!($name));
        };
    }

    #[test]
    fn structs_are_those_of_the_shaders() {
        let step = &module(&[STEP, TREE]);
        let narrow = &module(&[KERNELS, STEP, CHORDS, &[include_str!("../../shaders/narrow_phase.wgsl")]]);
        assert_layout!(step, Params {
            bodies leaves static_nodes prediction low max_pairs cells max_chords max_candidates max_survivors
        });
        assert_layout!(step, Body {
            position shape rotation translation scale turn arm local_center margin bound memberships collides_with owner
            world is_active slack
        });
        assert_layout!(step, Static {
            center shape rotation half rounding position scale radius memberships collides_with world owner
        });
        assert_layout!(step, Counters { pairs chords candidates survivors });
        assert_layout!(step, Pair { first second });
        assert_layout!(narrow, Shape { spheres primitives primitive_count nodes node_count });
        assert_layout!(narrow, Survivor { pair first second fraction });
        assert_layout!(&module(&[SORT]), Exchange { size distance });
        for (module, size, name) in [
            (step, SWEPT, "Swept"),
            (step, NODE, "TreeNode"),
            (step, NODE, "BvhNode"),
            (narrow, CHORD, "Chord"),
            (narrow, CANDIDATE, "Candidate"),
        ] {
            assert_eq!(u64::from(in_shader(module, name).0), size, "{name}");
        }
    }

    #[test]
    fn constants_are_those_of_the_shaders() {
        let step = module(&[STEP]);
        for (name, value) in [
            ("OTHER_SHAPE", OTHER_SHAPE),
            ("BOX_SHAPE", BOX_SHAPE),
            ("NO_OWNER", NO_OWNER as u32),
            ("STATIC", STATIC),
            ("UNKNOWN", UNKNOWN),
        ] {
            assert_eq!(number(&step, name), value, "{name}");
        }
        assert_eq!(number(&module(&[SORT]), "BLOCK"), SORT_BLOCK);
        assert_eq!(number(&module(&[STEP, TREE]), "BLOCK"), TREE_BLOCK);
    }
}
