//! Shapes of the meshes in spawned glTF scenes.
//!
//! ```text
//! find_nodes   new Mesh3d below a MedialScene --> its node: Unshaped
//! shape_nodes  Unshaped node --> rules, marks --> body on the node, child with a MedialMesh (from a file) or a BuildMedialMesh
//! ```

use std::{collections::HashMap, iter::once};

use bevy::{
    asset::RenderAssetUsages,
    ecs::{name::NameOrEntityItem, query::QueryData},
    gltf::{GltfExtras, GltfMeshExtras, GltfMeshName},
    mesh::{Mesh, Mesh3d, PrimitiveTopology, skinning::SkinnedMesh},
    prelude::*,
};

use super::{BuildMedialMesh, MedialBudget, MedialMesh, MedialSystems};
use crate::{
    builder::{FitOptions, NodeBody, NodeMark, TriangleMesh, is_named, nodes::Proportions},
    medial_axis::MedialAxis,
};

/// Gives each mesh of a glTF scene its medial mesh, when the scene has been spawned. Without a [`folder`](Self::folder) it needs
/// [`MedialBuildPlugin`](super::MedialBuildPlugin).
///
/// For each node with a mesh, the first of these decides: a rule of [`nodes`](Self::nodes), the [marks](NodeMark) in the file, [`body`](Self::body). The node
/// gets a `RigidBody` unless it has one, and a child with the [`MedialMesh`]. All primitives of a mesh are one shape. Nodes with the same mesh share it. A
/// non-uniform scale of a node is a part of its shape, and is that at the time when the scene is spawned. Skinned meshes are left out: see
/// [`SkinnedMedialMesh`](super::SkinnedMedialMesh).
///
/// An error is logged with the name of the node. [`MedialBuildStatus`](super::MedialBuildStatus) on the child shows the progress.
///
/// ```no_run
/// # use bevy::prelude::*;
/// # use bevy_medial::prelude::*;
/// fn spawn(mut commands: Commands, assets: Res<AssetServer>) {
///     let nodes = vec![("crate*".into(), NodeBody::Dynamic), ("leaf*".into(), NodeBody::NoShape)];
///     let scene = WorldAssetRoot(assets.load(GltfAssetLabel::Scene(0).from_asset("yard.glb")));
///     commands.spawn((scene, MedialScene { nodes, ..default() }));
/// }
/// ```
#[derive(Component, Clone, Debug, Default, PartialEq, Reflect)]
#[cfg_attr(feature = "serialize", derive(serde::Serialize, serde::Deserialize), reflect(Serialize, Deserialize))]
#[reflect(Component, Default, Clone, PartialEq)]
pub struct MedialScene {
    /// The body of a node that no rule and no mark mentions. Default: [`NodeBody::Fixed`].
    pub body: NodeBody,
    /// Rules: the name of a node or of its mesh, in which `*` stands for any text, and the body. The first rule with a matching name applies.
    pub nodes: Vec<(String, NodeBody)>,
    /// Options of the builds.
    pub options: FitOptions,
    /// Folder of shapes, as an asset path: the output of `medial build SCENE --per-mesh -o FOLDER`. Default: none; the shapes are built while the app runs.
    pub folder: Option<String>,
}

/// A node that waits for its shape.
#[derive(Component)]
struct Unshaped {
    scene: Entity,
}

/// The body of a node. The response inserts the body itself.
#[cfg(feature = "rapier")]
#[derive(Component)]
pub(crate) struct SceneBody(pub NodeBody);

/// Marks the child with the shape of a node.
#[derive(Component)]
struct NodeShape;

pub(super) fn add(app: &mut App) {
    app.register_type::<MedialScene>().add_systems(
        Update,
        (find_nodes, shape_nodes).chain().before(MedialSystems::Build).run_if(any_with_component::<MedialScene>),
    );
}

