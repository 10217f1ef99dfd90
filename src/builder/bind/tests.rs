use std::f32::consts::{FRAC_PI_2, TAU};

use glam::{Affine3A, Vec3};

use super::*;
use crate::{
    builder::{measure, measure_without_folds},
    medial_axis::{SkinJoint, oracle::Envelope},
    random::Random,
};

/// Two capsules along x with radius 1 and a small gap between them, in one shape.
fn capsules() -> MedialAxis {
    let ball = |x: f32, y: f32| Sphere::new(Vec3::new(x, y, 0.0), 1.0);
    let spheres = vec![ball(0.0, 0.0), ball(2.0, 0.0), ball(4.0, 0.0), ball(0.0, 2.02), ball(4.0, 2.02)];
    MedialAxis::from_lists(spheres, &[[0, 1], [1, 2], [3, 4]], &[]).unwrap().0
}

/// Adds the surface of a capsule of [`capsules`] at a height.
fn add_capsule(mesh: &mut TriangleMesh, height: f32) {
    const RINGS: u32 = 41;
    const AROUND: u32 = 32;
    let first = mesh.positions.len() as u32;
    for ring in 0..RINGS {
        let along = (ring as f32 / 10.0).clamp(1.0, 3.0);
        let cap = (ring as f32 / 10.0 - along) * FRAC_PI_2;
        for turn in (0..AROUND).map(|side| side as f32 / AROUND as f32 * TAU) {
            let (sin, cos) = turn.sin_cos();
            let center = Vec3::new((along - 1.0) * 2.0, height, 0.0);
            mesh.positions.push(center + Vec3::new(cap.sin(), cap.cos() * cos, cap.cos() * sin));
        }
    }
    let at = |ring: u32, side: u32| first + ring * AROUND + side % AROUND;
    let quads = (0..RINGS - 1).flat_map(|ring| (0..AROUND).map(move |side| (ring, side)));
    mesh.triangles.extend(quads.flat_map(|(ring, side)| {
        let [a, b, c, d] = [at(ring, side), at(ring + 1, side), at(ring + 1, side + 1), at(ring, side + 1)];
        [[a, c, b], [a, d, c]]
    }));
}

/// The surface of both. The lower capsule follows joint 0 at x < 2 and joint 1 at x > 2, with a blend of 1 m. The upper one follows joint 2.
fn skinned() -> SkinnedTriangleMesh {
    let mut mesh = TriangleMesh { positions: vec![], triangles: vec![] };
    [0.0, 2.02].into_iter().for_each(|height| add_capsule(&mut mesh, height));
    let weights = mesh.positions.iter().map(|p| {
        let second = (p.x - 1.5).clamp(0.0, 1.0);
        if p.y > 1.01 { [(2, 1.0); 4] } else { [(0, 1.0 - second), (1, second), (0, 0.0), (0, 0.0)] }
    });
    let weights: Vec<JointWeights> = weights.collect();
    let joints = ["left", "right", "upper"];
    let joints = joints.map(|name| SkinJoint { name: name.into(), inverse_bind: Affine3A::IDENTITY });
    SkinnedTriangleMesh::new(mesh, joints.into(), &weights).unwrap()
}

fn main_weights(axis: &MedialAxis) -> Vec<(u16, f32)> {
    axis.skin().unwrap().weights().iter().map(|weights| weights[0]).collect()
}

#[test]
fn spheres_follow_their_own_limb_and_blend_at_joints() {
    let axis = capsules();
    let mesh = skinned();
    let near = |sphere: &Sphere, low: bool| {
        let reach = sphere.radius * REACH as f32;
        mesh.mesh().positions.iter().filter(|p| (p.y < 1.01) == low && p.distance(sphere.center) < reach).count()
    };
    assert!(near(&axis.spheres()[3], true) > 2 && near(&axis.spheres()[1], false) > 2, "the other limb is in reach");
    let bound = mesh.bind(&axis).unwrap();
    let [left, middle, right, upper, other] = main_weights(&bound)[..5] else { panic!("not five") };
    assert_eq!([left, right, upper, other], [(0, 1.0), (1, 1.0), (2, 1.0), (2, 1.0)]);
    assert!((middle.1 - 0.5).abs() < 0.05, "{middle:?}");
    assert_eq!(bound.spheres()[..5], *axis.spheres());
    assert_eq!(bound.skin().unwrap().joints(), mesh.skin().joints());
}

