use bevy::{gizmos::gizmos::GizmoBuffer, prelude::*};

use crate::{
    geometry::{Pose3, Primitive, Sphere},
    medial_axis::{MedialAxis, face_normals, mantle_directions},
};

/// Sides of a great circle.
const SPHERE_SIDES: u32 = 16;
/// Lines along a cone.
const CONE_LINES: u32 = 4;

/// Lines of a shape in its own frame. Spheres, cones and slabs without a colour are left out.
pub(super) fn wireframe(axis: &MedialAxis, colors: [Option<Color>; 3]) -> GizmoAsset {
    let mut lines = GizmoAsset::new();
    draw(&mut lines, axis, &Pose3::IDENTITY, colors);
    lines
}

/// Draws the lines of a shape. `pose`: pose of its frame in the world.
pub(super) fn draw<Config: GizmoConfigGroup, Clear: 'static + Send + Sync>(
    lines: &mut GizmoBuffer<Config, Clear>,
    axis: &MedialAxis,
    pose: &Pose3,
    [spheres, cones, slabs]: [Option<Color>; 3],
) {
    // The point at which a plane with this normal touches a sphere.
    let touched = |corner: u32, normal: Vec3| {
        let sphere = &axis.spheres()[corner as usize];
        pose.transform_point(sphere.center + normal * sphere.radius)
    };
    if let Some(color) = spheres {
        for Sphere { center, radius } in axis.spheres().iter().filter(|sphere| sphere.radius > 0.0) {
            let place = Isometry3d::new(pose.transform_point(*center), pose.rotation);
            lines.sphere(place, *radius, color).resolution(SPHERE_SIDES);
        }
    }
    for primitive in axis.primitives() {
        match (primitive, cones, slabs) {
            (Primitive::Cone(corners), Some(color), _) => {
                let mut add_line = |direction: Vec3| {
                    let [from, to] = corners.map(|corner| touched(corner, direction));
                    lines.line(from, to, color);
                };
                let directions = mantle_directions(axis.spheres(), *corners, CONE_LINES);
                directions.into_iter().flatten().for_each(|direction| add_line(direction.as_vec3()));
            }
            (Primitive::Slab(corners), _, Some(color)) => {
                for normal in face_normals(axis.spheres(), *corners).into_iter().flatten() {
                    lines.lineloop(corners.map(|corner| touched(corner, normal.as_vec3())), color);
                }
            }
            _ => {}
        }
    }
}
