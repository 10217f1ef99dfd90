//! Layout of uploaded data and of results, as the shaders declare it.

use bytemuck::{Pod, Zeroable};
use glam::{Quat, Vec3, Vec4};

/// Shape of a collider that the GPU cannot represent.
pub(super) const OTHER_SHAPE: u32 = u32::MAX;
/// Shape of a plain box.
pub(super) const BOX_SHAPE: u32 = u32::MAX - 1;
/// Value of `rigid_body` for a body with a single shape.
pub(super) const NO_RIGID_BODY: u64 = u64::MAX;
/// Flag of statics among the sides of pairs.
pub(super) const STATIC: u32 = 1 << 31;
/// Flag of the second side of pairs whose primitives the CPU finds.
pub(super) const UNKNOWN: u32 = 1 << 30;

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
    pub max_candidates: u32,
    pub max_survivors: u32,
    pub touch: f32,
    pub unused: u32,
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
    pub candidates: u32,
    pub survivors: u32,
}

/// `Pair` in `step.wgsl`, which describes the fields.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct Pair {
    pub first: u32,
    pub second: u32,
}

/// `Survivor` in `narrow_phase.wgsl`, which describes the fields.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct Survivor {
    pub pair: u32,
    pub first: u32,
    pub second: u32,
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
            impacts::{self, Answer, MovingPair, Side},
            pass::{KERNELS, shader},
            passes::{SORT_BLOCK, TREE_BLOCK, WORKGROUP, shaders},
        },
        medial_axis::{MedialAxis, packed::PackedMedialMesh},
        query::{Cuboid, Moving, TimeOfImpactStatus},
    };

    const STEP: &[&str] = &[include_str!("../../shaders/motion.wgsl"), include_str!("../../shaders/step.wgsl")];
    const CHORDS: &[&str] = &[include_str!("../../shaders/chord.wgsl")];
    const SORT: &[&str] = &[include_str!("../../shaders/sort.wgsl")];
    const TREE: &[&str] = &[include_str!("../../shaders/tree.wgsl")];
    const DISPATCH: &[&str] = &[include_str!("../../shaders/dispatch.wgsl")];

    fn module(files: &[&[&str]]) -> Module {
        parse_str(&shader(&files.concat())).unwrap()
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
        let narrow = &module(&[KERNELS, STEP, CHORDS, &[include_str!("../../shaders/narrow_phase.wgsl")]]);
        assert_layout!(step, Params {
            bodies leaves static_nodes prediction low max_pairs cells max_chords max_candidates max_survivors touch
        });
        assert_layout!(step, Body {
            position shape rotation translation scale turn arm local_center margin bound memberships collides_with
            rigid_body world is_active slack
        });
        assert_layout!(step, Static {
            center shape rotation half rounding position scale radius memberships collides_with world rigid_body
        });
        assert_layout!(step, Counters { pairs chords candidates survivors });
        assert_layout!(step, Pair { first second });
        assert_layout!(narrow, Shape { spheres primitives primitive_count nodes node_count });
        assert_layout!(narrow, Survivor { pair first second });
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
    fn pairs_and_their_times_of_impact_are_those_of_the_shader() {
        let module = &parse_str(&impacts::text()).unwrap();
        assert_layout!(module, MovingPair as Pair { first second });
        assert_layout!(module, Answer as Result { normal distance point1 fraction status rounds feature });
        let (size, members) = in_shader(module, "Moving");
        assert_eq!(size as usize, size_of::<Side>());
        assert_eq!(members, [("hull".to_owned(), 0), ("motion".to_owned(), offset_of!(Side, motion) as u32)]);
        let (_, members) = in_shader(module, "Hull");
        let own = [("spheres", offset_of!(Side, spheres)), ("count", offset_of!(Side, count))];
        assert_eq!(members, own.map(|(name, offset)| (name.to_owned(), offset as u32)));

        let ball = Moving { start: [Sphere::new(Vec3::ZERO, 1.0)], motion: [Vec3::ZERO] };
        let pair = MovingPair::with_cuboid(&ball, &Cuboid { half: Vec3::ONE });
        assert_eq!([pair.first.count, pair.second.count], [1, number(module, "BOX")]);
        for (name, status) in [
            ("SEPARATED", TimeOfImpactStatus::Separated),
            ("HIT", TimeOfImpactStatus::Hit),
            ("OVERLAPPING", TimeOfImpactStatus::Overlapping),
            ("ITERATION_LIMIT", TimeOfImpactStatus::IterationLimit),
        ] {
            let mut answer = Answer::zeroed();
            answer.status = number(module, name);
            assert_eq!(answer.decoded().status, status, "{name}");
        }
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
        for (label, text) in shaders().chain([("impacts", impacts::text())]) {
            let module = parse_str(&text).unwrap();
            let entry = module.entry_points.iter().find(|entry| entry.name == label).unwrap();
            let size = match label {
                "dispatch" => 1,
                "sort_blocks" | "sort_far" | "sort_near" => SORT_BLOCK / 2,
                "tree_bottom" | "tree_top" => TREE_BLOCK,
                _ => WORKGROUP,
            };
            assert_eq!(entry.workgroup_size, [size, 1, 1], "{label}");
        }
        assert_eq!(number(&module(&[STEP, DISPATCH]), "WORKGROUP"), WORKGROUP);
    }

    #[test]
    fn constants_are_those_of_the_shaders() {
        let step = module(&[STEP]);
        for (name, value) in [
            ("OTHER_SHAPE", OTHER_SHAPE),
            ("BOX_SHAPE", BOX_SHAPE),
            ("NO_RIGID_BODY", NO_RIGID_BODY as u32),
            ("STATIC", STATIC),
            ("UNKNOWN", UNKNOWN),
        ] {
            assert_eq!(number(&step, name), value, "{name}");
        }
        assert_eq!(number(&module(&[SORT]), "BLOCK"), SORT_BLOCK);
        assert_eq!(number(&module(&[STEP, TREE]), "BLOCK"), TREE_BLOCK);
    }
}
