//! The colliders of rapier, and true distances from them.

use bevy::math::{DVec2, DVec3};
use bevy_rapier3d::parry::{
    query::{ClosestPoints, details::closest_points_segment_segment},
    shape::{Cone, Cylinder, Segment, SharedShape, Triangle, TypedShape},
};

use super::*;

/// A collider, and the pose that turns one of its sides up and puts the top of that side at height 0.
#[derive(Clone)]
pub(super) struct Case {
    pub(super) name: &'static str,
    pub(super) collider: Collider,
    pub(super) pose: Transform,
    /// True if a body can lie on it. Otherwise bodies roll off.
    pub(super) flat: bool,
    /// True if it has an interior, and so mass.
    pub(super) solid: bool,
    /// Half of its thickness from top to bottom, in metres; 0 without thickness.
    pub(super) half_height: f32,
}

impl Case {
    /// Accuracy of parry's iteration in metres. This crate uses it for curved shapes.
    pub(super) fn tolerance(&self) -> f32 {
        if self.name.contains("cylinder") || self.name.contains("cone") { 5e-3 } else { 2e-3 }
    }
}

pub(super) const CORNERS: [Vec3; 3] = [Vec3::new(-4.0, 0.0, -3.0), Vec3::new(0.0, 0.0, 6.0), Vec3::new(4.0, 0.0, -3.0)];

pub(super) fn cases() -> Vec<Case> {
    let case = |name, collider: Collider, height: f32, flat, solid| Case {
        name,
        collider,
        pose: Transform::from_xyz(0.0, -height, 0.0),
        flat,
        solid,
        half_height: height,
    };
    let shape = |shape: SharedShape| Collider::from(shape);
    let grid = |x: u32, z: u32| Vec3::new(x as f32 - 2.0, 0.0, z as f32 - 2.0);
    let vertices: Vec<Vec3> = (0..25).map(|i| grid(i % 5, i / 5)).collect();
    let cells = (0..16u32).map(|i| i % 4 + i / 4 * 5);
    let triangles: Vec<[u32; 3]> = cells.flat_map(|i| [[i, i + 5, i + 1], [i + 1, i + 5, i + 6]]).collect();
    let corners: Vec<Vec3> = (0..8)
        .map(|i| Vec3::new((i & 1) as f32 * 4.0 - 2.0, (i >> 1 & 1) as f32 * 0.6 - 0.3, (i >> 2) as f32 * 4.0 - 2.0))
        .collect();
    let plate = |x: f32| (Vec3::new(x, 0.0, 0.0), Quat::IDENTITY, Collider::cuboid(1.0, 0.3, 2.0));
    let voxels: Vec<IVec3> = (-4..4).flat_map(|x| (-4..4).map(move |z| IVec3::new(x, 0, z))).collect();
    let along = Vec3::X * 2.0;
    let mut cone = case("cone", Collider::cone(0.3, 2.0), 0.3, true, true);
    cone.pose.rotation = Quat::from_rotation_x(std::f32::consts::PI);
    let mut round_cone = case("round cone", Collider::round_cone(0.25, 1.9, 0.05), 0.3, true, true);
    round_cone.pose.rotation = cone.pose.rotation;
    let mut voxels = case("voxels", Collider::voxels(Vec3::splat(0.5), &voxels), 0.25, true, true);
    voxels.pose.translation.y = -0.5;
    vec![
        case("ball", Collider::ball(0.5), 0.5, false, true),
        case("cuboid", Collider::cuboid(2.0, 0.3, 2.0), 0.3, true, true),
        case("capsule", Collider::capsule(-along, along, 0.3), 0.3, false, true),
        case("cylinder", Collider::cylinder(0.3, 2.0), 0.3, true, true),
        cone,
        case("half-space", Collider::halfspace(Vec3::Y).unwrap(), 0.0, true, false),
        case("convex hull", Collider::convex_hull(&corners).unwrap(), 0.3, true, true),
        case("segment", Collider::segment(-along, along), 0.0, false, false),
        case("polyline", Collider::polyline(vec![-along, Vec3::X * 0.3, along], None), 0.0, false, false),
        case("triangle", Collider::triangle(CORNERS[0], CORNERS[1], CORNERS[2]), 0.0, true, false),
        case("triangle mesh", Collider::trimesh(vertices, triangles).unwrap(), 0.0, true, false),
        case("height field", Collider::heightfield(vec![0.0; 25], 5, 5, Vec3::new(4.0, 1.0, 4.0)), 0.0, true, false),
        voxels,
        case("compound", Collider::compound(vec![plate(-1.0), plate(1.0)]), 0.3, true, true),
        case("round cuboid", Collider::round_cuboid(1.9, 0.25, 1.9, 0.05), 0.3, true, true),
        case("round cylinder", Collider::round_cylinder(0.25, 1.9, 0.05), 0.3, true, true),
        round_cone,
        case("round convex hull", Collider::round_convex_hull(&corners, 0.05).unwrap(), 0.35, true, true),
        case(
            "round triangle",
            shape(SharedShape::round_triangle(CORNERS[0], CORNERS[1], CORNERS[2], 0.1)),
            0.1,
            true,
            false,
        ),
    ]
}

