use glam::Vec3;

use super::*;

fn ball(x: f32, y: f32, z: f32, radius: f32) -> Sphere {
    Sphere::new(Vec3::new(x, y, z), radius)
}

#[test]
fn errors_name_what_and_where() {
    let good = || vec![ball(0.0, 0.0, 0.0, 1.0), ball(3.0, 0.0, 0.0, 1.0)];
    let with = |sphere: Sphere| vec![good()[0], sphere];
    let cone = || vec![Primitive::Cone([0, 1])];
    let cases = [
        (vec![], vec![], "the shape has no spheres"),
        (vec![good()[0]; MAX_SPHERES + 1], vec![], "the shape has 1048577 spheres, more than 1048576"),
        (with(ball(0.0, f32::NAN, 0.0, 1.0)), cone(), "sphere 1: NaN is not a number from -1000000 to 1000000"),
        (with(ball(0.0, 0.0, 0.0, f32::INFINITY)), cone(), "sphere 1: inf is not a number from -1000000 to 1000000"),
        (with(ball(-2.0e6, 0.0, 0.0, 1.0)), cone(), "sphere 1: -2000000 is not a number from -1000000 to 1000000"),
        (with(ball(0.0, 0.0, 0.0, -0.5)), cone(), "sphere 1: the radius -0.5 is negative"),
        (
            good(),
            vec![Primitive::Cone([0, 1]), Primitive::Slab([0, 1, 2])],
            "primitive 1: there is no sphere 2 among 2",
        ),
    ];
    for (spheres, primitives, message) in cases {
        assert_eq!(MedialAxis::new(spheres, primitives).unwrap_err().to_string(), message);
    }
}

#[test]
fn spheres_without_a_primitive_become_one() {
    let spheres = vec![ball(0.0, 0.0, 0.0, 1.0), ball(3.0, 0.0, 0.0, 1.0), ball(9.0, 0.0, 0.0, 0.5)];
    let (axis, report) = MedialAxis::new(spheres, vec![Primitive::Cone([1, 0])]).unwrap();
    assert_eq!(axis.primitives(), [Primitive::Sphere([2]), Primitive::Cone([0, 1])]);
    assert_eq!(report.isolated_spheres, 1);
    assert_eq!(axis.min_radius(), 0.5);
    assert_eq!(axis.aabb(), Aabb { min: Vec3::splat(-1.0), max: Vec3::new(9.5, 1.0, 1.0) });
}
