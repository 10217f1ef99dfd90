//! Layout of uploaded data and of results, as the shaders declare it.

use bytemuck::{Pod, Zeroable};
use glam::{Quat, Vec3, Vec4};

use super::kinds::KINDS;

/// Shape of a collider that the GPU cannot represent.
pub(super) const OTHER_SHAPE: u32 = u32::MAX;
/// Shape of a plain box.
pub(super) const BOX_SHAPE: u32 = u32::MAX - 1;
/// Flag of shapes whose spheres move within the step.
pub(super) const DEFORMING: u32 = 1 << 30;
/// Value of `rigid_body` for a body with a single shape.
pub(super) const NO_RIGID_BODY: u64 = u64::MAX;
/// Flag of statics among the sides of pairs.
pub(super) const STATIC: u32 = 1 << 31;
/// Flag of the second side of pairs whose primitives the CPU finds.
pub(super) const UNKNOWN: u32 = 1 << 30;

/// Flag of the second primitive of survivors that may be near at the end of the step.
pub(super) const NEAR_AT_END: u32 = 1 << 31;

/// Sizes in bytes of types that only the shaders write: `Swept`, `TreeNode`, an item of `pair_chords`, `Chord`, `Candidate`.
pub(super) const SWEPT: u64 = 32;
pub(super) const NODE: u64 = 32;
pub(super) const PAIR_CHORD: u64 = 16;
pub(super) const CHORD: u64 = 176;
pub(super) const CANDIDATE: u64 = 12;

/// `Params` in `step.wgsl`, which describes the fields.
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
    pub max_survivors: u32,
    pub touch: f32,
    pub is_flat: u32,
    pub tiles: u32,
    pub candidates: [u32; 8],
}

/// `Body` in `motion.wgsl`, which describes the fields.
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
    pub rigid_body: [u32; 2],
    pub world: u32,
    pub is_active: u32,
    pub slack: f32,
    pub rounding: f32,
    pub half: Vec3,
    pub unused: u32,
}

/// `Static` in `motion.wgsl`, which describes the fields.
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
    pub rigid_body: [u32; 2],
    pub unused: [u32; 2],
}

/// `Shape` in `chord.wgsl`, which describes the fields.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct Shape {
    pub spheres: u32,
    pub primitives: u32,
    pub primitive_count: u32,
    pub nodes: u32,
    pub node_count: u32,
}

/// `Counters` in `step.wgsl`, which describes the fields.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub(super) struct Counters {
    pub pairs: u32,
    pub chords: u32,
    pub candidates: [u32; KINDS],
    pub survivors: u32,
}

/// `Pair` in `step.wgsl`, which describes the fields.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct Pair {
    pub first: u32,
    pub second: u32,
    pub chords: u32,
}

/// `Survivor` in `narrow_phase.wgsl`, which describes the fields.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct Survivor {
    pub pair: u32,
    pub first: u32,
    pub second: u32,
    pub touch: f32,
}

