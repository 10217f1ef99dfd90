//! From triangle meshes to medial meshes: reading, checking, building and measuring.
//!
//! ```text
//! file --load--> TriangleMesh --MeshReport--> flaws of the mesh
//!                     |
//!                     +-- fit --> MedialLevels: medial meshes with their errors, finest first
//!                     |    |
//!                     |    +-- build: --solid--> checked, closed, oriented, in a tree --some searches, judge--> the best --> Built
//!                     |          search: --surface_samples--> points, normals, medial balls --clusters--> spheres
//!                     |                  --connect--> edges, faces --refine--> fitted spheres --mend--> better worst places
//!          refine: merge --> exchange, rejoin --> descent, repeated
//!                     |
//!                     +-- measure(mesh, axis) --> two-sided error of a medial mesh
//!
//! SkinnedTriangleMesh --fit_skinned: fit in the bind pose, bind each level to the joints--> MedialLevels with skins
//! ```
//!
//! Within a build, the diagonal of the mesh's bounding box is 1. The same mesh and options give the same bytes, for any number of threads.

mod bind;
mod boxes;
mod build;
mod check;
mod clean;
mod clusters;
mod connect;
mod descent;
mod envelope;
mod exchange;
mod fit;
mod folds;
mod holes;
mod hull;
mod inscribe;
mod interior;
mod judge;
mod levels;
#[cfg(feature = "mesh_files")]
pub mod load;
mod measure;
mod mend;
mod merge;
mod mesh;
#[cfg(any(feature = "gltf_scenes", feature = "mesh_files"))]
pub(crate) mod nodes;
mod normal_equations;
mod orient;
mod parallel;
mod points;
mod progress;
mod refine;
mod rejoin;
mod report;
mod samples;
mod search;
mod sides;
mod skinned;
mod solid;
mod surface_samples;
mod target;
mod tree;
mod vectors;

pub use bind::fit_skinned;
pub use build::{BuildError, BuildOptions, BuildReport, Built, DEFAULT_SEED, build, build_levels};
pub use fit::{FitOptions, fit};
pub use folds::measure_without_folds;
pub use levels::{Level, MedialFileError, MedialLevels, MedialLevelsError, SideLimits};
pub use measure::{Deviation, TwoSidedError, measure, vertex_errors};
pub use mesh::{MAX_MESH_SIZE, MeshError, TriangleMesh};
#[cfg(any(feature = "gltf_scenes", feature = "mesh_files"))]
pub use nodes::{NodeBody, NodeMark, is_named};
#[cfg(feature = "bevy_mesh")]
pub(crate) use parallel::on_this_thread;
pub use report::MeshReport;
pub use skinned::{SkinnedMeshError, SkinnedTriangleMesh};
