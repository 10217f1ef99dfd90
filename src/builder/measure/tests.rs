use std::f32::consts::{PI, TAU};

use super::*;
use crate::{
    builder::mesh::tests::triangulated,
    medial_axis::{
        ma,
        oracle::{self, Envelope as Oracle},
    },
    random::Random,
};

/// The surface of revolution of a closed or open profile (distance from the z axis, height) about the z axis.
fn lathe(profile: &[[f32; 2]], closed: bool, segments: u32) -> TriangleMesh {
    let rows = profile.len() as u32;
    let positions = profile.iter().flat_map(|&[radius, height]| {
        (0..segments).map(move |i| {
            let (sin, cos) = (TAU * i as f32 / segments as f32).sin_cos();
            Vec3::new(radius * cos, radius * sin, height)
        })
    });
    let quads = (0..rows - u32::from(!closed)).flat_map(|row| (0..segments).map(move |i| [row, i]));
    let triangles = quads.flat_map(|[row, i]| {
        let at = |row: u32, i: u32| row % rows * segments + i % segments;
        let [a, b, c, d] = [at(row, i), at(row, i + 1), at(row + 1, i + 1), at(row + 1, i)];
        [[a, b, c], [a, c, d]]
    });
    TriangleMesh::new(positions.collect(), triangles.collect()).unwrap()
}

/// A sphere with its halves `length` apart along the z axis.
fn capsule(radius: f32, length: f32, segments: u32) -> TriangleMesh {
    let profile: Vec<_> = (0..=segments)
        .map(|i| {
            let (sin, cos) = (PI * i as f32 / segments as f32).sin_cos();
            [radius * sin, -radius * cos + if 2 * i > segments { length } else { 0.0 }]
        })
        .collect();
    lathe(&profile, false, segments)
}

fn cuboid(half: Vec3) -> TriangleMesh {
    let positions = (0..8).map(|i| half * Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32) * 2.0 - half);
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangles = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]);
    TriangleMesh::new(positions.collect(), triangles.collect()).unwrap()
}

fn torus(major: f32, minor: f32) -> TriangleMesh {
    let profile: Vec<_> = (0..24)
        .map(|i| {
            let (sin, cos) = (TAU * i as f32 / 24.0).sin_cos();
            [major + minor * cos, minor * sin]
        })
        .collect();
    let mut mesh = lathe(&profile, true, 48);
    // The medial torus lies about the y axis.
    mesh.positions.iter_mut().for_each(|p| *p = Vec3::new(p.y, p.z, p.x));
    mesh
}

/// A model of the project, and a triangulation of it that includes hidden patches.
fn model(name: &str, segments: u32) -> (TriangleMesh, MedialAxis) {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/assets/models/");
    let (axis, _) = ma::parse(&std::fs::read(format!("{path}{name}.ma")).unwrap()).unwrap().into_medial_axis().unwrap();
    (triangulated(&axis, segments), axis)
}

/// Distance to the nearest triangle, by brute force in f64.
fn to_mesh(mesh: &TriangleMesh, point: DVec3) -> f64 {
    let to_segment = |a: DVec3, b: DVec3| {
        let t = (point - a).dot(b - a) / (b - a).length_squared();
        point.distance(a.lerp(b, if t.is_finite() { t.clamp(0.0, 1.0) } else { 0.0 }))
    };
    let to_triangle = |triangle: &[u32; 3]| {
        let [a, b, c] = mesh.corners(*triangle).map(|p| p.as_dvec3());
        let normal = (b - a).cross(c - a);
        let above = [[a, b], [b, c], [c, a]].iter().all(|[a, b]| (b - a).cross(point - a).dot(normal) >= 0.0);
        let rim = to_segment(a, b).min(to_segment(b, c)).min(to_segment(c, a));
        if above && normal != DVec3::ZERO { (point - a).dot(normal.normalize()).abs() } else { rim }
    };
    mesh.triangles.iter().map(to_triangle).fold(f64::INFINITY, f64::min)
}

