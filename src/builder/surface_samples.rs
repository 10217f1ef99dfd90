//! Points on the surface of the input that stand for it.

use glam::DVec3;

use super::{hull::Ball, parallel, points::Points, solid::Solid};

/// Surface samples, evenly spread over the area, and vertices.
#[derive(Clone)]
pub(super) struct Samples {
    pub points: Points,
    /// Unit normals, whichever way the triangles turn them; after [`turned_outward`](Self::turned_outward) out of the solid, and zero where
    /// the surface is no boundary of it.
    pub normals: Vec<DVec3>,
    /// Share of each sample in the area, which is 1 in all.
    pub weights: Vec<f64>,
    /// Part of the solid on which the sample lies.
    pub parts: Vec<u32>,
    /// Area of the surface.
    pub area: f64,
    /// Mean distance of neighbours.
    pub spacing: f64,
}

/// How much a vertex counts beside a sample of the area.
const VERTEX_WEIGHT: f64 = 0.1;

/// How far from the surface the inside is looked for.
const PROBE: f64 = 1e-4;

impl Samples {
    /// About `count` samples of the area, and up to `vertices` vertices.
    pub fn new(solid: &Solid, count: usize, vertices: usize, seed: u64) -> Self {
        let triangles = solid.tree.triangles();
        let area_vectors: Vec<DVec3> = triangles.iter().map(|[a, b, c]| (b - a).cross(c - a) * 0.5).collect();
        let area: f64 = area_vectors.iter().map(|n| n.length()).sum();
        let share = area / count as f64;
        let vertex_count: usize = solid.vertices.iter().map(Vec::len).sum();
        let stride = vertex_count.div_ceil(vertices.max(1)).max(1);
        let (mut positions, mut normals, mut weights, mut parts) = (vec![], vec![], vec![], vec![]);
        let mut due = 0.5 * share;
        let mut random = Random(seed);
        let mut passed = 0;
        for (index, [a, b, c]) in triangles.iter().enumerate() {
            let normal = area_vectors[index].normalize_or_zero();
            let mut push = |position: DVec3, weight: f64| {
                positions.push(position);
                normals.push(normal);
                weights.push(weight);
                parts.push(solid.parts[index]);
            };
            due -= area_vectors[index].length();
            while due < 0.0 {
                due += share;
                let (s, t) = (random.unit().sqrt(), random.unit());
                push(a * (1.0 - s) + b * (s * (1.0 - t)) + c * (s * t), 1.0 / count as f64);
            }
            for &vertex in &solid.vertices[index] {
                if passed % stride == 0 {
                    push(vertex, VERTEX_WEIGHT / count as f64);
                }
                passed += 1;
            }
        }
        let total: f64 = weights.iter().sum();
        weights.iter_mut().for_each(|w| *w /= total);
        Self { points: Points::new(positions), normals, weights, parts, area, spacing: share.sqrt() }
    }

    pub fn turned_outward(mut self, solid: &Solid) -> Self {
        self.normals = parallel::map(self.len(), 64, |i| outward(solid, self.points.positions[i], self.normals[i]));
        self
    }

    pub fn len(&self) -> usize {
        self.normals.len()
    }
}

/// The normal or its opposite, whichever leads out of the solid, or zero.
fn outward(solid: &Solid, point: DVec3, normal: DVec3) -> DVec3 {
    let below = solid.tree.is_inside(point - normal * PROBE);
    let above = solid.tree.is_inside(point + normal * PROBE);
    match (below, above) {
        (true, false) => normal,
        (false, true) => -normal,
        _ => DVec3::ZERO,
    }
}

/// Splitmix64.
pub(super) struct Random(pub u64);

impl Random {
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    pub fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// Rounds of shrinking; each at least halves what is left, or stops.
const ROUNDS: usize = 24;

/// By what part of its radius a ball may leave the solid.
const OVERLAP: f64 = 0.01;

/// Balls whose two contacts are seen from the centre under a lesser angle than that of this cosine come of facets and noise.
const LEAST_SEPARATION: f64 = 0.75;

/// The largest ball within the solid that touches the surface at `point`, from the side that `normal` leaves.
///
/// It starts too large and shrinks to the nearest point of the surface until none is within.
pub(super) fn medial_ball(solid: &Solid, point: DVec3, normal: DVec3) -> Ball {
    let mut radius = 0.5;
    for _ in 0..ROUNDS {
        let center = point - normal * radius;
        let Some(nearest) = solid.tree.closest(center, radius * (1.0 - OVERLAP)) else { break };
        let chord = point - nearest;
        let smaller = chord.length_squared() / (2.0 * normal.dot(chord));
        if !(smaller > 0.0 && smaller < radius) {
            break;
        }
        let shrunk = point - normal * smaller;
        let separation = (point - shrunk).dot(nearest - shrunk) / (smaller * smaller);
        if separation > LEAST_SEPARATION {
            break;
        }
        radius = smaller;
    }
    Ball { center: point - normal * radius, radius }
}
