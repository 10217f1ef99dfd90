//! Fast impacts and near misses on the CPU.

use std::ops::Range;

use bevy_medial::scenes::headless_app;

use crate::flights::{Aim, Cell, SPEEDS, check, run_hits, run_misses, shapes};

#[test]
fn bullets_hit_as_in_fine_steps_and_near_misses_do_not_stop() {
    check_bullets(0..6);
}

#[test]
#[ignore = "exhaustive"]
fn exhaustive_bullets_hit_as_in_fine_steps_and_near_misses_do_not_stop() {
    check_bullets(0..12);
}

fn check_bullets(cells: Range<usize>) {
    let [close, compared] = check(headless_app, cells);
    assert!(close * 10 >= compared * 9, "{close} of {compared}");
}

/// After the hit, the rods turn once per step and slide along each other.
#[test]
fn rods_that_turn_once_per_step_hit_as_in_fine_steps() {
    let (_, shape) = shapes().swap_remove(0);
    let hits = run_hits(&Cell { shape, aim: Aim::Resting, speed: 50.0, spin: 0.0, app: headless_app }, 1, 20, true);
    assert!(hits.lost == 0 && hits.gains == 0 && 5 * hits.within(0.25) >= 4 * hits.ratios.len(), "{hits:?}");
    assert!(hits.ratios.len() > 15, "{hits:?}");
}

#[test]
fn without_stops_all_bullets_are_lost() {
    let (_, shape) = shapes().swap_remove(0);
    let cell = Cell { shape, aim: Aim::HeadOn, speed: 300.0, spin: 0.0, app: headless_app };
    let hits = run_hits(&cell, 1, 20, false);
    assert!(hits.lost == hits.count && hits.ratios.len() > 10, "{hits:?}");
}

/// Every cell, as a table: `cargo test --release --test all bullets_table -- --ignored --nocapture`.
#[test]
#[ignore = "takes a quarter of an hour"]
fn bullets_table() {
    println!(
        "                            hits                        transfer          momentum energy behind   misses"
    );
    println!(
        "shape    aim      m/s rad/s lost grazes chaos of  median in25% min   max     error  gains   wall ghosts of"
    );
    let (mut close, mut lost, mut all) = (0, 0, Vec::new());
    let mut faults = Vec::new();
    for (name, shape) in shapes() {
        for aim in [Aim::Wall, Aim::Resting, Aim::HeadOn] {
            for (speed, spin) in SPEEDS.into_iter().flat_map(|speed| [(speed, 0.0), (speed, 100.0)]) {
                let cell = Cell { shape: shape.clone(), aim, speed, spin, app: headless_app };
                let hits = run_hits(&cell, 1, 20, true);
                let misses = [1, 2].map(|seed| run_misses(&cell, seed, 20));
                let ghosts = misses[0][1] + misses[1][1];
                let ratios = &hits.ratios;
                println!(
                    "{name:8} {:8} {speed:4} {spin:4} {:4} {:6} {:5} {:4}  {:.3} {:5} % {:.2} {:.2}   {:.0e} {:5} {:5} {ghosts:5} {:5}",
                    format!("{aim:?}"),
                    hits.lost,
                    hits.grazes,
                    hits.chaotic,
                    hits.count,
                    hits.median(),
                    hits.within(0.25) * 100 / ratios.len(),
                    ratios[0],
                    ratios[ratios.len() - 1],
                    hits.momentum_error,
                    hits.gains,
                    hits.behind,
                    misses[0][0] + misses[1][0],
                );
                lost += hits.lost;
                if [hits.gains, hits.behind, ghosts] != [0; 3] || hits.momentum_error > 0.01 {
                    faults.push(format!("{name} {aim:?} at {speed} m/s, {spin} rad/s"));
                }
                close += hits.within(0.25);
                all.extend(hits.ratios);
            }
        }
    }
    all.sort_by(f64::total_cmp);
    let median = all[all.len() / 2];
    println!("of {} transfers {close} within 25 %, median {median:.3}", all.len());
    assert!(faults.is_empty(), "{faults:#?}");
    assert!(1000 * lost <= all.len(), "{lost} hits are lost");
    assert!(close * 10 >= all.len() * 9 && (median - 1.0).abs() < 0.1);
}