/// Slow reference results in f64, independent of the tested code. Points on the mesh are random by area. Points on the envelope are all crossings with
/// random lines, which are spread evenly over the area as well. Returns max and mean in each direction, in percent.
fn brute_force(mesh: &TriangleMesh, axis: &MedialAxis, random: &mut Random, count: usize) -> [[f64; 2]; 2] {
    let envelope = Oracle::new(axis.spheres(), axis.primitives());
    let corners = |t: &[u32; 3]| mesh.corners(*t).map(|p| p.as_dvec3());
    let mut areas = vec![0.0];
    for triangle in &mesh.triangles {
        let [a, b, c] = corners(triangle);
        areas.push(areas[areas.len() - 1] + (b - a).cross(c - a).length());
    }
    let on_mesh: Vec<f64> = (0..count)
        .map(|_| {
            let at = areas[areas.len() - 1] * f64::from(random.unit());
            let [a, b, c] = corners(&mesh.triangles[areas[1..].partition_point(|&area| area < at)]);
            let [u, v] = [f64::from(random.unit()).sqrt(), f64::from(random.unit())];
            envelope.distance(a * (1.0 - u) + b * u * (1.0 - v) + c * u * v).abs()
        })
        .collect();

    let bound = axis.bounding_sphere();
    let (center, reach) = (bound.center.as_dvec3(), 1.01 * f64::from(bound.radius));
    let mut on_envelope = Vec::new();
    while on_envelope.len() < count {
        let direction = random_direction(random);
        let (side, up) = direction.any_orthonormal_pair();
        let (y, x) = (f64::from(random.unit()) * std::f64::consts::TAU).sin_cos();
        let offset = (side * x + up * y) * reach * f64::from(random.unit()).sqrt();
        let (mut along, mut inside) = (-reach, false);
        while along < reach {
            let point = center + offset + direction * along;
            let distance = envelope.distance(point);
            if (distance < 0.0) != inside {
                inside = !inside;
                on_envelope.push(to_mesh(mesh, point));
            }
            along += distance.abs().max(1e-5 * reach);
        }
    }
    let diagonal = f64::from(mesh.diagonal());
    [on_mesh, on_envelope].map(|distances| {
        let max = distances.iter().copied().fold(0.0, f64::max);
        [max, distances.iter().sum::<f64>() / distances.len() as f64].map(|x| x / diagonal * 100.0)
    })
}

fn random_direction(random: &mut Random) -> DVec3 {
    loop {
        let vector = random.in_cube().as_dvec3();
        if (0.01..1.0).contains(&vector.length_squared()) {
            return vector.normalize();
        }
    }
}

fn assert_like_brute_force(name: &str, mesh: &TriangleMesh, axis: &MedialAxis, count: usize) {
    let found = measure(mesh, axis);
    let slow = brute_force(mesh, axis, &mut Random(21), count);
    println!("{name}: {found}; {count} random points: {slow:.4?}");
    for (found, [max, mean]) in [found.mesh_to_envelope, found.envelope_to_mesh].iter().zip(slow) {
        let [found_max, found_mean] = [f64::from(found.max), f64::from(found.mean)];
        // A thousand random points come near the farthest place, for example the tip of a limb. The points of `measure` come nearer.
        let slack = 2e-3 + 0.02 * found_max;
        assert!(max < found_max + slack && max > 0.7 * found_max - slack, "{name}: max {max} {found:?}");
        assert!((mean - found_mean).abs() < 2e-3 + 0.08 * found_mean, "{name}: mean {mean} {found:?}");
    }
}

#[test]
fn known_errors_are_measured() {
    let ball = MedialAxis::sphere(0.9).unwrap();
    let cube = cuboid(Vec3::ONE);
    let diagonal = 2.0 * 3f32.sqrt();
    let near = |found: f32, expected: f32| {
        assert!((found - 100.0 * expected / diagonal).abs() < 0.08, "{found} % instead of {expected} of {diagonal}");
    };
    let sphere = measure(&capsule(1.0, 0.0, 128), &ball);
    for deviation in [sphere.mesh_to_envelope, sphere.envelope_to_mesh] {
        near(deviation.max, 0.1);
        near(deviation.mean, 0.1);
    }
    // A ball in a box: the box's corners are far from the ball, and the ball is far from the faces in the direction of the corners.
    let boxed = measure(&cube, &MedialAxis::sphere(1.0).unwrap());
    near(boxed.mesh_to_envelope.max, 3f32.sqrt() - 1.0);
    near(boxed.envelope_to_mesh.max, 1.0 - 1.0 / 3f32.sqrt());
    assert_eq!((boxed.diagonal, boxed.max()), (diagonal, boxed.mesh_to_envelope.max));
    let exact = measure(&cube, &MedialAxis::rounded_box(Vec3::ONE, 0.0).unwrap());
    assert!(exact.max() < 1e-3, "{exact}");
}

#[test]
fn each_direction_finds_faults_that_the_other_misses() {
    let at = |x: f32| Sphere::new(Vec3::new(x, 0.0, 0.0), 0.5);
    let of = |spheres: Vec<Sphere>| MedialAxis::new(spheres, vec![]).unwrap().0;
    let one = capsule(0.5, 0.0, 128);
    let mut two = one.clone();
    two.positions.extend(one.positions.iter().map(|p| *p + Vec3::X * 3.0));
    let first = one.positions.len() as u32;
    two.triangles.extend(one.triangles.iter().map(|t| t.map(|i| first + i)));

    let extra = measure(&one, &of(vec![at(0.0), at(3.0)]));
    assert!(extra.mesh_to_envelope.max < 0.1, "{extra}");
    assert!((extra.envelope_to_mesh.max - 300.0 / 3f32.sqrt()).abs() < 0.1, "{extra}");
    let missing = measure(&two, &of(vec![at(0.0)]));
    assert!(missing.envelope_to_mesh.max < 0.1, "{missing}");
    assert!((missing.mesh_to_envelope.max - 300.0 / 18f32.sqrt()).abs() < 0.1, "{missing}");
    let both = measure(&two, &of(vec![at(0.0), at(3.0)]));
    assert!(both.max() < 0.1, "{both}");
}

