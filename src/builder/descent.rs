//! The last descent: spheres move until the envelope fits the surface, in both directions.
//!
//! The distance of a surface sample to its nearest primitive changes, when the spheres of that primitive move, by their weights
//! in the nearest blend. So a round is a least squares problem (Levenberg and Marquardt) whose matrix has a 4x4
//! block for each sphere and each edge.

use glam::{DVec3, DVec4};

use super::{
    envelope::{Complex, Envelope, Hit, SurfacePoint},
    parallel,
    points::Points,
    solid::Solid,
};

/// What an error costs: its square, and more where it is large beside the others, so that the largest come down.
#[derive(Clone, Copy, Debug)]
pub(super) struct Penalty {
    /// Square of the error from which on the cost is steep.
    steep: f64,
}

impl Penalty {
    /// Errors of this many times their root mean square are large.
    const LARGE: f64 = 2.5;
    /// Beyond this, in squares of large ones, the cost grows as the square again: one bad place does not hide all others.
    const STEEPEST: f64 = 9.0;

    /// Suited to a mean square of errors.
    pub fn new(mean_square: f64) -> Self {
        Self { steep: Self::LARGE * Self::LARGE * mean_square.max(1e-12) }
    }

    /// The same, steep from lesser errors on by a factor.
    pub fn steeper(self, factor: f64) -> Self {
        Self { steep: self.steep / (factor * factor) }
    }

    pub fn of(&self, error: f64) -> f64 {
        let square = error * error / self.steep;
        let bent = square.min(Self::STEEPEST);
        self.steep * (bent + bent.powi(2) + (square - bent) * (1.0 + 2.0 * bent))
    }

    /// Slope of the cost over twice the error: the weight of a least squares residual that pulls as the cost does.
    fn pull(&self, error: f64) -> f64 {
        let square = (error * error / self.steep).min(Self::STEEPEST);
        1.0 + 2.0 * square
    }
}

/// How much the way from the envelope to the surface counts beside the other.
const OUTWARD: f64 = 1.0;

/// How deep a point of the envelope sinks into other primitives until it counts no more, in spacings.
const FADE: f64 = 0.3;

/// Points of the envelope this deep within the solid may come out of it in a descent, as a part of the diagonal.
const NEARLY_OUTSIDE: f64 = 0.004;

/// How far a sphere may move in a step, in radii, and as a part of the diagonal.
const STRIDE: [f64; 2] = [0.3, 0.005];

/// Least radius, as a part of the diagonal.
const LEAST_RADIUS: f64 = 1e-4;

/// A point of the envelope and the point of the surface that it should be at.
pub(super) struct Anchor {
    /// Index of its place.
    place: usize,
    pub primitive: u32,
    pub weights: [f64; 3],
    normal: DVec3,
    pub target: DVec3,
    /// Unit direction from the target to the point when it was taken.
    out: DVec3,
    pub weight: f64,
}

impl Anchor {
    pub fn error(&self, envelope: &Envelope) -> f64 {
        let ball = envelope.hulls[self.primitive as usize].blend(&self.weights);
        (ball.center + self.normal * ball.radius - self.target).dot(self.out)
    }
}

/// What a shape is to fit.
pub(super) struct Target<'a> {
    pub solid: &'a Solid,
    pub points: &'a Points,
    /// Weights of the points.
    pub weights: &'a [f64],
    /// Area of the whole surface.
    pub area: f64,
    pub penalty: Penalty,
    /// Distance of points of the envelope.
    pub spacing: f64,
    /// How much a sample outside of the envelope counts beside one within.
    pub uncovered: f64,
    /// How deep within the solid points of the envelope count in a descent, as at the bottom of a crease, as a part of the diagonal.
    pub creases: f64,
    /// What else there is that does not move, if the shape is a part of one.
    pub rest: Option<Rest<'a>>,
}

/// The part of a shape that does not move.
pub(super) struct Rest<'a> {
    pub envelope: &'a Envelope,
    /// The primitives of the envelope that count.
    pub primitives: Vec<u32>,
    /// Their distances to the target's points.
    pub distances: Vec<f64>,
    /// Which spheres of the moving part do not move either.
    pub frozen: Vec<bool>,
}

/// Stands for the primitives of the rest in a hit.
const NONE: u32 = u32::MAX;

