//! The first spheres: surface samples are grouped into clusters, with one sphere per cluster.
//!
//! A sphere fits its cluster if it touches the tangent planes of the samples. So a cluster may extend along a whole cylinder or
//! plate, as a cone or a slab between two spheres requires.

use glam::DVec3;

use crate::builder::{hull::Ball, parallel, surface_samples::Samples};

/// Spheres, and the index of each sample's sphere (`u32::MAX` for a sample that does not bound the solid).
pub(super) struct Clusters {
    pub balls: Vec<Ball>,
    pub parts: Vec<u32>,
    pub labels: Vec<u32>,
}

/// Weight of the distance from the sphere, relative to the distance of the sphere from the tangent plane.
const EUCLIDEAN: f64 = 0.2;

const SETTLING_ROUNDS: usize = 3;

pub(super) fn cluster(samples: &Samples, medial: &[Option<Ball>], count: usize, part_count: usize) -> Clusters {
    let mut clusters = Clusters { balls: vec![], parts: vec![], labels: vec![u32::MAX; samples.len()] };
    // One sphere per part: the largest medial ball of its samples.
    let mut largest: Vec<Option<Ball>> = vec![None; part_count];
    for (ball, &part) in medial.iter().zip(&samples.parts) {
        let best = &mut largest[part as usize];
        if best.is_none_or(|b| ball.is_some_and(|ball| b.radius < ball.radius)) {
            *best = *ball;
        }
    }
    for (part, ball) in largest.into_iter().enumerate() {
        clusters.balls.extend(ball);
        clusters.parts.extend(ball.map(|_| part as u32));
    }
    let mut energies = clusters.assign(samples);
    while clusters.balls.len() < count {
        let more = (clusters.balls.len() / 4).clamp(1, count - clusters.balls.len());
        if !clusters.split(samples, medial, &energies, more) {
            break;
        }
        clusters.assign(samples);
        clusters.fit(samples, medial);
        energies = clusters.assign(samples);
    }
    for _ in 0..SETTLING_ROUNDS {
        clusters.fit(samples, medial);
        clusters.assign(samples);
    }
    clusters
}

fn energy(ball: &Ball, point: DVec3, normal: DVec3) -> f64 {
    let to_plane = normal.dot(ball.center - point) + ball.radius;
    to_plane * to_plane + EUCLIDEAN * ball.distance(point).powi(2)
}

impl Clusters {
    /// Assigns each sample to the sphere that fits it best. Returns the energies of the fit.
    fn assign(&mut self, samples: &Samples) -> Vec<f64> {
        let mut of_part: Vec<Vec<u32>> = vec![];
        for (ball, &part) in self.parts.iter().enumerate() {
            of_part.resize(of_part.len().max(part as usize + 1), vec![]);
            of_part[part as usize].push(ball as u32);
        }
        let best = parallel::map(samples.len(), 256, |i| {
            let (point, normal) = (samples.points.positions[i], samples.normals[i]);
            let mut best = (u32::MAX, f64::INFINITY);
            if normal == DVec3::ZERO {
                return best;
            }
            for &ball in of_part.get(samples.parts[i] as usize).into_iter().flatten() {
                let energy = energy(&self.balls[ball as usize], point, normal);
                if energy < best.1 {
                    best = (ball, energy);
                }
            }
            best
        });
        self.labels = best.iter().map(|b| b.0).collect();
        best.into_iter().map(|b| b.1).collect()
    }

    /// Adds spheres at the samples with the worst fit, at most one per cluster. Returns false if all samples fit.
    fn split(&mut self, samples: &Samples, medial: &[Option<Ball>], energies: &[f64], more: usize) -> bool {
        let mut worst: Vec<(f64, u32)> = vec![(0.0, 0); self.balls.len()];
        for (i, &label) in self.labels.iter().enumerate().filter(|(_, label)| **label != u32::MAX) {
            let entry = &mut worst[label as usize];
            if energies[i] > entry.0 && medial[i].is_some() {
                *entry = (energies[i], i as u32);
            }
        }
        worst.retain(|w| w.0 > 0.0);
        worst.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        worst.truncate(more);
        for &(_, sample) in &worst {
            self.balls.extend(medial[sample as usize]);
            self.parts.push(samples.parts[sample as usize]);
        }
        !worst.is_empty()
    }

    /// Fits each sphere to its cluster by least squares, then replaces it by the most similar medial ball of the cluster.
    fn fit(&mut self, samples: &Samples, medial: &[Option<Ball>]) {
        let mut members: Vec<Vec<u32>> = vec![vec![]; self.balls.len()];
        for (i, &label) in self.labels.iter().enumerate().filter(|(_, label)| **label != u32::MAX) {
            members[label as usize].push(i as u32);
        }
        for (ball, members) in self.balls.iter_mut().zip(&members) {
            let mut system = Quadric::default();
            for &i in members {
                let (point, normal, weight) =
                    (samples.points.positions[i as usize], samples.normals[i as usize], samples.weights[i as usize]);
                system.add([normal.x, normal.y, normal.z, 1.0], normal.dot(point), weight);
                let out = (point - ball.center).normalize_or(normal);
                system.add([out.x, out.y, out.z, 1.0], out.dot(point), weight * EUCLIDEAN);
            }
            let fitted = system.solve(ball);
            let off = |b: &Ball| b.center.distance_squared(fitted.center) + (b.radius - fitted.radius).powi(2);
            let nearest =
                members.iter().filter_map(|&i| medial[i as usize].as_ref()).min_by(|a, b| off(a).total_cmp(&off(b)));
            if let Some(nearest) = nearest {
                *ball = *nearest;
            }
        }
    }
}

/// Least squares problem for centre and radius.
#[derive(Default)]
struct Quadric {
    matrix: [[f64; 4]; 4],
    right: [f64; 4],
    weight: f64,
}

impl Quadric {
    fn add(&mut self, row: [f64; 4], right: f64, weight: f64) {
        for i in 0..4 {
            for j in 0..=i {
                self.matrix[i][j] += weight * row[i] * row[j];
            }
            self.right[i] += weight * row[i] * right;
        }
        self.weight += weight;
    }

    /// The least squares solution, regularized towards `prior` so that it is unique.
    fn solve(mut self, prior: &Ball) -> Ball {
        let pull = 1e-3 * self.weight + 1e-30;
        let prior = [prior.center.x, prior.center.y, prior.center.z, prior.radius];
        for (i, prior) in prior.into_iter().enumerate() {
            self.matrix[i][i] += pull;
            self.right[i] += pull * prior;
        }
        let [x, y, z, radius] = solve_symmetric(self.matrix, self.right);
        Ball { center: DVec3::new(x, y, z), radius }
    }
}

/// Solves a linear system by Cholesky's method. `matrix` is positive definite; only its lower half is read.
pub(super) fn solve_symmetric<const N: usize>(mut matrix: [[f64; N]; N], mut right: [f64; N]) -> [f64; N] {
    for i in 0..N {
        for j in 0..=i {
            let sum = matrix[i][j] - (0..j).map(|k| matrix[i][k] * matrix[j][k]).sum::<f64>();
            matrix[i][j] = if i == j { sum.max(1e-300).sqrt() } else { sum / matrix[j][j] };
        }
        right[i] = (right[i] - (0..i).map(|k| matrix[i][k] * right[k]).sum::<f64>()) / matrix[i][i];
    }
    for i in (0..N).rev() {
        right[i] = (right[i] - (i + 1..N).map(|k| matrix[k][i] * right[k]).sum::<f64>()) / matrix[i][i];
    }
    right
}
