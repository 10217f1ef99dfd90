//! Response through rapier: medial bodies are colliders with a custom shape, and rapier asks our dispatcher for their contacts.
//!
//! ```text
//! SyncBackend      attach: the collider of each loaded shape
//! -- Snapshot      poses and velocities at the start of the step
//! StepSimulation   rapier solves; the dispatcher answers from the last step's table, or computes
//! -- Detect        the step of the pipeline from start to solved poses; bodies stop at their first impact; the table for
//!                  the next step
//! -- Report        messages and diagnostics
//! Writeback
//! ```
//!
//! One pass of the pipeline serves both ends: the impacts of this step, and the contacts of the next, whose start is this end.
//! A body that is moved in between is no longer where the table knows it, and its contacts are computed on demand.

mod cast;
mod dispatcher;
mod parts;
mod shape;
mod systems;
mod table;

pub use dispatcher::MedialDispatcher;
pub use shape::MedialShape;
pub use table::ContactTable;

pub(crate) use systems::add_systems;
