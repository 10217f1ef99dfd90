//! One search for a medial mesh: the stages from samples to fitted spheres.

use std::{collections::BTreeSet, sync::Arc};

use glam::DVec3;

use super::{
    clusters,
    connect::{self, Limits},
    descent,
    inscribe::inscribe,
    judge::{Judge, Verdict},
    mend, refine,
    state::{CREASES, MARGIN, Plan, SPACING, is_hurried, target, target_for},
    target::{Penalty, Target},
};
use crate::{
    builder::{
        BuildError, BuildOptions, BuildReport, Built,
        envelope::Complex,
        hull::Ball,
        parallel,
        progress::{Progress, between},
        solid::Solid,
        surface_samples::{Samples, medial_ball},
    },
    geometry::{Primitive, Sphere},
    medial_axis::{MAX_SPHERES, MedialAxis},
};

/// Samples of the area per sphere during the search for spheres, and additional vertices per sphere.
const COARSE: [usize; 2] = [60, 12];

/// The same for a hurried search.
const COARSER: [usize; 2] = [36, 7];

/// The same for the last descent.
const FINE: [usize; 2] = [150, 75];

/// Smallest and largest number of coarse samples of the area.
const SAMPLES: [usize; 2] = [3000, 20_000];

/// Steps of the two last descents: one with the normal penalty, and one with a steeper penalty that includes creases.
const LAST_STEPS: [usize; 2] = [16, 10];

/// Steps of the only last descent of a hurried search.
const HURRIED_STEPS: usize = 8;

/// Ratio of the errors above which the normal and the steeper penalty are steep.
const STEEPER: f64 = 2.2;

/// Ratio of the initial to the final number of spheres.
const SURPLUS: f64 = 1.7;

/// Number of edges beyond the number of spheres, and number of faces, per sphere of a body without limbs.
const EXTRA: f64 = 0.95;

/// Cycles per cluster in the graph of touching clusters: for limbs, which have cycles at forks, and for a body without limbs (Euler's formula).
const CYCLES: [f64; 2] = [0.27, 2.0];

#[derive(Clone)]
pub(in crate::builder) struct Search {
    coarse: Arc<Samples>,
    fine: Arc<Samples>,
    complex: Complex,
    /// Component of each sphere.
    parts: Vec<u32>,
    plan: Plan,
    /// The judge's verdict on the shape.
    pub verdict: Verdict,
}

/// Fraction of a solid that is not limbs, from 0 to 1: the mean of its components, weighted by their clusters.
fn body(parts: &[u32], touching: &BTreeSet<[u32; 2]>, part_count: usize) -> f64 {
    let mut counts = vec![[0usize; 2]; part_count];
    parts.iter().for_each(|&part| counts[part as usize][0] += 1);
    touching.iter().for_each(|&[i, _]| counts[parts[i as usize] as usize][1] += 1);
    let bodies = counts.iter().filter(|[clusters, _]| *clusters > 0).map(|&[clusters, pairs]| {
        let cycles = pairs.saturating_sub(clusters) as f64 / clusters as f64;
        clusters as f64 * ((cycles - CYCLES[0]) / (CYCLES[1] - CYCLES[0])).clamp(0.0, 1.0)
    });
    bodies.sum::<f64>() / parts.len() as f64
}

/// Returns samples for a number of spheres. The number of samples of the area lies between two bounds.
fn samples(
    solid: &Solid,
    spheres: usize,
    [area, vertices]: [usize; 2],
    [least, most]: [usize; 2],
    seed: u64,
) -> Samples {
    let count = (spheres * area).clamp(least, most);
    Samples::new(solid, count, count * vertices / area, seed)
}

/// Returns the medial balls of every second bounding sample of each part, starting with the first one, so that no part goes without.
fn medial_balls(solid: &Solid, samples: &Samples) -> Vec<Option<Ball>> {
    let mut has_ball = vec![false; solid.part_count];
    let chosen: Vec<bool> = (samples.normals.iter().zip(&samples.parts))
        .map(|(normal, &part)| {
            let bounds = *normal != DVec3::ZERO;
            has_ball[part as usize] ^= bounds;
            bounds && has_ball[part as usize]
        })
        .collect();
    parallel::map(samples.len(), 32, |i| {
        chosen[i].then(|| medial_ball(solid, samples.parts[i], samples.points.positions[i], samples.normals[i]))
    })
}

