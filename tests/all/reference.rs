//! Reference distance and time of impact in f64. It shares no method with the kernels: no closed forms, no special cases per kind of shape.
//!
//! Two hulls of spheres touch if the hull of their *difference* contains the origin. The difference consists of the spheres `b_j - a_i` of
//! radius `r_i + r_j`; a box is the hull of eight points. The signed distance of the difference to the origin is a saddle value,
//!
//! ```text
//!   min over weights w of |c(w)| - r(w)  =  max over |n| <= 1 of min over k of c_k . n - r_k,
//! ```
//!
//! computed by an interior-point method. Any `w` gives an upper bound and any `n` a lower bound, so each result proves its own accuracy.

use glam::DVec3;

/// Difference of the two bounds at which the search for a distance ends, in sizes of the pair.
const ACCURACY: f64 = 2e-11;

/// Distance at which two bodies count as touching, in sizes of the pair.
pub const TOUCHING: f64 = 1e-9;

/// A sphere that moves on a line.
#[derive(Clone, Copy, Debug, Default)]
pub struct Ball {
    pub center: DVec3,
    pub radius: f64,
    pub motion: DVec3,
}

/// Bounds of a signed distance: `lower <= distance <= upper`.
///
/// The distance is negative if the bodies overlap. It is never less than minus the largest sum of two radii, so it does not measure deep
/// overlaps: see [`Difference::depth`].
#[derive(Clone, Copy, Debug)]
pub struct Distance {
    pub lower: f64,
    pub upper: f64,
    /// The direction from the first to the second that proves `lower`; a unit vector unless the centres cross.
    pub normal: DVec3,
}

/// The hull of all differences of two bodies' spheres.
pub struct Difference {
    balls: [Ball; 24],
    count: usize,
}

impl Difference {
    /// The difference of the hulls of two sets of spheres, with at most 24 pairs of spheres.
    pub fn new(first: &[Ball], second: &[Ball]) -> Self {
        let mut balls = [Ball::default(); 24];
        let mut count = 0;
        for a in first {
            for b in second {
                balls[count] =
                    Ball { center: b.center - a.center, radius: a.radius + b.radius, motion: b.motion - a.motion };
                count += 1;
            }
        }
        Self { balls, count }
    }

    fn balls(&self) -> &[Ball] {
        &self.balls[..self.count]
    }

    /// The largest relative speed of two vertices.
    pub fn speed(&self) -> f64 {
        self.balls().iter().map(|ball| ball.motion.length()).fold(0.0, f64::max)
    }

    /// Moves the second body.
    pub fn shift(&mut self, by: DVec3) {
        self.balls[..self.count].iter_mut().for_each(|ball| ball.center += by);
    }

    /// The difference at a fraction of the motion, with all motions set to zero.
    pub fn at(&self, fraction: f64) -> Self {
        let mut still = Self { balls: self.balls, count: self.count };
        for ball in &mut still.balls[..self.count] {
            ball.center += ball.motion * fraction;
            ball.motion = DVec3::ZERO;
        }
        still
    }

    /// Gap of the support planes at fraction 0 along a unit direction: a lower bound of the distance.
    pub fn gap(&self, n: DVec3) -> f64 {
        self.balls().iter().map(|ball| ball.center.dot(n) - ball.radius).fold(f64::INFINITY, f64::min)
    }

