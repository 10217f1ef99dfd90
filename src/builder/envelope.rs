//! The shape under construction, and distances of points to its envelope.

use std::collections::{BTreeSet, HashSet};

use glam::DVec3;

use super::{
    hull::{BLOCK, Ball, Hull, nearest_to_block, sample_sphere},
    parallel,
    points::Points,
};
use crate::{geometry::Primitive, medial_axis::numbers_of_kept};

/// Spheres joined by edges and faces. Edges are sorted pairs and include those of the faces.
#[derive(Clone, Debug, Default)]
pub(super) struct Complex {
    pub balls: Vec<Ball>,
    pub edges: Vec<[u32; 2]>,
    pub faces: Vec<[u32; 3]>,
}

/// The three edges of a face.
pub(super) fn edges_of([a, b, c]: [u32; 3]) -> [[u32; 2]; 3] {
    [[a, b], [b, c], [a, c]]
}

impl Complex {
    /// The primitives: faces, edges without a face, and spheres without an edge.
    pub fn primitives(&self) -> Vec<Primitive> {
        let covered: HashSet<[u32; 2]> = self.faces.iter().flat_map(|&f| edges_of(f)).collect();
        let mut joined = vec![false; self.balls.len()];
        self.edges.iter().flatten().for_each(|&i| joined[i as usize] = true);
        let slabs = self.faces.iter().map(|&f| Primitive::Slab(f));
        let cones = self.edges.iter().filter(|e| !covered.contains(*e)).map(|&e| Primitive::Cone(e));
        let alone = (0..self.balls.len()).filter(|&i| !joined[i]).map(|i| Primitive::Sphere([i as u32]));
        slabs.chain(cones).chain(alone).collect()
    }

    /// Removes the spheres in `gone`, which no edge or face may use, and renumbers the others.
    pub fn compact(&mut self, gone: &BTreeSet<u32>) {
        let numbers = numbers_of_kept((0..self.balls.len() as u32).map(|i| !gone.contains(&i)));
        let mut index = 0;
        self.balls.retain(|_| {
            index += 1;
            !gone.contains(&(index - 1))
        });
        self.edges.iter_mut().flatten().for_each(|i| *i = numbers[*i as usize]);
        self.faces.iter_mut().flatten().for_each(|i| *i = numbers[*i as usize]);
        self.edges.sort_unstable();
        self.faces.sort_unstable();
    }

    pub fn envelope(&self) -> Envelope {
        Envelope::of(&self.balls, self.primitives())
    }
}

/// The primitives of a complex, prepared for distances.
pub(super) struct Envelope {
    pub primitives: Vec<Primitive>,
    pub hulls: Vec<Hull>,
}

/// Limits for exact results at any distance.
const ALL: [f32; 2] = [f32::NEG_INFINITY, f32::INFINITY];

/// The nearest primitive to a point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Hit {
    /// Signed distance to the primitive, negative inside.
    pub distance: f64,
    pub primitive: u32,
    /// Weights of the primitive's spheres. They blend to the sphere nearest to the point.
    pub weights: [f64; 3],
    /// Unit direction from the centre of that sphere to the point.
    pub normal: DVec3,
}

/// A point on a primitive's surface: the point in direction `normal` on the sphere at `weights`.
#[derive(Clone, Copy, Debug)]
pub(super) struct SurfacePoint {
    pub primitive: u32,
    pub weights: [f64; 3],
    pub normal: DVec3,
    /// Area represented by the point.
    pub area: f64,
}

/// A part of the surfaces of all primitives.
pub(super) enum Piece {
    /// A primitive, without its spheres.
    Sides(u32),
    /// The sphere at a corner of a primitive.
    Sphere(u32, usize),
}

impl Envelope {
    pub fn of(balls: &[Ball], primitives: Vec<Primitive>) -> Self {
        let hulls = primitives.iter().map(|p| Hull::new(balls, p)).collect();
        Self { primitives, hulls }
    }

    pub fn point(&self, s: &SurfacePoint) -> DVec3 {
        self.hulls[s.primitive as usize].point(&s.weights, s.normal)
    }

    /// Points about `spacing` apart, at least five around a cone, on the surfaces of all spheres, cones and slabs, including hidden parts.
    pub fn surface(&self, spacing: f64) -> Vec<SurfacePoint> {
        const PIECES_PER_TASK: usize = 8;
        let pieces = self.pieces();
        parallel::flat_map(pieces.len(), PIECES_PER_TASK, |i, points| {
            self.sample(&pieces[i], spacing, |point| points.push(point));
        })
    }

    /// The sides of all cones and slabs, and all spheres.
    pub fn pieces(&self) -> Vec<Piece> {
        let mut seen = HashSet::new();
        let mut pieces: Vec<Piece> = (0..self.hulls.len() as u32).map(Piece::Sides).collect();
        for (primitive, spheres) in (0..).zip(self.primitives.iter().map(Primitive::indices)) {
            let fresh = (0..3).zip(spheres).filter(|(_, sphere)| seen.insert(**sphere));
            pieces.extend(fresh.map(|(corner, _)| Piece::Sphere(primitive, corner)));
        }
        pieces
    }

