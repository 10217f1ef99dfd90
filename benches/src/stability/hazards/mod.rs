//! The hazards, with a file for each family.

mod chains;
mod impacts;
mod life;
mod misses;
mod piles;
mod rest;
mod rooms;
mod scales;
mod seams;
mod shapes;
mod time;

use crate::stability::methods::Method;

/// A situation in which methods fail.
#[derive(Clone, Copy)]
pub struct Hazard {
    pub name: &'static str,
    /// The criterion, without the full stop at its end.
    pub criterion: &'static str,
    /// Number of seeds in a quick run and in a full one.
    pub seeds: [u64; 2],
    /// Runs the hazard. An error describes the fault.
    pub run: fn(&Method, u64) -> Result<(), String>,
}

/// All hazards.
pub fn all() -> Vec<Hazard> {
    let families = [
        impacts::HAZARDS,
        misses::HAZARDS,
        rooms::HAZARDS,
        rest::HAZARDS,
        shapes::HAZARDS,
        scales::HAZARDS,
        seams::HAZARDS,
        chains::HAZARDS,
        piles::HAZARDS,
        life::HAZARDS,
        time::HAZARDS,
    ];
    families.concat()
}

/// Returns the fault as an error if a condition does not hold.
fn ensure(holds: bool, fault: impl FnOnce() -> String) -> Result<(), String> {
    if holds { Ok(()) } else { Err(fault()) }
}
