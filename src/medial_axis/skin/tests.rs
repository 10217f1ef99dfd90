use glam::Quat;

use super::*;
use crate::{medial_axis::MedialAxis, random::Random};

fn joint(name: &str, at: Vec3) -> SkinJoint {
    SkinJoint { name: name.into(), inverse_bind: Affine3A::from_translation(-at) }
}

/// Two joints at x = 0 and x = 2, with the given weight of the second for each point.
fn two(second: &[f32]) -> Skin {
    let weights: Vec<JointWeights> = second.iter().map(|w| [(1, *w), (0, 1.0 - w), (0, 0.0), (0, 0.0)]).collect();
    Skin::new([joint("root", Vec3::ZERO), joint("tip", Vec3::X * 2.0)], &weights).unwrap()
}

fn random_transform(random: &mut Random) -> Affine3A {
    Affine3A::from_rotation_translation(random.rotation(), random.in_cube() * 9.0)
}

fn posed(skin: &Skin, spheres: &[Sphere], joints: &[Affine3A]) -> Vec<Sphere> {
    let (mut poses, mut posed) = (vec![], vec![Sphere::default()]);
    skin.joint_poses(joints, &mut poses);
    skin.pose(spheres, &poses, &mut posed);
    posed
}

fn spheres(random: &mut Random, count: usize) -> Vec<Sphere> {
    (0..count).map(|_| Sphere::new(random.in_cube() * 3.0, random.unit())).collect()
}

#[test]
fn the_bind_pose_is_exact() {
    let mut random = Random(1);
    let spheres = spheres(&mut random, 50);
    let skin = two(&std::array::from_fn::<_, 50, _>(|_| random.unit()));
    assert!(skin.weights().iter().all(|w| w[0].1 >= w[1].1 && (w[0].1 + w[1].1 - 1.0).abs() < 1e-6));
    assert!(skin.weights().iter().any(|w| w[1].1 > 0.1), "some spheres follow both joints");
    let joints = [Affine3A::IDENTITY, Affine3A::from_translation(Vec3::X * 2.0)];
    assert_eq!(posed(&skin, &spheres, &joints), spheres);
}

#[test]
fn rigid_motion_of_all_joints_moves_the_spheres_rigidly() {
    let mut random = Random(2);
    for _ in 0..100 {
        let spheres = spheres(&mut random, 10);
        let skin = two(&std::array::from_fn::<_, 10, _>(|_| random.unit()));
        let motion = random_transform(&mut random);
        let joints = skin.joints().iter().map(|j| motion * j.inverse_bind.inverse()).collect::<Vec<_>>();
        for (sphere, now) in spheres.iter().zip(posed(&skin, &spheres, &joints)) {
            assert!(now.center.distance(motion.transform_point3(sphere.center)) < 1e-5, "{now:?}");
            assert!((now.radius - sphere.radius).abs() < 1e-6, "{now:?}");
        }
    }
}

#[test]
fn centres_blend_linearly() {
    let skin = two(&[0.5, 0.25]);
    // The tip turns by 180 degrees about x, so an offset of 1 m along y becomes -1 m.
    let turned = Affine3A::from_rotation_translation(Quat::from_rotation_x(std::f32::consts::PI), Vec3::X * 2.0);
    let spheres = [Sphere::new(Vec3::new(1.0, 1.0, 0.0), 0.5); 2];
    let [half, quarter] = posed(&skin, &spheres, &[Affine3A::IDENTITY, turned])[..] else { panic!("not two") };
    assert!(half.center.distance(Vec3::X) < 1e-6 && quarter.center.distance(Vec3::new(1.0, 0.5, 0.0)) < 1e-6);
}

#[test]
fn spheres_at_a_bend_shrink_like_the_skin() {
    let mut random = Random(3);
    for turns in 1..100 {
        let angle = turns as f32 * 0.03;
        let (weight, axis) = (random.unit(), random.direction().as_vec3());
        let bent = Affine3A::from_rotation_translation(Quat::from_axis_angle(axis, angle), Vec3::X * 2.0);
        let [sphere] = posed(&two(&[weight]), &[Sphere::new(Vec3::X, 2.0)], &[Affine3A::IDENTITY, bent])[..] else {
            panic!("not one")
        };
        // Volume of a small tetrahedron of the skin with the same weights, over its volume in the bind pose.
        let corners =
            [Vec3::X, Vec3::X * 2.0, Vec3::X + Vec3::Y, Vec3::X + Vec3::Z].map(|center| Sphere::new(center, 0.0));
        let corners = posed(&two(&[weight; 4]), &corners, &[Affine3A::IDENTITY, bent]);
        let [a, b, c] = [1, 2, 3].map(|corner| corners[corner].center - corners[0].center);
        let volume = a.dot(b.cross(c)).abs();
        assert!(volume < 1.0 && ((sphere.radius / 2.0).powi(3) - volume).abs() < 1e-5, "{angle}: {sphere:?}");
    }
}

