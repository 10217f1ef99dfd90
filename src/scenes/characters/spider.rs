use std::f32::consts::PI;

use glam::{Quat, Vec3};

use super::{Character, CharacterJoint, Gait};

const THORAX: [[[f32; 4]; 2]; 1] = [[[0.08, 0.24, 0., 0.095], [-0.08, 0.24, 0., 0.09]]];
const ABDOMEN: [[[f32; 4]; 2]; 1] = [[[-0.18, 0.27, 0., 0.07], [-0.34, 0.31, 0., 0.12]]];

/// A leg that points along +x: name, parts, rotation. Rotations about z raise it, rotations about y swing it forwards on the right side.
const LEG: [(&str, [[f32; 4]; 2], fn(f32) -> Quat); 3] = [
    ("femur", [[0.09, 0.22, 0., 0.036], [0.24, 0.4, 0., 0.032]], |phase| {
        Quat::from_rotation_y(0.3 * phase.sin()) * Quat::from_rotation_z(0.35 * lift(phase))
    }),
    ("tibia", [[0.24, 0.4, 0., 0.032], [0.46, 0.18, 0., 0.026]], |phase| {
        Quat::from_rotation_z(0.1 - 0.4 * lift(phase))
    }),
    ("foot", [[0.46, 0.18, 0., 0.026], [0.54, 0.026, 0., 0.024]], |phase| Quat::from_rotation_z(-0.3 * lift(phase))),
];

/// The height of a step, from 0 to 1: a leg is raised while it swings forwards.
fn lift(phase: f32) -> f32 {
    let up = phase.cos().max(0.0);
    up * up
}

/// The legs on the right side, from front to back: name, x of the base, heading in degrees, shift of the phase.
const LEGS: [(&str, f32, f32, f32); 4] = [
    ("first", 0.06, 36.0, 0.0),
    ("second", 0.025, 68.0, PI),
    ("third", -0.025, 104.0, 0.0),
    ("fourth", -0.06, 136.0, PI),
];

pub(super) fn spider() -> Character {
    let still = Gait::RIGHT;
    let abdomen = Gait { turn: |phase| Quat::from_rotation_z(0.06 * (2.0 * phase).sin()), ..still };
    let mut joints = vec![
        CharacterJoint::new("thorax".into(), None, Vec3::ZERO, &THORAX, still),
        CharacterJoint::new("abdomen".into(), Some(0), Vec3::ZERO, &ABDOMEN, abdomen),
    ];
    for (side, is_mirrored, shift) in [("right", false, 0.0), ("left", true, PI)] {
        for (leg, x, degrees, phase) in LEGS {
            let mut parent = 0;
            for (part, balls, turn) in LEG {
                let gait = Gait { turn, phase: phase + shift, heading: -degrees.to_radians(), is_mirrored };
                let joint =
                    CharacterJoint::new(format!("{side} {leg} {part}"), Some(parent), Vec3::X * x, &[balls], gait);
                parent = joints.len();
                joints.push(joint);
            }
        }
    }
    let sway = |phase: f32| Vec3::Y * (0.015 * (2.0 * phase).cos() - 0.02);
    Character { name: "spider", joints, period: 0.5, cell: 0.02, sway }
}
