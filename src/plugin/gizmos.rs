use bevy::prelude::*;

use super::MedialStep;

/// Gizmos of medial bodies. Off by default: enable the group, or single layers by their colours, in the `GizmoConfigStore`.
#[derive(GizmoConfigGroup, Reflect, Clone, Debug)]
#[reflect(Default)]
pub struct MedialGizmos {
    /// The spheres of each shape. Default: yellow.
    pub spheres: Option<Color>,
    /// The boxes of statics. Default: grey.
    pub boxes: Option<Color>,
    /// The way of each moving body's centre. Default: cyan.
    pub sweeps: Option<Color>,
    /// Contacts, drawn as their normals. Default: red.
    pub contacts: Option<Color>,
    /// Length of a normal, in metres. Default: 0.2.
    pub normal_length: f32,
}

impl Default for MedialGizmos {
    fn default() -> Self {
        Self {
            spheres: Some(Color::srgb(0.9, 0.8, 0.2)),
            boxes: Some(Color::srgb(0.6, 0.6, 0.6)),
            sweeps: Some(Color::srgb(0.2, 0.8, 0.9)),
            contacts: Some(Color::srgb(0.9, 0.2, 0.2)),
            normal_length: 0.2,
        }
    }
}

pub(super) fn add(app: &mut App) {
    app.insert_gizmo_config(MedialGizmos::default(), GizmoConfig { enabled: false, ..default() })
        .add_systems(Last, draw.run_if(|store: Res<GizmoConfigStore>| store.config::<MedialGizmos>().0.enabled));
}

fn draw(step: Res<MedialStep>, store: Res<GizmoConfigStore>, mut gizmos: Gizmos<MedialGizmos>) {
    let config = store.config::<MedialGizmos>().1;
    for body in &step.input.bodies {
        let sweep = &body.sweep;
        if let (Some(color), Some(shape)) = (config.spheres, body.solid.medial()) {
            {
                for sphere in shape.axis.spheres() {
                    let center = sweep.end.transform_point(sphere.center * shape.scale);
                    gizmos.sphere(center, sphere.radius * shape.scale, color).resolution(12);
                }
            }
        }
        if let Some(color) = config.sweeps {
            let center = sweep.start.transform_point(sweep.local_center);
            gizmos.line(center, center + sweep.translation, color);
        }
    }
    if let Some(color) = config.boxes {
        for body in step.statics.bodies() {
            let obb = body.obb();
            let transform = Transform::from_translation(obb.pose.translation)
                .with_rotation(obb.pose.rotation)
                .with_scale(obb.half_extents * 2.0);
            gizmos.cube(transform, color);
        }
    }
    if let Some(color) = config.contacts {
        for pair in &step.output.pairs {
            let end = step.final_pose(pair.first);
            for contact in step.output.manifolds[pair.manifolds.clone()].iter().flat_map(|m| m.contacts()) {
                let point = end.transform_point(contact.point1);
                gizmos.arrow(point, point + end.rotation * contact.normal1 * config.normal_length, color);
            }
        }
    }
}