/// Finds the nodes of new meshes, and of all meshes below a new scene.
fn find_nodes(
    mut commands: Commands,
    scenes: Query<(), With<MedialScene>>,
    new_scenes: Query<Entity, Added<MedialScene>>,
    new_meshes: Query<Entity, Added<Mesh3d>>,
    meshes: Query<&Mesh3d, Without<NodeShape>>,
    shapes: Query<(), With<NodeShape>>,
    children: Query<&Children>,
    parents: Query<&ChildOf>,
) {
    let below = new_scenes.iter().flat_map(|scene| children.iter_descendants(scene));
    for entity in below.chain(&new_meshes) {
        let Ok(mesh) = meshes.get(entity) else { continue };
        let Some(scene) = parents.iter_ancestors(entity).find(|above| scenes.contains(*above)) else { continue };
        let parent = parents.get(entity).ok().map(ChildOf::parent);
        let node = parent.filter(|_| gltf_mesh(mesh).is_some()).unwrap_or(entity);
        if !children.get(node).is_ok_and(|below| below.iter().any(|child| shapes.contains(child))) {
            commands.entity(node).try_insert(Unshaped { scene });
        }
    }
}

/// Name of the mesh to which a primitive of a glTF file belongs, for meshes without a name in the file. `None` for other meshes.
fn gltf_mesh(mesh: &Mesh3d) -> Option<String> {
    let label = mesh.0.path()?.label()?.to_owned();
    Some(format!("Gltf{}", label.split_once("/Primitive")?.0))
}

/// A mesh below a node, or on it.
#[derive(QueryData)]
struct Part {
    entity: Entity,
    mesh: &'static Mesh3d,
    place: &'static Transform,
    name: Option<&'static GltfMeshName>,
    extras: Option<&'static GltfMeshExtras>,
    is_skinned: Has<SkinnedMesh>,
}

/// The shape that a node gets.
struct Wanted {
    body: NodeBody,
    budget: Option<f32>,
    proportions: Proportions,
    /// Name of the mesh.
    mesh: String,
    /// Scale of the shape below the node.
    scale: Vec3,
}

impl Wanted {
    /// `None` for a node without a shape.
    fn new(
        scene: &MedialScene,
        node: &str,
        extras: Option<&GltfExtras>,
        part: &PartItem,
        place: &GlobalTransform,
    ) -> Result<Option<Self>, String> {
        let mesh = part.name.map(|name| name.0.clone()).or_else(|| gltf_mesh(part.mesh));
        let mesh = mesh.unwrap_or_else(|| node.to_owned());
        let texts = extras.map(|extras| &*extras.value).into_iter().chain(part.extras.map(|extras| &*extras.value));
        let NodeMark { body, budget } = NodeMark::new(node, texts)?;
        let is_named = |(pattern, _): &&(String, NodeBody)| [node, &mesh].iter().any(|name| is_named(name, pattern));
        let rule = scene.nodes.iter().find(is_named).map(|(_, body)| *body);
        let body = rule.or(body).unwrap_or(scene.body);
        if body == NodeBody::NoShape {
            return Ok(None);
        }
        if part.is_skinned {
            return Err("it is skinned; give it a SkinnedMedialMesh, or name it with -noshape".into());
        }
        let matrix = Mat3::from(place.affine().matrix3);
        let (proportions, largest) = Proportions::of(matrix)?;
        let scale = Vec3::from_array([0, 1, 2].map(|axis| largest / matrix.col(axis).length()));
        Ok(Some(Self { body, budget, proportions, mesh, scale }))
    }
}

/// Identity of a mesh that is made of others: their assets and places, and the scale that it contains.
type Joined = (Vec<(AssetId<Mesh>, [u32; 16])>, [u32; 3]);

