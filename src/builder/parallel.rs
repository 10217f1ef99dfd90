//! Parallel loops with results that do not depend on the number of cores.

use std::{cell::Cell, ops::Range};

use bevy::tasks::{ComputeTaskPool, TaskPool};

thread_local! {
    /// True while this thread runs an item of a loop. Nested loops run on the same thread.
    static WITHIN: Cell<bool> = const { Cell::new(false) };
}

/// Tasks per thread. There are several, because items take different times.
const TASKS: usize = 12;

/// Runs a function and its loops on this thread, so that the other cores are free for more urgent work.
pub(crate) fn on_this_thread<R>(function: impl FnOnce() -> R) -> R {
    /// Restores the flag, also after a panic.
    struct Outer(bool);
    impl Drop for Outer {
        fn drop(&mut self) {
            WITHIN.set(self.0);
        }
    }
    let _outer = Outer(WITHIN.replace(true));
    function()
}

/// The results of `function` for each of `0..count`, in order.
pub(super) fn map<R: Send + 'static>(
    count: usize,
    least_per_task: usize,
    function: impl Fn(usize) -> R + Sync,
) -> Vec<R> {
    flat_map(count, least_per_task, |i, results| results.push(function(i)))
}

/// The items that `function` adds to a list for each of `0..count`, in order.
pub(super) fn flat_map<R: Send + 'static>(
    count: usize,
    least_per_task: usize,
    function: impl Fn(usize, &mut Vec<R>) + Sync,
) -> Vec<R> {
    let of_range = |range: Range<usize>| {
        let mut results = Vec::with_capacity(range.len());
        range.for_each(|i| function(i, &mut results));
        results
    };
    let pool = ComputeTaskPool::get_or_init(TaskPool::default);
    let chunk = count.div_ceil(pool.thread_num().max(1) * TASKS).max(least_per_task);
    if count <= chunk || WITHIN.get() {
        return of_range(0..count);
    }
    let of_range = &of_range;
    let chunks = pool.scope(|scope| {
        for from in (0..count).step_by(chunk) {
            scope.spawn(async move { on_this_thread(|| of_range(from..count.min(from + chunk))) });
        }
    });
    let mut all = Vec::with_capacity(chunks.iter().map(Vec::len).sum());
    chunks.into_iter().for_each(|chunk| all.extend(chunk));
    all
}
