//! Contacts of a pair: found, thinned out, freed from internal edges, reduced to manifolds, and kept for the next step.

pub(in crate::pipeline) mod approach;
mod cache;
mod cluster;
mod features;
pub(in crate::pipeline) mod find;
pub(in crate::pipeline) mod gap;
mod internal_edges;
mod manifold;
mod margin;
pub(in crate::pipeline) mod near;
pub(in crate::pipeline) mod near_list;
pub(in crate::pipeline) mod reduce;

pub(in crate::pipeline) use cache::EarlierPair;
pub use cache::{CachedPair, ContactCache};
pub use find::{find, manifolds};
pub use manifold::{Contact, Manifold};
pub use margin::{ContactMargin, Displacement};
