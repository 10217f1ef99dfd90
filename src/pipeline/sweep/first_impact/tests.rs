use bevy::tasks::TaskPool;

use super::*;
use crate::{
    geometry::{Pose3, Sweep},
    medial_axis::MedialAxis,
    pipeline::{Body, Shape, step},
};

/// A rod turns by 2 rad above a ball whose surface it touches for a few intervals, but not its core.
#[test]
fn a_graze_that_ends_in_a_later_interval_is_an_impact() {
    let rod = Shape::new(MedialAxis::capsule(-Vec3::X, Vec3::X, 0.05).unwrap());
    let ball = Shape::new(MedialAxis::sphere(0.1).unwrap());
    let at_rest = Sweep::at_rest(Pose3::IDENTITY);
    let (mut found, mut ends_later) = (0, 0);
    for case in 0..20 {
        let (angle, depth) = (0.5 + 0.05 * case as f32, [1.0e-4, 3.0e-4, 5.0e-4, 7.0e-4][case % 4]);
        let direction = Vec3::new(angle.cos(), angle.sin(), 0.0);
        let center = 0.5 * direction + Vec3::Z * (0.15 - depth);
        let turning = Sweep::at_rates(Pose3::IDENTITY, Vec3::ZERO, Vec3::ZERO, 2.0 * Vec3::Z);
        let resting = Sweep { start: Pose3::from_translation(center), ..at_rest };
        let resting = Sweep { end: resting.start, ..resting };
        let bodies = vec![Body::new(rod.clone(), turning), Body::new(ball.clone(), resting)];
        let output = step(&StepInput { bodies, ..Default::default() }, &Statics::default(), &TaskPool::new());
        let impact = output.pairs.first().and_then(|pair| pair.impact);
        found += usize::from(impact.is_some_and(|impact| (impact.fraction - 0.5 * angle).abs() < 0.02));
        // Half of the width of the touch, in intervals of 1/128 of the step.
        let half_width = (0.15f32.powi(2) - (0.15 - depth).powi(2)).sqrt();
        ends_later += usize::from(2.0 * half_width > 1.0 / 128.0);
    }
    assert_eq!((found, ends_later), (20, 20));
}
