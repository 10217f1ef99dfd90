//! Points on the surface of the input that represent it.

use glam::DVec3;

use super::{hull::Ball, parallel, points::Points, solid::Solid};
use crate::random::Random;

/// Surface samples, evenly spread over the area, and vertices.
#[derive(Clone)]
pub(super) struct Samples {
    pub points: Points,
    /// Unit normals, with the orientation of the triangles. After [`turned_outward`](Self::turned_outward) they point out of the solid, and are zero where
    /// the surface does not bound it.
    pub normals: Vec<DVec3>,
    /// Share of each sample in the area. The sum is 1.
    pub weights: Vec<f64>,
    /// Part of the solid on which the sample lies.
    pub parts: Vec<u32>,
    /// Area of the surface.
    pub area: f64,
    /// Mean distance between neighbours.
    pub spacing: f64,
}

/// Weight of a vertex relative to a sample of the area.
const VERTEX_WEIGHT: f64 = 0.1;

/// Minimum number of samples of the area per part, and its lower limit for many parts.
const LEAST_OF_PART: [usize; 2] = [24, 2];

/// Distances from the surface at which the inside is probed. The second one is for solids that are too thin for the first.
const PROBES: [f64; 2] = [1e-4, 1e-5];

impl Samples {
    /// About `count` samples of the area, and up to `vertices` vertices. Parts that are too small for their share get additional samples.
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
                push(point_of_triangle(&mut random, &[*a, *b, *c]), 1.0 / count as f64);
            }
            for &vertex in &solid.vertices[index] {
                if passed % stride == 0 {
                    push(vertex, VERTEX_WEIGHT / count as f64);
                }
                passed += 1;
            }
        }
        let mut seen = vec![0; solid.part_count];
        parts.iter().for_each(|&part| seen[part as usize] += 1);
        let least = LEAST_OF_PART[0].min(count / solid.part_count).max(LEAST_OF_PART[1]);
        let is_small = |index: usize| seen[solid.parts[index] as usize] < least;
        let small: Vec<usize> = (0..triangles.len()).filter(|&index| is_small(index)).collect();
        let mut part_areas = vec![0.0; solid.part_count];
        small.iter().for_each(|&index| part_areas[solid.parts[index] as usize] += area_vectors[index].length());
        let shares: Vec<f64> = part_areas.iter().map(|area| area / least as f64).collect();
        let mut due: Vec<f64> = shares.iter().map(|share| 0.5 * share).collect();
        for index in small {
            let part = solid.parts[index];
            let (due, share) = (&mut due[part as usize], shares[part as usize]);
            *due -= area_vectors[index].length();
            while *due < 0.0 {
                *due += share;
                positions.push(point_of_triangle(&mut random, &triangles[index]));
                normals.push(area_vectors[index].normalize_or_zero());
                weights.push(share / area);
                parts.push(part);
            }
        }
        let all = Self { points: Points::new(positions), normals, weights, parts, area, spacing: share.sqrt() };
        all.shown(solid)
    }

    /// The samples that no other part of the solid hides. Their weights sum to 1.
    fn shown(self, solid: &Solid) -> Self {
        let positions = &self.points.positions;
        let shown = parallel::map(positions.len(), 64, |i| !solid.is_hidden(positions[i]));
        let shown = || (0..shown.len()).filter(|&i| shown[i]);
        let total: f64 = shown().map(|i| self.weights[i]).sum();
        Self {
            points: Points::new(shown().map(|i| positions[i]).collect()),
            normals: shown().map(|i| self.normals[i]).collect(),
            weights: shown().map(|i| self.weights[i] / total).collect(),
            parts: shown().map(|i| self.parts[i]).collect(),
            ..self
        }
    }

    pub fn turned_outward(mut self, solid: &Solid) -> Self {
        self.normals = parallel::map(self.len(), 64, |i| outward(solid, self.points.positions[i], self.normals[i]));
        self
    }

    pub fn len(&self) -> usize {
        self.normals.len()
    }
}

/// The normal or its opposite, the one that points out of the solid. Zero if neither does.
fn outward(solid: &Solid, point: DVec3, normal: DVec3) -> DVec3 {
    for probe in PROBES.map(|probe| normal * probe) {
        match [point - probe, point + probe].map(|place| solid.is_inside(place)) {
            [true, false] => return normal,
            [false, true] => return -normal,
            [true, true] => break,
            [false, false] => {}
        }
    }
    DVec3::ZERO
}

/// A random point of a triangle, uniform by area.
fn point_of_triangle(random: &mut Random, [a, b, c]: &[DVec3; 3]) -> DVec3 {
    let (s, t) = (random.unit_f64().sqrt(), random.unit_f64());
    a * (1.0 - s) + b * (s * (1.0 - t)) + c * (s * t)
}

/// Largest number of iterations of shrinking.
const ROUNDS: usize = 24;

/// Largest distance that a ball may protrude from the solid, as a part of its radius. It may not protrude by the radius that it would have otherwise, because
/// a large ball protrudes little from a thin wall.
const OVERLAP: f64 = 0.01;

/// Smallest protrusion that is distinguished from rounding, as a part of the radius.
const UNSEEN: f64 = 1e-5;

/// Factor on the radius of a ball that has passed a thin wall.
const CLOSER: f64 = 0.1;

/// Cosine of the smallest angle between a ball's two contacts, as seen from its centre. Balls with smaller angles result from facets and noise.
const LEAST_SEPARATION: f64 = 0.75;

/// The largest ball inside the solid that touches the surface at `point`, on the side opposite to `normal`.
///
/// It starts with the size of its part, and shrinks to touch the nearest point of the surface until no point of the surface is inside.
pub(super) fn medial_ball(solid: &Solid, part: u32, point: DVec3, normal: DVec3) -> Ball {
    let mut radius = solid.part_radii[part as usize];
    for _ in 0..ROUNDS {
        let center = point - normal * radius;
        let Some(nearest) = solid.tree.closest(center, radius * (1.0 - UNSEEN)) else {
            if solid.is_inside(center) {
                break;
            }
            // The opposite wall is too near to be seen from afar.
            radius *= CLOSER;
            continue;
        };
        let chord = point - nearest;
        let smaller = chord.length_squared() / (2.0 * normal.dot(chord));
        let protrusion = radius - center.distance(nearest);
        if !(smaller > 0.0 && smaller < radius) || protrusion < (OVERLAP * radius).min(smaller) {
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
