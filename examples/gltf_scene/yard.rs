//! A scene made by code, as the bytes of a .glb file: a yard with walls, crates, a plank, a ball and two animals.

use bevy::{
    camera::{primitives::Aabb, visibility::VisibilityClass},
    gltf::{GltfExtras, GltfMaterialName, GltfMeshExtras, GltfMeshName},
    mesh::{Indices, Mesh, VertexAttributeValues},
    prelude::*,
    transform::components::TransformTreeChanged,
};
use bevy_medial::builder::TriangleMesh;
use serde_json::{Value, json};

/// Numbers of the meshes in the file.
const BOX: usize = 0;
const CRATE: usize = 1;
const BALL: usize = 2;
const ANIMAL: usize = 3;
const LAWN: usize = 4;

/// Names of the nodes with a dynamic body.
pub const MOVING: [&str; 7] =
    ["crate", "crate.001", "crate.002", "plank-medial", "ball", "animal-medial", "animal-medial.001"];
/// Names of the nodes with a fixed body.
pub const STILL: [&str; 5] = [
    "ground-medialstatic",
    "wall-medialstatic",
    "wall-medialstatic.001",
    "wall-medialstatic.002",
    "wall-medialstatic.003",
];

/// Registers the components of scenes. Bevy's feature `reflect_auto_register`, a default, does it as well.
pub fn register(app: &mut App) {
    app.register_type::<Transform>()
        .register_type::<GlobalTransform>()
        .register_type::<TransformTreeChanged>()
        .register_type::<Visibility>()
        .register_type::<InheritedVisibility>()
        .register_type::<ViewVisibility>()
        .register_type::<VisibilityClass>()
        .register_type::<Name>()
        .register_type::<Children>()
        .register_type::<ChildOf>()
        .register_type::<Aabb>()
        .register_type::<Mesh3d>()
        .register_type::<MeshMaterial3d<StandardMaterial>>()
        .register_type::<GltfExtras>()
        .register_type::<GltfMeshExtras>()
        .register_type::<GltfMeshName>()
        .register_type::<GltfMaterialName>();
}

/// The bytes of the file. The height of the animal is about 1 m.
pub fn yard(animal: &TriangleMesh) -> Vec<u8> {
    let mut file = Glb::default();
    let cube = Mesh::from(Cuboid::from_length(1.0));
    // The two materials of a crate split its surface into two open parts.
    let [lid, body] = [true, false].map(|top| part_of(&cube, |triangle| triangle.iter().all(|p| p.y > 0.0) == top));
    file.mesh("box", &[(&cube, 0)]);
    file.mesh("crate", &[(&body, 1), (&lid, 2)]);
    file.mesh("ball", &[(&Sphere::new(0.5).mesh().ico(4).unwrap_or_else(|_| Sphere::new(0.5).into()), 3)]);
    file.mesh("animal", &[(&animal.to_bevy().with_computed_area_weighted_normals(), 4)]);
    file.mesh("lawn", &[(&Plane3d::default().mesh().size(3.0, 3.0).build(), 5)]);
    file.meshes[BALL]["extras"] = json!({"medial": {"body": "dynamic"}});
    file.bytes(&nodes())
}

/// The first nodes are those at the root of the scene.
fn nodes() -> Vec<Value> {
    let crate_extras = json!({"medial": {"budget": 1.0, "body": "dynamic"}});
    let turned = |degrees: f32| Quat::from_rotation_y(degrees.to_radians()).to_array();
    let wall = |number: usize| {
        let name = STILL[1 + number];
        let place = Quat::from_rotation_y(90f32.to_radians() * number as f32) * Vec3::new(4.75, 0.5, 0.0);
        // Two of the walls are mirrored.
        let side = if number.is_multiple_of(2) { 1.0 } else { -1.0 };
        let rotation = turned(90.0 * number as f32);
        json!({"name": name, "mesh": BOX, "translation": place.to_array(), "rotation": rotation, "scale": [0.5, 1.0, 9.0 * side]})
    };
    let crate_at = |name: &str, height: f32| json!({"name": name, "mesh": CRATE, "translation": [0.0, height, 0.0], "extras": crate_extras});
    vec![
        json!({"name": STILL[0], "mesh": BOX, "translation": [0.0, -0.25, 0.0], "scale": [10.0, 0.5, 10.0]}),
        wall(0),
        wall(1),
        wall(2),
        wall(3),
        json!({"name": "stack", "translation": [-2.0, 0.0, 0.0], "rotation": turned(30.0), "scale": [0.8, 0.8, 0.8], "children": [11, 12]}),
        json!({"name": "crate.002", "mesh": CRATE, "translation": [0.5, 0.3, 2.0], "scale": [1.2, 0.6, 0.8], "extras": crate_extras}),
        json!({"name": "plank-medial", "mesh": BOX, "translation": [2.0, 0.5, -2.0], "rotation": turned(20.0), "scale": [2.0, 0.1, 0.4]}),
        json!({"name": "ball", "mesh": BALL, "translation": [2.1, 1.0, -2.0], "scale": [0.5, 0.5, 0.5]}),
        json!({"name": "mirror", "scale": [-1.0, 1.0, 1.0], "children": [13]}),
        json!({"name": "lawn-noshape", "mesh": LAWN, "translation": [2.0, 0.02, 2.0]}),
        crate_at("crate", 0.55),
        crate_at("crate.001", 1.65),
        json!({"name": "animal-medial.001", "mesh": ANIMAL, "translation": [-2.5, 0.7, -2.5]}),
        json!({"name": "animal-medial", "mesh": ANIMAL, "translation": [1.5, 0.7, 2.5]}),
    ]
}

