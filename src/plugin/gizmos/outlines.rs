//! One child of each body that shows the lines of its shape.

use bevy::{camera::visibility::RenderLayers, prelude::*};

use super::{
    MedialGizmo, MedialGizmos,
    lines::{Drawing, Lines},
    stops::StopOutline,
    wireframe::wireframe,
};
use crate::{
    medial_axis::MedialAxis,
    plugin::{Changes, MedialLevel, MedialMesh},
};

/// The lines of an entity, and the child that shows them. A clone of the entity gets its own child.
#[derive(Component, Clone, Copy)]
#[component(clone_behavior = Ignore)]
pub(super) struct Outlined {
    drawing: Drawing,
    outline: Entity,
}

/// A child that only shows its parent's lines.
#[derive(Component)]
pub(super) struct Outline;

/// Adds a child with lines to each entity whose shape is to be drawn, and removes children that are not needed.
pub(super) fn outline(
    mut commands: Commands,
    store: Res<GizmoConfigStore>,
    meshes: Query<(Entity, &MedialMesh, Option<&MedialLevel>, Option<&MedialGizmo>, Option<&Outlined>)>,
    left: Query<(Entity, &Outlined), Without<MedialMesh>>,
    outlines: Query<(), With<Outline>>,
    axes: Res<Assets<MedialAxis>>,
    mut changes: Changes<MedialAxis>,
    mut gizmos: ResMut<Assets<GizmoAsset>>,
    mut shared: ResMut<Lines>,
) {
    let (group, layers) = store.config::<MedialGizmos>();
    let changed = changes.read();
    shared.clean(&changed);
    for (entity, outlined) in &left {
        remove(&mut commands, entity, outlined);
    }
    for (entity, mesh, level, gizmo, outlined) in &meshes {
        let asset = mesh.0.id();
        let level = level.map_or(0, |level| level.0);
        let axis = axes.get(asset);
        let coarseness = axis.map_or(0.0, |axis| level as f32 / axis.coarser().len().max(1) as f32);
        let colors = colors(group.enabled, layers, coarseness, gizmo);
        let wanted = axis.filter(|_| colors != [None; 3]).map(|axis| (axis, Drawing::new(asset, level, colors)));
        let is_drawn = |outlined: &&Outlined| outlines.contains(outlined.outline) && !changed.contains(&asset);
        if outlined.filter(is_drawn).map(|outlined| outlined.drawing) == wanted.map(|(_, drawing)| drawing) {
            continue;
        }
        if let Some(outlined) = outlined {
            remove(&mut commands, entity, outlined);
        }
        let Some((axis, drawing)) = wanted else { continue };
        let lines = shared.get(drawing, &mut gizmos, || wireframe(axis.level(level), colors));
        let gizmo = Gizmo { handle: lines, line_config: group.line.clone(), depth_bias: group.depth_bias };
        let layers = group.render_layers.clone();
        // An entity that has been despawned in the meantime gets no child.
        commands.entity(entity).queue_silenced(move |mut body: EntityWorldMut| {
            let child = (Outline, gizmo, layers, ChildOf(body.id()));
            let outline = body.world_scope(|world| world.spawn(child).id());
            body.insert(Outlined { drawing, outline });
        });
    }
}

fn remove(commands: &mut Commands, entity: Entity, outlined: &Outlined) {
    commands.entity(outlined.outline).try_despawn();
    commands.entity(entity).try_remove::<Outlined>();
}

/// Returns the colours of an entity's spheres, cones and slabs. `coarseness` of its level of detail: from 0 for the finest to 1 for the coarsest.
fn colors(enabled: bool, layers: &MedialGizmos, coarseness: f32, gizmo: Option<&MedialGizmo>) -> [Option<Color>; 3] {
    [layers.spheres, layers.cones, layers.slabs].map(|layer| {
        let is_drawn = gizmo.map_or(enabled && layer.enabled, |gizmo| gizmo.enabled);
        let own = if layers.color_by_level { color_of_level(coarseness) } else { layer.color };
        is_drawn.then(|| gizmo.and_then(|gizmo| gizmo.color).unwrap_or(own))
    })
}

/// Blue for the finest level, then green and yellow, red for the coarsest.
fn color_of_level(coarseness: f32) -> Color {
    Color::hsl(220.0 * (1.0 - coarseness).max(0.0), 0.85, 0.55)
}

/// Applies changes of line width, depth bias and render layers to existing lines.
pub(super) fn follow_config(
    store: Res<GizmoConfigStore>,
    mut outlines: Query<(&mut Gizmo, &mut RenderLayers), Or<(With<Outline>, With<StopOutline>)>>,
) {
    let group = store.config::<MedialGizmos>().0;
    for (mut gizmo, mut layers) in &mut outlines {
        gizmo.line_config = group.line.clone();
        gizmo.depth_bias = group.depth_bias;
        layers.set_if_neq(group.render_layers.clone());
    }
}
