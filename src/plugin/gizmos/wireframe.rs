use bevy::{
    gizmos::{config::GizmoConfigGroup, gizmos::GizmoBuffer},
    prelude::*,
};

use crate::{
    geometry::{Pose3, Primitive, Sphere},
    medial_axis::{MedialAxis, face_normals, mantle_directions},
};

/// Sides of a great circle.
const SPHERE_SIDES: u32 = 16;
/// Lines along a cone.
const CONE_LINES: u32 = 4;

/// Where a shape is, and how large.
#[derive(Clone, Copy)]
pub(super) struct Place {
    pub pose: Pose3,
    pub scale: f32,
}

impl Place {
    /// The shape's own frame.
    pub const OWN: Self = Self { pose: Pose3::IDENTITY, scale: 1.0 };

    fn point(&self, point: Vec3) -> Vec3 {
        self.pose.transform_point(point * self.scale)
    }
}

/// Adds the lines of a shape in colours for its spheres, cones and slabs. What has none is left out.
pub(super) fn wireframe<Config: GizmoConfigGroup, Clear: Send + Sync + 'static>(
    lines: &mut GizmoBuffer<Config, Clear>,
    axis: &MedialAxis,
    place: Place,
    [spheres, cones, slabs]: [Option<Color>; 3],
) {
    // Where a plane of that normal touches a sphere.
    let touched = |corner: u32, normal: Vec3| {
        let sphere = &axis.spheres()[corner as usize];
        place.point(sphere.center + normal * sphere.radius)
    };
    if let Some(color) = spheres {
        for Sphere { center, radius } in axis.spheres().iter().filter(|sphere| sphere.radius > 0.0) {
            let isometry = Isometry3d::new(place.point(*center), place.pose.rotation);
            lines.sphere(isometry, radius * place.scale, color).resolution(SPHERE_SIDES);
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
