//! Loops on all cores whose results do not depend on their number.

use std::cell::Cell;

use bevy::tasks::{ComputeTaskPool, TaskPool};

thread_local! {
    /// Whether this thread runs an item of a loop: loops within loops run where they are.
    static WITHIN: Cell<bool> = const { Cell::new(false) };
}

/// Runs a function with its loops where it is, so that the other cores are free for what is in more of a hurry.
#[cfg(feature = "bevy_mesh")]
pub(crate) fn on_this_thread<R>(function: impl FnOnce() -> R) -> R {
    let outer = WITHIN.replace(true);
    let result = function();
    WITHIN.set(outer);
    result
}

/// `function` of each of `0..count`, in order.
pub(super) fn map<R: Send + 'static>(
    count: usize,
    least_per_task: usize,
    function: impl Fn(usize) -> R + Sync,
) -> Vec<R> {
    let pool = ComputeTaskPool::get_or_init(TaskPool::default);
    let chunk = count.div_ceil(pool.thread_num().max(1) * 4).max(least_per_task);
    if count <= chunk || WITHIN.get() {
        return (0..count).map(function).collect();
    }
    let function = &function;
    let chunks = pool.scope(|scope| {
        for from in (0..count).step_by(chunk) {
            scope.spawn(async move {
                let outer = WITHIN.replace(true);
                let results = (from..count.min(from + chunk)).map(function).collect::<Vec<R>>();
                WITHIN.set(outer);
                results
            });
        }
    });
    chunks.into_iter().flatten().collect()
}