impl Target<'_> {
    fn hits(&self, envelope: &Envelope) -> Vec<Hit> {
        let mut hits = envelope.hits(self.points);
        if let Some(rest) = &self.rest {
            for (hit, &distance) in hits.iter_mut().zip(&rest.distances) {
                if distance < hit.distance {
                    (hit.distance, hit.primitive) = (distance, NONE);
                }
            }
        }
        hits
    }

    /// Visible points of the envelope with their nearest points of the surface.
    pub fn anchors(&self, envelope: &Envelope) -> Vec<Anchor> {
        self.anchors_at(envelope, &envelope.surface(self.spacing), &[], 0.0)
    }

    /// Visible points of the envelope that lie within the solid, as at the bottom of a crease, and what each costs.
    pub fn creases(&self, envelope: &Envelope) -> Vec<(DVec3, f64)> {
        let mut creases = vec![];
        for anchor in self.anchors_at(envelope, &envelope.surface(self.spacing), &[], f64::INFINITY) {
            let ball = envelope.hulls[anchor.primitive as usize].blend(&anchor.weights);
            let point = ball.center + anchor.normal * ball.radius;
            if !self.solid.is_out(point, point - anchor.target, anchor.normal) {
                creases.push((point, anchor.weight * self.penalty.of(anchor.error(envelope))));
            }
        }
        creases
    }

    /// The same at given places; those that lie no deeper within the solid than `depth_limit` count as well. A place fades as it
    /// sinks into other primitives. `near`: for each place a point of the surface that may be nearby, or none at all.
    fn anchors_at(
        &self,
        envelope: &Envelope,
        places: &[SurfacePoint],
        near: &[DVec3],
        depth_limit: f64,
    ) -> Vec<Anchor> {
        // While places are sought, so do those that may come to light.
        let margin = if near.is_empty() { depth_limit.min(NEARLY_OUTSIDE) } else { 0.0 };
        let fade = FADE * self.spacing + margin;
        let points = Points::new(places.iter().map(|s| envelope.point(s)).collect());
        let mut depths = envelope.depths(&points);
        if let Some(rest) = &self.rest {
            let others = rest.envelope.depths_among(&points, &rest.primitives);
            depths.iter_mut().zip(others).for_each(|(depth, other)| *depth = depth.max(other));
        }
        let weight = |i: usize| 1.0 - depths[i] / fade;
        let visible: Vec<(usize, f64)> =
            (0..places.len()).map(|i| (i, weight(i))).filter(|(_, weight)| *weight > 0.0).collect();
        let anchors = parallel::map(visible.len(), 32, |at| {
            let (i, weight) = visible[at];
            let (s, point) = (&places[i], points.positions[i]);
            let target = self.solid.closest_off_rims(point, near.get(i).copied())?;
            let away = point - target;
            let out = if away.length() > 1e-9 { away.normalize() } else { s.normal };
            // Where the envelope lies within the solid, the samples above see it, and without its jumps at creases.
            if away.length() > depth_limit && !self.solid.is_out(point, away, s.normal) {
                return None;
            }
            let (primitive, weights, normal) = (s.primitive, s.weights, s.normal);
            Some(Anchor {
                place: i,
                primitive,
                weights,
                normal,
                target,
                out,
                weight: OUTWARD * weight * s.area / self.area,
            })
        });
        anchors.into_iter().flatten().collect()
    }

    fn side(&self, distance: f64) -> f64 {
        if distance > 0.0 { self.uncovered } else { 1.0 }
    }

    /// What the distance of a sample to the envelope costs.
    pub fn cost_of(&self, distance: f64) -> f64 {
        self.side(distance) * self.penalty.of(distance)
    }

    fn total(&self, hits: &[Hit], anchors: &[Anchor], envelope: &Envelope) -> f64 {
        let inward: f64 = hits.iter().zip(self.weights).map(|(h, w)| w * self.cost_of(h.distance)).sum();
        let outward: f64 = anchors.iter().map(|a| a.weight * self.penalty.of(a.error(envelope))).sum();
        inward + outward
    }
}

/// Gains of this part of the cost are enough while spheres come and go.
pub(super) const ROUGH: f64 = 1e-3;

