//! Adds meshes to bodies. A model gets the triangle mesh that its shape was built from, other medial bodies the surface of their shape, and static boxes
//! their faces.

use std::{
    collections::HashMap,
    path::{Path, PathBuf},
};

use bevy::{light::NotShadowCaster, prelude::*};
use bevy_medial::{
    builder::load,
    medial_axis::{MedialAxis, triangulate},
    prelude::*,
};

/// Number of sides of a sphere or cone.
const SIDES: u32 = 24;

/// Adds a mesh and a material to medial bodies without a mesh, and to static boxes. The mesh of a body called `NAME` is `NAME.obj` in the folder, if that
/// file exists.
pub struct Dress {
    pub models: PathBuf,
}

impl Plugin for Dress {
    fn build(&self, app: &mut App) {
        app.insert_resource(Sources { folder: self.models.clone(), meshes: HashMap::new() })
            .add_systems(Update, (dress_bodies, dress_boxes));
    }
}

/// Meshes of models by name. `None` if there is no such file or it does not load.
#[derive(Resource)]
struct Sources {
    folder: PathBuf,
    meshes: HashMap<String, Option<Handle<Mesh>>>,
}

fn source(folder: &Path, name: &str) -> Option<Mesh> {
    let path = folder.join(name).with_extension("obj");
    let mesh = path.exists().then(|| load::load(&path))?;
    mesh.inspect_err(|error| warn!("{error}")).ok().map(|mesh| mesh.to_bevy().with_computed_area_weighted_normals())
}

fn dress_bodies(
    mut commands: Commands,
    bodies: Query<(Entity, &MedialMesh, Option<&Name>, Has<StaticObb>), Without<Mesh3d>>,
    axes: Res<Assets<MedialAxis>>,
    mut sources: ResMut<Sources>,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
) {
    for (entity, medial, name, is_static) in &bodies {
        let Some(axis) = axes.get(&medial.0) else { continue };
        let Sources { folder, meshes: known } = &mut *sources;
        let source = name.and_then(|name| {
            let load = || source(folder, name).map(|mesh| meshes.add(mesh));
            known.entry(name.to_string()).or_insert_with(load).clone()
        });
        let mesh = source.unwrap_or_else(|| meshes.add(triangulate(axis.spheres(), axis.primitives(), SIDES)));
        // Steps by the golden angle give entities with neighbouring indices different hues.
        let base_color = match is_static {
            true => Color::srgb(0.55, 0.57, 0.6),
            false => Color::hsl((entity.index_u32() as f32 * 137.5) % 360.0, 0.55, 0.58),
        };
        let material = StandardMaterial { base_color, perceptual_roughness: 0.55, ..default() };
        commands.entity(entity).insert((Mesh3d(mesh), MeshMaterial3d(materials.add(material))));
    }
}

fn dress_boxes(
    mut commands: Commands,
    boxes: Query<(Entity, &StaticObb, Option<&Name>, &Transform), (Added<StaticObb>, Without<MedialMesh>)>,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
) {
    for (entity, obb, name, place) in &boxes {
        let is_named = |other: &str| name.is_some_and(|name| name.as_str() == other);
        if is_named("wall") {
            // This wall is invisible, and the pointer picks bodies behind it.
            commands.entity(entity).insert(Pickable::IGNORE);
            continue;
        }
        let shade = if is_named("ground") { 0.5 } else { 0.62 };
        let base_color = Color::srgb(shade, shade, shade * 0.95);
        let material = StandardMaterial { base_color, perceptual_roughness: 0.9, ..default() };
        let mut dressed = commands.entity(entity);
        let mesh = if is_named("bin") {
            dressed.insert((NotShadowCaster, Pickable::IGNORE));
            inner_face(obb, place.translation)
        } else {
            Cuboid::from_size(obb.half_extents * 2.0).into()
        };
        dressed.insert((Mesh3d(meshes.add(mesh)), MeshMaterial3d(materials.add(material))));
    }
}

/// The face of a wall that points to the middle of the scene. It is visible from that side only, so that no wall hides the content of a bin.
fn inner_face(wall: &StaticObb, center: Vec3) -> Mesh {
    let half = wall.half_extents;
    let (inward, width, depth) = match half.x < half.z {
        true => (Vec3::X * -center.x.signum(), half.z, half.x),
        false => (Vec3::Z * -center.z.signum(), half.x, half.z),
    };
    Mesh::from(Rectangle::new(2.0 * width, 2.0 * half.y))
        .rotated_by(Quat::from_rotation_arc(Vec3::Z, inward))
        .translated_by(inward * depth)
}