/// Number of distinct values.
fn distinct(parts: &[u32]) -> usize {
    let mut parts = parts.to_vec();
    parts.sort_unstable();
    parts.dedup();
    parts.len()
}

impl Search {
    /// Starts a search with spheres from samples.
    pub fn new(
        solid: &Solid,
        options: &BuildOptions,
        triangles: usize,
        seed: u64,
        progress: &Progress,
    ) -> Result<Self, BuildError> {
        let report = |part: f32| if progress(part).is_break() { Err(BuildError::Cancelled) } else { Ok(()) };
        report(0.0)?;
        let spheres = options.spheres.clamp(1, MAX_SPHERES);
        // A caller that sets the number of searches accepts the time that they take.
        let hurried = options.searches.is_none() && is_hurried(triangles, spheres);
        let per_sphere = if hurried { COARSER } else { COARSE };
        let coarse = samples(solid, spheres, per_sphere, SAMPLES, seed).turned_outward(solid);
        let fine = samples(solid, spheres, FINE, SAMPLES.map(|samples| 2 * samples), seed);
        let balls = medial_balls(solid, &coarse);
        report(0.1)?;
        let at_first = ((spheres as f64 * SURPLUS) as usize).min(balls.iter().flatten().count());
        let clusters = clusters::cluster(&coarse, &balls, at_first, solid.part_count);
        if clusters.balls.is_empty() {
            return Err(BuildError::NoVolume);
        }
        let components = distinct(&clusters.parts);
        if components > spheres {
            return Err(BuildError::TooFewSpheres { components, spheres });
        }
        let mut complex = Complex { balls: clusters.balls, ..Complex::default() };
        let touching = connect::touching(&coarse, &clusters.labels);
        let extra = (EXTRA * body(&clusters.parts, &touching, solid.part_count) * spheres as f64) as usize;
        let plan = Plan {
            spheres,
            edges: options.edges.unwrap_or(spheres + extra),
            faces: options.faces.unwrap_or(extra),
            rounds: Plan::rounds(triangles, spheres),
            mends: mend::rounds(triangles, spheres),
            steps: 4,
            hurried,
            spacing: SPACING[0],
        };
        // Before the first descent, errors of some thousandths of the diagonal are usual.
        let target = target(solid, &coarse, Penalty::new(1e-5), plan.spacing);
        let surplus = complex.balls.len().saturating_sub(spheres);
        let limits = Limits { edges: plan.edges.saturating_add(surplus), faces: plan.faces };
        let cones = touching.iter().map(|&pair| Primitive::Cone(pair)).collect();
        connect::connect(&mut complex, &clusters.parts, &touching, cones, &coarse, limits, &target);
        let (coarse, fine) = (coarse.into(), fine.into());
        let (parts, verdict) = (clusters.parts, Verdict::UNKNOWN);
        Ok(Self { coarse, fine, complex, parts, plan, verdict })
    }

    /// Number of components with a sphere.
    pub fn full_components(&self) -> usize {
        distinct(&self.parts)
    }

    /// Largest allowed number of spheres.
    pub fn spheres(&self) -> usize {
        self.plan.spheres
    }

    /// Number of spheres. It is smaller than the limit if the samples yield no more.
    pub fn balls(&self) -> usize {
        self.complex.balls.len()
    }

    /// A search for a shape with fewer spheres that starts from this shape, with about a proportional number of edges and faces.
    pub fn coarser(&self, spheres: usize) -> Self {
        let share = |limit: usize| limit.saturating_mul(spheres) / self.plan.spheres;
        let (edges, faces) = (share(self.plan.edges), share(self.plan.faces));
        let (rounds, mends) = (Plan::MOST_ROUNDS, mend::MOST_ROUNDS);
        Self { plan: Plan { spheres, edges, faces, rounds, mends, hurried: false, ..self.plan }, ..self.clone() }
    }

