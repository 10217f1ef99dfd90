//! A back end of Bevy's picking that casts rays at the exact shapes of medial bodies.

use bevy::{
    camera::{
        Camera,
        visibility::{InheritedVisibility, RenderLayers},
    },
    ecs::query::QueryData,
    picking::{
        Pickable, PickingPlugin, PickingSystems,
        backend::{HitData, PointerHits, ray::RayMap},
    },
    prelude::*,
};

use super::{MedialLevel, MedialMesh, StaticObb, uniform_scale};
use crate::{geometry::Aabb, medial_axis::MedialAxis, pipeline::Shape};

/// A back end of Bevy's picking. Pointers hit medial bodies, at the level of detail with which they collide, and static boxes. Add it after `DefaultPlugins`.
///
/// Hits contain point and normal in the world, and observers of the entities receive `Pointer<Click>` and similar events. As with any back end,
/// `Pickable` decides which entities are hovered over and which hide the entities behind them. Other colliders and meshes are neither hit nor hide
/// entities. The back ends of rapier and of Bevy hit them, and can be used at the same time.
///
/// ```no_run
/// # use bevy::prelude::*;
/// # use bevy_medial::{plugin::MedialPickingPlugin, prelude::*};
/// # use bevy_rapier3d::prelude::RigidBody;
/// fn main() {
///     App::new()
///         .add_plugins((DefaultPlugins, MedialPhysicsPlugins::default(), MedialPickingPlugin))
///         .add_systems(Startup, spawn)
///         .run();
/// }
///
/// fn spawn(mut commands: Commands, assets: Res<AssetServer>) {
///     commands
///         .spawn((RigidBody::Dynamic, MedialMesh(assets.load("models/bear.medial"))))
///         .observe(|click: On<Pointer<Click>>| info!("clicked at {:?}", click.hit.position));
/// }
/// ```
#[derive(Clone, Copy, Debug, Default)]
pub struct MedialPickingPlugin;

impl Plugin for MedialPickingPlugin {
    fn build(&self, app: &mut App) {
        if !app.is_plugin_added::<PickingPlugin>() {
            app.add_plugins(PickingPlugin);
        }
        super::init_medial_axis(app);
        app.register_type::<MedialPickingCamera>()
            .register_type::<MedialPickingSettings>()
            .init_resource::<MedialPickingSettings>()
            .add_systems(PreUpdate, update_hits.in_set(PickingSystems::Backend));
    }
}

/// Settings of [`MedialPickingPlugin`].
#[derive(Resource, Clone, Copy, Debug, PartialEq, Reflect)]
#[cfg_attr(feature = "serialize", derive(serde::Serialize, serde::Deserialize), reflect(Serialize, Deserialize))]
#[reflect(Resource, Default, Clone, PartialEq)]
pub struct MedialPickingSettings {
    /// If true, only cameras with a [`MedialPickingCamera`] pick, and only entities with a `Pickable` are hit. Default: false.
    pub require_markers: bool,
    /// If true, entities that are hidden by their `Visibility` are not hit. Default: true.
    pub visible_only: bool,
}

impl Default for MedialPickingSettings {
    fn default() -> Self {
        Self { require_markers: false, visible_only: true }
    }
}

/// Marks a camera that picks medial bodies where [`MedialPickingSettings`] require markers.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Eq, Reflect)]
#[cfg_attr(feature = "serialize", derive(serde::Serialize, serde::Deserialize), reflect(Serialize, Deserialize))]
#[reflect(Component, Default, Clone, PartialEq)]
pub struct MedialPickingCamera;

/// An entity that may be hit.
#[derive(QueryData)]
struct Target {
    entity: Entity,
    mesh: Option<&'static MedialMesh>,
    level: Option<&'static MedialLevel>,
    obb: Option<&'static StaticObb>,
    transform: &'static GlobalTransform,
    pickable: Option<&'static Pickable>,
    visibility: Option<&'static InheritedVisibility>,
    layers: Option<&'static RenderLayers>,
}

/// Writes the hits of the pointers of each camera.
fn update_hits(
    settings: Res<MedialPickingSettings>,
    rays: Res<RayMap>,
    cameras: Query<(&Camera, Has<MedialPickingCamera>, Option<&RenderLayers>)>,
    targets: Query<Target, Or<(With<MedialMesh>, With<StaticObb>)>>,
    axes: Res<Assets<MedialAxis>>,
    mut hits: MessageWriter<PointerHits>,
) {
    let everywhere = RenderLayers::default();
    for (id, ray) in rays.iter() {
        let Ok((camera, is_marked, camera_layers)) = cameras.get(id.camera) else { continue };
        if settings.require_markers && !is_marked {
            continue;
        }
        let camera_layers = camera_layers.unwrap_or(&everywhere);
        let may_be_hit = |target: &TargetItem| {
            // An entity that is neither hovered over nor hides others has no effect.
            target
                .pickable
                .map_or(!settings.require_markers, |pickable| pickable.is_hoverable || pickable.should_block_lower)
                && !(settings.visible_only && target.visibility.is_some_and(|visibility| !visibility.get()))
                && camera_layers.intersects(target.layers.unwrap_or(&everywhere))
        };
        let picks: Vec<(Entity, HitData)> = targets
            .iter()
            .filter(may_be_hit)
            .filter_map(|target| {
                let (depth, normal) = hit(&target, &axes, ray)?;
                let position = ray.get_point(depth);
                Some((target.entity, HitData::new(id.camera, depth, Some(position), Some(normal))))
            })
            .collect();
        if !picks.is_empty() {
            hits.write(PointerHits::new(id.pointer, picks, camera.order as f32));
        }
    }
}

/// Returns the distance at which the ray enters the target, and the normal there. The distance is 0 from inside.
fn hit(target: &TargetItem, axes: &Assets<MedialAxis>, ray: &Ray3d) -> Option<(f32, Vec3)> {
    let (scale, rotation, translation) = target.transform.to_scale_rotation_translation();
    let (origin, direction) = (rotation.inverse() * (ray.origin - translation), rotation.inverse() * *ray.direction);
    let (depth, normal) = match (target.mesh, target.obb) {
        (Some(mesh), _) => {
            let axis = axes.get(&mesh.0)?.level(target.level.map_or(0, |level| level.0));
            let (hit, _) = Shape::scaled(axis, uniform_scale(scale)?).ray_cast(origin, direction, f32::MAX)?;
            (hit.time, hit.normal)
        }
        (None, Some(obb)) => {
            let half = (obb.half_extents * scale).abs();
            let [depth, _] = Aabb { min: -half, max: half }.crossing(origin, direction, f32::MAX)?;
            (depth, face_normal(half, origin, direction))
        }
        (None, None) => return None,
    };
    Some((depth, rotation * normal))
}

/// Returns the normal of the face through which a ray enters a box: of the faces towards the origin, the one whose plane it crosses last.
fn face_normal(half: Vec3, origin: Vec3, direction: Vec3) -> Vec3 {
    let towards = -direction.signum();
    let entered = (half * towards - origin) / direction;
    let axis = Vec3::select(direction.cmpne(Vec3::ZERO), entered, Vec3::NEG_INFINITY).max_position();
    let mut normal = Vec3::ZERO;
    normal[axis] = towards[axis];
    normal
}
