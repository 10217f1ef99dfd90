use std::f32::consts::PI;

use glam::{Quat, Vec3};

use super::{Character, CharacterJoint, Gait};

/// A cone: two balls of x, y, z and radius.
type Cone = [[f32; 4]; 2];

/// The joints in the middle: name, parent, parts, rotation.
const TRUNK: [(&str, Option<usize>, &[Cone], fn(f32) -> Quat); 5] = [
    (
        "hips",
        None,
        &[[[0., 0.98, 0., 0.12], [0., 1.0, 0., 0.12]], [[0., 0.97, -0.07, 0.115], [0., 0.97, 0.07, 0.115]]],
        |phase| Quat::from_rotation_z(-0.12) * Quat::from_rotation_y(-0.12 * phase.sin()),
    ),
    (
        "spine",
        Some(0),
        &[[[0., 1.12, 0., 0.11], [0., 1.22, 0., 0.115]], [[0., 1.16, -0.05, 0.105], [0., 1.16, 0.05, 0.105]]],
        |phase| Quat::from_rotation_y(0.14 * phase.sin()),
    ),
    (
        "chest",
        Some(1),
        &[
            [[0., 1.3, 0., 0.12], [0., 1.4, 0., 0.1]],
            [[0., 1.31, -0.08, 0.115], [0., 1.31, 0.08, 0.115]],
            [[0., 1.42, -0.13, 0.07], [0., 1.42, 0.13, 0.07]],
        ],
        |phase| Quat::from_rotation_y(0.18 * phase.sin()),
    ),
    ("neck", Some(2), &[[[0., 1.5, 0., 0.058], [0.01, 1.58, 0., 0.055]]], |phase| {
        Quat::from_rotation_y(-0.12 * phase.sin())
    }),
    ("head", Some(3), &[[[0.01, 1.62, 0., 0.075], [0.02, 1.7, 0., 0.1]]], |phase| {
        Quat::from_rotation_z(0.1) * Quat::from_rotation_y(-0.08 * phase.sin())
    }),
];

/// Direction about which an elbow turns forwards, in the bind pose.
const ELBOW: Vec3 = Vec3::new(0.0, std::f32::consts::FRAC_1_SQRT_2, std::f32::consts::FRAC_1_SQRT_2);

/// The right side; the left one is its mirror image, half a cycle later. Parents are joints of the trunk, or of the same side.
const SIDE: [(&str, &str, &[Cone], fn(f32) -> Quat); 6] = [
    ("upper arm", "chest", &[[[0., 1.43, 0.2, 0.06], [0., 1.23, 0.4, 0.046]]], |phase| {
        Quat::from_rotation_z(-0.7 * phase.sin()) * Quat::from_rotation_x(0.5)
    }),
    ("forearm", "upper arm", &[[[0., 1.23, 0.4, 0.046], [0., 1.05, 0.58, 0.036]]], |phase| {
        Quat::from_axis_angle(ELBOW, 1.3 - 0.3 * phase.sin())
    }),
    ("hand", "forearm", &[[[0., 1.05, 0.58, 0.036], [0., 0.96, 0.67, 0.04]]], |_| Quat::IDENTITY),
    ("thigh", "hips", &[[[0., 0.9, 0.115, 0.082], [0.01, 0.5, 0.12, 0.06]]], |phase| {
        Quat::from_rotation_z(0.35 + 0.75 * phase.sin())
    }),
    ("shin", "thigh", &[[[0.01, 0.5, 0.12, 0.06], [-0.02, 0.1, 0.12, 0.042]]], |phase| {
        let flexed = 0.5 + 0.5 * (phase + 0.2).cos();
        Quat::from_rotation_z(-0.15 - 1.4 * flexed * flexed)
    }),
    (
        "foot",
        "shin",
        &[
            [[-0.02, 0.1, 0.12, 0.042], [-0.04, 0.05, 0.12, 0.045]],
            [[-0.04, 0.05, 0.12, 0.045], [0.16, 0.045, 0.13, 0.04]],
        ],
        |phase| Quat::from_rotation_z(0.25 * phase.sin() - 0.1),
    ),
];

pub(super) fn biped() -> Character {
    let mut joints: Vec<CharacterJoint> = vec![];
    for (name, parent, balls, turn) in TRUNK {
        joints.push(CharacterJoint::new(name.into(), parent, Vec3::ZERO, balls, Gait { turn, ..Gait::RIGHT }));
    }
    for (side, is_mirrored, phase) in [("right", false, 0.0), ("left", true, PI)] {
        for (name, parent, balls, turn) in SIDE {
            let whole = format!("{side} {parent}");
            let parent = joints.iter().position(|joint| joint.name == parent || joint.name == whole);
            let gait = Gait { turn, phase, is_mirrored, ..Gait::RIGHT };
            joints.push(CharacterJoint::new(format!("{side} {name}"), parent, Vec3::ZERO, balls, gait));
        }
    }
    let sway = |phase: f32| Vec3::Y * (0.035 + 0.03 * (2.0 * phase).cos());
    Character { name: "biped", joints, period: 0.6, cell: 0.025, sway }
}
