//! The hazards, a file for each family.

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

use crate::stability::methods::Method;

/// A situation in which methods fail.
#[derive(Clone, Copy)]
pub struct Hazard {
    pub name: &'static str,
    /// The criterion in a sentence.
    pub criterion: &'static str,
    /// Number of seeds in a quick run and in a full one.
    pub seeds: [u64; 2],
    /// Runs it; what went wrong, if anything did.
    pub run: fn(&Method, u64) -> Result<(), String>,
}

/// All of them.
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
    ];
    families.concat()
}

/// An error unless something holds.
fn ensure(holds: bool, fault: impl FnOnce() -> String) -> Result<(), String> {
    if holds { Ok(()) } else { Err(fault()) }
}
