use super::*;

fn sphere(x: f32, y: f32, z: f32, radius: f32) -> Sphere {
    Sphere::new(Vec3::new(x, y, z), radius)
}

#[test]
fn a_point_on_the_axis_of_a_cone_without_radius_touches_it() {
    let point = [sphere(0.978_988_77, -0.155_454_08, 1.136_328_6, 0.0)];
    let cone =
        [sphere(0.976_103_96, -0.166_572_23, 1.137_034, 0.0), sphere(1.032_398_3, 0.050_387_785, 1.123_266_2, 0.0)];
    let found = separation(&point, &cone, 0);
    assert!(found.distance.abs() < 1e-6, "{found:?}");
}

#[test]
fn points_of_a_pair_far_apart_are_across_from_each_other() {
    let cone = [
        sphere(-62.815_254, 42.640_427, 160.476_44, 0.017_589_169),
        sphere(-62.797_565, 42.493_88, 159.864_18, 0.092_462_12),
    ];
    let slab = [
        sphere(62.729_24, -43.130_146, -159.463_7, 0.198_130_67),
        sphere(62.788_235, -43.364_43, -160.454_1, 0.230_135_96),
        sphere(62.893_833, -43.148_552, -160.440_05, 0.227_457_63),
    ];
    let found = separation(&cone, &slab, 0);
    let apart = found.point2 - found.point1;
    assert!(apart.reject_from(found.normal).length() < 1e-3, "{found:?}");
    assert!((apart.length() - found.distance).abs() < 1e-4, "{found:?}");
}
