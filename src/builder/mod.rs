//! From triangle meshes to medial meshes: reading, checking, building and measuring.
//!
//! ```text
//! file --load--> TriangleMesh --MeshReport--> flaws of the mesh
//!                     |
//!                     +-- fit --> MedialLevels: medial meshes with their errors, finest first
//!                     |    |
//!                     |    +-- build: --solid--> checked, closed, oriented, in a tree --some searches, judge--> the best --> Built
//!                     |          a search is in optimise/
//!                     |
//!                     +-- measure(mesh, axis) --> two-sided error of a medial mesh
//!
//! SkinnedTriangleMesh --fit_skinned: fit in the bind pose, bind each level to the joints--> MedialLevels with skins
//! ```
//!
//! Within a build, the diagonal of the mesh's bounding box is 1. The same mesh and options give the same bytes, for any number of threads.

mod bind;
mod build;
mod check;
mod clean;
mod convex;
mod envelope;
mod fit;
mod folds;
mod holes;
mod hull;
mod interior;
mod levels;
#[cfg(feature = "mesh_files")]
pub mod load;
mod measure;
mod mesh;
#[cfg(any(feature = "gltf_scenes", feature = "mesh_files"))]
pub(crate) mod nodes;
mod optimise;
mod options;
mod orient;
mod parallel;
mod points;
mod progress;
mod report;
mod roof;
mod samples;
mod sides;
mod skinned;
mod solid;
mod surface_samples;
mod tree;
mod vectors;

pub use bind::fit_skinned;
pub use build::{build, build_levels};
pub use fit::{FitOptions, fit};
pub use folds::measure_without_folds;
pub use levels::{Level, MedialFileError, MedialLevels, MedialLevelsError, SideLimits};
pub use measure::{Deviation, TwoSidedError, measure, vertex_errors};
pub use mesh::{MAX_MESH_SIZE, MeshError, TriangleMesh};
#[cfg(any(feature = "gltf_scenes", feature = "mesh_files"))]
pub use nodes::{NodeBody, NodeMark, is_named};
pub use options::{BuildError, BuildOptions, BuildReport, Built, DEFAULT_SEED};
#[cfg(any(feature = "asset_processor", feature = "bevy_mesh"))]
pub(crate) use parallel::on_this_thread;
pub use report::MeshReport;
pub use skinned::{SkinnedMeshError, SkinnedTriangleMesh};
