//! The surface of a solid.
//!
//! ```text
//! signed distance --on a grid--> surface nets --quadrics--> fewer triangles --onto the surface, to size--> mesh
//! ```

use std::error::Error;

use alum::{
    DVec3, Handle, HasDecimation, HasIterators, HasTopology, PolyMeshF64, QuadricDecimater,
    decimate::quadric::QuadricType,
};
use bevy_medial::builder::TriangleMesh;
use fast_surface_nets::{
    SurfaceNetsBuffer,
    ndshape::{RuntimeShape, Shape},
    surface_nets,
};
use glam::Vec3;

use crate::limbs::Solid;

/// Vertices, and the three vertex indices of each triangle.
type Triangles = (Vec<Vec3>, Vec<[u32; 3]>);

/// The surface as a mesh with the given number of triangles. The middle of its bounds is the origin, and their longest side is `size` metres long.
pub fn surface(solid: &Solid, triangles: usize, size: f32) -> Result<TriangleMesh, Box<dyn Error>> {
    let bounds = solid.aabb();
    let longest = (bounds.max - bounds.min).max_element();
    // Surface nets are not manifold where two sheets share a cell. In a crease this can happen on any grid, but it rarely
    // happens on the next grid as well.
    let mut grids = (125..200).step_by(5).map(|cells| longest / cells as f32);
    let closed = grids.find_map(|cell| thinned(&nets(solid, cell), triangles).ok());
    let (mut positions, triangles) = closed.ok_or("the surface touches itself on every grid: move limbs apart")?;
    // The gradient of a distance has length 1, except in creases.
    let step = 0.001 * longest;
    let onto_surface = |p: Vec3| p - solid.gradient(p, step).normalize_or_zero() * solid.distance(p);
    positions.iter_mut().for_each(|p| *p = onto_surface(onto_surface(*p)));
    let mut mesh = TriangleMesh::new(positions, triangles)?;
    let bounds = mesh.aabb();
    let scale = size / (bounds.max - bounds.min).max_element();
    mesh.positions.iter_mut().for_each(|p| *p = (*p - bounds.center()) * scale);
    Ok(mesh)
}

/// The surface on a grid with cells of width `cell`.
fn nets(solid: &Solid, cell: f32) -> Triangles {
    let bounds = solid.aabb();
    // The grid is symmetric like the solid, with space for fillets.
    let half = (bounds.half_extents() / cell).ceil() + 4.0;
    let place = |at: [f32; 3]| bounds.center() + (Vec3::from(at) - half) * cell;
    let shape = RuntimeShape::<u32, 3>::new((half * 2.0 + 1.0).as_uvec3().to_array());
    let distance = |i| solid.distance(place(shape.delinearize(i).map(|x| x as f32)));
    let field: Vec<f32> = (0..shape.size()).map(distance).collect();
    let mut nets = SurfaceNetsBuffer::default();
    surface_nets(&field, &shape, [0; 3], shape.as_array().map(|side| side - 1), &mut nets);
    (nets.positions.into_iter().map(place).collect(), nets.indices.as_chunks().0.to_vec())
}

/// The closed surface, decimated to `count` triangles. They are smaller where the curvature is larger. Fails if the surface is not manifold.
fn thinned((positions, triangles): &Triangles, count: usize) -> Result<Triangles, alum::Error> {
    let mut mesh = PolyMeshF64::new();
    for p in positions {
        mesh.add_vertex(DVec3(p.x.into(), p.y.into(), p.z.into()))?;
    }
    for [a, b, c] in triangles {
        mesh.add_tri_face((*a).into(), (*b).into(), (*c).into())?;
    }
    let mut quadrics = QuadricDecimater::new(&mesh, QuadricType::ProbabilisticTriangle)?;
    mesh.decimate_to_face_count(&mut quadrics, count)?;
    mesh.garbage_collection()?;
    let points = mesh.points();
    let points = points.try_borrow()?;
    let positions = mesh.vertices().map(|v| points[v]).map(|DVec3(x, y, z)| Vec3::new(x as f32, y as f32, z as f32));
    let status = mesh.face_status_prop();
    let triangles = mesh.triangulated_vertices(&*status.try_borrow()?).map(|t| t.map(|v| v.index())).collect();
    Ok((positions.collect(), triangles))
}
