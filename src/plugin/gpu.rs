//! The GPU back end in an app: choice of the device, and of the steps that it culls.

use std::time::Duration;

use bevy::{
    prelude::*,
    render::renderer::{RenderAdapterInfo, RenderDevice, RenderQueue},
};

use super::{MedialBackend, MedialSettings, MedialStep, choice::Choice, pipelined::LookAhead};
use crate::{
    constants::LEAST_GPU_PAIRS,
    gpu::{GpuCapacity, GpuCulling, GpuDevice, GpuError},
    pipeline::{Candidates, Statics, StepInput},
};

/// State of the back end.
#[derive(Default)]
pub(super) struct GpuBackend {
    /// The renderer's device, or the reason why it cannot be used.
    renderer: Option<Result<GpuDevice, String>>,
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
    Ready(Box<GpuCulling>),
    /// It has failed and is not used again.
    Failed,
}

/// Takes the renderer's device, if there is one, and the initial capacity.
pub(super) fn adopt_renderer(
    device: Option<Res<RenderDevice>>,
    queue: Option<Res<RenderQueue>>,
    info: Option<Res<RenderAdapterInfo>>,
    capacity: Res<GpuCapacity>,
    mut step: ResMut<MedialStep>,
) {
    step.gpu.capacity = *capacity;
    let (Some(device), Some(queue), Some(info)) = (device, queue, info) else { return };
    step.gpu.renderer = Some(of_renderer(&device, &queue, &info).map_err(|error| error.to_string()));
}

/// Wraps the renderer's device.
pub(super) fn of_renderer(
    device: &RenderDevice,
    queue: &RenderQueue,
    info: &RenderAdapterInfo,
) -> Result<GpuDevice, GpuError> {
    let queue: &wgpu::Queue = queue;
    GpuDevice::new(device.wgpu_device().clone(), queue.clone(), (***info).clone())
}

impl GpuBackend {
    /// Returns true if the GPU should cull a step of `pairs` primitive pairs.
    pub fn is_wanted(&self, backend: MedialBackend, pairs: usize) -> bool {
        match backend {
            MedialBackend::Cpu => false,
            MedialBackend::Gpu => true,
            MedialBackend::Auto => self.hardware(pairs).is_some() && self.choice.is_gpu(pairs),
        }
    }

    /// Returns true if the GPU looks ahead when it is used.
    pub fn looks_ahead(&self, settings: &MedialSettings) -> bool {
        settings.pipelined && self.look_ahead.answers.is_some() && matches!(self.renderer, Some(Ok(_)))
    }

    /// Records the back end and the duration of a step.
    pub fn note(&mut self, backend: MedialBackend, on_gpu: bool, pairs: usize, time: Duration) {
        if backend == MedialBackend::Auto
            && let Some(name) = self.hardware(pairs).map(|gpu| gpu.name().to_owned())
            && let Some(line) = self.choice.note(on_gpu, pairs, time, &name)
        {
            info!("{line}");
        }
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
            }
        }
        None
    }

    /// Returns the passes, and creates them for the first step.
    fn start(&mut self, backend: MedialBackend) -> Option<&mut GpuCulling> {
        if let State::Unused = self.state {
            let device = self.renderer.clone().unwrap_or_else(|| GpuDevice::request().map_err(|e| e.to_string()));
            let passes = |gpu| GpuCulling::new(&gpu, self.capacity).map_err(|error| error.to_string());
            self.state = match device.and_then(passes) {
                Ok(culling) => {
                    info!("medial meshes can be culled on the GPU `{}` ({backend:?})", culling.device().name());
                    State::Ready(Box::new(culling))
                }
                Err(error) => {
                    warn!("medial meshes are culled on the CPU: {error}");
                    State::Failed
                }
            };
        }
        match &mut self.state {
            State::Ready(culling) => Some(culling),
            State::Unused | State::Failed => None,
        }
    }

    /// Returns the passes, if they exist.
    pub fn culling(&self) -> Option<&GpuCulling> {
        match &self.state {
            State::Ready(culling) => Some(culling),
            State::Unused | State::Failed => None,
        }
    }

    /// Returns the renderer's hardware if it can be used for a step of `pairs` primitive pairs. Otherwise the log shows the reason.
    fn hardware(&self, pairs: usize) -> Option<&GpuDevice> {
        match &self.renderer {
            // The failure has been logged.
            _ if matches!(self.state, State::Failed) => {}
            None => info_once!("medial meshes are culled on the CPU: the app has no renderer with a GPU"),
            Some(Err(error)) => info_once!("medial meshes are culled on the CPU: {error}"),
            Some(Ok(gpu)) if gpu.is_software() => {
                info_once!("medial meshes are culled on the CPU: `{}` is a software renderer", gpu.name());
            }
            Some(Ok(_)) if pairs < LEAST_GPU_PAIRS => {
                info_once!(
                    "medial meshes are culled on the CPU in steps of fewer than {LEAST_GPU_PAIRS} primitive pairs"
                );
            }
            Some(Ok(gpu)) => return Some(gpu),
        }
        None
    }
}