pub(super) const RADIUS: f32 = 0.1;

pub(super) fn capsule() -> MedialAxis {
    MedialAxis::capsule(Vec3::X * -0.3, Vec3::X * 0.3, RADIUS).unwrap()
}

/// The same solid in a form whose distance parry can compute.
pub(super) fn reference(shape: &SharedShape) -> SharedShape {
    match shape.as_typed_shape() {
        TypedShape::HeightField(field) => {
            let (vertices, triangles) = field.to_trimesh();
            SharedShape::trimesh(vertices, triangles).unwrap()
        }
        // The box that all voxels fill.
        TypedShape::Voxels(_) => {
            let block = SharedShape::cuboid(2.0, 0.25, 2.0);
            SharedShape::compound(vec![(Pose3::from_translation(Vec3::Y * 0.25), block)])
        }
        _ => shape.clone(),
    }
}

/// The capsule, a slab and a ring of cones: all spheres have one radius.
pub(super) fn probes() -> [MedialAxis; 3] {
    let corners = [Vec3::new(0.3, 0.0, 0.0), Vec3::new(-0.2, 0.1, 0.2), Vec3::new(-0.1, -0.1, -0.3)];
    let slab = MedialAxis::from_lists(corners.map(|corner| Sphere::new(corner, RADIUS)).into(), &[], &[[0, 1, 2]]);
    [capsule(), slab.unwrap().0, MedialAxis::torus(0.3, RADIUS, 12).unwrap()]
}

/// Distance between a collider and a medial body whose spheres have one radius: the smallest distance of the body's segments and triangles.
/// `None` if one of them crosses the collider.
pub(super) fn true_distance(axis: &MedialAxis, pose12: &Pose3, shape: &dyn ParryShape) -> Option<f32> {
    let corner = |&sphere: &u32| axis.spheres()[sphere as usize].center;
    let of_primitive = |primitive: &Primitive| match *primitive.indices().iter().map(corner).collect::<Vec<_>>() {
        [a, b] => core_distance(&Segment::new(a, b), pose12, shape),
        [a, b, c] => core_distance(&Triangle::new(a, b, c), pose12, shape),
        _ => unreachable!("a single sphere"),
    };
    let distance = axis.primitives().iter().map(of_primitive).fold(f32::INFINITY, f32::min);
    (distance > 0.0).then_some(distance - RADIUS)
}

