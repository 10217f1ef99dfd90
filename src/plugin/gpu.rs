//! The GPU back end in an app: choice of the device, and of the steps that it culls.

use std::{
    sync::{
        Mutex,
        mpsc::{Receiver, TryRecvError, channel},
    },
    time::Duration,
};

use bevy::prelude::*;

use super::{MedialBackend, MedialSettings, choice::Choice, look_ahead::LookAhead};
use crate::{
    gpu::{GpuCapacity, GpuCulling, GpuDevice},
    pipeline::{Candidates, Statics, StepInput},
};

/// State of the back end.
#[derive(Default)]
pub(super) struct GpuBackend {
    /// The renderer's device, or the reason why it cannot be used.
    pub renderer: Option<Result<GpuDevice, String>>,
    state: State,
    /// Trials for [`MedialBackend::Auto`].
    choice: Choice,
    pub look_ahead: LookAhead,
    pub capacity: GpuCapacity,
}

#[derive(Default)]
enum State {
    /// No step has used it yet.
    #[default]
    Unused,
    /// Another thread creates the passes.
    Building(Mutex<Receiver<Result<GpuCulling, String>>>),
    Ready(Box<GpuCulling>),
    /// It has failed and is not used again.
    Failed,
}

impl GpuBackend {
    /// Returns true if the GPU should cull the next step.
    pub fn is_wanted(&self, backend: MedialBackend) -> bool {
        match backend {
            MedialBackend::Cpu => false,
            MedialBackend::Gpu => true,
            MedialBackend::Auto => self.choice.is_gpu(),
        }
    }

    /// Returns true if the GPU looks ahead when it is used. [`MedialBackend::Auto`] never waits for a renderer.
    pub fn looks_ahead(&self, settings: &MedialSettings) -> bool {
        let is_pipelined = settings.pipelined || settings.backend == MedialBackend::Auto;
        is_pipelined && self.look_ahead.answers.is_some() && matches!(self.renderer, Some(Ok(_)))
    }

    /// Returns true if the GPU should receive a prediction of the next steps.
    pub fn asks(&self, settings: &MedialSettings) -> bool {
        let is_auto = settings.backend == MedialBackend::Auto;
        self.looks_ahead(settings) && if is_auto { self.choice.looks_ahead() } else { self.is_wanted(settings.backend) }
    }

    /// Records the back end and the duration of a step of a number of bodies.
    pub fn note(&mut self, settings: &MedialSettings, on_gpu: bool, bodies: usize, time: Duration) {
        if settings.backend != MedialBackend::Auto {
            return;
        }
        let mut choice = std::mem::take(&mut self.choice);
        if let Some(line) = choice.note(on_gpu, bodies, time, || self.hardware(settings)) {
            info!("{line}");
        }
        self.choice = choice;
    }

    /// Returns the pairs that may meet, and the time of each pass. An error is logged once, and the CPU takes over.
    pub fn cull(
        &mut self,
        backend: MedialBackend,
        input: &StepInput,
        statics: &Statics,
    ) -> Option<(Vec<Candidates>, &[(&'static str, Duration)])> {
        match self.start(backend)?.cull(input, statics) {
            Ok(found) => return Some((found, self.culling()?.times())),
            Err(error) if error.is_of_one_step() => warn_once!("this step is culled on the CPU: {error}"),
            Err(error) => {
                warn!("medial meshes are culled on the CPU from now on: {error}");
                self.state = State::Failed;
                self.choice = Choice::default();
            }
        }
        None
    }

    /// Returns the passes, and creates them for the first step.
    fn start(&mut self, backend: MedialBackend) -> Option<&mut GpuCulling> {
        if let State::Unused | State::Building(_) = self.state {
            let device = self.renderer.clone().unwrap_or_else(|| GpuDevice::request().map_err(|e| e.to_string()));
            self.state = State::of(device.and_then(|gpu| passes(&gpu, self.capacity)), backend);
        }
        match &mut self.state {
            State::Ready(culling) => Some(culling),
            _ => None,
        }
    }

    /// Returns the passes, if they exist.
    pub fn culling(&self) -> Option<&GpuCulling> {
        match &self.state {
            State::Ready(culling) => Some(culling),
            _ => None,
        }
    }

    /// Returns the name of the hardware that can cull steps now. Its passes are created in the background, so it is `None` at first. If there is no such
    /// hardware, the log shows the reason once.
    fn hardware(&mut self, settings: &MedialSettings) -> Option<String> {
        match &self.renderer {
            Some(Err(error)) => {
                info_once!("medial meshes are culled on the CPU: {error}");
                return None;
            }
            Some(Ok(gpu)) if gpu.is_software() => {
                info_once!("medial meshes are culled on the CPU: `{}` is a software renderer", gpu.name());
                return None;
            }
            // The render world creates the passes when it receives the first prediction.
            Some(Ok(gpu)) if self.looks_ahead(settings) => return Some(gpu.name().into()),
            Some(Ok(_)) | None => {}
        }
        match &mut self.state {
            State::Unused => {
                let (sender, receiver) = channel();
                let (renderer, capacity) = (self.renderer.clone(), self.capacity);
                let build = move || {
                    let device =
                        renderer.unwrap_or_else(|| GpuDevice::request_hardware().map_err(|error| error.to_string()));
                    // The receiver is gone if the app has ended.
                    let _ = sender.send(device.and_then(|gpu| passes(&gpu, capacity)));
                };
                // Driver calls would block a thread of a task pool. Without threads there is no GPU, because the receiver finds the sender gone.
                let _ = std::thread::Builder::new().spawn(build);
                self.state = State::Building(Mutex::new(receiver));
            }
            State::Building(built) => {
                let built = built.get_mut().map_or(Err(TryRecvError::Disconnected), |built| built.try_recv());
                match built {
                    Ok(built) => self.state = State::of(built, MedialBackend::Auto),
                    Err(TryRecvError::Empty) => {}
                    Err(TryRecvError::Disconnected) => {
                        self.state = State::of(Err("its driver has failed".into()), MedialBackend::Auto);
                    }
                }
            }
            State::Ready(_) | State::Failed => {}
        }
        self.culling().map(|culling| culling.device().name().into())
    }
}

impl State {
    /// Logs the result of creating the passes. [`MedialBackend::Auto`] works without a GPU, so it warns of none.
    fn of(built: Result<GpuCulling, String>, backend: MedialBackend) -> Self {
        match built {
            Ok(culling) => {
                info!("medial meshes can be culled on the GPU `{}` ({backend:?})", culling.device().name());
                return State::Ready(Box::new(culling));
            }
            Err(error) if backend == MedialBackend::Auto => {
                info_once!("medial meshes are culled on the CPU: {error}");
            }
            Err(error) => warn!("medial meshes are culled on the CPU: {error}"),
        }
        State::Failed
    }
}

fn passes(gpu: &GpuDevice, capacity: GpuCapacity) -> Result<GpuCulling, String> {
    GpuCulling::new(gpu, capacity).map_err(|error| error.to_string())
}
