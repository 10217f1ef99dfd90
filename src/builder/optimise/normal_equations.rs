//! The least squares problem of one step of a descent: a 4x4 block for each sphere and each edge.

use glam::DVec4;

use super::{
    clusters::solve_symmetric,
    target::{Anchor, Target},
};
use crate::{
    builder::envelope::{Complex, Envelope, Hit},
    geometry::Primitive,
};

/// Upper half of a symmetric 4x4 matrix.
#[derive(Clone, Copy, Default)]
struct Block([f64; 10]);

impl Block {
    fn outer(m: DVec4) -> Self {
        let [x, y, z, w] = m.to_array();
        Self([x * x, x * y, x * z, x * w, y * y, y * z, y * w, z * z, z * w, w * w])
    }

    fn add(&mut self, other: &Block, factor: f64) {
        self.0.iter_mut().zip(&other.0).for_each(|(a, b)| *a += b * factor);
    }

    fn mul(&self, v: DVec4) -> DVec4 {
        let m = &self.0;
        DVec4::new(
            m[0] * v.x + m[1] * v.y + m[2] * v.z + m[3] * v.w,
            m[1] * v.x + m[4] * v.y + m[5] * v.z + m[6] * v.w,
            m[2] * v.x + m[5] * v.y + m[7] * v.z + m[8] * v.w,
            m[3] * v.x + m[6] * v.y + m[8] * v.z + m[9] * v.w,
        )
    }

    fn diagonal(&self) -> DVec4 {
        DVec4::new(self.0[0], self.0[4], self.0[7], self.0[9])
    }

    fn add_diagonal(&mut self, d: DVec4) {
        self.0[0] += d.x;
        self.0[4] += d.y;
        self.0[7] += d.z;
        self.0[9] += d.w;
    }

    /// The inverse of a positive definite block.
    fn inverse(&self) -> Self {
        let columns = DVec4::AXES.map(|e| self.solve(e));
        let (a, b, c, d) = (columns[0], columns[1], columns[2], columns[3]);
        Self([a.x, a.y, a.z, a.w, b.y, b.z, b.w, c.z, c.w, d.w])
    }

    fn solve(&self, right: DVec4) -> DVec4 {
        let m = &self.0;
        let full =
            [[m[0], m[1], m[2], m[3]], [m[1], m[4], m[5], m[6]], [m[2], m[5], m[7], m[8]], [m[3], m[6], m[8], m[9]]];
        DVec4::from_array(solve_symmetric(full, right.to_array()))
    }
}

pub(super) struct NormalEquations {
    diagonal: Vec<Block>,
    /// Off-diagonal blocks of the edges.
    pairs: Vec<([usize; 2], Block)>,
    downhill: Vec<DVec4>,
}