#[test]
fn spheres_are_added_where_weights_bend_and_do_not_change_the_shape() {
    // A slab and a cone.
    let spheres = [[0.0, 0.0], [4.0, 0.0], [2.0, -0.9], [0.0, 2.02], [4.0, 2.02]];
    let spheres = spheres.map(|[x, y]| Sphere::new(Vec3::new(x, y, 0.0), if y == -0.9 { 0.6 } else { 1.0 }));
    let (axis, _) = MedialAxis::from_lists(spheres.to_vec(), &[[3, 4]], &[[0, 1, 2]]).unwrap();
    let bound = skinned().bind(&axis).unwrap();
    let added = &bound.spheres()[5..];
    assert!((2..20).contains(&added.len()), "{added:?}");
    for sphere in added {
        assert!(
            (0.4..3.6).contains(&sphere.center.x) && sphere.center.y < 1.0,
            "{sphere:?} is in the straight limb or at an end"
        );
    }
    let (mut random, mut worst) = (Random(4), 0.0f64);
    let [before, after] = [&axis, &bound].map(|axis| Envelope::new(axis.spheres(), axis.primitives()));
    for _ in 0..2000 {
        let point = before.point_near_surface(&mut random);
        worst = worst.max((before.distance(point) - after.distance(point)).abs());
    }
    assert!(worst < 1e-5, "{worst}");
    // No two neighbours follow different joints only.
    let left = |sphere: u32| {
        let weights = &bound.skin().unwrap().weights()[sphere as usize];
        weights.iter().filter(|(joint, _)| *joint == 0).map(|(_, weight)| weight).sum::<f32>()
    };
    let mut largest = 0.0f32;
    for primitive in bound.primitives() {
        for pair in primitive.indices().windows(2) {
            largest = largest.max((left(pair[0]) - left(pair[1])).abs());
        }
    }
    assert!((0.2..0.9).contains(&largest), "{largest}");
}

#[test]
fn folds_of_the_skin_do_not_count() {
    // Two overlapping capsules in one mesh: the parts of each inside the other are folds.
    let mut mesh = TriangleMesh { positions: vec![], triangles: vec![] };
    [0.0, 1.0].into_iter().for_each(|height| add_capsule(&mut mesh, height));
    let ball = |x: f32, y: f32| Sphere::new(Vec3::new(x, y, 0.0), 1.0);
    let spheres = vec![ball(0.0, 0.0), ball(4.0, 0.0), ball(0.0, 1.0), ball(4.0, 1.0)];
    let (axis, _) = MedialAxis::from_lists(spheres, &[[0, 1], [2, 3]], &[]).unwrap();
    let [with, without] = [measure(&mesh, &axis), measure_without_folds(&mesh, &axis)];
    assert!(with.mesh_to_envelope.max > 10.0 && without.max() < 1.0, "{with}; {without}");
    // An error of the outer surface counts: a capsule is missing.
    let (half, _) = MedialAxis::from_lists(axis.spheres()[..2].to_vec(), &[[0, 1]], &[]).unwrap();
    assert!(measure_without_folds(&mesh, &half).mesh_to_envelope.max > 10.0);
}

#[test]
fn triangles_may_be_clockwise_or_degenerate() {
    let axis = capsules();
    let mesh = skinned();
    let turned = |change: &dyn Fn(&mut Vec<[u32; 3]>)| {
        let mut triangles = mesh.mesh().clone();
        change(&mut triangles.triangles);
        let joints = mesh.skin().joints().to_vec();
        main_weights(&SkinnedTriangleMesh::new(triangles, joints, mesh.skin().weights()).unwrap().bind(&axis).unwrap())
    };
    let expected = turned(&|_| {});
    assert_eq!(turned(&|triangles| triangles.iter_mut().for_each(|t| t.swap(0, 1))), expected);
    assert_eq!(turned(&|triangles| triangles.extend((0..50).map(|i| [i, i, i + 1]))), expected);
}

#[test]
fn a_sphere_beside_the_mesh_follows_the_nearest_surface() {
    let mesh = skinned();
    for (at, joint) in [(Vec3::new(-4.0, 0.0, 0.0), 0), (Vec3::new(9.0, -1.0, 0.0), 1), (Vec3::new(2.0, 6.0, 1.0), 2)] {
        let (axis, _) = MedialAxis::new(vec![Sphere::new(at, 0.0)], vec![Primitive::Sphere([0])]).unwrap();
        assert_eq!(main_weights(&mesh.bind(&axis).unwrap()), [(joint, 1.0)], "{at}");
    }
}
