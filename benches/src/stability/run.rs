//! Runs every hazard with every method.

use std::{
    any::Any,
    panic::{AssertUnwindSafe, catch_unwind},
    sync::{Mutex, PoisonError},
    thread,
};

use indicatif::{ProgressBar, ProgressStyle};

use super::{hazards::Hazard, methods::Method};

/// The results of a hazard with a method, both by index, one result per seed.
#[derive(Clone, Debug)]
pub struct Cell {
    pub hazard: usize,
    pub method: usize,
    /// In the order of the seeds, from 0 on. An error describes a fault.
    pub results: Vec<Result<(), String>>,
}

impl Cell {
    /// Number of seeds that passed.
    pub fn passed(&self) -> usize {
        self.results.iter().filter(|result| result.is_ok()).count()
    }
}

/// Runs all hazards with all methods, on all cores. Methods that need an adapter share the main thread, which their renderers expect. They run one
/// seed, because their results have the same bits as on the CPU.
pub fn all(hazards: &[Hazard], methods: &[Method], quick: bool) -> Vec<Cell> {
    let cells = (0..hazards.len()).flat_map(|hazard| (0..methods.len()).map(move |method| [hazard, method]));
    let (mut graphic, plain): (Vec<_>, Vec<_>) = cells.partition(|[_, method]| methods[*method].needs_adapter);
    let seeds = |[hazard, method]: [usize; 2]| {
        let all = hazards[hazard].seeds[usize::from(!quick)];
        if methods[method].needs_adapter { all.min(1) } else { all }
    };
    let total = graphic.iter().chain(&plain).map(|cell| seeds(*cell)).sum();
    let progress = ProgressBar::new(total);
    if let Ok(style) = ProgressStyle::with_template("{elapsed} {wide_bar} {pos}/{len} {msg}") {
        progress.set_style(style);
    }
    let (plain, done) = (Mutex::new(plain), Mutex::new(Vec::new()));
    let run = |[hazard, method]: [usize; 2]| {
        progress.set_message(format!("{}: {}", hazards[hazard].name, methods[method].name));
        let results = (0..seeds([hazard, method])).map(|seed| {
            let result = run_one(&hazards[hazard], &methods[method], seed);
            progress.inc(1);
            result
        });
        let cell = Cell { hazard, method, results: results.collect() };
        done.lock().unwrap_or_else(PoisonError::into_inner).push(cell);
    };
    let next = || plain.lock().unwrap_or_else(PoisonError::into_inner).pop();
    let work = || {
        while let Some(cell) = next() {
            run(cell);
        }
    };
    let others = thread::available_parallelism().map_or(1, usize::from).saturating_sub(1).max(1);
    thread::scope(|scope| {
        for _ in 0..others {
            scope.spawn(work);
        }
        while let Some(cell) = graphic.pop() {
            run(cell);
        }
        work();
    });
    progress.finish_and_clear();
    let mut done = done.into_inner().unwrap_or_else(PoisonError::into_inner);
    done.sort_by_key(|cell| (cell.hazard, cell.method));
    done
}

/// Runs a hazard with a method and a seed. A panic is a fault.
pub fn run_one(hazard: &Hazard, method: &Method, seed: u64) -> Result<(), String> {
    catch_unwind(AssertUnwindSafe(|| (hazard.run)(method, seed)))
        .unwrap_or_else(|panic| Err(format!("panicked: {}", message(panic.as_ref()))))
}

fn message(panic: &(dyn Any + Send)) -> &str {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("without a message")
}