/// Numbers of the nodes at the root.
fn roots() -> Vec<usize> {
    (0..=10).chain([14]).collect()
}

/// The triangles of a mesh that satisfy a condition on their corners.
fn part_of(mesh: &Mesh, wanted: impl Fn(&[Vec3; 3]) -> bool) -> Mesh {
    let mut part = mesh.clone();
    let (positions, indices) = lists(mesh);
    let corners = |triangle: &[u32; 3]| triangle.map(|i| Vec3::from(positions[i as usize]));
    let kept = indices.as_chunks().0.iter().filter(|triangle| wanted(&corners(triangle)));
    part.insert_indices(Indices::U32(kept.flatten().copied().collect()));
    part
}

fn lists(mesh: &Mesh) -> (Vec<[f32; 3]>, Vec<u32>) {
    let of = |values: Option<&VertexAttributeValues>| {
        values.and_then(|values| values.as_float3()).unwrap_or_default().to_vec()
    };
    let positions = of(mesh.attribute(Mesh::ATTRIBUTE_POSITION));
    let indices = mesh.indices().map(|indices| indices.iter().map(|i| i as u32).collect());
    (positions, indices.unwrap_or_default())
}

/// A .glb file with meshes of one primitive per material.
#[derive(Default)]
struct Glb {
    binary: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
    meshes: Vec<Value>,
}

impl Glb {
    fn mesh(&mut self, name: &str, primitives: &[(&Mesh, usize)]) {
        let primitives: Vec<Value> =
            primitives.iter().map(|(mesh, material)| self.primitive(mesh, *material)).collect();
        self.meshes.push(json!({"name": name, "primitives": primitives}));
    }

    fn primitive(&mut self, mesh: &Mesh, material: usize) -> Value {
        let (positions, indices) = lists(mesh);
        let normals =
            mesh.attribute(Mesh::ATTRIBUTE_NORMAL).and_then(|values| values.as_float3()).unwrap_or_default().to_vec();
        let points = positions.iter().copied().map(Vec3::from);
        let [min, max] = [Vec3::min, Vec3::max].map(|of| points.clone().reduce(of).unwrap_or_default().to_array());
        let bounds = json!({"min": min, "max": max});
        let position = self.accessor(
            positions.as_flattened().iter().flat_map(|x| x.to_le_bytes()),
            5126,
            "VEC3",
            positions.len(),
            bounds,
        );
        let normal = self.accessor(
            normals.as_flattened().iter().flat_map(|x| x.to_le_bytes()),
            5126,
            "VEC3",
            normals.len(),
            json!({}),
        );
        let indices_at =
            self.accessor(indices.iter().flat_map(|i| i.to_le_bytes()), 5125, "SCALAR", indices.len(), json!({}));
        json!({"attributes": {"POSITION": position, "NORMAL": normal}, "indices": indices_at, "material": material})
    }

    fn accessor(
        &mut self,
        bytes: impl Iterator<Item = u8>,
        kind: u32,
        shape: &str,
        count: usize,
        mut accessor: Value,
    ) -> usize {
        let start = self.binary.len();
        self.binary.extend(bytes);
        self.views.push(json!({"buffer": 0, "byteOffset": start, "byteLength": self.binary.len() - start}));
        for (key, value) in [
            ("bufferView", json!(self.views.len() - 1)),
            ("componentType", json!(kind)),
            ("type", json!(shape)),
            ("count", json!(count)),
        ] {
            accessor[key] = value;
        }
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    fn bytes(self, nodes: &[Value]) -> Vec<u8> {
        let colors = [
            [0.5, 0.5, 0.48],
            [0.55, 0.36, 0.2],
            [0.75, 0.55, 0.3],
            [0.8, 0.25, 0.2],
            [0.6, 0.45, 0.3],
            [0.3, 0.5, 0.25],
        ];
        let material = |[r, g, b]: [f32; 3]| json!({"pbrMetallicRoughness": {"baseColorFactor": [r, g, b, 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.8}});
        let document = json!({
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": roots()}],
            "nodes": nodes,
            "meshes": self.meshes,
            "materials": colors.map(material),
            "accessors": self.accessors,
            "bufferViews": self.views,
            "buffers": [{"byteLength": self.binary.len()}],
        });
        let mut text = document.to_string().into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        let length = |bytes: usize| (bytes as u32).to_le_bytes();
        let chunk = |kind: &[u8; 4], content: &[u8]| [&length(content.len())[..], kind, content].concat();
        let chunks = [chunk(b"JSON", &text), chunk(b"BIN\0", &self.binary)].concat();
        [&b"glTF"[..], &2u32.to_le_bytes(), &length(12 + chunks.len()), &chunks].concat()
    }
}
