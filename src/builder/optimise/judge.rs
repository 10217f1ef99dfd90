//! Ranks shapes and finds their worst places, by two-sided errors at samples that no shape was fitted to.

use glam::DVec3;

use super::target::{CLOSE_SPACING, CLOSE_WITHIN};
use crate::builder::{
    envelope::Complex, measure::Sum, parallel, points::Points, solid::Solid, surface_samples::Samples,
};

/// Number of samples of the area, and of additional vertices.
const SAMPLES: [usize; 2] = [20_000, 10_000];

/// Points of the envelope deeper inside than this are hidden by other primitives. As a part of the diagonal.
const HIDDEN: f64 = 1e-5;

/// Places with more than this part of the envelope's largest distance are among the worst.
const BAD: f64 = 0.6;

/// Largest number of worst places in a verdict.
const MOST_WORST: usize = 12;

/// Distances between the surface and the envelope, as parts of the diagonal.
#[derive(Clone, Debug)]
pub(in crate::builder) struct Verdict {
    /// Largest distance from the surface to the envelope, and from the envelope to the surface.
    pub greatest: [f64; 2],
    /// The larger mean of both directions.
    pub mean: f64,
    /// Places of the envelope with about the largest distance from the surface, the worst first.
    pub worst: Vec<DVec3>,
}

impl Verdict {
    /// Verdict of a shape that has not been judged.
    pub const UNKNOWN: Self = Self { greatest: [f64::INFINITY; 2], mean: f64::INFINITY, worst: vec![] };

    /// Error for comparisons: the same relative change of the mean or of the largest distance in either direction counts the same. Infinite without samples.
    pub fn error(&self) -> f64 {
        let error = self.greatest[0] * self.greatest[1] * self.mean;
        if error > 0.0 { error } else { f64::INFINITY }
    }

    /// The largest distance in either direction.
    pub fn max(&self) -> f64 {
        self.greatest[0].max(self.greatest[1])
    }
}

pub(in crate::builder) struct Judge<'a> {
    pub solid: &'a Solid,
    samples: Samples,
}

impl<'a> Judge<'a> {
    pub fn new(solid: &'a Solid, seed: u64) -> Self {
        Self { solid, samples: Samples::new(solid, SAMPLES[0], SAMPLES[1], !seed) }
    }

    pub fn verdict(&self, complex: &Complex) -> Verdict {
        let envelope = complex.envelope();
        let distances = envelope.distances(&self.samples.points);
        let inward = sum(distances.iter().map(|d| d.abs()).zip(self.samples.weights.iter().copied()));
        let pieces = envelope.pieces();
        // Points of the envelope, their distances from the surface, and the areas that they represent.
        let errors: Vec<(DVec3, f64, f64)> = parallel::flat_map(pieces.len(), 1, |i, errors| {
            let (mut positions, mut areas) = (vec![], vec![]);
            envelope.sample(&pieces[i], CLOSE_SPACING, |place| {
                positions.push(envelope.point(&place));
                areas.push(place.area);
            });
            let points = Points::new(positions);
            let depths = envelope.depths(&points, HIDDEN);
            let mut near = None;
            for (at, &point) in points.positions.iter().enumerate().filter(|(at, _)| depths[*at] < HIDDEN) {
                if let Some((nearest, triangle)) = self.solid.closest_off_rims(point, near) {
                    near = Some(triangle);
                    errors.push((point, nearest.distance(point), areas[at]));
                }
            }
        });
        let outward = sum(errors.iter().map(|&(_, distance, area)| (distance, area)));
        let bad = errors.into_iter().filter(|(_, distance, _)| *distance > BAD * outward.max);
        let worst = spread(bad.map(|(point, distance, _)| (point, distance)).collect());
        Verdict { greatest: [inward.max, outward.max], mean: inward.mean().max(outward.mean()), worst }
    }
}

/// The worst places. Of places close to each other, only the worst is kept.
fn spread(mut errors: Vec<(DVec3, f64)>) -> Vec<DVec3> {
    errors.sort_by(|a, b| b.1.total_cmp(&a.1));
    let mut places: Vec<DVec3> = vec![];
    for (place, _) in errors {
        if places.len() == MOST_WORST {
            break;
        }
        if places.iter().all(|other| other.distance(place) > 0.5 * CLOSE_WITHIN) {
            places.push(place);
        }
    }
    places
}

fn sum(distances: impl Iterator<Item = (f64, f64)>) -> Sum {
    let mut sum = Sum::default();
    distances.for_each(|(distance, area)| sum.add(distance, area));
    sum
}
