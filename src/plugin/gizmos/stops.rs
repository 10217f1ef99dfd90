//! Shapes of bodies at their stops. Their lines are retained, like those beside bodies.

use bevy::prelude::*;

use super::{
    MedialGizmo, MedialGizmos,
    lines::{Drawing, Lines},
    step::color,
    wireframe::wireframe,
};
use crate::{
    medial_axis::MedialAxis,
    pipeline::{Shape, Side},
    plugin::{MedialLevel, MedialMesh, MedialStep},
};

/// Shows the shape of a body that has stopped. Each step uses these entities again, for other bodies.
#[derive(Component)]
pub(super) struct StopOutline;

/// Places an outline at each stop of the last step.
pub(super) fn outline(
    mut commands: Commands,
    step: Res<MedialStep>,
    store: Res<GizmoConfigStore>,
    overrides: Query<&MedialGizmo>,
    meshes: Query<(&MedialMesh, &MedialLevel)>,
    axes: Res<Assets<MedialAxis>>,
    mut lines: ResMut<Lines>,
    mut gizmos: ResMut<Assets<GizmoAsset>>,
    mut outlines: Query<(Entity, &mut Gizmo, &mut GlobalTransform), With<StopOutline>>,
) {
    let (group, layers) = store.config::<MedialGizmos>();
    let mut spare = outlines.iter_mut();
    for stop in step.output.stops.iter().filter(|_| group.enabled && layers.stops.enabled) {
        let side = Side::Body(stop.body);
        let entity = step.info(side).entity;
        let Some(Shape { axis, scale }) = step.solid(side).medial() else { continue };
        let Some(color) = color(&layers.stops, overrides.get(entity).ok()) else { continue };
        let Ok((mesh, level)) = meshes.get(entity) else { continue };
        let Some(drawn) = axes.get(&mesh.0).map(|finest| finest.level(level.0)) else { continue };
        let colors = [Some(color); 3];
        let drawing = Drawing::new(mesh.0.id(), level.0, colors);
        let handle = lines.get(drawing, &mut gizmos, || wireframe(drawn, colors));
        // The lines are those of the asset; the shape may be its mirror image.
        let side = if drawn.address() == axis.address() { 1.0 } else { -1.0 };
        let scale = *scale * Vec3::new(side, 1.0, 1.0);
        let place = Transform { translation: stop.pose.translation, rotation: stop.pose.rotation, scale };
        match spare.next() {
            Some((_, mut gizmo, mut transform)) => {
                gizmo.handle = handle;
                *transform = place.into();
            }
            None => {
                let gizmo = Gizmo { handle, line_config: group.line.clone(), depth_bias: group.depth_bias };
                let place = (place, GlobalTransform::from(place));
                commands.spawn((StopOutline, gizmo, group.render_layers.clone(), place));
            }
        }
    }
    for (entity, ..) in spare {
        commands.entity(entity).despawn();
    }
}