#[test]
fn radii_grow_with_the_blended_scale() {
    let skin = two(&[0.0, 0.25, 1.0]);
    let large = Affine3A::from_scale_rotation_translation(Vec3::splat(3.0), Quat::from_rotation_y(1.0), Vec3::Y);
    let grown = Affine3A::from_scale_rotation_translation(Vec3::splat(3.0), Quat::IDENTITY, Vec3::Y);
    let radii = posed(&skin, &[Sphere::new(Vec3::Z, 2.0); 3], &[Affine3A::IDENTITY, grown]);
    for (sphere, expected) in radii.iter().zip([2.0, 3.0, 6.0]) {
        assert!((sphere.radius - expected).abs() < 1e-5, "{sphere:?}");
    }
    assert!(JointPose::new(large).is_uniform() && JointPose::new(Affine3A::from_scale(Vec3::ZERO)).is_uniform());
    for stretched in [Affine3A::from_scale(Vec3::new(1.0, 1.02, 1.0)), Affine3A::from_scale(Vec3::new(2.0, 0.5, 1.0))] {
        assert!(!JointPose::new(large * stretched * large).is_uniform());
    }
}

#[test]
fn the_largest_weight_names_the_joint() {
    let skin = two(&[0.9, 0.2, 0.5]);
    let cone = Primitive::Cone([0, 1]);
    assert_eq!([[1.0, 0.0], [0.5, 0.5], [0.4, 0.6], [0.0, 1.0]].map(|s| skin.joint_within(&cone, &s)), [1, 1, 0, 0]);
    assert_eq!(skin.joint_within(&Primitive::Slab([0, 1, 2]), &[0.2, 0.3, 0.5]), 0);
}

#[test]
fn errors_name_point_joint_and_cause() {
    let joints = || vec![joint("root", Vec3::ZERO), joint("tip", Vec3::X)];
    let flat = SkinJoint { name: "flat".into(), inverse_bind: Affine3A::from_scale(Vec3::new(1.0, 0.0, 1.0)) };
    let with = |joint: u16, weight: f32| vec![[(0, 1.0); 4], [(joint, weight), (9, 0.0), (0, 0.0), (0, 0.0)]];
    let cases = [
        (vec![], vec![], "the skin has no joints"),
        (vec![joint("a", Vec3::X); MAX_JOINTS + 1], vec![], "the skin has 65537 joints, more than 65536"),
        (vec![joint("a", Vec3::X); 2], vec![], "joints 0 and 1 are both named `a`; rename one of them"),
        (
            vec![joint("a", Vec3::X), flat],
            vec![],
            "joint 1 `flat`: its inverse bind pose is not finite or not invertible; export the skin again",
        ),
        (
            vec![joint("a", Vec3::NAN)],
            vec![],
            "joint 0 `a`: its inverse bind pose is not finite or not invertible; export the skin again",
        ),
        (
            joints(),
            with(1, -0.5),
            "point 1: the weight -0.5 of joint 1 is negative or not finite; normalize the weights",
        ),
        (
            joints(),
            with(0, f32::NAN),
            "point 1: the weight NaN of joint 0 is negative or not finite; normalize the weights",
        ),
        (joints(), with(0, 0.0), "point 1: all of its weights are 0; assign it to a joint"),
        (joints(), with(2, 0.5), "point 1: there is no joint 2 among 2"),
    ];
    for (joints, weights, message) in cases {
        assert_eq!(Skin::new(joints, &weights).unwrap_err().to_string(), message);
    }
    // The largest weights are finite, and unused entries may name any joint.
    let skin = Skin::new(joints(), &[[(0, f32::MAX), (1, f32::MAX), (0, f32::MAX), (9, 0.0)]]).unwrap();
    let [(0, most), (1, rest), (0, 0.0), (0, 0.0)] = skin.weights()[0] else { panic!("{skin:?}") };
    assert!((most - 2.0 / 3.0).abs() < 1e-6 && (rest - 1.0 / 3.0).abs() < 1e-6);
    let axis = MedialAxis::torus(1.0, 0.2, 8).unwrap();
    let error = axis.with_skin(skin).unwrap_err();
    assert_eq!(error.to_string(), "the skin has weights for 1 points, the mesh has 8");
}

#[test]
fn an_axis_carries_its_skin() {
    let axis = MedialAxis::torus(1.0, 0.2, 8).unwrap();
    assert!(axis.skin().is_none());
    let (skin, before) = (two(&[0.5; 8]), axis.memory());
    let bound = axis.clone().with_skin(skin.clone()).unwrap();
    assert_eq!((bound.skin(), axis.skin()), (Some(&skin), None));
    assert!(bound.clone().with_coarser(vec![(bound.clone(), 0.1)]).level(1).skin() == Some(&skin));
    assert_eq!(bound.memory(), before + 8 * size_of::<JointWeights>());
}
