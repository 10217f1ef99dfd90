//! State of the look-ahead of the GPU in the main world.

use std::{
    sync::{Arc, Mutex, mpsc::Receiver},
    time::Duration,
};

use crate::{gpu::Prediction, pipeline::Candidates};

/// The pairs that may meet in the steps of a prediction.
pub(super) struct Answer {
    pub prediction: Arc<Prediction>,
    pub found: Vec<Candidates>,
    /// Time of each pass.
    pub times: Vec<(&'static str, Duration)>,
}

/// State in the main world.
#[derive(Default)]
pub(super) struct LookAhead {
    /// Receiver of answers, if there is a renderer.
    pub answers: Option<Mutex<Receiver<Answer>>>,
    pub latest: Option<Answer>,
    /// Prediction of the steps after the last one, for the GPU.
    pub asked: Option<Arc<Prediction>>,
}

impl LookAhead {
    /// Returns the latest answer.
    pub fn latest(&mut self) -> Option<&Answer> {
        if let Some(answers) = &self.answers
            && let Ok(answers) = answers.lock()
        {
            self.latest = answers.try_iter().last().or(self.latest.take());
        }
        self.latest.as_ref()
    }
}
