use super::*;
use crate::{builder::MeshReport, medial_axis::JointPose};

fn characters() -> [Character; 2] {
    [Character::biped(), Character::spider()]
}

fn poses(character: &Character, mesh: &SkinnedTriangleMesh, joints: &[Affine3A]) -> Vec<JointPose> {
    let mut poses = vec![];
    mesh.skin().joint_poses(joints, &mut poses);
    assert_eq!(poses.len(), character.joints.len());
    poses
}

#[test]
fn a_character_is_one_closed_surface_that_stays_without_motion() {
    for character in characters() {
        let mesh = character.mesh().unwrap();
        let report = MeshReport::new(mesh.mesh());
        println!("{}: {report}", character.name);
        assert!(report.flaws().is_empty() && report.components == 1 && report.volume > 0.0, "{report}");
        let still = mesh.posed(&poses(&character, &mesh, &character.bind_pose()));
        for (a, b) in still.positions.iter().zip(&mesh.mesh().positions) {
            assert!(a.distance(*b) < 1e-5, "{a} {b}");
        }
        let blended = mesh.skin().weights().iter().filter(|weights| weights[1].1 > 0.2).count();
        assert!(blended * 20 > mesh.mesh().positions.len(), "{}: {blended} vertices follow two joints", character.name);
        for (joint, part) in character.joints.iter().enumerate() {
            let own = mesh.skin().weights().iter().filter(|weights| usize::from(weights[0].0) == joint).count();
            assert!(own >= 10, "{}: {own} vertices follow {}", character.name, part.name);
        }
    }
}

#[test]
fn both_sides_do_the_same_half_a_cycle_apart() {
    for character in characters() {
        let [now, later] = [0.1, 0.1 + 0.5 * character.period].map(|time| character.pose(time));
        let mut pairs = 0;
        for (right, joint) in character.joints.iter().enumerate() {
            let Some(part) = joint.name.strip_prefix("right ") else { continue };
            let left = character.joints.iter().position(|other| other.name == format!("left {part}")).unwrap();
            let [a, b] = [now[right].translation, later[left].translation].map(Vec3::from);
            assert!(a.distance(b * Vec3::new(1.0, 1.0, -1.0)) < 1e-4, "{}: {a} {b}", joint.name);
            pairs += 1;
        }
        assert!(pairs >= 6, "{pairs}");
    }
}

#[test]
fn the_gait_is_periodic_and_stays_above_the_ground() {
    for character in characters() {
        let mesh = character.mesh().unwrap();
        let posed = |time: f32| mesh.posed(&poses(&character, &mesh, &character.pose(time))).positions;
        let step = character.period / 60.0;
        let frames: Vec<Vec<Vec3>> = (0..61).map(|frame| posed(frame as f32 * step)).collect();
        let (mut lowest, mut fastest) = (f32::INFINITY, 0.0f32);
        for pair in frames.windows(2) {
            for (a, b) in pair[0].iter().zip(&pair[1]) {
                (lowest, fastest) = (lowest.min(b.y), fastest.max(a.distance(*b) / step));
            }
        }
        println!("{}: lowest point {lowest} m, fastest point {fastest} m/s", character.name);
        assert!(lowest > -0.1 && (2.0..25.0).contains(&fastest), "{lowest} {fastest}");
        assert!(frames[0].iter().zip(&frames[60]).all(|(a, b)| a.distance(*b) < 1e-3));
    }
}
