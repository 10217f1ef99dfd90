//! A shape with its errors, limits of a search, and its target.

use super::{
    connect::Limits,
    target::{Anchor, Penalty, Target},
};
use crate::builder::{
    envelope::{Complex, Envelope, Hit},
    solid::Solid,
    surface_samples::Samples,
};

/// Distance between points of the envelope, as a part of the diagonal: coarse and fine.
pub(super) const SPACING: [f64; 2] = [0.02, 0.012];

/// Largest depth of the bottoms of these creases inside the solid, as a part of the diagonal.
pub(super) const CREASES: f64 = 0.02;

/// Depth up to which hidden points of the envelope may become visible during the last descents, as a part of the diagonal. Without these points, some of the
/// largest protrusions remain. Earlier descents leave them out to save time.
pub(super) const MARGIN: f64 = 0.004;

/// A shape with the errors at its samples.
pub(super) struct State {
    pub envelope: Envelope,
    pub hits: Vec<Hit>,
    pub anchors: Vec<Anchor>,
}

impl State {
    pub fn new(complex: &Complex, target: &Target) -> Self {
        let envelope = complex.envelope();
        let hits = envelope.hits(target.points);
        let anchors = target.anchors(&envelope);
        Self { envelope, hits, anchors }
    }

    /// The samples that each primitive is nearest to.
    pub fn samples_of_primitives(&self) -> Vec<Vec<u32>> {
        let mut samples = vec![vec![]; self.envelope.primitives.len()];
        for (i, hit) in self.hits.iter().enumerate() {
            samples[hit.primitive as usize].push(i as u32);
        }
        samples
    }

    /// The sphere of a primitive with the largest weight at a point.
    pub fn sphere(&self, primitive: u32, weights: &[f64; 3]) -> u32 {
        let indices = self.envelope.primitives[primitive as usize].indices();
        let heaviest = (0..indices.len()).max_by(|&a, &b| weights[a].total_cmp(&weights[b]).then(b.cmp(&a)));
        indices[heaviest.unwrap_or(0)]
    }
}

/// Limits and effort of a search.
#[derive(Clone, Copy)]
pub(super) struct Plan {
    /// Largest numbers of spheres, edges and faces.
    pub spheres: usize,
    pub edges: usize,
    pub faces: usize,
    /// Number of iterations with exchanges.
    pub rounds: usize,
    /// Number of iterations for the worst places.
    pub mends: usize,
    /// Number of steps of a descent within an iteration.
    pub steps: usize,
    /// True if the last descent is a short one, and the only one.
    pub hurried: bool,
    /// Distance between points of the envelope.
    pub spacing: f64,
}

impl Plan {
    pub const MOST_ROUNDS: usize = 18;

    /// Number of iterations within the time that a mesh of this size may take.
    pub fn rounds(triangles: usize, spheres: usize) -> usize {
        const TRIANGLES_PER_ROUND: usize = 5000;
        let least = if is_quick(triangles, spheres) { 12 } else { 3 };
        (2 + triangles / TRIANGLES_PER_ROUND).clamp(least, Self::MOST_ROUNDS)
    }

    pub fn limits(&self) -> Limits {
        Limits { edges: self.edges, faces: self.faces }
    }

    /// Largest number of spheres that an iteration may exchange.
    pub fn most_exchanged(&self) -> usize {
        self.spheres.div_ceil(6)
    }
}

/// True for few spheres and few triangles, as in low-poly models: even a more thorough search is fast.
pub(in crate::builder) fn is_quick(triangles: usize, spheres: usize) -> bool {
    const TRIANGLES: usize = 2000;
    const SPHERES: usize = 60;
    triangles < TRIANGLES && spheres <= SPHERES
}

/// True for so few triangles per sphere that the time allowed for the mesh does not suffice for a full search.
pub(in crate::builder) fn is_hurried(triangles: usize, spheres: usize) -> bool {
    const TRIANGLES_PER_SPHERE: usize = 100;
    triangles < TRIANGLES_PER_SPHERE * spheres && !is_quick(triangles, spheres)
}

/// Weight of a sample outside the envelope, relative to one inside, during the search for spheres. It also stands for the opposite direction, which
/// is longer in a crease.
const UNCOVERED: f64 = 1.5;

pub(super) fn target<'a>(solid: &'a Solid, samples: &'a Samples, penalty: Penalty, spacing: f64) -> Target<'a> {
    Target {
        solid,
        points: &samples.points,
        weights: &samples.weights,
        area: samples.area,
        penalty,
        spacing,
        uncovered: UNCOVERED,
        creases: 0.0,
        margin: 0.0,
        worst: &[],
        rest: None,
    }
}

/// The target with a penalty that suits the errors of a shape.
pub(super) fn target_for<'a>(complex: &Complex, solid: &'a Solid, samples: &'a Samples, spacing: f64) -> Target<'a> {
    let distances = complex.envelope().distances(&samples.points);
    let squares = distances.iter().zip(&samples.weights).map(|(d, w)| w * d * d);
    target(solid, samples, Penalty::new(squares.sum()), spacing)
}
