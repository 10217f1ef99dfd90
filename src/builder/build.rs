//! The entry: the stages in order.

use std::ops::ControlFlow;

use glam::DVec3;
use thiserror::Error;

use super::{
    TriangleMesh, clusters,
    connect::{self, Limits},
    descent::{self, Penalty, Target},
    envelope::Complex,
    parallel,
    refine::{self, Plan},
    solid::Solid,
    surface_samples::{Samples, medial_ball},
};
use crate::{
    geometry::Sphere,
    medial_axis::{CleanupReport, MedialAxis, MedialAxisError},
};

/// What to build.
#[derive(Clone, Debug, PartialEq)]
pub struct BuildOptions {
    /// Largest number of spheres, one or more.
    pub spheres: usize,
    /// Largest number of edges, those of faces included; `None`: in proportion to the spheres, the more the less the solid is made of limbs.
    pub edges: Option<usize>,
    /// Largest number of faces; `None`: as for edges.
    pub faces: Option<usize>,
    /// Seed of the surface samples.
    pub seed: u64,
}

impl Default for BuildOptions {
    fn default() -> Self {
        Self { spheres: 60, edges: None, faces: None, seed: 1 }
    }
}

/// A medial mesh and how it came to be.
#[derive(Clone, Debug)]
pub struct Built {
    /// The medial mesh, in the frame and the units of the triangle mesh.
    pub axis: MedialAxis,
    /// What is worth knowing.
    pub report: BuildReport,
}

/// What is worth knowing about a build.
#[derive(Clone, Debug)]
pub struct BuildReport {
    /// Connected components of the triangle mesh.
    pub components: usize,
    /// Components that enclose no volume, so that no sphere lies in them.
    pub empty_components: usize,
    /// Root mean square distance of surface samples to the envelope, as a part of the diagonal of the mesh's bounding box.
    pub rms_error: f32,
    /// Greatest distance of a surface sample to the envelope, as a part of the diagonal.
    pub max_error: f32,
    /// What the last clean-up changed.
    pub cleanup: CleanupReport,
}

/// Why a mesh has no medial mesh.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum BuildError {
    /// There is no triangle with an area.
    #[error("no triangle of the mesh has an area; export it with its faces")]
    Empty,
    /// A triangle refers to a vertex that does not exist.
    #[error("triangle {triangle} refers to vertex {index}, which does not exist; export the mesh anew")]
    IndexOutOfRange {
        /// The triangle.
        triangle: usize,
        /// The offending index.
        index: u32,
    },
    /// A vertex is NaN or infinite.
    #[error("vertex {vertex} is not finite; export the mesh anew")]
    NotFinite {
        /// The vertex.
        vertex: u32,
    },
    /// The surface encloses nothing.
    #[error("the mesh encloses no volume; close its holes or give its sheets a thickness")]
    NoVolume,
    /// Each component needs a sphere.
    #[error(
        "the mesh has {components} components that enclose a volume, more than {spheres} spheres; allow more spheres or join components"
    )]
    TooFewSpheres {
        /// Components with a volume.
        components: usize,
        /// Spheres that were allowed.
        spheres: usize,
    },
    /// The progress callback said so.
    #[error("the build was cancelled")]
    Cancelled,
    /// The result is beyond what a medial mesh can hold.
    #[error(transparent)]
    Asset(#[from] MedialAxisError),
}

/// Samples of the area per sphere while spheres are sought, and vertices beside them.
const COARSE: [usize; 2] = [60, 12];

/// The same for the last descent.
const FINE: [usize; 2] = [150, 75];

/// Least and greatest number of coarse samples of the area.
const SAMPLES: [usize; 2] = [3000, 20_000];

/// Distance of points of the envelope, as a part of the diagonal: coarse and fine.
const SPACING: [f64; 2] = [0.02, 0.012];

/// Steps of the last descents, one by a usual penalty and one by a steeper one.
const LAST_STEPS: [usize; 2] = [24, 12];

/// By how much that is steep earlier.
const STEEPER: f64 = 2.2;

/// How many more spheres there are at first.
const SURPLUS: f64 = 1.3;

/// Edges beyond the number of spheres, and faces, per cycle of the graph of spheres that touch on the surface: limbs have few.
const PER_CYCLE: f64 = 0.43;

/// A medial mesh of a solid.
///
/// `progress` is told the part of the work that is done, from 0 to 1, and may break it off.
///
/// # Errors
/// If the mesh has no area or encloses nothing, if a vertex is not finite or missing, if there are more components than
/// spheres, or if `progress` breaks.
pub fn build(
    mesh: &TriangleMesh,
    options: &BuildOptions,
    progress: &dyn Fn(f32) -> ControlFlow<()>,
) -> Result<Built, BuildError> {
    let mut builder = Builder::new(mesh, options, progress)?;
    builder.refine()?;
    builder.finish()
}

/// A chain of medial meshes, each with at most half as many spheres as the one before, down to one sphere a component.
///
/// # Errors
/// As for [`build`].
pub fn build_levels(
    mesh: &TriangleMesh,
    options: &BuildOptions,
    progress: &dyn Fn(f32) -> ControlFlow<()>,
) -> Result<Vec<Built>, BuildError> {
    let mut builder = Builder::new(mesh, options, progress)?;
    let mut levels = vec![];
    loop {
        builder.refine()?;
        levels.push(builder.finish()?);
        let least = builder.full_components();
        if builder.plan.spheres <= least {
            return Ok(levels);
        }
        builder.plan.coarsen(least);
    }
}

