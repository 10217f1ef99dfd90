//! From triangle meshes to medial meshes: reading, judging and measuring.
//!
//! ```text
//! file --load--> TriangleMesh --MeshReport--> what is wrong with it
//!                     |
//!                     +-- measure(mesh, axis) --> two-sided error of a medial mesh
//! ```

mod levels;
#[cfg(feature = "mesh_files")]
pub mod load;
mod measure;
mod mesh;
mod report;
mod samples;

pub use levels::{Level, MedialFileError, MedialLevels, MedialLevelsError};
pub use measure::{Deviation, TwoSidedError, measure, vertex_errors};
pub use mesh::{MAX_MESH_SIZE, MeshError, TriangleMesh};
pub use report::MeshReport;