#[test]
fn agrees_with_brute_force_on_simple_shapes() {
    let half = Vec3::new(0.5, 0.8, 0.6);
    let rod = MedialAxis::cone(Sphere::new(Vec3::ZERO, 0.4), Sphere::new(Vec3::Z * 0.9, 0.25)).unwrap();
    let cases = [
        ("sphere", capsule(1.0, 0.0, 48), MedialAxis::sphere(0.9).unwrap()),
        ("capsule", capsule(0.4, 1.0, 48), rod),
        ("box", cuboid(half), MedialAxis::rounded_box(half * 0.95, 0.2).unwrap()),
        ("torus", torus(1.0, 0.3), MedialAxis::torus(1.0, 0.28, 9).unwrap()),
    ];
    for (name, mesh, axis) in cases {
        assert_like_brute_force(name, &mesh, &axis, 1500);
    }
}

#[test]
fn agrees_with_brute_force_on_a_model() {
    let [(mesh, _), (_, cow)] = ["bear", "cow"].map(|name| model(name, 8));
    assert_like_brute_force("bear against cow", &mesh, &cow, 4000);
}

#[cfg(feature = "mesh_files")]
#[test]
fn agrees_with_brute_force_on_mesh_files() {
    let files = oracle::model_files(&["bear.obj", "cow.ma"], &["cow.obj", "qmat/cow_q82.ma"]);
    for pair in files.chunks_exact(2) {
        let mesh = crate::builder::load::load(&pair[0]).unwrap();
        let (axis, _) = ma::parse(&std::fs::read(&pair[1]).unwrap()).unwrap().into_medial_axis().unwrap();
        assert_like_brute_force(&pair[1].display().to_string(), &mesh, &axis, 4000);
    }
}

#[test]
fn each_distance_is_exact() {
    let (mesh, axis) = model("spider", 12);
    let frame = Frame::new(&mesh, &axis);
    let envelope = frame.envelope(&axis);
    let surface = TriangleTree::new(&frame.triangles(&mesh));
    let oracle = Oracle::new(axis.spheres(), axis.primitives());
    let mut random = Random(5);
    let mut inside = 0;
    for _ in 0..500 {
        let point = oracle.point_near_surface(&mut random).as_vec3();
        let expected = [oracle.distance(point.as_dvec3()), to_mesh(&mesh, point.as_dvec3())];
        let placed = frame.point(point);
        let to_envelope = envelope.distances(&Points::new(vec![placed]))[0];
        let found = [to_envelope, f64::from(surface.distance(placed))].map(|distance| distance * frame.unit);
        for (found, expected) in found.iter().zip(expected) {
            assert!((found - expected).abs() < 2e-5 * frame.unit, "{found} instead of {expected} at {point}");
        }
        inside += usize::from(expected[0] < 0.0);
    }
    assert!((25..475).contains(&inside), "{inside} points inside");
}

#[test]
fn far_from_the_origin_little_is_lost() {
    let (mut mesh, axis) = model("dolphin", 12);
    let here = measure(&mesh, &axis);
    // A power of two, so that coordinates keep most of their bits.
    let shift = Vec3::new(256.0, -512.0, 128.0);
    mesh.positions.iter_mut().for_each(|p| *p += shift);
    let spheres = axis.spheres().iter().map(|s| Sphere::new(s.center + shift, s.radius)).collect();
    let there = measure(&mesh, &MedialAxis::new(spheres, axis.primitives().to_vec()).unwrap().0);
    assert!((here.max() - there.max()).abs() < 0.02, "{here} and {there}");
    assert!((here.envelope_to_mesh.mean - there.envelope_to_mesh.mean).abs() < 0.01, "{here} and {there}");
}

#[test]
fn the_side_of_each_vertex_is_correct() {
    let mesh = capsule(1.0, 0.0, 128);
    let diagonal = mesh.diagonal();
    for radius in [0.8, 1.1f32] {
        let expected = 100.0 * (1.0 - radius) / diagonal;
        let errors = vertex_errors(&mesh, &MedialAxis::sphere(radius).unwrap());
        assert_eq!(errors.len(), mesh.positions.len());
        assert!(errors.iter().all(|error| (error - expected).abs() < 1e-3), "{expected}: {:?}", &errors[..5]);
    }
}

#[test]
fn wild_sizes_give_finite_errors() {
    let tiny = cuboid(Vec3::splat(1e-6));
    let flat = cuboid(Vec3::new(1e5, 0.0, 1e5));
    let huge = Sphere::new(Vec3::splat(9e5), 9e5);
    for mesh in [&tiny, &flat] {
        for spheres in [vec![huge], vec![Sphere::new(Vec3::ZERO, 0.0)], vec![huge, Sphere::new(Vec3::ZERO, 1e-9)]] {
            let error = measure(mesh, &MedialAxis::new(spheres, vec![]).unwrap().0);
            let all = [error.mesh_to_envelope, error.envelope_to_mesh].map(|d| [d.max, d.mean]);
            assert!(all.iter().flatten().all(|x| x.is_finite() && *x >= 0.0), "{error}");
        }
    }
}
