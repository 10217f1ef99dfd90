//! The optimiser: finds the spheres, edges and faces with the smallest error for their number.
//!
//! ```text
//! search: surface samples --clusters--> spheres --connect--> edges, faces --refine--> fitted spheres --mend--> better worst places
//! refine: merge --> exchange, rejoin --> descent, repeated until the cost hardly falls
//! judge:  a candidate --> its error, for comparison with the best one
//! ```

mod clusters;
mod connect;
mod descent;
mod exchange;
mod inscribe;
mod judge;
mod mend;
mod merge;
mod normal_equations;
mod refine;
mod rejoin;
mod search;
mod state;
mod target;

pub(super) use judge::Judge;
pub(super) use search::Search;
#[cfg(test)]
pub(super) use state::is_hurried;
pub(super) use state::is_quick;
