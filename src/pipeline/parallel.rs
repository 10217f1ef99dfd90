//! Parallel work on many items. The order of the results does not depend on the number of threads.

use std::{
    sync::{LazyLock, Mutex, PoisonError},
    thread::available_parallelism,
};

use bevy::tasks::TaskPool;

/// Number of available cores. More threads than cores would only take turns.
static CORES: LazyLock<usize> = LazyLock::new(|| available_parallelism().map_or(1, Into::into));

/// A pool of scratch buffers. Each running task borrows one, and later tasks reuse it.
#[derive(Debug, Default)]
pub(crate) struct Scratches<S>(Mutex<Vec<S>>);

impl<S: Default> Scratches<S> {
    /// Returns all buffers of the pool.
    pub fn iter_mut(&mut self) -> impl Iterator<Item = &mut S> {
        self.0.get_mut().unwrap_or_else(PoisonError::into_inner).iter_mut()
    }

    fn lend<R>(&self, work: impl FnOnce(&mut S) -> R) -> R {
        let all = || self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let free = all().pop();
        let mut scratch = free.unwrap_or_default();
        let result = work(&mut scratch);
        all().push(scratch);
        result
    }
}

/// Calls `function` for every item on the pool's threads. The results are in the order of the items, for any number of threads.
pub(crate) fn gather<S: Default + Send, T: Sync, R: Send + 'static>(
    pool: &TaskPool,
    scratches: &Scratches<S>,
    items: &[T],
    least_per_task: usize,
    results: &mut Vec<R>,
    function: impl Fn(&mut S, usize, &T, &mut Vec<R>) + Sync,
) {
    let run = |first: usize, items: &[T], results: &mut Vec<R>| {
        scratches.lend(|scratch| {
            for (i, item) in (first..).zip(items) {
                function(scratch, i, item, results);
            }
        });
    };
    // The waiting thread works too. Items take different times, so there are several chunks per worker.
    let workers = (pool.thread_num() + 1).min(*CORES);
    let chunk = items.len().div_ceil(workers * 8).max(least_per_task);
    if workers == 1 || items.len() <= chunk {
        return run(0, items, results);
    }
    let run = &run;
    let chunks = pool.scope(|scope| {
        for (number, items) in items.chunks(chunk).enumerate() {
            scope.spawn(async move {
                let mut results = Vec::new();
                run(number * chunk, items, &mut results);
                results
            });
        }
    });
    results.extend(chunks.into_iter().flatten());
}

/// Changes every item on the pool's threads. The results are in the order of the items, for any number of threads.
pub(crate) fn change<T: Send, R: Send + 'static>(
    pool: &TaskPool,
    items: &mut [T],
    least_per_task: usize,
    function: impl Fn(&mut T) -> Option<R> + Sync,
) -> Vec<R> {
    let workers = (pool.thread_num() + 1).min(*CORES);
    let chunk = items.len().div_ceil(workers * 8).max(least_per_task);
    if workers == 1 || items.len() <= chunk {
        return items.iter_mut().filter_map(function).collect();
    }
    let function = &function;
    let chunks = pool.scope(|scope| {
        for items in items.chunks_mut(chunk) {
            scope.spawn(async move { items.iter_mut().filter_map(function).collect::<Vec<_>>() });
        }
    });
    chunks.into_iter().flatten().collect()
}

/// Computes one result for each item. See [`gather`].
pub(crate) fn map<S: Default + Send, T: Sync, R: Send + 'static>(
    pool: &TaskPool,
    scratches: &Scratches<S>,
    items: &[T],
    least_per_task: usize,
    results: &mut Vec<R>,
    function: impl Fn(&mut S, usize, &T) -> R + Sync,
) {
    results.clear();
    results.reserve(items.len());
    gather(pool, scratches, items, least_per_task, results, |scratch, i, item, results| {
        results.push(function(scratch, i, item));
    });
}
