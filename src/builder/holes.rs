//! Closes holes with caps of minimal area.
//!
//! At an opening, as in scans and the undersides of many models, nothing would stop a sphere from bulging out. But not every rim
//! bounds a hole: patches that lie edge to edge without being joined have rims as well, and a cap over such a patch would cut into the
//! solid. The winding number distinguishes them. On both sides of a cap over a hole it differs from an integer by about a half; other pieces that
//! enclose the hole add an integer. On both sides of an unjoined patch it is close to an integer.

use std::collections::{BTreeMap, HashMap};

use glam::DVec3;

use super::{
    TriangleMesh,
    mesh::{edge_uses, tree_of},
    tree::TriangleTree,
};

/// A rim with more corners is reduced by cutting off every other corner. The time of a cap of minimal area grows with the cube of the corners.
const MOST_CORNERS: usize = 160;

/// Smallest mean difference between the winding number and the nearest integer, on both sides of a cap over a hole.
const LEAST_FRACTION: f64 = 0.25;

/// Number of iterations in which rims are classified.
const ROUNDS: usize = 8;

/// Distance of probe points from a cap: a multiple of the square root of twice a triangle's area, and a minimum as a part of the diagonal.
const PROBE: [f64; 2] = [0.02, 2e-5];

impl TriangleMesh {
    /// The same surface, welded, with caps over its holes. Other rims stay open: those of patches that are not joined to their neighbours.
    ///
    /// # Panics
    /// If an index of the mesh is out of range.
    #[must_use]
    pub fn with_holes_closed(&self) -> Self {
        let mut mesh = self.welded();
        close(&mut mesh);
        mesh
    }
}

/// Adds the caps to a welded mesh, after its triangles.
pub(super) fn close(mesh: &mut TriangleMesh) {
    let rims = rims(&mesh.triangles);
    if rims.is_empty() {
        return;
    }
    let places = mesh.unit_places();
    let corners = |triangle: &[u32; 3]| triangle.map(|i| places[i as usize]);
    let mut caps: Vec<Vec<[u32; 3]>> = rims.into_iter().map(|rim| cap(rim, &places)).collect();
    // Each closed hole makes the winding numbers at the other rims more accurate.
    for _ in 0..ROUNDS {
        let tree = tree_of(mesh.triangles.iter().map(corners));
        let (closing, others): (Vec<_>, Vec<_>) =
            caps.into_iter().partition(|cap| is_over_a_hole(cap.iter().map(corners), &tree));
        if closing.is_empty() {
            break;
        }
        mesh.triangles.extend(closing.into_iter().flatten());
        caps = others;
    }
}

/// Closed loops of the edges with an odd number of triangles. A loop contains a vertex at most once and runs against the sense of its triangles.
fn rims(triangles: &[[u32; 3]]) -> Vec<Vec<u32>> {
    let uses = edge_uses(triangles);
    // Number of triangles that run from `from` to `to`, minus the number that run back.
    let sense = |from: u32, to: u32| {
        let [along, back] = uses[&[from.min(to), from.max(to)]].map(i64::from);
        if from < to { along - back } else { back - along }
    };
    // An even number of such edges ends at each vertex, because each triangle has two or no edges there. So every walk returns to its start.
    let mut open = BTreeMap::<u32, Vec<u32>>::new();
    for &[i, j] in uses.iter().filter(|(_, [along, back])| (along + back) % 2 == 1).map(|(edge, _)| edge) {
        open.entry(i).or_default().push(j);
        open.entry(j).or_default().push(i);
    }
    open.values_mut().for_each(|ends| ends.sort_unstable());
    let mut rims = vec![];
    let mut path: Vec<u32> = vec![];
    let mut place = HashMap::<u32, usize>::new();
    loop {
        if path.is_empty() {
            let Some((&start, _)) = open.first_key_value() else { return rims };
            path.push(start);
            place.insert(start, 0);
        }
        let from = path[path.len() - 1];
        let Some(to) = step(&mut open, from) else {
            // A walk can only end at its start.
            path.clear();
            place.clear();
            continue;
        };
        let Some(&met) = place.get(&to) else {
            place.insert(to, path.len());
            path.push(to);
            continue;
        };
        // The path meets itself: the loop is split off.
        let mut rim = path.split_off(met);
        rim.iter().for_each(|vertex| _ = place.remove(vertex));
        path.push(to);
        place.insert(to, met);
        let along: i64 = (0..rim.len()).map(|i| sense(rim[i], rim[(i + 1) % rim.len()])).sum();
        if along > 0 {
            rim.reverse();
        }
        rims.push(rim);
    }
}

