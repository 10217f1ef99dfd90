//! Cleans a surface before a build: leaves out triangles and pieces that enclose no volume, and turns the others outward.

use std::f64::consts::PI;

use glam::DVec3;

use super::{
    TriangleMesh, holes,
    mesh::{EdgeUse, pieces, sorted_edges},
    orient::oriented,
};
use crate::disjoint_sets::DisjointSets;

/// Largest part of a piece's area in caps over its holes. The cap over a sheet has about its area, a half; other pieces have thickness.
const MOST_CAPS: f64 = 0.495;

/// A cleaned surface: welded, with caps over its holes, without repeated triangles and sheets, outward.
pub(super) struct Cleaned {
    pub mesh: TriangleMesh,
    /// Number of connected pieces that were left out because they enclose no volume.
    pub sheets: usize,
}

impl Cleaned {
    pub fn new(mesh: &TriangleMesh) -> Self {
        let mut mesh = mesh.welded();
        leave_out_doubles(&mut mesh.triangles);
        let one_sided = turn_alike(&mut mesh);
        let strips = leave_out_strips(&mut mesh, &one_sided);
        let caps = mesh.triangles.len();
        holes::close(&mut mesh);
        let sheets = strips + leave_out_sheets(&mut mesh, caps);
        Self { mesh: oriented(mesh), sheets }
    }
}

/// Leaves out triangles with the corners of another one. Of a triangle and its back one remains, unless they are a wall inside a solid or a fin on it: these
/// end at an edge of other triangles.
fn leave_out_doubles(triangles: &mut Vec<[u32; 3]>) {
    let mut keyed: Vec<([u32; 3], bool, u32)> = (0..).zip(&*triangles).map(|(i, &t)| key(t, i)).collect();
    keyed.sort_unstable();
    let mut kept: Vec<(u32, bool)> = vec![];
    for group in keyed.chunk_by(|a, b| a.0 == b.0) {
        let turned = group.iter().filter(|(_, turned, _)| *turned).count();
        let most_turned = 2 * turned > group.len();
        let first = group.iter().find(|(_, turned, _)| *turned == most_turned);
        kept.extend(first.map(|&(_, _, i)| (i, 2 * turned == group.len())));
    }
    if kept.len() == triangles.len() {
        return;
    }
    kept.sort_unstable();
    let remaining: Vec<[u32; 3]> = kept.iter().map(|&(i, _)| triangles[i as usize]).collect();
    let mut patches = DisjointSets::new(kept.len());
    let is_double = |edge: &EdgeUse| kept[edge.triangle as usize].1;
    let edges = sorted_edges(&remaining);
    let mut ends: Vec<EdgeUse> = vec![];
    for uses in edges.chunk_by(|a, b| a.edge == b.edge) {
        match uses {
            _ if uses.iter().all(is_double) => {
                uses.windows(2).for_each(|pair| _ = patches.join(pair[0].triangle, pair[1].triangle));
            }
            _ if uses.len() % 2 == 1 => ends.extend(uses.iter().copied().filter(is_double)),
            _ => {}
        }
    }
    let mut ends_within = vec![false; kept.len()];
    ends.iter().for_each(|edge| ends_within[patches.find(edge.triangle) as usize] = true);
    let stays = |i: usize| !kept[i].1 || !ends_within[patches.find(i as u32) as usize];
    let stays: Vec<bool> = (0..kept.len()).map(stays).collect();
    *triangles = remaining.into_iter().zip(stays).filter_map(|(triangle, stays)| stays.then_some(triangle)).collect();
}

/// The sorted corners of a triangle, whether sorting turns it, and its number.
fn key(triangle: [u32; 3], number: u32) -> ([u32; 3], bool, u32) {
    let mut sorted = triangle;
    sorted.sort_unstable();
    let first = triangle.iter().position(|&i| i == sorted[0]).unwrap_or(0);
    (sorted, triangle[(first + 1) % 3] != sorted[1], number)
}

