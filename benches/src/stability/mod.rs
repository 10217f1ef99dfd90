//! Hazards: situations in which collision methods fail. Each hazard has a physical criterion, the same for all methods.

pub mod hazards;
pub mod judge;
pub mod methods;
pub mod run;

#[cfg(all(test, feature = "peers"))]
mod tests {
    use super::{hazards, methods::METHODS, run::run_one};

    #[test]
    fn avian_loses_a_body_in_one_long_step() {
        let hazard = *hazards::all().iter().find(|hazard| hazard.name == "one step of 0.5 s").unwrap();
        let avian = METHODS.iter().find(|method| method.name == "avian").unwrap();
        let faults: Vec<String> = (0..hazard.seeds[0]).filter_map(|seed| run_one(&hazard, avian, seed).err()).collect();
        assert!(faults.iter().any(|fault| fault.starts_with("escaped")), "{faults:?}");
    }
}
