//! Descent: spheres move until the envelope fits the surface, with errors measured in both directions.
//!
//! The distance of a surface sample to its nearest primitive changes with the spheres of that primitive, in proportion to their weights
//! in the nearest blend. So each step solves a least squares problem (Levenberg and Marquardt).

use super::{normal_equations::NormalEquations, target::Target};
use crate::builder::envelope::{Complex, SurfacePoint};

/// Largest displacement of a sphere per step: the sum of a multiple of its radius and a part of the diagonal.
const STRIDE: [f64; 2] = [0.3, 0.005];

/// Smallest radius, as a part of the diagonal.
const LEAST_RADIUS: f64 = 1e-4;

/// Relative reduction of the cost per step that ends a descent while spheres are still exchanged.
pub(super) const ROUGH: f64 = 1e-3;

/// Moves the spheres for up to `steps` steps, until a step reduces the cost by less than the fraction `enough`. Returns the cost.
///
/// Visibility and nearest surface points of the envelope's points are recomputed for every trial. Points that are deeper than the margin
/// inside the shape or the solid at the start never count.
pub(super) fn descend(complex: &mut Complex, target: &Target, steps: usize, enough: f64) -> f64 {
    // The places on the envelope stay fixed relative to the spheres, so that the costs of trials are comparable.
    let envelope = complex.envelope();
    let chosen = target.anchors_at(&envelope, &target.places(&envelope), &[], target.margin.max(target.creases));
    let places: Vec<SurfacePoint> = chosen.iter().map(|anchor| anchor.place).collect();
    let near: Vec<u32> = chosen.iter().map(|anchor| anchor.triangle).collect();
    let measure = |complex: &Complex| {
        let envelope = complex.envelope();
        let nearest = target.nearest(&envelope);
        let anchors = target.anchors_at(&envelope, &places, &near, target.creases);
        let cost = target.total(&nearest, &anchors, &envelope);
        (cost, envelope, nearest, anchors)
    };
    let mut damping = 1e-2;
    let (mut cost, mut envelope, mut nearest, mut anchors) = measure(complex);
    for _ in 0..steps {
        let hits = target.hits(&envelope, &nearest);
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
            (cost, envelope, nearest, anchors) = measured;
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