    /// Signed distance at fraction 0, by a primal-dual interior-point method (Nesterov and Todd's scaling): maximise `s` subject to
    /// `c_k . n - r_k >= s` and `(1, n)` in the second-order cone. The multipliers of the former are the weights.
    pub fn distance(&self) -> Distance {
        let scale = self.balls().iter().map(|b| b.center.length() + b.radius).fold(f64::MIN_POSITIVE, f64::max);
        let (mut c, mut r) = ([DVec3::ZERO; 24], [0.0; 24]);
        for (k, ball) in self.balls().iter().enumerate() {
            (c[k], r[k]) = (ball.center / scale, ball.radius / scale);
        }
        let (c, r) = (&c[..self.count], &r[..self.count]);
        let lowest = |n: DVec3| (0..c.len()).map(|k| c[k].dot(n) - r[k]).fold(f64::INFINITY, f64::min);
        let mut best = Distance { lower: f64::NEG_INFINITY, upper: f64::INFINITY, normal: DVec3::ZERO };
        let mut n = c.iter().sum::<DVec3>().normalize_or_zero() * 0.7;
        let mut s = lowest(n) - 0.3;
        let mut weight = [1.0 / c.len() as f64; 24];
        let mut tension = (0.5, -0.5 * n);
        let mut centring = 0.1;
        for _ in 0..80 {
            let total: f64 = weight[..c.len()].iter().sum();
            let (mut center, mut radius) = (DVec3::ZERO, 0.0);
            for k in 0..c.len() {
                (center, radius) = (center + c[k] * weight[k], radius + r[k] * weight[k]);
            }
            best.upper = best.upper.min((center.length() - radius) / total);
            for direction in [n, n.normalize_or_zero()] {
                let lower = lowest(direction);
                if lower > best.lower {
                    (best.lower, best.normal) = (lower, direction);
                }
            }
            if best.upper - best.lower < ACCURACY {
                break;
            }

            // Newton's step towards slack times multiplier = mu.
            let mut slack = [0.0; 24];
            let mut complementarity = tension.0 + tension.1.dot(n);
            for k in 0..c.len() {
                slack[k] = c[k].dot(n) - r[k] - s;
                complementarity += slack[k] * weight[k];
            }
            let mu = centring * complementarity / (c.len() + 1) as f64;
            let mut matrix = [[0.0; 4]; 4];
            let mut right = [0.0, 0.0, 0.0, 1.0];
            for k in 0..c.len() {
                let gradient = [c[k].x, c[k].y, c[k].z, -1.0];
                for i in 0..4 {
                    right[i] += mu / slack[k] * gradient[i];
                    for j in 0..=i {
                        matrix[i][j] += weight[k] / slack[k] * gradient[i] * gradient[j];
                    }
                }
            }
            // The cone's scaling: `(1, n)` has the length `room`, its multiplier the length `strength`.
            let room = (1.0 - n.length_squared()).sqrt();
            let strength = (tension.0 * tension.0 - tension.1.length_squared()).sqrt();
            let gamma = (0.5 + 0.5 * (tension.0 + tension.1.dot(n)) / (room * strength)).sqrt();
            let w0 = (1.0 / room + tension.0 / strength) / (2.0 * gamma);
            let w = (n / room - tension.1 / strength) / (2.0 * gamma);
            let stiffness = strength / room;
            for i in 0..3 {
                right[i] -= mu * n[i] / (room * room);
                matrix[i][i] += stiffness;
                for j in 0..=i {
                    matrix[i][j] += 2.0 * stiffness * w[i] * w[j];
                }
            }
            let step = solve(matrix, right);
            if step.iter().any(|x| !x.is_finite()) {
                break;
            }
            let (step_n, step_s) = (DVec3::new(step[0], step[1], step[2]), step[3]);
            let step_tension = (
                mu / (room * room) - tension.0 + 2.0 * stiffness * w0 * w.dot(step_n),
                n * (-mu / (room * room)) - tension.1 - (w * (2.0 * w.dot(step_n)) + step_n) * stiffness,
            );

            // The step is so short that all slacks, weights and cone variables stay feasible.
            let mut length = cone_limit((1.0, n), (0.0, step_n)).min(cone_limit(tension, step_tension));
            let mut step_weight = [0.0; 24];
            for k in 0..c.len() {
                let step_slack = c[k].dot(step_n) - step_s;
                step_weight[k] = -weight[k] + (mu - weight[k] * step_slack) / slack[k];
                for (value, change) in [(slack[k], step_slack), (weight[k], step_weight[k])] {
                    if change < 0.0 {
                        length = length.min(-value / change);
                    }
                }
            }
            let length = (0.98 * length).min(1.0);
            n += step_n * length;
            s += step_s * length;
            tension = (tension.0 + step_tension.0 * length, tension.1 + step_tension.1 * length);
            for k in 0..c.len() {
                weight[k] += step_weight[k] * length;
            }
            centring = (1.0 - length).powi(2).clamp(0.02, 0.5);
        }
        Distance { lower: best.lower * scale, upper: best.upper * scale, normal: best.normal }
    }

