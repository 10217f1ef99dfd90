use super::*;
use crate::medial_axis::{MedialAxis, triangulate};

/// Boxes by their lower corners and sizes, each of 12 triangles.
pub fn boxes(each: &[[[f64; 3]; 2]]) -> TriangleMesh {
    let mut mesh = TriangleMesh { positions: vec![], triangles: vec![] };
    each.iter().map(|b| b.map(DVec3::from_array)).for_each(|[min, size]| add_box(&mut mesh, min, size));
    mesh
}

/// A prism over a polygon in x and y, counter-clockwise and star-shaped around its first corner.
pub fn prism(polygon: &[[f64; 2]], height: f64) -> TriangleMesh {
    let count = polygon.len() as u32;
    let level = |z: f64| polygon.iter().map(move |&[x, y]| DVec3::new(x, y, z).as_vec3());
    let mut mesh = TriangleMesh { positions: level(0.0).chain(level(height)).collect(), triangles: vec![] };
    for i in 0..count {
        let j = (i + 1) % count;
        mesh.triangles.extend([[i, j, count + j], [i, count + j, count + i]]);
        if i > 0 && j > 0 {
            mesh.triangles.extend([[0, j, i], [count, count + i, count + j]]);
        }
    }
    mesh
}

/// A regular polygon.
pub fn circle(corners: u32, radius: f64) -> Vec<[f64; 2]> {
    let corner = |i: u32| {
        let (y, x) = (std::f64::consts::TAU * f64::from(i) / f64::from(corners)).sin_cos();
        [x * radius, y * radius]
    };
    (0..corners).map(corner).collect()
}

/// The surfaces of a shape's primitives, including the parts inside other primitives.
pub fn triangulated(axis: &MedialAxis, segments: u32) -> TriangleMesh {
    let surface = triangulate(axis.spheres(), axis.primitives(), segments);
    let positions = surface.positions.into_iter().map(Vec3::from).collect();
    TriangleMesh::new(positions, surface.indices.as_chunks().0.to_vec()).unwrap()
}

/// Adds a box of 12 outward triangles.
pub fn add_box(mesh: &mut TriangleMesh, min: DVec3, size: DVec3) {
    let first = mesh.positions.len() as u32;
    mesh.positions.extend((0..8u32).map(|corner| {
        let unit = DVec3::new((corner & 1).into(), (corner >> 1 & 1).into(), (corner >> 2).into());
        (min + unit * size).as_vec3()
    }));
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    for [a, b, c, d] in quads.map(|q: [u32; 4]| q.map(|i| first + i)) {
        mesh.triangles.extend([[a, b, c], [a, c, d]]);
    }
}

/// A unit tetrahedron with outward triangles.
pub fn tetrahedron() -> TriangleMesh {
    let positions = vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z];
    TriangleMesh::new(positions, vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]).unwrap()
}

#[test]
fn errors_name_what_and_where() {
    let good = tetrahedron();
    let with = |at: usize, position: Vec3| {
        let mut positions = good.positions.clone();
        positions[at] = position;
        positions
    };
    let range = "is not a number from -1000000 to 1000000; move or scale the mesh";
    let cases = [
        (good.positions.clone(), vec![], "the mesh has no triangles".into()),
        (with(2, Vec3::new(0.0, f32::NAN, 0.0)), vec![[0, 1, 2]], format!("vertex 2: NaN {range}")),
        (with(3, Vec3::INFINITY), vec![[0, 1, 2]], format!("vertex 3: inf {range}")),
        (with(0, Vec3::X * 2e6), vec![[0, 1, 2]], format!("vertex 0: 2000000 {range}")),
        (good.positions.clone(), vec![[0, 1, 2], [1, 2, 4]], "triangle 1: there is no vertex 4 among 4".into()),
        (vec![Vec3::ONE; 3], vec![[0, 1, 2]], "the mesh has no size: all of its triangles lie in one point".into()),
        (
            vec![Vec3::ONE; MAX_MESH_SIZE + 1],
            vec![[0, 1, 2]],
            "the mesh has 16777217 vertices, more than 16777216; reduce it first".into(),
        ),
    ];
    for (positions, triangles, message) in cases {
        assert_eq!(TriangleMesh::new(positions, triangles).unwrap_err().to_string(), message);
    }
}

#[test]
fn welding_joins_equal_places_and_drops_unused_ones() {
    let good = tetrahedron();
    // Each triangle has its own vertices, one of them at -0, and one vertex is unused.
    let mut positions = vec![Vec3::splat(9.0)];
    positions.extend(good.triangles.iter().flat_map(|t| good.corners(*t)));
    positions[1] = -Vec3::ZERO;
    let soup = TriangleMesh::new(positions, (0..4).map(|i| [0, 1, 2].map(|k| 1 + 3 * i + k)).collect()).unwrap();
    assert_eq!((soup.components().len(), good.components().len()), (4, 1));
    let welded = soup.welded();
    assert_eq!((welded.positions.len(), welded.components()), (4, vec![vec![0, 1, 2, 3]]));
    for (a, b) in welded.triangles.iter().zip(&good.triangles) {
        assert_eq!(welded.corners(*a), good.corners(*b));
    }
    assert_eq!(soup.diagonal(), 3f32.sqrt(), "the unused vertex is counted");
}

#[cfg(feature = "bevy_mesh")]
#[test]
fn bevy_meshes_of_triangles_are_taken() {
    use bevy::{
        asset::RenderAssetUsages,
        mesh::{Indices, Mesh, MeshBuilder, Meshable, PrimitiveTopology},
    };

    let cuboid = bevy::math::primitives::Cuboid::new(1.0, 2.0, 3.0).mesh().build();
    let mesh = TriangleMesh::from_bevy(&cuboid).unwrap();
    assert_eq!((mesh.positions.len(), mesh.triangles.len()), (8, 12), "24 vertices with normals are 8 places");
    let report = super::super::MeshReport::new(&mesh);
    assert!(report.is_closed() && (report.volume - 6.0).abs() < 1e-5, "{report:?}");

    let square = vec![[0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]];
    let of = |topology| {
        Mesh::new(topology, RenderAssetUsages::default())
            .with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, square.clone())
    };
    let strip = TriangleMesh::from_bevy(&of(PrimitiveTopology::TriangleStrip)).unwrap();
    assert_eq!(strip.triangles, [[0, 1, 2], [2, 1, 3]]);
    let unindexed = TriangleMesh::from_bevy(&of(PrimitiveTopology::TriangleList)).unwrap();
    assert_eq!(unindexed.triangles, [[0, 1, 2]]);
    let wild = of(PrimitiveTopology::TriangleList).with_inserted_indices(Indices::U32(vec![0, 1, 4]));
    assert!(matches!(TriangleMesh::from_bevy(&wild), Err(MeshError::IndexOutOfRange { index: 4, .. })));
    for (mesh, why) in [
        (of(PrimitiveTopology::LineList), "LineList"),
        (Mesh::new(PrimitiveTopology::TriangleList, RenderAssetUsages::default()), "wasn't found"),
    ] {
        let error = TriangleMesh::from_bevy(&mesh).unwrap_err().to_string();
        assert!(error.contains(why), "{error}");
    }
}
