//! A build on a separate thread.

use std::{
    ops::ControlFlow,
    sync::{
        Arc, Mutex,
        atomic::{AtomicU32, Ordering},
        mpsc::{Receiver, channel},
    },
    thread,
};

use bevy::prelude::Resource;
use bevy_medial::builder::{BuildError, MedialLevels};

type Outcome = Result<MedialLevels, String>;

/// Reports the part of a build that is done, from 0 to 1, and returns whether to go on.
pub type Progress<'a> = &'a (dyn Fn(f32) -> ControlFlow<()> + Sync);

/// A running or finished build. Dropping it cancels the build.
#[derive(Resource)]
pub struct Job {
    /// The part of the build that is done, from 0 to 1, as the bits of an `f32`.
    progress: Arc<AtomicU32>,
    outcome: Mutex<Receiver<Outcome>>,
}

impl Job {
    /// Starts a build.
    pub fn start(build: impl FnOnce(Progress) -> Result<MedialLevels, BuildError> + Send + 'static) -> Self {
        let (sender, receiver) = channel();
        let progress = Arc::new(AtomicU32::new(0));
        let watched = Arc::downgrade(&progress);
        thread::spawn(move || {
            let report = |part: f32| match watched.upgrade() {
                Some(progress) => {
                    progress.store(part.to_bits(), Ordering::Relaxed);
                    ControlFlow::Continue(())
                }
                None => ControlFlow::Break(()),
            };
            // The receiver of a cancelled build is dropped.
            let _ = sender.send(build(&report).map_err(|error| error.to_string()));
        });
        Self { progress, outcome: Mutex::new(receiver) }
    }

    /// A finished build.
    pub fn done(levels: MedialLevels) -> Self {
        let (sender, receiver) = channel();
        let _ = sender.send(Ok(levels));
        Self { progress: Arc::new(AtomicU32::new(1f32.to_bits())), outcome: Mutex::new(receiver) }
    }

    /// The part that is done, from 0 to 1.
    pub fn progress(&self) -> f32 {
        f32::from_bits(self.progress.load(Ordering::Relaxed))
    }

    /// The result of the build. `None` while the build is running, and after the first call that returned the result.
    pub fn take(&self) -> Option<Outcome> {
        self.outcome.lock().ok()?.try_recv().ok()
    }

    /// Waits for the end of the build, and returns its result.
    pub fn wait(self) -> Outcome {
        let receiver = self.outcome.into_inner().map_err(|error| error.to_string())?;
        receiver.recv().map_err(|error| error.to_string())?
    }
}
