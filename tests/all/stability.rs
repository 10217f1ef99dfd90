//! Hazards: this crate passes all of them, and other methods have their known failures.

use bevy_medial_compare::stability::{
    hazards::{self, Hazard},
    methods::{METHODS, Method},
    run,
};

fn hazard(name: &str) -> Hazard {
    *hazards::all().iter().find(|hazard| hazard.name == name).unwrap()
}

fn method(name: &str) -> Method {
    *METHODS.iter().find(|method| method.name == name).unwrap()
}

#[test]
fn this_crate_passes_every_hazard() {
    let mut hazards = hazards::all();
    hazards.retain(|hazard| hazard.seeds[0] > 0);
    assert!(hazards.len() > 30, "{}", hazards.len());
    let cells = run::all(&hazards, &[method("medial, CPU")], true);
    assert_eq!(cells.len(), hazards.len());
    for cell in cells {
        let hazard = &hazards[cell.hazard];
        assert_eq!(cell.results.len() as u64, hazard.seeds[0]);
        assert_eq!(cell.passed(), cell.results.len(), "{}: {:?}", hazard.name, cell.results);
    }
}

#[test]
fn methods_with_known_weaknesses_fail() {
    for (hazard_name, method_name, fault) in [
        ("thin wall, 100 m/s", "rapier, triangles", "through"),
        ("body at rest, 100 m/s", "rapier", "through"),
        ("two bullets, 1000 m/s", "rapier", "through"),
        ("two bullets, 1000 m/s", "rapier, Ccd", "through"),
        ("near miss, 100 m/s", "rapier, soft CCD", "ghost"),
        ("chain under load", "rapier, triangles", "unlinked"),
        ("stack of ten boxes", "rapier, triangles", "falls"),
        ("rolling keeps time", "rapier, triangles", "time"),
    ] {
        let hazard = hazard(hazard_name);
        let results = (0..hazard.seeds[0]).map(|seed| run::run_one(&hazard, &method(method_name), seed));
        let faults: Vec<String> = results.filter_map(Result::err).collect();
        assert!(faults.iter().any(|found| found.starts_with(fault)), "{hazard_name}, {method_name}: {faults:?}");
    }
}

#[test]
fn a_panic_is_reported_as_a_fault() {
    let hazard = Hazard { name: "panic", criterion: "", seeds: [1, 1], run: |_, _| panic!("out of range") };
    let result = run::run_one(&hazard, &method("rapier"), 0);
    assert_eq!(result, Err("panicked: out of range".into()));
}