/// `Exchange` in `sort.wgsl`, which describes the fields.
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
    use crate::{
        geometry::{Aabb, Bvh, Sphere},
        gpu::{
            kinds::Kind,
            pair_bounds::{self, Side},
            pass::{entry_point, shader},
            passes::{SORT_BLOCK, TREE_BLOCK, WORKGROUP, shaders},
        },
        medial_axis::{MedialAxis, packed::PackedMedialMesh},
    };

    const STEP: &[&str] = &[include_str!("../../shaders/motion.wgsl"), include_str!("../../shaders/step.wgsl")];
    const CHORDS: &[&str] = &[include_str!("../../shaders/chord.wgsl")];
    const SORT: &[&str] = &[include_str!("../../shaders/sort.wgsl")];
    const TREE: &[&str] = &[include_str!("../../shaders/tree.wgsl")];

    fn module(files: &[&[&str]]) -> Module {
        parse_str(&shader(files.concat())).unwrap()
    }

    /// Returns the size of a struct in the shaders, and names and offsets of its members.
    fn in_shader(module: &Module, name: &str) -> (u32, Vec<(String, u32)>) {
        let found = module.types.iter().find_map(|(_, ty)| match (&ty.name, &ty.inner) {
            (Some(found), TypeInner::Struct { members, span }) if found == name => {
                Some((*span, members.iter().map(|m| (m.name.clone().unwrap(), m.offset)).collect()))
            }
            _ => None,
        });
        found.unwrap_or_else(|| panic!("{name} is missing in the shader"))
    }

    /// Returns the bits of an integer constant in the shaders. For a vector of equal components, it returns those of one component.
    fn number(module: &Module, name: &str) -> u32 {
        let constant = module.constants.iter().find(|(_, constant)| constant.name.as_deref() == Some(name));
        let mut expression = constant.unwrap_or_else(|| panic!("{name} is missing in the shader")).1.init;
        loop {
            match &module.global_expressions[expression] {
                Expression::Literal(Literal::U32(value)) => return *value,
                Expression::Literal(Literal::I32(value)) => return value.cast_unsigned(),
                Expression::Splat { value, .. } => expression = *value,
                Expression::Compose { components, .. } => expression = components[0],
                other => panic!("{name} is {other:?}"),
            }
        }
    }

    macro_rules! assert_layout {
        ($module:expr, $name:ident { $($member:ident)* }) => {
            assert_layout!($module, $name as $name { $($member)* });
        };
        ($module:expr, $name:ident as $theirs:ident { $($member:ident)* }) => {
            let (size, members) = in_shader($module, stringify!($theirs));
            assert_eq!(size as usize, size_of::<$name>(), stringify!($name));
            let own = vec![$((stringify!($member).to_owned(), offset_of!($name, $member) as u32)),*];
            assert_eq!(members, own, stringify!($name));
        };
    }

    #[test]
    fn structs_are_those_of_the_shaders() {
        let step = &module(&[STEP, TREE]);
        let (_, narrow) = shaders().last().unwrap();
        let narrow = &parse_str(&narrow).unwrap();
        assert_layout!(step, Params {
            bodies leaves static_nodes prediction low max_pairs cells max_chords max_survivors touch is_flat tiles
            candidates
        });
        assert_layout!(step, Body {
            position shape rotation translation scale turn arm local_center margin bound memberships collides_with
            rigid_body world is_active slack rounding half
        });
        assert_layout!(step, Static {
            center shape rotation half rounding position scale radius memberships collides_with world rigid_body
        });
        assert_layout!(step, Counters { pairs chords candidates survivors });
        assert_layout!(step, Pair { first second chords });
        assert_layout!(narrow, Shape { spheres primitives primitive_count nodes node_count });
        assert_layout!(narrow, Survivor { pair first second touch });
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
        assert_eq!(in_shader(narrow, "Primitive").0 as usize, size_of::<[i32; 3]>());
    }

    #[test]
    fn moving_pairs_are_those_of_the_shader() {
        let module = &parse_str(&pair_bounds::text(Kind::ConeCone)).unwrap();
        let (size, members) = in_shader(module, "Moving");
        assert_eq!(size as usize, size_of::<Side>());
        let offsets: Vec<u32> = members.iter().map(|(_, offset)| *offset).collect();
        assert_eq!(offsets, [offset_of!(Side, start), 48, 64, 80].map(|offset| offset as u32));
        assert_eq!(offset_of!(Side, motion), 48);
    }

    #[test]
    fn kinds_are_those_of_the_shaders() {
        let (_, narrow) = shaders().last().unwrap();
        let module = &parse_str(&narrow).unwrap();
        let names = ["CONE_CONE", "CONE_SLAB", "SLAB_SLAB", "CONE_BOX", "SLAB_BOX"];
        for ((kind, name), index) in Kind::ALL.into_iter().zip(names).zip(0..) {
            assert_eq!((number(module, name), kind as u32), (index, index), "{name}");
        }
        assert_eq!(number(module, "KINDS"), KINDS as u32);
    }

    /// Layouts that other files write for the GPU.
    #[test]
    fn hierarchies_and_primitives_are_those_of_the_shaders() {
        let step = &module(&[STEP, TREE]);
        let boxes = [0.0, 2.0].map(|x| Aabb { min: Vec3::new(x, 3.0, 4.0), max: Vec3::new(x + 1.0, 6.0, 7.0) });
        let bvh = Bvh::new(&boxes);
        let (_, members) = in_shader(step, "BvhNode");
        let at = |node: usize, name: &str| {
            let (_, offset) = members.iter().find(|(member, _)| member == name).unwrap();
            &bvh.bytes()[node * NODE as usize + *offset as usize..]
        };
        let vector = |bytes: &[u8]| -> Vec3 { bytemuck::pod_read_unaligned(&bytes[..12]) };
        let link = |node: usize| -> u32 { bytemuck::pod_read_unaligned(&at(node, "link")[..4]) };
        assert_eq!(bvh.bytes().len(), 3 * NODE as usize);
        assert_eq!([vector(at(0, "low")), vector(at(0, "high"))], [boxes[0].min, boxes[1].max]);
        assert_eq!([0, 1, 2].map(link), [3, number(step, "LEAF"), number(step, "LEAF") | 1]);

        let chords = module(&[STEP, CHORDS]);
        let sphere = |x: f32| Sphere::new(Vec3::X * x, 0.5);
        for (axis, name) in [
            (MedialAxis::sphere(0.5).unwrap(), "SPHERE"),
            (MedialAxis::cone(sphere(0.0), sphere(1.0)).unwrap(), "CONE"),
        ] {
            let [[kind, ..]] = PackedMedialMesh::new(&axis).primitives[..] else { panic!("{axis:?}") };
            assert_eq!(kind.cast_unsigned(), number(&chords, name), "{name}");
        }
    }

    #[test]
    fn workgroups_are_those_of_the_shaders() {
        for (label, text) in shaders().chain([(pair_bounds::LABEL, pair_bounds::text(Kind::SlabSlab))]) {
            let module = parse_str(&text).unwrap();
            let entry = module.entry_points.iter().find(|entry| entry.name == entry_point(label)).unwrap();
            let size = match label {
                "dispatch" => 1,
                "sort_blocks" | "sort_far" | "sort_near" => SORT_BLOCK / 2,
                "tree_bottom" | "tree_top" => TREE_BLOCK,
                _ => WORKGROUP,
            };
            assert_eq!(entry.workgroup_size, [size, 1, 1], "{label}");
        }
        let (_, dispatch) = shaders().find(|(label, _)| *label == "dispatch").unwrap();
        assert_eq!(number(&parse_str(&dispatch).unwrap(), "WORKGROUP"), WORKGROUP);
    }

    #[test]
    fn constants_are_those_of_the_shaders() {
        let step = module(&[STEP]);
        for (name, value) in [
            ("OTHER_SHAPE", OTHER_SHAPE),
            ("BOX_SHAPE", BOX_SHAPE),
            ("DEFORMING", DEFORMING),
            ("NO_RIGID_BODY", NO_RIGID_BODY as u32),
            ("STATIC", STATIC),
            ("UNKNOWN", UNKNOWN),
        ] {
            assert_eq!(number(&step, name), value, "{name}");
        }
        let (_, narrow) = shaders().last().unwrap();
        assert_eq!(number(&parse_str(&narrow).unwrap(), "NEAR_AT_END"), NEAR_AT_END);
        assert_eq!(number(&module(&[SORT]), "BLOCK"), SORT_BLOCK);
        assert_eq!(number(&module(&[STEP, TREE]), "BLOCK"), TREE_BLOCK);
    }
}
