//! From a triangle mesh to a medial mesh.
//!
//! ```text
//! TriangleMesh --solid--> checked, scaled, in a tree --surface_samples--> points, normals, medial balls
//!   --clusters--> spheres --connect--> edges, faces --refine (exchange, descent)--> the fit --MedialAxis::from_lists--> Built
//! ```
//!
//! Within, the diagonal of the mesh's bounding box is 1. The same mesh and options give the same bytes, for any number of threads.

mod build;
mod clusters;
mod connect;
mod descent;
mod envelope;
mod exchange;
mod mesh;
mod parallel;
mod refine;
mod solid;
mod surface_samples;
mod tree;

pub use build::{BuildError, BuildOptions, BuildReport, Built, build, build_levels};
pub use mesh::TriangleMesh;