/// Moves the spheres downhill in some steps, unless one brings the cost down by a lesser part than `enough`; returns the cost.
///
/// The points of the envelope are taken anew for every trial: what comes to light as spheres move counts at once.
pub(super) fn descend(complex: &mut Complex, target: &Target, steps: usize, enough: f64) -> f64 {
    // The places on the envelope stay the same, relative to the spheres, so that costs compare.
    let envelope = complex.envelope();
    let surface = envelope.surface(target.spacing);
    let anchored = target.anchors_at(&envelope, &surface, &[], NEARLY_OUTSIDE.max(target.creases));
    let places: Vec<SurfacePoint> = anchored.iter().map(|anchor| surface[anchor.place]).collect();
    let near: Vec<DVec3> = anchored.iter().map(|anchor| anchor.target).collect();
    let measure = |complex: &Complex| {
        let envelope = complex.envelope();
        let hits = target.hits(&envelope);
        let anchors = target.anchors_at(&envelope, &places, &near, target.creases);
        let cost = target.total(&hits, &anchors, &envelope);
        (cost, envelope, hits, anchors)
    };
    let mut damping = 1e-2;
    let (mut cost, mut envelope, mut hits, mut anchors) = measure(complex);
    for _ in 0..steps {
        let normal = NormalEquations::assemble(complex, &envelope, target, &hits, &anchors);
        let step = normal.solve(damping);
        let mut trial = complex.clone();
        for (ball, d) in trial.balls.iter_mut().zip(&step) {
            let d = *d * ((ball.radius * STRIDE[0] + STRIDE[1]) / d.length()).min(1.0);
            ball.center += d.truncate();
            ball.radius = (ball.radius + d.w).max(LEAST_RADIUS);
        }
        if let Some(rest) = &target.rest {
            for (i, _) in rest.frozen.iter().enumerate().filter(|(_, frozen)| **frozen) {
                trial.balls[i] = complex.balls[i];
            }
        }
        let measured = measure(&trial);
        if measured.0 < cost {
            *complex = trial;
            let done = measured.0 > cost * (1.0 - enough);
            (cost, envelope, hits, anchors) = measured;
            damping = (damping * 0.3).max(1e-6);
            if done {
                break;
            }
        } else {
            damping = (damping * 5.0).min(1e4);
        }
    }
    cost
}

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
        DVec4::from_array(super::clusters::solve_symmetric(full, right.to_array()))
    }
}

struct NormalEquations {
    diagonal: Vec<Block>,
    /// Blocks of the edges.
    pairs: Vec<([usize; 2], Block)>,
    downhill: Vec<DVec4>,
}

impl NormalEquations {
    fn assemble(complex: &Complex, envelope: &Envelope, target: &Target, hits: &[Hit], anchors: &[Anchor]) -> Self {
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
                crate::geometry::Primitive::Sphere([i]) => ([i, i, i], [0; 3]),
                crate::geometry::Primitive::Cone([i, j]) => ([i, j, i], [edge(i, j), 0, 0]),
                crate::geometry::Primitive::Slab([i, j, k]) => ([i, j, k], [edge(i, j), edge(j, k), edge(i, k)]),
            })
            .map(|(spheres, edges)| (spheres.map(|i| i as usize), edges))
            .collect();
        let mut add = |primitive: u32, weights: &[f64; 3], slope: DVec4, error: f64, weight: f64| {
            let (spheres, edges) = &places[primitive as usize];
            let outer = Block::outer(slope);
            for k in 0..3 {
                if weights[k] == 0.0 {
                    continue;
                }
                this.diagonal[spheres[k]].add(&outer, weight * weights[k] * weights[k]);
                this.downhill[spheres[k]] -= slope * (weight * weights[k] * error);
                let l = (k + 1) % 3;
                if weights[l] != 0.0 {
                    this.pairs[edges[k]].1.add(&outer, weight * weights[k] * weights[l]);
                }
            }
        };
        for (hit, weight) in hits.iter().zip(target.weights).filter(|(hit, _)| hit.primitive != NONE) {
            let slope = -hit.normal.extend(1.0);
            add(
                hit.primitive,
                &hit.weights,
                slope,
                hit.distance,
                weight * target.side(hit.distance) * penalty.pull(hit.distance),
            );
        }
        for anchor in anchors {
            let error = anchor.error(envelope);
            let slope = anchor.out.extend(anchor.out.dot(anchor.normal));
            add(anchor.primitive, &anchor.weights, slope, error, anchor.weight * penalty.pull(error));
        }
        // What does not move is as if infinitely heavy.
        if let Some(rest) = &target.rest {
            for i in (0..rest.frozen.len()).filter(|&i| rest.frozen[i]) {
                this.diagonal[i] = Block([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 1.0]);
                this.downhill[i] = DVec4::ZERO;
            }
            this.pairs.retain(|([i, j], _)| !rest.frozen[*i] && !rest.frozen[*j]);
        }
        this
    }

    /// The damped step, by conjugate gradients.
    fn solve(&self, damping: f64) -> Vec<DVec4> {
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