    /// Fits the spheres.
    pub fn refine(&mut self, judge: &Judge, progress: &Progress) -> Result<(), BuildError> {
        let Self { coarse, fine, complex, parts, plan, verdict } = self;
        let solid = judge.solid;
        if refine::refine(complex, parts, solid, coarse, plan, &between(progress, 0.2, 0.7)).is_break() {
            return Err(BuildError::Cancelled);
        }
        let target = target_for(complex, solid, fine, SPACING[1]);
        let even = Target { uncovered: 1.0, creases: 0.0, margin: MARGIN, ..target };
        if plan.hurried {
            // A hurried shape is not judged, because there is no other shape to compare it with.
            descent::descend(complex, &even, HURRIED_STEPS, 0.1 * descent::ROUGH);
            return if progress(1.0).is_break() { Err(BuildError::Cancelled) } else { Ok(()) };
        }
        let steep = Target { penalty: even.penalty.steeper(STEEPER), creases: CREASES, rest: None, ..even };
        // Either of the two descents may give the better shape.
        let mut other = complex.clone();
        descent::descend(complex, &even, LAST_STEPS[0], 0.1 * descent::ROUGH);
        descent::descend(&mut other, &steep, LAST_STEPS[1], descent::ROUGH);
        *verdict = judge.verdict(complex);
        let of_other = judge.verdict(&other);
        if of_other.error() < verdict.error() {
            (*complex, *verdict) = (other, of_other);
        }
        let mended = mend::mend(complex, parts, verdict, judge, fine, plan, &between(progress, 0.7, 1.0));
        if mended.is_break() { Err(BuildError::Cancelled) } else { Ok(()) }
    }

    /// The same shape, changed to lie [inside the solid](inscribe()).
    pub fn inscribed(&self, judge: &Judge) -> Self {
        let complex = inscribe(&self.complex, &self.parts, &self.fine, judge.solid);
        let verdict = judge.verdict(&complex);
        Self { complex, verdict, ..self.clone() }
    }

    /// The current shape with its report.
    pub fn built(&self, solid: &Solid) -> Result<Built, BuildError> {
        let Self { complex, fine, .. } = self;
        let spheres = complex.balls.iter().map(|ball| {
            let center = ball.center * solid.diagonal + solid.origin;
            Sphere::new(center.as_vec3(), (ball.radius * solid.diagonal) as f32)
        });
        let (axis, cleanup) = MedialAxis::from_lists(spheres.collect(), &complex.edges, &complex.faces)?;
        let distances = complex.envelope().distances(&fine.points);
        let mean_square: f64 = distances.iter().zip(&fine.weights).map(|(d, w)| w * d * d).sum();
        let report = BuildReport {
            components: solid.part_count,
            empty_components: solid.part_count - self.full_components(),
            rms_error: mean_square.sqrt() as f32,
            max_error: distances.iter().map(|d| d.abs()).fold(0.0, f64::max) as f32,
            cleanup,
        };
        Ok(Built { axis, report })
    }
}

#[cfg(test)]
mod tests {
    use std::ops::ControlFlow;

    use glam::Vec3;

    use super::*;
    use crate::{
        builder::{measure, mesh::tests::triangulated},
        medial_axis::MedialAxis,
    };

    #[test]
    fn only_builds_of_few_triangles_a_sphere_are_hurried() {
        let capsule = MedialAxis::capsule(Vec3::ZERO, Vec3::X, 0.2).unwrap();
        let mesh = triangulated(&capsule, 32);
        let solid = Solid::new(&mesh).unwrap();
        let search = |triangles: usize, searches: Option<usize>| {
            let options = BuildOptions { spheres: 40, searches, ..BuildOptions::default() };
            Search::new(&solid, &options, triangles, 1, &|_| ControlFlow::Continue(())).unwrap()
        };
        let hurried = search(3999, None);
        let calm = [search(4000, None), search(3999, Some(1)), search(1999, None)];
        assert!(hurried.plan.hurried);
        for calm in calm {
            assert!(!calm.plan.hurried);
            assert!(calm.coarse.len() >= hurried.coarse.len());
        }
        assert!(!hurried.coarser(20).plan.hurried, "coarser levels are not hurried");
        let mut search = hurried;
        search.refine(&Judge::new(&solid, 1), &|_| ControlFlow::Continue(())).unwrap();
        let axis = search.built(&solid).unwrap().axis;
        assert!(axis.spheres().len() <= 40);
        let error = measure(&mesh, &axis);
        assert!(error.max() < 1.0, "{error:?}");
    }
}
