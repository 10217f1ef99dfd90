//! Surface nets: a closed triangle mesh of a signed distance.

use std::collections::HashMap;

use glam::{UVec3, Vec3};

use crate::{
    builder::{MeshError, TriangleMesh},
    geometry::Aabb,
};

/// Empty cells around the bounds.
const MARGIN: f32 = 2.5;

/// The surface of a solid within `bounds`, on a grid of cells with the given width. Each cell that the surface crosses has a vertex.
pub(super) fn surface(bounds: &Aabb, cell: f32, distance: impl Fn(Vec3) -> f32) -> Result<TriangleMesh, MeshError> {
    let half = (bounds.half_extents() / cell).ceil() + MARGIN;
    let size = (half * 2.0).as_uvec3() + 1;
    let place = |at: UVec3| bounds.center() + (at.as_vec3() - half) * cell;
    let index = |at: UVec3| (at.x + size.x * (at.y + size.y * at.z)) as usize;
    let points = (0..size.z).flat_map(|z| (0..size.y).flat_map(move |y| (0..size.x).map(move |x| UVec3::new(x, y, z))));
    let mut field: Vec<f32> = points.clone().map(|at| distance(place(at))).collect();
    while points.clone().any(|at| fill(at, size, index, &mut field)) {}
    let mut vertices = HashMap::new();
    let (mut positions, mut triangles) = (vec![], vec![]);
    let mut vertex = |cell: UVec3| -> u32 {
        *vertices.entry(cell).or_insert_with(|| {
            positions.push(middle(cell, place, |at| field[index(at)]));
            positions.len() as u32 - 1
        })
    };
    for at in points.filter(|at| at.min_element() > 0) {
        for axis in 0..3 {
            let [step, u, v] = [0, 1, 2].map(|turn| UVec3::AXES[(axis + turn) % 3]);
            if (at + step).cmpge(size).any() {
                continue;
            }
            let [here, there] = [at, at + step].map(|at| field[index(at)] < 0.0);
            if here != there {
                // The four cells around the edge, counter-clockwise as seen from its end.
                let [a, b, c, d] = [at - u - v, at - v, at, at - u].map(&mut vertex);
                let [a, b, c, d] = if here { [a, b, c, d] } else { [d, c, b, a] };
                triangles.extend([[a, b, c], [a, c, d]]);
            }
        }
    }
    positions.iter_mut().for_each(|position| *position = onto_surface(*position, 0.1 * cell, &distance));
    TriangleMesh::new(positions, triangles)
}

/// Fills a corner of a face of the grid if only opposite corners of the face are inside: two sheets would meet there. True if it changed the field.
fn fill(at: UVec3, size: UVec3, index: impl Fn(UVec3) -> usize, field: &mut [f32]) -> bool {
    let faces = [[UVec3::X, UVec3::Y], [UVec3::Y, UVec3::Z], [UVec3::Z, UVec3::X]];
    let filled = faces.into_iter().filter(|[u, v]| {
        if (at + u + v).cmpge(size).any() {
            return false;
        }
        let corners = [at, at + u, at + u + v, at + v].map(&index);
        let [a, b, c, d] = corners.map(|corner| field[corner] < 0.0);
        let is_crossed = a == c && b == d && a != b;
        if is_crossed {
            field[corners[usize::from(a)]] = -f32::EPSILON;
        }
        is_crossed
    });
    filled.count() > 0
}

/// The mean of the points in which the surface crosses the edges of a cell.
fn middle(cell: UVec3, place: impl Fn(UVec3) -> Vec3, field: impl Fn(UVec3) -> f32) -> Vec3 {
    let corner = |number: u32| cell + UVec3::new(number & 1, number >> 1 & 1, number >> 2);
    let edges = (0..8).flat_map(|from| [1, 2, 4].map(|bit| [from, from | bit])).filter(|[from, to]| from != to);
    let crossings = edges.filter_map(|edge| {
        let [from, to] = edge.map(corner);
        let [a, b] = [from, to].map(&field);
        ((a < 0.0) != (b < 0.0)).then(|| place(from).lerp(place(to), a / (a - b)))
    });
    let (sum, count) = crossings.fold((Vec3::ZERO, 0.0), |(sum, count), point| (sum + point, count + 1.0));
    sum / f32::max(count, 1.0)
}

/// Moves a point along the gradient to the surface. Gradients are central differences over two `step`s.
fn onto_surface(point: Vec3, step: f32, distance: impl Fn(Vec3) -> f32) -> Vec3 {
    (0..2).fold(point, |point, _| {
        let gradient = Vec3::AXES.map(|axis| distance(point + axis * step) - distance(point - axis * step));
        point - Vec3::from(gradient).normalize_or_zero() * distance(point)
    })
}