/// Distance between a collider and a segment or a triangle: in closed form, or by an exact method of parry.
pub(super) fn core_distance(core: &dyn ParryShape, pose12: &Pose3, shape: &dyn ParryShape) -> f32 {
    let to = |shape: &dyn ParryShape| query::distance(&Pose3::IDENTITY, core, pose12, shape).unwrap();
    let to_segment = |segment: &Segment| {
        let TypedShape::Segment(axis) = core.as_typed_shape() else { return to(segment) };
        let ends = closest_points_segment_segment(pose12, axis, segment, f32::MAX);
        let ClosestPoints::WithinMargin(point1, point2) = ends else { return 0.0 };
        point1.distance(pose12.transform_point(point2))
    };
    let to_revolved = |distance: &dyn Fn(DVec2) -> f64| least_distance(core, &pose12.inverse(), distance);
    match shape.as_typed_shape() {
        TypedShape::Capsule(capsule) => to_segment(&capsule.segment) - capsule.radius,
        TypedShape::Segment(segment) => to_segment(segment),
        TypedShape::Polyline(line) => line.segments().map(|s| to_segment(&s)).fold(f32::INFINITY, f32::min),
        TypedShape::Cylinder(cylinder) => to_revolved(&|point| from_cylinder(cylinder, point)),
        TypedShape::Cone(cone) => to_revolved(&|point| from_cone(cone, point)),
        TypedShape::RoundTriangle(round) => to(&round.inner_shape) - round.border_radius,
        TypedShape::RoundCuboid(round) => to(&round.inner_shape) - round.border_radius,
        TypedShape::RoundCylinder(round) => {
            to_revolved(&|point| from_cylinder(&round.inner_shape, point)) - round.border_radius
        }
        TypedShape::RoundCone(round) => {
            to_revolved(&|point| from_cone(&round.inner_shape, point)) - round.border_radius
        }
        TypedShape::RoundConvexPolyhedron(round) => to(&round.inner_shape) - round.border_radius,
        _ => to(shape),
    }
}

/// Distance from a cylinder to a point. The point is given by its distance from the axis and its height.
pub(super) fn from_cylinder(cylinder: &Cylinder, point: DVec2) -> f64 {
    let corner = DVec2::new(cylinder.radius.into(), cylinder.half_height.into());
    (DVec2::new(point.x, point.y.abs()) - corner).max(DVec2::ZERO).length()
}

/// Distance from a cone to a point in the same form.
pub(super) fn from_cone(cone: &Cone, point: DVec2) -> f64 {
    let (radius, half) = (f64::from(cone.radius), f64::from(cone.half_height));
    let [axis, rim, tip] = [DVec2::new(0.0, -half), DVec2::new(radius, -half), DVec2::new(0.0, half)];
    if point.y >= -half && (tip - rim).perp_dot(point - rim) >= 0.0 {
        return 0.0;
    }
    let from_edge = |a: DVec2, b: DVec2| {
        let along = (point - a).dot(b - a) / (b - a).length_squared();
        point.distance(a.lerp(b, along.clamp(0.0, 1.0)))
    };
    from_edge(axis, rim).min(from_edge(rim, tip))
}

/// Smallest distance of a segment or a triangle from a convex solid of revolution about the y axis. `from_solid` returns the distance of a point.
pub(super) fn least_distance(core: &dyn ParryShape, pose: &Pose3, from_solid: &dyn Fn(DVec2) -> f64) -> f32 {
    let placed = |point: Vec3| pose.transform_point(point).as_dvec3();
    let at = |point: DVec3| from_solid(DVec2::new(point.x.hypot(point.z), point.y));
    let least = match core.as_typed_shape() {
        TypedShape::Segment(segment) => {
            let [a, b] = [segment.a, segment.b].map(placed);
            least(1.0, &|t| at(a.lerp(b, t)))
        }
        TypedShape::Triangle(triangle) => {
            let [a, b, c] = [triangle.a, triangle.b, triangle.c].map(placed);
            least(1.0, &|t| least(t, &|u| at(a + (b - a) * t + (c - b) * u)))
        }
        _ => unreachable!("no core"),
    };
    least as f32
}

/// The minimum of a convex function from 0 to `end`.
pub(super) fn least(end: f64, value: &dyn Fn(f64) -> f64) -> f64 {
    let (mut low, mut high) = (0.0, end);
    for _ in 0..50 {
        let [a, b] = [(2.0 * low + high) / 3.0, (low + 2.0 * high) / 3.0];
        if value(a) < value(b) { high = b } else { low = a }
    }
    value(0.5 * (low + high))
}

pub(super) fn spawn_fixed(app: &mut App, case: &Case, at: Transform) -> Entity {
    app.world_mut().spawn((case.collider.clone(), at * case.pose)).id()
}

/// A collider across the path of a shot along x; its top faces the shot.
pub(super) fn upright(at: Vec3) -> Transform {
    Transform::from_translation(at).with_rotation(Quat::from_rotation_z(std::f32::consts::FRAC_PI_2))
}