    /// First fraction in [0, 1] at which the signed distance is down to `level`, within [`TOUCHING`] of `size`.
    ///
    /// The gap along the normal of the current lower bound is concave in time. It stays above `level` until its first root, so the search
    /// continues there.
    pub fn first_within(&self, level: f64, size: f64) -> Option<f64> {
        let mut fraction = 0.0;
        for _ in 0..20_000 {
            let now = self.at(fraction).distance();
            assert!(now.upper - now.lower < 1e-7 * size, "bounds too far apart at {fraction}: {now:?}");
            if now.lower <= level + TOUCHING * size {
                return Some(fraction);
            }
            let mut next = f64::INFINITY;
            for ball in self.balls() {
                let closing = -ball.motion.dot(now.normal);
                if closing > 0.0 {
                    next = next.min((ball.center.dot(now.normal) - ball.radius - level) / closing);
                }
            }
            if next > 1.0 {
                return None;
            }
            fraction = next.max(fraction);
        }
        panic!("no convergence at {fraction}: {:?}", self.at(fraction).distance());
    }

    /// True if no translation of the given length separates the two bodies at fraction 0.
    pub fn deeper_than(&self, length: f64) -> bool {
        self.gap(self.distance().normal.normalize_or(DVec3::Y)) < -length && self.depth(400) < -length
    }

    /// Largest gap at fraction 0 along any unit direction. For an overlap this is minus the length of the shortest translation that ends it.
    /// The search samples the unit sphere and climbs from the best samples. So the result is a lower bound, close to the truth.
    pub fn depth(&self, samples: usize) -> f64 {
        let turn = std::f64::consts::PI * (3.0 - 5f64.sqrt());
        let mut starts: Vec<(f64, DVec3)> = (0..samples)
            .map(|i| {
                let z = 1.0 - (2 * i + 1) as f64 / samples as f64;
                let (sin, cos) = (i as f64 * turn).sin_cos();
                let n = DVec3::new(cos * (1.0 - z * z).sqrt(), sin * (1.0 - z * z).sqrt(), z);
                (self.gap(n), n)
            })
            .collect();
        starts.sort_by(|a, b| b.0.total_cmp(&a.0));
        starts.truncate(12);
        for (gap, n) in &mut starts {
            let mut reach = 4.0 / (samples as f64).sqrt();
            while reach > 1e-9 {
                let (u, v) = n.any_orthonormal_pair();
                let better = (0..16)
                    .map(|i| {
                        let (sin, cos) = (i as f64 * std::f64::consts::TAU / 16.0).sin_cos();
                        let n = (*n + (u * cos + v * sin) * reach).normalize();
                        (self.gap(n), n)
                    })
                    .max_by(|a, b| a.0.total_cmp(&b.0));
                match better {
                    Some(better) if better.0 > *gap => (*gap, *n) = better,
                    _ => reach *= 0.5,
                }
            }
        }
        starts.iter().map(|start| start.0).fold(f64::NEG_INFINITY, f64::max)
    }
}

/// Largest multiple of a direction that keeps a point of the second-order cone `u >= |v|` inside the cone.
fn cone_limit((u, v): (f64, DVec3), (du, dv): (f64, DVec3)) -> f64 {
    let a = du * du - dv.length_squared();
    let b = u * du - v.dot(dv);
    let c = u * u - v.length_squared();
    let denominator = (b * b - a * c).max(0.0).sqrt() - b;
    if denominator > 0.0 { c / denominator } else { f64::INFINITY }
}

/// Solves a symmetric positive definite system given by its lower triangle (Cholesky).
fn solve(mut m: [[f64; 4]; 4], mut b: [f64; 4]) -> [f64; 4] {
    for i in 0..4 {
        for j in 0..=i {
            let sum = m[i][j] - (0..j).map(|k| m[i][k] * m[j][k]).sum::<f64>();
            m[i][j] = if i == j { sum.max(1e-300).sqrt() } else { sum / m[j][j] };
        }
        b[i] = (b[i] - (0..i).map(|k| m[i][k] * b[k]).sum::<f64>()) / m[i][i];
    }
    for i in (0..4).rev() {
        b[i] = (b[i] - (i + 1..4).map(|k| m[k][i] * b[k]).sum::<f64>()) / m[i][i];
    }
    b
}