impl NormalEquations {
    pub fn assemble(
        complex: &Complex,
        envelope: &Envelope,
        target: &Target,
        hits: &[(Hit, f64)],
        anchors: &[Anchor],
    ) -> Self {
        let penalty = target.penalty;
        let mut this = Self {
            diagonal: vec![Block::default(); complex.balls.len()],
            pairs: complex.edges.iter().map(|e| (e.map(|i| i as usize), Block::default())).collect(),
            downhill: vec![DVec4::ZERO; complex.balls.len()],
        };
        // For each primitive its spheres, and the blocks of the pairs 01, 12 and 02.
        let edge = |i: u32, j: u32| complex.edges.binary_search(&[i, j]).unwrap_or(0);
        let places: Vec<([usize; 3], [usize; 3])> = envelope
            .primitives
            .iter()
            .map(|p| match *p {
                Primitive::Sphere([i]) => ([i, i, i], [0; 3]),
                Primitive::Cone([i, j]) => ([i, j, i], [edge(i, j), 0, 0]),
                Primitive::Slab([i, j, k]) => ([i, j, k], [edge(i, j), edge(j, k), edge(i, k)]),
            })
            .map(|(spheres, edges)| (spheres.map(|i| i as usize), edges))
            .collect();
        let mut add = |primitive: u32, weights: &[f64; 3], slope: DVec4, error: f64, weight: f64| {
            let (spheres, edges) = &places[primitive as usize];
            let (pull, stiffness) = (weight * penalty.pull(error), weight * penalty.stiffness(error));
            let outer = Block::outer(slope);
            for k in 0..3 {
                if weights[k] == 0.0 {
                    continue;
                }
                this.diagonal[spheres[k]].add(&outer, stiffness * weights[k] * weights[k]);
                this.downhill[spheres[k]] -= slope * (pull * weights[k] * error);
                let l = (k + 1) % 3;
                if weights[l] != 0.0 {
                    this.pairs[edges[k]].1.add(&outer, stiffness * weights[k] * weights[l]);
                }
            }
        };
        for (hit, weight) in hits {
            let slope = -hit.normal.extend(1.0);
            add(hit.primitive, &hit.weights, slope, hit.distance, weight * target.side(hit.distance));
        }
        for anchor in anchors {
            let error = anchor.error(envelope);
            let slope = anchor.out.extend(anchor.out.dot(anchor.place.normal));
            add(anchor.place.primitive, &anchor.place.weights, slope, error, anchor.weight);
        }
        // Frozen spheres do not move: their diagonal block is the identity and their right-hand side is zero.
        if let Some(rest) = &target.rest {
            for i in (0..rest.frozen.len()).filter(|&i| rest.frozen[i]) {
                this.diagonal[i] = Block([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 1.0]);
                this.downhill[i] = DVec4::ZERO;
            }
            this.pairs.retain(|([i, j], _)| !rest.frozen[*i] && !rest.frozen[*j]);
        }
        this
    }

    /// Solves for the damped step by conjugate gradients.
    pub fn solve(&self, damping: f64) -> Vec<DVec4> {
        const FLOOR: f64 = 1e-6;
        const TOLERANCE: f64 = 1e-6;
        const MOST_ROUNDS: usize = 200;
        let count = self.diagonal.len();
        let mut diagonal = self.diagonal.clone();
        for block in &mut diagonal {
            let own = block.diagonal();
            block.add_diagonal(own * damping + DVec4::splat(FLOOR));
        }
        let inverse: Vec<Block> = diagonal.iter().map(Block::inverse).collect();
        let multiply = |v: &[DVec4]| {
            let mut out: Vec<DVec4> = diagonal.iter().zip(v).map(|(block, v)| block.mul(*v)).collect();
            for ([i, j], block) in &self.pairs {
                out[*i] += block.mul(v[*j]);
                out[*j] += block.mul(v[*i]);
            }
            out
        };
        let dot = |a: &[DVec4], b: &[DVec4]| a.iter().zip(b).map(|(a, b)| a.dot(*b)).sum::<f64>();
        let mut x = vec![DVec4::ZERO; count];
        let mut residual = self.downhill.clone();
        let mut z: Vec<DVec4> = inverse.iter().zip(&residual).map(|(m, r)| m.mul(*r)).collect();
        let mut direction = z.clone();
        let mut rz = dot(&residual, &z);
        let enough = rz * TOLERANCE * TOLERANCE;
        for _ in 0..MOST_ROUNDS {
            if rz <= enough || rz <= 0.0 {
                break;
            }
            let product = multiply(&direction);
            let alpha = rz / dot(&direction, &product);
            if !alpha.is_finite() {
                break;
            }
            for i in 0..count {
                x[i] += direction[i] * alpha;
                residual[i] -= product[i] * alpha;
                z[i] = inverse[i].mul(residual[i]);
            }
            let next = dot(&residual, &z);
            let beta = next / rz;
            rz = next;
            for i in 0..count {
                direction[i] = z[i] + direction[i] * beta;
            }
        }
        x
    }
}
