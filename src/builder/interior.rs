//! The interior of a surface along a grid of parallel lines: its mass properties, and the pieces that bound it.
//!
//! A line runs inside where its winding number, the number of times that it entered minus the number of times that it left, is one or more. So pieces that
//! overlap count once, and cavities are empty. The lines and the integrals are those of the mass properties of a medial mesh.

use glam::DVec3;

use crate::{
    disjoint_sets::DisjointSets,
    medial_axis::{Chord, LINES, MassProperties, first_line, line_position},
};

/// Approximate number of intersections of lines with triangles. The error of the volume is below 0.3 %.
const CROSSINGS: f64 = 300_000.0;

/// Largest number of rows of lines through triangles, in total. It limits the time for many needles.
const ROWS: f64 = 4_000_000.0;

/// Largest part of the lines that may have no end. Beyond it, an opening of the surface is large, and its interior is not known.
const OPEN: f64 = 0.05;

/// The interior of a surface.
pub(super) struct Interior {
    /// `None` if the surface has a large opening.
    pub mass: Option<MassProperties>,
    /// Body of each piece. Pieces that overlap or touch along a line are one body. A cavity belongs to the body around it.
    pub bodies: Vec<u32>,
    pub body_count: usize,
    /// For each piece, true if all lines that meet it run inside on both of its sides. Such a piece does not bound the interior.
    pub buried: Vec<bool>,
}

/// An intersection of a line with a triangle.
struct Crossing {
    line: [i64; 2],
    x: f64,
    /// 1 where the line enters, -1 where it leaves.
    step: i32,
    piece: u32,
}

impl Interior {
    /// The interior of outward triangles. `pieces`: the piece of each triangle. `middle` is the origin of the triangles' coordinates.
    pub fn new(triangles: &[[DVec3; 3]], pieces: &[u32], piece_count: usize, middle: DVec3) -> Self {
        let turned: Vec<[DVec3; 3]> = triangles.iter().map(|t| t.map(|corner| LINES * corner)).collect();
        let (mut area, mut rows) = (0.0, 0.0);
        for [a, b, c] in &turned {
            area += 0.5 * (b - a).cross(c - a).x.abs();
            rows += a.y.max(b.y).max(c.y) - a.y.min(b.y).min(c.y);
        }
        let spacing = (area / CROSSINGS).sqrt().max(rows / ROWS);
        let mut crossings = vec![];
        if spacing > 0.0 {
            for (corners, &piece) in turned.iter().zip(pieces) {
                let step = if (corners[1] - corners[0]).cross(corners[2] - corners[0]).x < 0.0 { 1 } else { -1 };
                cross(corners, spacing, |line, x| crossings.push(Crossing { line, x, step, piece }));
            }
        }
        // At equal places a line enters first, so that bodies that touch are one.
        crossings.sort_unstable_by(|a, b| {
            a.line.cmp(&b.line).then(a.x.total_cmp(&b.x)).then(b.step.cmp(&a.step)).then(a.piece.cmp(&b.piece))
        });
        let mut sets = DisjointSets::new(piece_count);
        let mut buried = vec![None; piece_count];
        let (mut chords, mut lines, mut endless) = (vec![], 0, 0);
        for on_line in crossings.chunk_by(|a, b| a.line == b.line) {
            // A line through a gap of the surface has no end.
            lines += 1;
            if on_line.iter().map(|crossing| crossing.step).sum::<i32>() != 0 {
                endless += 1;
            } else {
                walk(on_line, &mut sets, &mut buried, &mut chords);
            }
        }
        let mut numbers = vec![u32::MAX; piece_count];
        let mut body_count = 0;
        let bodies = (0..piece_count as u32).map(|piece| {
            let number = &mut numbers[sets.find(piece) as usize];
            if *number == u32::MAX {
                *number = body_count;
                body_count += 1;
            }
            *number
        });
        Self {
            mass: (f64::from(endless) <= OPEN * f64::from(lines))
                .then(|| MassProperties::of_chords(&chords, spacing, middle)),
            bodies: bodies.collect(),
            body_count: body_count as usize,
            buried: buried.into_iter().map(|buried| buried == Some(true)).collect(),
        }
    }
}

/// Walks along a line: adds its chords, joins the pieces within each, and notes the pieces that bound the interior.
fn walk(on_line: &[Crossing], sets: &mut DisjointSets, buried: &mut [Option<bool>], chords: &mut Vec<Chord>) {
    let (mut winding, mut entered) = (0, 0.0);
    let mut last: Option<&Crossing> = None;
    for crossing in on_line {
        let before = winding;
        winding += crossing.step;
        let bounds = (before < 1) != (winding < 1);
        let state = &mut buried[crossing.piece as usize];
        *state = Some(state.unwrap_or(true) && before >= 1 && winding >= 1);
        if before >= 1
            && let Some(last) = last
        {
            sets.join(last.piece, crossing.piece);
        }
        if bounds && winding >= 1 {
            entered = crossing.x;
        } else if bounds {
            chords.push(Chord { line: crossing.line, from: entered, to: crossing.x });
        }
        last = Some(crossing);
    }
}

/// Calls `visit` with the lines through a triangle and the x coordinates. Triangles with a common edge have no line twice, and leave none out.
fn cross(corners: &[DVec3; 3], spacing: f64, mut visit: impl FnMut([i64; 2], f64)) {
    let [a, b, c] = corners;
    let mut edges = [[a, b], [b, c], [c, a]];
    // Both triangles of an edge compute the same points, because its lower end comes first.
    edges.iter_mut().for_each(|[from, to]| {
        if (to.y, to.z) < (from.y, from.z) {
            std::mem::swap(from, to);
        }
    });
    let normal = (b - a).cross(c - a);
    let [least, greatest] = [a.x.min(b.x).min(c.x), a.x.max(b.x).max(c.x)];
    let [bottom, top] = [a.y.min(b.y).min(c.y), a.y.max(b.y).max(c.y)].map(|y| first_line(y, spacing));
    for row in bottom..top {
        let y = line_position(row, spacing);
        let met =
            edges.iter().filter(|[from, to]| (first_line(from.y, spacing)..first_line(to.y, spacing)).contains(&row));
        let columns =
            met.map(|[from, to]| first_line(from.z + (to.z - from.z) * ((y - from.y) / (to.y - from.y)), spacing));
        let (first, end) = columns.fold((i64::MAX, i64::MIN), |(lo, hi), column| (lo.min(column), hi.max(column)));
        for column in first..end {
            let z = line_position(column, spacing);
            let x = a.x - (normal.y * (y - a.y) + normal.z * (z - a.z)) / normal.x;
            visit([row, column], if x.is_finite() { x.clamp(least, greatest) } else { least });
        }
    }
}

#[cfg(test)]
mod tests;
