//! Progress reports and cancellation.

use std::{
    ops::ControlFlow,
    sync::{Mutex, PoisonError},
};

/// A callback for the completed part of the work, from 0 to 1, which may cancel the work.
pub(super) type Progress<'a> = dyn Fn(f32) -> ControlFlow<()> + Sync + 'a;

/// The progress of a task that is the part from `from` to `to` of another task.
pub(super) fn between<'a>(
    progress: &'a Progress<'a>,
    from: f32,
    to: f32,
) -> impl Fn(f32) -> ControlFlow<()> + Sync + 'a {
    move |part| progress(from + part * (to - from))
}

/// Combines the progress of several parallel tasks to that of one.
pub(super) struct Shares<'a> {
    progress: &'a Progress<'a>,
    state: Mutex<State>,
}

struct State {
    /// The completed part of each task.
    parts: Vec<f32>,
    broken: bool,
}

impl<'a> Shares<'a> {
    pub fn new(count: usize, progress: &'a Progress<'a>) -> Self {
        Self { progress, state: Mutex::new(State { parts: vec![0.0; count], broken: false }) }
    }

    /// Records the progress of one task. Breaks if the work was cancelled. Reported values never decrease, because reports are serialized by the lock.
    pub fn report(&self, piece: usize, part: f32) -> ControlFlow<()> {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        state.parts[piece] = part;
        let mean = state.parts.iter().sum::<f32>() / state.parts.len() as f32;
        state.broken = state.broken || (self.progress)(mean).is_break();
        if state.broken { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }

    /// True if the work was cancelled.
    pub fn broken(&self) -> bool {
        self.state.lock().unwrap_or_else(PoisonError::into_inner).broken
    }
}