/// Removes the first remaining edge at a vertex, and returns its other end.
fn step(open: &mut BTreeMap<u32, Vec<u32>>, from: u32) -> Option<u32> {
    let to = *open.get(&from)?.first()?;
    for [at, end] in [[from, to], [to, from]] {
        if let Some(ends) = open.get_mut(&at) {
            ends.retain(|&other| other != end);
            if ends.is_empty() {
                open.remove(&at);
            }
        }
    }
    Some(to)
}

/// The triangles of minimal area over a rim, in its sense.
fn cap(mut rim: Vec<u32>, places: &[DVec3]) -> Vec<[u32; 3]> {
    let mut triangles = vec![];
    while rim.len() > MOST_CORNERS {
        let corners = rim.len() / 2 * 2;
        triangles.extend((1..corners).step_by(2).map(|i| [rim[i - 1], rim[i], rim[(i + 1) % rim.len()]]));
        rim = rim.into_iter().step_by(2).collect();
    }
    // For each part of the rim between two corners, closed by a line: the minimal area, and the third corner of the triangle at that line.
    let count = rim.len();
    let mut best = vec![(0.0, 0); count * count];
    for length in 2..count {
        for from in 0..count - length {
            let to = from + length;
            let area = |apex: usize| {
                let [a, b, c] = [from, apex, to].map(|i| places[rim[i] as usize]);
                let sides = best[from * count + apex].0 + best[apex * count + to].0;
                (sides + (b - a).cross(c - a).length(), apex)
            };
            let least = (from + 1..to).map(area).min_by(|a, b| a.0.total_cmp(&b.0));
            best[from * count + to] = least.unwrap_or_default();
        }
    }
    let mut waiting = vec![[0, count.saturating_sub(1)]];
    while let Some([from, to]) = waiting.pop() {
        if to >= from + 2 {
            let apex = best[from * count + to].1;
            triangles.push([from, apex, to].map(|i| rim[i]));
            waiting.extend([[from, apex], [apex, to]]);
        }
    }
    triangles
}