struct Builder<'a> {
    solid: Solid,
    coarse: Samples,
    fine: Samples,
    complex: Complex,
    /// Component of each sphere.
    parts: Vec<u32>,
    plan: Plan,
    progress: &'a dyn Fn(f32) -> ControlFlow<()>,
}

impl<'a> Builder<'a> {
    fn new(
        mesh: &TriangleMesh,
        options: &BuildOptions,
        progress: &'a dyn Fn(f32) -> ControlFlow<()>,
    ) -> Result<Self, BuildError> {
        let report = |part: f32| if progress(part).is_break() { Err(BuildError::Cancelled) } else { Ok(()) };
        report(0.0)?;
        let solid = Solid::new(mesh)?;
        let spheres = options.spheres.max(1);
        let count = |per_sphere: [usize; 2], factor: usize| {
            let area = (spheres * per_sphere[0]).clamp(SAMPLES[0] * factor, SAMPLES[1] * factor);
            (area, area * per_sphere[1] / per_sphere[0])
        };
        let ((area, vertices), (fine_area, fine_vertices)) = (count(COARSE, 1), count(FINE, 2));
        let coarse = Samples::new(&solid, area, vertices, options.seed).turned_outward(&solid);
        let fine = Samples::new(&solid, fine_area, fine_vertices, options.seed);
        let balls = parallel::map(coarse.len(), 32, |i| {
            let normal = coarse.normals[i];
            (i % 2 == 0 && normal != DVec3::ZERO).then(|| medial_ball(&solid, coarse.points.positions[i], normal))
        });
        report(0.1)?;
        let at_first = (spheres as f64 * SURPLUS) as usize;
        let clusters = clusters::cluster(&coarse, &balls, at_first, solid.part_count);
        if clusters.balls.is_empty() {
            return Err(BuildError::NoVolume);
        }
        let mut complex = Complex { balls: clusters.balls, ..Complex::default() };
        let touching = connect::touching(&coarse, &clusters.labels);
        let cycles = touching.len().saturating_sub(complex.balls.len()) as f64 / complex.balls.len() as f64;
        let extra = (PER_CYCLE * cycles * spheres as f64) as usize;
        let plan = Plan {
            spheres,
            edges: options.edges.unwrap_or(spheres + extra),
            faces: options.faces.unwrap_or(extra),
            rounds: Plan::rounds(mesh.triangles.len()),
            steps: 8,
            spacing: SPACING[0],
        };
        // Until the first descent an error of some thousandths is usual.
        let target = refine::target(&solid, &coarse, Penalty::new(1e-5), plan.spacing);
        let surplus = complex.balls.len().saturating_sub(spheres);
        let limits = Limits { edges: plan.edges + surplus, faces: plan.faces };
        connect::connect(&mut complex, &clusters.parts, &touching, &coarse, limits, &target);
        let builder = Self { solid, coarse, fine, complex, parts: clusters.parts, plan, progress };
        let components = builder.full_components();
        if components > spheres {
            return Err(BuildError::TooFewSpheres { components, spheres });
        }
        Ok(builder)
    }

    /// Components that have a sphere.
    fn full_components(&self) -> usize {
        let mut parts = self.parts.clone();
        parts.sort_unstable();
        parts.dedup();
        parts.len()
    }

    /// Fits the spheres.
    fn refine(&mut self) -> Result<(), BuildError> {
        let progress = |part: f32| (self.progress)(0.2 + 0.7 * part);
        let done = refine::refine(&mut self.complex, &mut self.parts, &self.solid, &self.coarse, &self.plan, &progress);
        if done.is_break() {
            return Err(BuildError::Cancelled);
        }
        let fine = refine::target_for(&self.complex, &self.solid, &self.fine, SPACING[1]);
        let even = Target { uncovered: 1.0, ..fine };
        let steep = Target { penalty: even.penalty.steeper(STEEPER), rest: None, ..even };
        // Either may leave the lesser greatest error.
        let mut other = self.complex.clone();
        descent::descend(&mut self.complex, &even, LAST_STEPS[0], 0.1 * descent::ROUGH);
        descent::descend(&mut other, &steep, LAST_STEPS[1], descent::ROUGH);
        if even.worst(&other) < even.worst(&self.complex) {
            self.complex = other;
        }
        Ok(())
    }

    fn finish(&self) -> Result<Built, BuildError> {
        let Self { solid, complex, fine, .. } = self;
        let spheres = complex.balls.iter().map(|ball| {
            let center = ball.center * solid.diagonal + solid.origin;
            Sphere::new(center.as_vec3(), (ball.radius * solid.diagonal) as f32)
        });
        let (axis, cleanup) = MedialAxis::from_lists(spheres.collect(), &complex.edges, &complex.faces)?;
        let hits = complex.envelope().hits(&fine.points);
        let mean_square: f64 = hits.iter().zip(&fine.weights).map(|(h, w)| w * h.distance * h.distance).sum();
        let report = BuildReport {
            components: solid.part_count,
            empty_components: solid.part_count - self.full_components(),
            rms_error: mean_square.sqrt() as f32,
            max_error: hits.iter().map(|h| h.distance.abs()).fold(0.0, f64::max) as f32,
            cleanup,
        };
        if (self.progress)(1.0).is_break() {
            return Err(BuildError::Cancelled);
        }
        Ok(Built { axis, report })
    }
}