    /// Calls `push` with the points on a piece.
    pub fn sample(&self, piece: &Piece, spacing: f64, mut push: impl FnMut(SurfacePoint)) {
        match *piece {
            Piece::Sides(primitive) => self.hulls[primitive as usize].sample(spacing, |weights, normal, area| {
                push(SurfacePoint { primitive, weights, normal, area });
            }),
            Piece::Sphere(primitive, corner) => {
                let mut weights = [0.0; 3];
                weights[corner] = 1.0;
                let radius = self.hulls[primitive as usize].blend(&weights).radius;
                sample_sphere(radius, spacing, |normal, area| {
                    push(SurfacePoint { primitive, weights, normal, area });
                });
            }
        }
    }

    /// The nearest primitive to each point.
    pub fn hits(&self, points: &Points) -> Vec<Hit> {
        self.nearest(points, &self.all(), ALL, |i, primitive, _| self.hit(points.positions[i], primitive))
    }

    /// The nearest primitive to each point and the signed distance to it, up to the rounding of an f32.
    pub fn nearest_primitives(&self, points: &Points) -> Vec<(u32, f64)> {
        self.nearest(points, &self.all(), ALL, |_, primitive, distance| (primitive, f64::from(distance)))
    }

    /// The signed distance of each point to the nearest primitive, up to the rounding of an f32.
    pub fn distances(&self, points: &Points) -> Vec<f64> {
        self.distances_among(points, &self.all())
    }

    /// The same to the nearest of the given primitives, infinite for an empty list.
    pub fn distances_among(&self, points: &Points, among: &[u32]) -> Vec<f64> {
        self.nearest(points, among, ALL, |_, _, distance| f64::from(distance))
    }

    /// Depth of each point inside the given primitives, 0 outside, up to the rounding of an f32. A depth of more than `enough` may be too small, but not
    /// less than `enough`.
    pub fn depths_among(&self, points: &Points, among: &[u32], enough: f64) -> Vec<f64> {
        self.nearest(points, among, [-enough as f32, 0.0], |_, _, distance| f64::from(-distance))
    }

    pub fn depths(&self, points: &Points, enough: f64) -> Vec<f64> {
        self.depths_among(points, &self.all(), enough)
    }

    fn all(&self) -> Vec<u32> {
        (0..self.hulls.len() as u32).collect()
    }

    /// For each point, the result of `found` for its index, the nearest of the given primitives and the distance. If no primitive is within `limit`,
    /// the distance is `limit` and the primitive is arbitrary. If several primitives are within `enough`, it may be any
    /// of them, with its distance.
    fn nearest<R: Send + 'static>(
        &self,
        points: &Points,
        among: &[u32],
        [enough, limit]: [f32; 2],
        found: impl Fn(usize, u32, f32) -> R + Sync,
    ) -> Vec<R> {
        let gaps_of = |middles| among.iter().map(|&p| self.hulls[p as usize].distances(middles)).collect();
        let gaps_of_groups: Vec<Vec<[f32; BLOCK]>> = points.group_middles.iter().map(gaps_of).collect();
        parallel::flat_map(points.groups.len(), 1, |at, results| {
            let group = &points.groups[at];
            let gaps = gaps_of_groups[at / BLOCK].iter().map(|gaps| gaps[at % BLOCK]);
            let reach = (gaps.clone().fold(f32::INFINITY, f32::min) + group.radius).min(limit) + group.radius;
            let near: Vec<u32> = among.iter().zip(gaps).filter(|(_, gap)| *gap <= reach).map(|(&p, _)| p).collect();
            let gaps: Vec<[f32; BLOCK]> =
                near.iter().map(|&p| self.hulls[p as usize].distances(&group.middles)).collect();
            let mut least = [f32::INFINITY; BLOCK];
            gaps.iter().for_each(|gaps| (0..BLOCK).for_each(|i| least[i] = least[i].min(gaps[i])));
            let mut nearer = vec![];
            for (lane, block) in points.blocks_of(at).enumerate() {
                let radius = points.blocks[block].radius;
                let reach = (least[lane] + radius).min(limit) + radius;
                nearer.clear();
                nearer.extend(near.iter().zip(&gaps).map(|(&p, gaps)| (p, gaps[lane])).filter(|n| n.1 <= reach));
                let (primitives, distances) =
                    nearest_to_block(&self.hulls, &nearer, &points.blocks[block].points, radius, [enough, limit]);
                let nearest = primitives.into_iter().zip(distances);
                results.extend(points.range(block).zip(nearest).map(|(i, (p, d))| found(i, p, d)));
            }
        })
    }

    /// The hit of a point on a given primitive.
    pub fn hit(&self, point: DVec3, primitive: u32) -> Hit {
        let (distance, weights) = self.hulls[primitive as usize].closest(point);
        let center = self.hulls[primitive as usize].blend(&weights).center;
        Hit { distance, primitive, weights, normal: (point - center).normalize_or(DVec3::Z) }
    }
}