/// Turns triangles so that those with a common edge have the same orientation, that of most of the area. Returns true for each triangle of a patch where that
/// is impossible, because the patch has one side only. Such a patch stays unchanged.
fn turn_alike(mesh: &mut TriangleMesh) -> Vec<bool> {
    let edges = sorted_edges(&mesh.triangles);
    let pairs = edges.chunk_by(|a, b| a.edge == b.edge).filter_map(|uses| <[EdgeUse; 2]>::try_from(uses).ok());
    let pairs: Vec<([u32; 2], bool)> = pairs.map(|[a, b]| ([a.triangle, b.triangle], a.along == b.along)).collect();
    let count = mesh.triangles.len();
    if pairs.iter().all(|(_, turns)| !turns) {
        return vec![false; count];
    }
    // Each triangle has two items: as it is, and turned. An item is joined with those of the neighbours that face the same way.
    let mut sets = DisjointSets::new(2 * count);
    for &([a, b], turns) in &pairs {
        let turned = u32::from(turns);
        sets.join(2 * a, 2 * b + turned);
        sets.join(2 * a + 1, 2 * b + (1 - turned));
    }
    let places = mesh.unit_places();
    let mut areas = vec![0.0; 2 * count];
    let mut sides = vec![];
    for (number, triangle) in (0..).zip(&mesh.triangles) {
        let [as_is, turned] = [2 * number, 2 * number + 1].map(|item| sets.find(item));
        areas[as_is as usize] += area(&triangle.map(|i| places[i as usize]));
        sides.push([as_is, turned]);
    }
    for (triangle, &[as_is, turned]) in mesh.triangles.iter_mut().zip(&sides) {
        // If the areas are equal, the orientation of the first triangle is chosen.
        if (areas[as_is as usize], turned) < (areas[turned as usize], as_is) {
            triangle.swap(1, 2);
        }
    }
    sides.iter().map(|[as_is, turned]| as_is == turned).collect()
}

/// Twice the area of a triangle.
fn area([a, b, c]: &[DVec3; 3]) -> f64 {
    (b - a).cross(c - a).length()
}

/// Leaves out pieces with a patch that has one side only, as a Moebius strip, if their rims are long relative to their area. A single fault in a scan stays.
/// Returns the number of pieces that were left out.
fn leave_out_strips(mesh: &mut TriangleMesh, one_sided: &[bool]) -> usize {
    if !one_sided.contains(&true) {
        return 0;
    }
    let (piece_of, count) = pieces(mesh.positions.len(), &mesh.triangles);
    let places = mesh.unit_places();
    let (mut areas, mut rims, mut is_strip) = (vec![0.0; count], vec![0.0; count], vec![false; count]);
    for ((&piece, triangle), one_sided) in piece_of.iter().zip(&mesh.triangles).zip(one_sided) {
        areas[piece as usize] += 0.5 * area(&triangle.map(|i| places[i as usize]));
        is_strip[piece as usize] |= one_sided;
    }
    for rim in sorted_edges(&mesh.triangles).chunk_by(|a, b| a.edge == b.edge).filter(|uses| uses.len() == 1) {
        let [a, b] = rim[0].edge.map(|i| places[i as usize]);
        rims[piece_of[rim[0].triangle as usize] as usize] += a.distance(b);
    }
    // A disc has a ratio of 4 pi, and each opening of a solid has less. A strip has more.
    (0..count).for_each(|piece| is_strip[piece] &= rims[piece] * rims[piece] > 4.0 * PI * areas[piece]);
    leave_out(mesh, &piece_of, &is_strip)
}

/// Leaves out the pieces whose caps are a large part of their area. Caps start at number `caps`. Returns the number of these pieces.
fn leave_out_sheets(mesh: &mut TriangleMesh, caps: usize) -> usize {
    let (piece_of, count) = pieces(mesh.positions.len(), &mesh.triangles);
    let places = mesh.unit_places();
    let mut areas = vec![[0.0; 2]; count];
    for (number, (&piece, triangle)) in piece_of.iter().zip(&mesh.triangles).enumerate() {
        let area = area(&triangle.map(|i| places[i as usize]));
        areas[piece as usize][0] += area;
        areas[piece as usize][1] += if number < caps { 0.0 } else { area };
    }
    let is_sheet: Vec<bool> = areas.iter().map(|[all, caps]| *caps > MOST_CAPS * all).collect();
    leave_out(mesh, &piece_of, &is_sheet)
}

/// Leaves out the triangles of some pieces. Returns the number of these pieces.
fn leave_out(mesh: &mut TriangleMesh, piece_of: &[u32], pieces: &[bool]) -> usize {
    let mut of_triangle = piece_of.iter();
    mesh.triangles.retain(|_| of_triangle.next().is_some_and(|&piece| !pieces[piece as usize]));
    pieces.iter().filter(|&&piece| piece).count()
}

#[cfg(test)]
mod tests;
