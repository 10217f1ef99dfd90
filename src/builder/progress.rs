//! How far the work has come.

use std::{
    ops::ControlFlow,
    sync::{Mutex, PoisonError},
};

/// Is told the part of the work that is done, from 0 to 1, and may break it off.
pub(super) type Progress<'a> = dyn Fn(f32) -> ControlFlow<()> + Sync + 'a;

/// The progress of a piece of work that is the part of another between two parts of it.
pub(super) fn between<'a>(
    progress: &'a Progress<'a>,
    from: f32,
    to: f32,
) -> impl Fn(f32) -> ControlFlow<()> + Sync + 'a {
    move |part| progress(from + part * (to - from))
}

/// The progress of several pieces of work side by side, as that of one.
pub(super) struct Shares<'a> {
    progress: &'a Progress<'a>,
    state: Mutex<State>,
}

struct State {
    /// The part of each piece that is done.
    parts: Vec<f32>,
    broken: bool,
}

impl<'a> Shares<'a> {
    pub fn new(count: usize, progress: &'a Progress<'a>) -> Self {
        Self { progress, state: Mutex::new(State { parts: vec![0.0; count], broken: false }) }
    }

    /// Takes note of one piece's progress; breaks if any was broken off. What is told never falls, as nothing is told at the same time.
    pub fn report(&self, piece: usize, part: f32) -> ControlFlow<()> {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        state.parts[piece] = part;
        let mean = state.parts.iter().sum::<f32>() / state.parts.len() as f32;
        state.broken = state.broken || (self.progress)(mean).is_break();
        if state.broken { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }

    /// Whether the work was broken off.
    pub fn broken(&self) -> bool {
        self.state.lock().unwrap_or_else(PoisonError::into_inner).broken
    }
}