/// Gives nodes their shapes as soon as their meshes are loaded.
fn shape_nodes(
    mut commands: Commands,
    nodes: Query<(NameOrEntity, &Unshaped, Option<&GltfExtras>, Option<&Children>)>,
    parts: Query<Part, Without<NodeShape>>,
    scenes: Query<&MedialScene>,
    hierarchy: TransformHelper,
    server: Res<AssetServer>,
    mut meshes: ResMut<Assets<Mesh>>,
    mut joined: Local<HashMap<Joined, AssetId<Mesh>>>,
) {
    for (name, unshaped, extras, children) in &nodes {
        let node = name.entity;
        let below =
            once(node).chain(children.into_iter().flatten().copied()).filter_map(|entity| parts.get(entity).ok());
        let parts: Vec<PartItem> = below.filter(|part| part.entity == node || gltf_mesh(part.mesh).is_some()).collect();
        let (Ok(scene), Some(first)) = (scenes.get(unshaped.scene), parts.first()) else { continue };
        if parts.iter().any(|part| !meshes.contains(&part.mesh.0)) {
            continue;
        }
        commands.entity(node).try_remove::<Unshaped>();
        let place = hierarchy.compute_global_transform(node).map_err(|error| error.to_string());
        let wanted = place.and_then(|place| Wanted::new(scene, &name.to_string(), extras, first, &place));
        let shaped = wanted.and_then(|wanted| {
            let Some(wanted) = wanted else { return Ok(None) };
            let source = match &scene.folder {
                Some(folder) => {
                    let file = wanted.proportions.file_name(&wanted.mesh);
                    Source::File(server.load(format!("{folder}/{file}.medial")))
                }
                None => Source::Mesh(mesh_of(node, &parts, wanted.proportions, &mut meshes, &mut joined)?),
            };
            Ok(Some((wanted, source)))
        });
        match shaped {
            Ok(None) => {}
            Ok(Some((wanted, source))) => spawn(&mut commands, name, scene, &wanted, source),
            Err(error) => error!("{name}: the node gets no shape: {error}"),
        }
    }
}

/// Origin of a shape.
enum Source {
    File(Handle<MedialAxis>),
    Mesh(Handle<Mesh>),
}

/// Inserts the body of a node, and spawns the child with its shape.
fn spawn(commands: &mut Commands, node: NameOrEntityItem, scene: &MedialScene, wanted: &Wanted, source: Source) {
    #[cfg(feature = "rapier")]
    commands.entity(node.entity).try_insert(SceneBody(wanted.body));
    let place = (Transform::from_scale(wanted.scale), ChildOf(node.entity));
    let mut shape = commands.spawn((NodeShape, Name::new(node.to_string()), place));
    #[cfg(not(feature = "rapier"))]
    if wanted.body == NodeBody::Fixed {
        shape.insert(super::StaticObb::default());
    }
    if let Some(budget) = wanted.budget {
        shape.insert(MedialBudget::Percent(budget));
    }
    match source {
        Source::File(shared) => shape.insert(MedialMesh(shared)),
        Source::Mesh(mesh) => shape.insert((Mesh3d(mesh), BuildMedialMesh(scene.options))),
    };
}

/// A mesh with the triangles of all parts, in the proportions of the node.
fn mesh_of(
    node: Entity,
    parts: &[PartItem],
    proportions: Proportions,
    meshes: &mut Assets<Mesh>,
    joined: &mut HashMap<Joined, AssetId<Mesh>>,
) -> Result<Handle<Mesh>, String> {
    let place = |part: &PartItem| if part.entity == node { Transform::IDENTITY } else { *part.place };
    if let [part] = parts
        && proportions.0 == Vec3::ONE
        && place(part) == Transform::IDENTITY
    {
        return Ok(part.mesh.0.clone());
    }
    let bits = |part: &PartItem| (part.mesh.0.id(), place(part).to_matrix().to_cols_array().map(f32::to_bits));
    let key = (parts.iter().map(bits).collect(), proportions.0.to_array().map(f32::to_bits));
    if let Some(known) = joined.get(&key).and_then(|id| meshes.get_strong_handle(*id)) {
        return Ok(known);
    }
    let (mut positions, mut triangles) = (vec![], vec![]);
    for part in parts {
        let Some(mesh) = meshes.get(&part.mesh.0).filter(|mesh| has_triangles(mesh)) else {
            continue;
        };
        let mesh = TriangleMesh::from_bevy(mesh).map_err(|error| error.to_string())?;
        let first = positions.len() as u32;
        positions.extend(mesh.positions.iter().map(|&point| proportions.0 * place(part).transform_point(point)));
        triangles.extend(mesh.triangles.iter().map(|triangle| triangle.map(|vertex| first + vertex)));
    }
    let mesh = TriangleMesh::new(positions, triangles).map_err(|error| error.to_string())?;
    let mut mesh = mesh.to_bevy();
    mesh.asset_usage = RenderAssetUsages::MAIN_WORLD;
    let mesh = meshes.add(mesh);
    joined.insert(key, mesh.id());
    Ok(mesh)
}

/// False for lines and points, which have no surface.
fn has_triangles(mesh: &Mesh) -> bool {
    matches!(mesh.primitive_topology(), PrimitiveTopology::TriangleList | PrimitiveTopology::TriangleStrip)
}