/// True if a cap lies over a hole: on both sides the winding number is not close to an integer.
fn is_over_a_hole(cap: impl Iterator<Item = [DVec3; 3]>, tree: &TriangleTree) -> bool {
    let (mut area, mut fractions) = (0.0, [0.0; 2]);
    for [a, b, c] in cap {
        let normal = (b - a).cross(c - a);
        let (middle, size) = ((a + b + c) / 3.0, normal.length());
        let off = normal.normalize_or_zero() * (PROBE[0] * size.sqrt()).max(PROBE[1]);
        area += size;
        for (sum, side) in fractions.iter_mut().zip([-off, off]) {
            let windings = tree.winding(middle + side);
            *sum += size * (windings - windings.round()).abs();
        }
    }
    fractions.iter().all(|fraction| *fraction >= LEAST_FRACTION * area)
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::builder::{MeshReport, mesh::tests::tetrahedron};

    /// A bowl: the lower half of a sphere of radius 1, with `strips` strips of `turns` quads.
    fn bowl(strips: u32, turns: u32) -> TriangleMesh {
        let mut positions = vec![Vec3::NEG_Y];
        for ring in 1..=strips {
            let (radius, height) = (f32::from(ring as u16) / strips as f32 * std::f32::consts::FRAC_PI_2).sin_cos();
            positions.extend((0..turns).map(|turn| {
                let (z, x) = (turn as f32 / turns as f32 * std::f32::consts::TAU).sin_cos();
                Vec3::new(radius * x, -height, radius * z)
            }));
        }
        let at = |ring: u32, turn: u32| 1 + (ring - 1) * turns + turn % turns;
        let mut triangles: Vec<[u32; 3]> = (0..turns).map(|turn| [0, at(1, turn), at(1, turn + 1)]).collect();
        for ring in 1..strips {
            for turn in 0..turns {
                let [a, b, c, d] = [at(ring, turn), at(ring, turn + 1), at(ring + 1, turn), at(ring + 1, turn + 1)];
                triangles.extend([[a, c, b], [b, c, d]]);
            }
        }
        TriangleMesh::new(positions, triangles).unwrap()
    }

    #[test]
    fn holes_get_flat_caps_whichever_way_the_surface_turns() {
        for turns in [3, 24, 700] {
            let mesh = bowl(6, turns);
            let report = MeshReport::new(&mesh);
            assert_eq!(report.boundary_edges, turns as usize);
            for inwards in [false, true] {
                let mut mesh = mesh.clone();
                if inwards {
                    mesh.triangles.iter_mut().for_each(|t| t.swap(0, 1));
                }
                let closed = MeshReport::new(&mesh.with_holes_closed());
                assert!(closed.is_closed(), "{closed}");
                assert_eq!(closed.triangles - report.triangles, turns as usize - 2);
                let circle = f64::from(turns) / 2.0 * (std::f64::consts::TAU / f64::from(turns)).sin();
                assert!((closed.area - report.area - circle).abs() < 1e-4, "{closed}");
            }
        }
    }

    #[test]
    fn a_cap_keeps_to_a_rim_that_turns_in() {
        // An L-shape. A fan from the middle, or from any corner except one, would miss a part of it and add others.
        let rim = [[0, 0], [3, 0], [3, 1], [1, 1], [1, 3], [0, 3]].map(|[x, y]| DVec3::new(x.into(), y.into(), 0.0));
        for first in 0..6 {
            let mut places = rim;
            places.rotate_left(first);
            let triangles = cap((0..6).collect(), &places);
            let areas = triangles.iter().map(|t| {
                let [a, b, c] = t.map(|i| places[i as usize]);
                (b - a).cross(c - a).z * 0.5
            });
            let areas: Vec<f64> = areas.collect();
            assert!(areas.len() == 4 && areas.iter().all(|&area| area > 0.0), "{areas:?}");
            assert!((areas.iter().sum::<f64>() - 5.0).abs() < 1e-12);
        }
    }

    #[test]
    fn meshes_without_holes_stay_unchanged() {
        let whole = tetrahedron();
        assert_eq!(whole.with_holes_closed(), whole.welded());
        // Faces that lie edge to edge with tiny gaps.
        let mut mesh = TriangleMesh { positions: vec![], triangles: vec![] };
        for (i, triangle) in (0..).zip(&whole.triangles) {
            mesh.positions.extend(whole.corners(*triangle).map(|p| p * (1.0 + 1e-4 * i as f32)));
            mesh.triangles.push([3 * i, 3 * i + 1, 3 * i + 2]);
        }
        assert_eq!(MeshReport::new(&mesh).boundary_edges, 12);
        assert_eq!(mesh.with_holes_closed(), mesh.welded());
    }

    #[test]
    fn a_hole_that_another_piece_hides_is_closed() {
        // Smaller bowls: upside down inside the first one, at its rim, and far away.
        let (bowl, mut mesh) = (bowl(6, 12), bowl(6, 12));
        for (size, at) in [(-0.3, Vec3::new(0.3, -0.6, 0.0)), (0.2, Vec3::new(0.9, 0.0, 0.0)), (0.5, Vec3::X * 9.0)] {
            let first = mesh.positions.len() as u32;
            mesh.positions.extend(bowl.positions.iter().map(|&p| p * size + at));
            mesh.triangles.extend(bowl.triangles.iter().map(|t| t.map(|i| first + i)));
        }
        let (open, closed) = (MeshReport::new(&mesh), MeshReport::new(&mesh.with_holes_closed()));
        assert_eq!((open.components, open.boundary_edges), (4, 48));
        assert!(closed.boundary_edges == 0 && closed.triangles == open.triangles + 40, "{closed}");
    }

    #[test]
    fn rims_that_touch_are_separate_holes() {
        // A plate of four by four quads without three: two holes with a common corner, and a third at the outline.
        let at = |x: u32, y: u32| 5 * y + x;
        let mut triangles = vec![];
        for (x, y) in (0..4).flat_map(|x| (0..4).map(move |y| (x, y))) {
            if ![(1, 1), (2, 2), (1, 3)].contains(&(x, y)) {
                let [a, b, c, d] = [at(x, y), at(x + 1, y), at(x, y + 1), at(x + 1, y + 1)];
                triangles.extend([[a, b, c], [b, d, c]]);
            }
        }
        let mut lengths: Vec<usize> = rims(&triangles).iter().map(Vec::len).collect();
        lengths.sort_unstable();
        // The outline includes the third.
        assert_eq!(lengths, [4, 4, 18]);
    }
}
