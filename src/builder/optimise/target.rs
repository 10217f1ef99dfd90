//! The target of a fit: samples of the surface, points of the envelope, and the costs of their errors.

use glam::DVec3;

use crate::builder::{
    envelope::{Envelope, Hit, SurfacePoint},
    parallel,
    points::Points,
    solid::Solid,
};

/// Cost of an error: its square, and more if it is large relative to the others, so that the largest errors decrease.
#[derive(Clone, Copy, Debug)]
pub(super) struct Penalty {
    /// Square of the error above which the cost is steep.
    steep: f64,
    /// True if the cost there grows as the fourth power of the square instead of the second.
    walled: bool,
}

impl Penalty {
    /// Errors larger than this multiple of their root mean square are large.
    const LARGE: f64 = 2.5;
    /// Limit of the steep part, in squares of large errors. Beyond it the cost grows as the square again, so that one bad place does not hide all others.
    const STEEPEST: f64 = 9.0;
    /// Position of the wall, as a multiple of large errors. A smaller value reduces the largest error more, at the expense of the mean.
    const FAR: f64 = 1.4;

    /// A penalty for errors with a given mean square.
    pub fn new(mean_square: f64) -> Self {
        Self { steep: Self::LARGE * Self::LARGE * mean_square.max(1e-12), walled: false }
    }

    /// The same, but steep from errors smaller by `factor`.
    pub fn steeper(self, factor: f64) -> Self {
        Self { steep: self.steep / (factor * factor), ..self }
    }

    /// The same with a wall: only errors far beyond the others cost more than their square, but then very much more.
    pub fn walled(self) -> Self {
        Self { walled: true, ..self.steeper(1.0 / Self::FAR) }
    }

    pub fn of(&self, error: f64) -> f64 {
        let square = error * error / self.steep;
        let bent = square.min(Self::STEEPEST);
        self.steep * (bent * (1.0 + self.rise(bent)) + (square - bent) * self.slope(bent))
    }

    /// Derivative of the cost, divided by twice the error: the weight of a least squares residual with the same gradient.
    pub fn pull(&self, error: f64) -> f64 {
        self.slope((error * error / self.steep).min(Self::STEEPEST))
    }

    /// Weight of that residual in the matrix. At the wall it is the curvature of the cost, because a step by the gradient's weight would overshoot. Elsewhere
    /// it is that weight, because its longer steps make more progress.
    pub fn stiffness(&self, error: f64) -> f64 {
        let square = error * error / self.steep;
        if self.walled && square < Self::STEEPEST {
            1.0 + (2.0 * self.power() - 1.0) * self.power() * self.rise(square)
        } else {
            self.pull(error)
        }
    }

    /// Exponent of the square in the steep part of the cost.
    fn power(&self) -> f64 {
        if self.walled { 4.0 } else { 2.0 }
    }

    /// The square to that power, divided by the square.
    fn rise(&self, square: f64) -> f64 {
        if self.walled { square * square * square } else { square }
    }

    fn slope(&self, square: f64) -> f64 {
        1.0 + self.power() * self.rise(square)
    }
}

/// Weight of distances from the envelope to the surface, relative to the opposite direction.
const OUTWARD: f64 = 1.0;

/// Depth inside other primitives, in spacings, at which a point of the envelope does not count.
const FADE: f64 = 0.3;

/// A point of the envelope, and the point of the surface that it should coincide with.
pub(super) struct Anchor {
    pub place: SurfacePoint,
    pub target: DVec3,
    /// The triangle of the target, in the order of the tree.
    pub triangle: u32,
    /// Unit direction from the target to the point, at the time when the anchor was created.
    pub out: DVec3,
    pub weight: f64,
}

impl Anchor {
    pub fn point(&self, envelope: &Envelope) -> DVec3 {
        envelope.point(&self.place)
    }

    pub fn error(&self, envelope: &Envelope) -> f64 {
        (self.point(envelope) - self.target).dot(self.out)
    }
}

