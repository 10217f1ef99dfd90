//! The hazards of the example `stability`: this crate passes them, and methods that are known to fail do fail.

#[path = "../examples/stability/hazards/mod.rs"]
mod hazards;
#[path = "../examples/stability/judge.rs"]
mod judge;
#[path = "../examples/stability/methods/mod.rs"]
mod methods;
#[path = "../examples/stability/run.rs"]
mod run;
#[path = "../examples/stability/shapes.rs"]
mod shapes;
#[path = "../examples/stability/world.rs"]
mod world;

use hazards::Hazard;
use methods::{METHODS, Method};

fn hazard(name: &str) -> Hazard {
    *hazards::all().iter().find(|hazard| hazard.name == name).unwrap()
}

fn method(name: &str) -> Method {
    *METHODS.iter().find(|method| method.name == name).unwrap()
}

#[test]
fn no_hazard_makes_this_crate_fail() {
    let hazards: Vec<Hazard> = hazards::all().into_iter().filter(|hazard| hazard.seeds[0] > 0).collect();
    let cells = run::all(&hazards, &[method("medial, CPU")], true);
    assert_eq!(cells.len(), hazards.len());
    for cell in cells {
        let seeds = hazards[cell.hazard].seeds[0] as usize;
        assert_eq!((cell.passed(), seeds), (seeds, cell.results.len()), "{}: {cell:?}", hazards[cell.hazard].name);
    }
}
