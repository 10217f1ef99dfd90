//! Options, results and errors of a build.

use thiserror::Error;

use crate::medial_axis::{CleanupReport, MedialAxis, MedialAxisError};

/// Largest difference of a mass property, in percent.
pub(super) const MOST_OFF: f64 = 10.0;

/// Options of a build.
#[derive(Clone, Debug, PartialEq)]
pub struct BuildOptions {
    /// Largest number of spheres, one or more.
    pub spheres: usize,
    /// Largest number of edges, including those of faces. `None`: proportional to the spheres, with more edges for solids without limbs.
    pub edges: Option<usize>,
    /// Largest number of faces. `None`: as for edges.
    pub faces: Option<usize>,
    /// Number of searches for a shape, each from different samples; the best result is used. Each coarser level of a chain has one more search, which
    /// starts from the level before. `None`: one or two searches for the finest level, depending on the size of the mesh, with a shorter search below 100
    /// triangles per sphere. Coarser levels have up to four, the coarser the more.
    pub searches: Option<usize>,
    /// Seed of the surface samples.
    pub seed: u64,
}

/// Default seed. The result of a search varies with the seed; with this one, no mesh of `docs/accuracy.md` has an unusually large error.
pub const DEFAULT_SEED: u64 = 10;

impl Default for BuildOptions {
    fn default() -> Self {
        Self { spheres: 60, edges: None, faces: None, searches: None, seed: DEFAULT_SEED }
    }
}

/// A medial mesh with a report of its build.
#[derive(Clone, Debug)]
pub struct Built {
    /// The medial mesh, in the frame and the units of the triangle mesh.
    pub axis: MedialAxis,
    /// Results of the build beside the shape.
    pub report: BuildReport,
}

/// Results of a build beside the shape.
#[derive(Clone, Debug)]
pub struct BuildReport {
    /// Number of components of the triangle mesh. Connected pieces that overlap or touch are one component. Pieces without a volume are left out.
    pub components: usize,
    /// Components without a sphere, because their volume is almost zero.
    pub empty_components: usize,
    /// Root mean square distance of surface samples to the envelope, as a fraction of the diagonal of the mesh's bounding box.
    pub rms_error: f32,
    /// Largest distance of a surface sample to the envelope, as a fraction of the diagonal.
    pub max_error: f32,
    /// Changes of the last clean-up.
    pub cleanup: CleanupReport,
}

/// Reasons why a mesh has no medial mesh.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum BuildError {
    /// There is no triangle with an area.
    #[error("no triangle of the mesh has an area; export it with its faces")]
    Empty,
    /// A triangle refers to a vertex that does not exist.
    #[error("triangle {triangle} refers to vertex {index}, which does not exist; export the mesh again")]
    IndexOutOfRange {
        /// Index of the triangle.
        triangle: usize,
        /// The invalid index.
        index: u32,
    },
    /// A vertex is NaN or infinite.
    #[error("vertex {vertex} is not finite; export the mesh again")]
    NotFinite {
        /// Index of the vertex.
        vertex: u32,
    },
    /// The surface encloses no volume.
    #[error(
        "the mesh encloses no volume; close its holes, give its sheets a thickness, or remove the backs of doubled faces"
    )]
    NoVolume,
    /// Each component needs a sphere.
    #[error(
        "the mesh has {components} components that enclose a volume, more than {spheres} spheres; allow more spheres or join components"
    )]
    TooFewSpheres {
        /// Number of components with a volume.
        components: usize,
        /// Largest allowed number of spheres.
        spheres: usize,
    },
    /// The mass properties of the finest shape differ from those of the mesh.
    #[error(
        "the {what} of the shape with {spheres} spheres is {percent:.1} % off, more than {MOST_OFF} %; allow more spheres, make thin parts thicker, or split the mesh"
    )]
    Mass {
        /// The property with the largest difference.
        what: &'static str,
        /// Number of spheres of the shape.
        spheres: usize,
        /// The difference.
        percent: f32,
    },
    /// The error of the finest shape is larger than [`error_limit`](super::FitOptions::error_limit).
    #[error(
        "the error of the shape with {spheres} spheres is {percent:.1} % of the diagonal, more than {limit} %; allow more spheres, or a larger error"
    )]
    Error {
        /// Number of spheres of the shape.
        spheres: usize,
        /// The error in percent of the diagonal.
        percent: f32,
        /// The largest allowed error.
        limit: f32,
    },
    /// The finest shape does not keep the [limits](super::FitOptions::sides) of its sides.
    #[error(
        "the shape with {spheres} spheres exceeds the limits of its sides: it protrudes by {out:.3} %, and the mesh by {gap:.3} % of the diagonal more than allowed; allow more spheres, or a larger distance"
    )]
    Sides {
        /// Number of spheres of the shape.
        spheres: usize,
        /// Protrusion of the shape from the mesh, beyond the limit, in percent of the diagonal.
        out: f32,
        /// Distance of the mesh outside of the shape, beyond the limit, in percent of the diagonal.
        gap: f32,
    },
    /// The mass or the inertia of the solid is too small or too large for an f32.
    #[error("the mesh is {diagonal:e} m in size, and its mass is too small or too large to compute with; scale it")]
    TooSmall {
        /// Diagonal of the bounding box in metres.
        diagonal: f32,
    },
    /// The progress callback cancelled the build.
    #[error("the build was cancelled")]
    Cancelled,
    /// The result exceeds the limits of a medial mesh.
    #[error(transparent)]
    Asset(#[from] MedialAxisError),
}
