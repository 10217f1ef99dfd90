//! Improves the worst places of a shape that fits well on the whole: places where the envelope leaves a thin limb, bridges a gap or opens to a void.
//!
//! The mean error hides them, and so do the coarse points of the search. Here the cost of errors far beyond the others is very steep in both directions,
//! and the envelope's points are dense around its worst places. Spheres move there from places where they reduce the cost little, and edges and faces
//! are chosen again.

use std::ops::ControlFlow;

use super::{
    judge::{Judge, Verdict},
    refine::Change,
    state::{CREASES, MARGIN, Plan, SPACING, target_for},
    target::Target,
};
use crate::builder::{envelope::Complex, progress::Progress, surface_samples::Samples};

/// Number of steps of a descent.
const STEPS: usize = 6;

/// Largest number of iterations.
pub(super) const MOST_ROUNDS: usize = 4;

/// Number of iterations that the time allows: none below 400 triangles per sphere, where the search takes all of the time.
pub(super) fn rounds(triangles: usize, spheres: usize) -> usize {
    const TRIANGLES_PER_ROUND: usize = 100;
    const WITHOUT: usize = 3;
    (triangles / TRIANGLES_PER_ROUND / spheres).saturating_sub(WITHOUT).min(MOST_ROUNDS)
}

/// Reduces the error in up to `plan.mends` iterations, without a larger maximum or mean. Iterations alternate between spheres, and edges and faces.
pub(super) fn mend(
    complex: &mut Complex,
    parts: &mut Vec<u32>,
    verdict: &mut Verdict,
    judge: &Judge,
    samples: &Samples,
    plan: &Plan,
    progress: &Progress,
) -> ControlFlow<()> {
    if plan.mends == 0 {
        return progress(1.0);
    }
    let samples = samples.clone().turned_outward(judge.solid);
    let plan = Plan { steps: STEPS, ..*plan };
    let most_mean = verdict.mean;
    let mut failures = 0;
    for round in 0..plan.mends {
        progress(round as f32 / plan.mends as f32)?;
        let target = target_for(complex, judge.solid, &samples, SPACING[1]);
        let penalty = target.penalty.walled();
        let target =
            Target { penalty, uncovered: 1.0, creases: CREASES, margin: MARGIN, worst: &verdict.worst, ..target };
        let change = if round % 2 == 0 { Change::Spheres(plan.most_exchanged()) } else { Change::Connectivity };
        let (mut trial, mut trial_parts) = (complex.clone(), parts.clone());
        change.make(&mut trial, &mut trial_parts, &samples, &plan, &target);
        let after = judge.verdict(&trial);
        if after.max() <= verdict.max() && after.mean <= most_mean && after.error() < verdict.error() {
            (*complex, *parts, *verdict) = (trial, trial_parts, after);
            failures = 0;
        } else {
            failures += 1;
            if failures == 2 {
                break;
            }
        }
    }
    progress(1.0)
}

#[cfg(test)]
mod tests {
    use std::ops::ControlFlow;

    use glam::{DVec3, Vec3};

    use super::*;
    use crate::{
        builder::{hull::Ball, mesh::tests::triangulated, solid::Solid},
        medial_axis::MedialAxis,
    };

    #[test]
    fn a_planted_bulge_is_mended() {
        let capsule = MedialAxis::capsule(Vec3::ZERO, Vec3::X, 0.2).unwrap();
        let mesh = triangulated(&capsule, 32);
        let solid = Solid::new(&mesh).unwrap();
        let judge = Judge::new(&solid, 1);
        let samples = Samples::new(&solid, 3000, 0, 1);
        let ball = |(x, radius): (f64, f64)| Ball {
            center: (DVec3::X * x - solid.origin) / solid.diagonal,
            radius: radius / solid.diagonal,
        };
        let bulging = Complex {
            balls: [(0.0, 0.2), (0.4, 0.26), (0.7, 0.2), (1.0, 0.2)].map(ball).into(),
            edges: vec![[0, 1], [1, 2], [2, 3]],
            faces: vec![],
        };
        let before = judge.verdict(&bulging);
        let mended = |mends: usize| {
            let plan =
                Plan { spheres: 4, edges: 3, faces: 0, rounds: 0, mends, steps: 4, hurried: false, spacing: 0.02 };
            let (mut complex, mut parts, mut verdict) = (bulging.clone(), vec![0; 4], before.clone());
            let never = |_: f32| ControlFlow::Continue(());
            let end = mend(&mut complex, &mut parts, &mut verdict, &judge, &samples, &plan, &never);
            assert!(end.is_continue());
            assert_eq!(parts.len(), complex.balls.len());
            assert_eq!(judge.verdict(&complex).max(), verdict.max(), "the verdict is that of the result");
            verdict.max()
        };
        assert_eq!(mended(0), before.max());
        assert!(mended(2) < 0.3 * before.max(), "{} of {}", mended(2), before.max());
    }
}