/// The target of a fit.
pub(super) struct Target<'a> {
    pub solid: &'a Solid,
    pub points: &'a Points,
    /// Weights of the points.
    pub weights: &'a [f64],
    /// Area of the whole surface.
    pub area: f64,
    pub penalty: Penalty,
    /// Distance between points of the envelope.
    pub spacing: f64,
    /// Weight of a sample outside the envelope, relative to one inside.
    pub uncovered: f64,
    /// Largest depth inside the solid at which points of the envelope count in a descent, as at the bottom of a crease. As a part of the diagonal.
    pub creases: f64,
    /// Largest depth inside the solid, and inside other primitives, of points that may become visible during a descent. As a part of the diagonal.
    pub margin: f64,
    /// Places of the envelope with additional, closely spaced points around them, so that their errors count more.
    pub worst: &'a [DVec3],
    /// The other part of the shape, which does not move, if only a part is fitted.
    pub rest: Option<Rest<'a>>,
}

/// The part of a shape that does not move.
pub(super) struct Rest<'a> {
    pub envelope: &'a Envelope,
    /// The primitives of the envelope that belong to the rest.
    pub primitives: Vec<u32>,
    /// Their distances to the target's points.
    pub distances: Vec<f64>,
    /// True for spheres of the moving part that do not move either.
    pub frozen: Vec<bool>,
}

/// Index that stands for the primitives of the rest.
pub(super) const NONE: u32 = u32::MAX;

/// Distance from the worst places within which points of the envelope are closely spaced, as a part of the diagonal.
pub(super) const CLOSE_WITHIN: f64 = 0.03;

/// Distance between these points, as a part of the diagonal.
pub(super) const CLOSE_SPACING: f64 = 0.005;

