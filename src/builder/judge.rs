//! Which of several shapes is the best: their two-sided errors at samples that none of them was fitted to.

use super::{envelope::Complex, measure::Sum, parallel, points::Points, solid::Solid, surface_samples::Samples};

/// Samples of the area, and vertices beside them.
const SAMPLES: [usize; 2] = [30_000, 20_000];

/// Distance of points of the envelope, as a part of the diagonal.
const SPACING: f64 = 0.005;

/// Points of the envelope deeper inside than this are hidden by other primitives.
const HIDDEN: f64 = 1e-5;

pub(super) struct Judge<'a> {
    pub solid: &'a Solid,
    samples: Samples,
}

impl<'a> Judge<'a> {
    pub fn new(solid: &'a Solid, seed: u64) -> Self {
        Self { solid, samples: Samples::new(solid, SAMPLES[0], SAMPLES[1], !seed) }
    }

    /// How bad a shape is: the greatest distance between the surface and the envelope, either way, times the greater of both means. A tenth less of
    /// either counts alike.
    pub fn error(&self, complex: &Complex) -> f64 {
        let envelope = complex.envelope();
        let distances = envelope.distances(&self.samples.points);
        let inward = sum(distances.iter().map(|d| d.abs()).zip(self.samples.weights.iter().copied()));
        let surface = envelope.surface(SPACING);
        let points = Points::new(surface.iter().map(|s| envelope.point(s)).collect());
        let depths = envelope.depths(&points);
        let visible: Vec<usize> = (0..surface.len()).filter(|&i| depths[i] < HIDDEN).collect();
        let nearest = parallel::map(visible.len(), 32, |at| {
            let point = points.positions[visible[at]];
            self.solid.closest_off_rims(point, None).map(|nearest| nearest.distance(point))
        });
        let outward = visible.iter().zip(nearest).filter_map(|(&i, distance)| Some((distance?, surface[i].area)));
        let outward = sum(outward);
        inward.max.max(outward.max) * inward.mean().max(outward.mean())
    }
}

fn sum(distances: impl Iterator<Item = (f64, f64)>) -> Sum {
    let mut sum = Sum::default();
    distances.for_each(|(distance, area)| sum.add(distance, area));
    sum
}
