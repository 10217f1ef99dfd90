use bevy::tasks::TaskPool;

/// Applies `function` to every item on the pool's threads; results are in the items' order, whatever the number of threads.
pub(crate) fn map<T: Sync, R: Send + 'static>(
    pool: &TaskPool,
    items: &[T],
    least_per_task: usize,
    function: impl Fn(usize, &T) -> R + Sync,
) -> Vec<R> {
    // Whoever waits works as well. Items take more or less time, so there are several chunks for each.
    let workers = pool.thread_num() + 1;
    let chunk = items.len().div_ceil(workers * 8).max(least_per_task);
    if items.len() <= chunk {
        return items.iter().enumerate().map(|(i, item)| function(i, item)).collect();
    }
    let function = &function;
    let chunks = pool.scope(|scope| {
        for (number, items) in items.chunks(chunk).enumerate() {
            scope.spawn(async move {
                let apply = |(i, item)| function(number * chunk + i, item);
                items.iter().enumerate().map(apply).collect::<Vec<R>>()
            });
        }
    });
    chunks.into_iter().flatten().collect()
}