impl Target<'_> {
    /// Points of the envelope, including hidden ones.
    pub fn places(&self, envelope: &Envelope) -> Vec<SurfacePoint> {
        let mut places = envelope.surface(self.spacing);
        if !self.worst.is_empty() {
            let close = |place: &SurfacePoint| {
                let point = envelope.point(place);
                self.worst.iter().any(|worst| worst.distance_squared(point) < CLOSE_WITHIN * CLOSE_WITHIN)
            };
            places.extend(envelope.surface(CLOSE_SPACING).into_iter().filter(close));
        }
        places
    }

    /// The nearest primitive to each point, or [`NONE`], and the signed distance.
    pub fn nearest(&self, envelope: &Envelope) -> Vec<(u32, f64)> {
        let mut nearest = envelope.nearest_primitives(self.points);
        if let Some(rest) = &self.rest {
            for (nearest, &distance) in nearest.iter_mut().zip(&rest.distances) {
                if distance < nearest.1 {
                    *nearest = (NONE, distance);
                }
            }
        }
        nearest
    }

    /// The hits of the points on their nearest primitives, with the points' weights. Points nearest to the rest are omitted.
    pub fn hits(&self, envelope: &Envelope, nearest: &[(u32, f64)]) -> Vec<(Hit, f64)> {
        let moving: Vec<usize> = (0..nearest.len()).filter(|&i| nearest[i].0 != NONE).collect();
        parallel::map(moving.len(), 64, |at| {
            let i = moving[at];
            (envelope.hit(self.points.positions[i], nearest[i].0), self.weights[i])
        })
    }

    /// Visible points of the envelope, with their nearest points of the surface.
    pub fn anchors(&self, envelope: &Envelope) -> Vec<Anchor> {
        self.anchors_at(envelope, &self.places(envelope), &[], 0.0)
    }

    /// Visible points of the envelope that lie inside the solid, as at the bottom of a crease, with the cost of each.
    pub fn creases(&self, envelope: &Envelope) -> Vec<(DVec3, f64)> {
        let mut creases = vec![];
        for anchor in self.anchors_at(envelope, &self.places(envelope), &[], f64::INFINITY) {
            let point = anchor.point(envelope);
            if !self.solid.is_out(point, point - anchor.target, anchor.place.normal) {
                creases.push((point, anchor.weight * self.penalty.of(anchor.error(envelope))));
            }
        }
        creases
    }

    /// Anchors at given places. Places up to `depth_limit` deep inside the solid count as well. The weight of a place decreases with its depth inside
    /// other primitives. `near`: a nearby triangle for each place, or empty.
    pub fn anchors_at(
        &self,
        envelope: &Envelope,
        places: &[SurfacePoint],
        near: &[u32],
        depth_limit: f64,
    ) -> Vec<Anchor> {
        // Without `near`, places are being selected: those that may become visible count as well.
        let margin = if near.is_empty() { depth_limit.min(self.margin) } else { 0.0 };
        let fade = FADE * self.spacing + margin;
        let points = Points::new(places.iter().map(|s| envelope.point(s)).collect());
        let mut depths = envelope.depths(&points, fade);
        if let Some(rest) = &self.rest {
            let others = rest.envelope.depths_among(&points, &rest.primitives, fade);
            depths.iter_mut().zip(others).for_each(|(depth, other)| *depth = depth.max(other));
        }
        let weight = |i: usize| 1.0 - depths[i] / fade;
        let visible: Vec<(usize, f64)> =
            (0..places.len()).map(|i| (i, weight(i))).filter(|(_, weight)| *weight > 0.0).collect();
        parallel::flat_map(visible.len(), 32, |at, anchors| {
            let (i, weight) = visible[at];
            let (place, point) = (places[i], points.positions[i]);
            // Consecutive places are near each other.
            let near = near.get(i).copied().or(anchors.last().map(|anchor: &Anchor| anchor.triangle));
            let Some((target, triangle)) = self.solid.closest_off_rims(point, near) else { return };
            let away = point - target;
            let out = if away.length() > 1e-9 { away.normalize() } else { place.normal };
            // Deep inside the solid, the samples above measure the same error, without the jumps of the envelope at creases.
            if away.length() > depth_limit && !self.solid.is_out(point, away, place.normal) {
                return;
            }
            anchors.push(Anchor { place, target, triangle, out, weight: OUTWARD * weight * place.area / self.area });
        })
    }

    pub fn side(&self, distance: f64) -> f64 {
        if distance > 0.0 { self.uncovered } else { 1.0 }
    }

    /// Cost of the distance of a sample from the envelope.
    pub fn cost_of(&self, distance: f64) -> f64 {
        self.side(distance) * self.penalty.of(distance)
    }

    pub fn total(&self, nearest: &[(u32, f64)], anchors: &[Anchor], envelope: &Envelope) -> f64 {
        let inward: f64 = nearest.iter().zip(self.weights).map(|((_, d), w)| w * self.cost_of(*d)).sum();
        let outward: f64 = anchors.iter().map(|a| a.weight * self.penalty.of(a.error(envelope))).sum();
        inward + outward
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn penalties_pull_as_they_cost() {
        const STEP: f64 = 1e-4;
        let plain = Penalty::new(1.0);
        let (mut bent, mut curved) = (0, 0);
        for penalty in [plain, plain.steeper(2.0), plain.walled()] {
            for error in (1..400).map(|i| 0.05 * f64::from(i)) {
                let [before, at, after] = [-STEP, 0.0, STEP].map(|step| penalty.of(error + step));
                let pull = (after - before) / (4.0 * STEP * error);
                assert!((pull / penalty.pull(error) - 1.0).abs() < 1e-4, "{penalty:?} pulls by {pull} at {error}");
                let curvature = (after - 2.0 * at + before) / (2.0 * STEP * STEP);
                let from_bend = error - (Penalty::STEEPEST * penalty.steep).sqrt();
                if from_bend.abs() < STEP {
                    continue;
                }
                if from_bend > 0.0 {
                    bent += 1;
                    assert_eq!(penalty.stiffness(error), penalty.pull(error));
                } else if penalty.walled && error > 3.0 {
                    curved += 1;
                    assert!((curvature / penalty.stiffness(error) - 1.0).abs() < 1e-3, "{curvature} at {error}");
                }
            }
        }
        assert!(bent > 100 && curved > 100, "{bent} {curved}");
    }
}
