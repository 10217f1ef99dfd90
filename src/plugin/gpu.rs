//! The GPU back end in an app: on which device it runs, and when it is worth it.

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

/// The back end, as far as it is there.
#[derive(Default)]
pub(super) struct GpuBackend {
    /// The renderer's device, or why it does not do.
    renderer: Option<Result<GpuDevice, String>>,
    state: State,
    /// What [`MedialBackend::Auto`] goes by.
    choice: Choice,
    pub look_ahead: LookAhead,
    pub capacity: GpuCapacity,
}

#[derive(Default)]
enum State {
    /// Nobody has asked for it.
    #[default]
    Unused,
    Ready(Box<GpuCulling>),
    /// It has failed, and is not asked again.
    Failed,
}

/// Takes the renderer's device, if there is one, and the settings.
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

/// The renderer's device.
pub(super) fn of_renderer(
    device: &RenderDevice,
    queue: &RenderQueue,
    info: &RenderAdapterInfo,
) -> Result<GpuDevice, GpuError> {
    let queue: &wgpu::Queue = queue;
    GpuDevice::new(device.wgpu_device().clone(), queue.clone(), (***info).clone())
}

impl GpuBackend {
    /// True if the GPU is to cull a step of so many primitive pairs.
    pub fn is_wanted(&self, backend: MedialBackend, pairs: usize) -> bool {
        match backend {
            MedialBackend::Cpu => false,
            MedialBackend::Gpu => true,
            MedialBackend::Auto => self.hardware(pairs).is_some() && self.choice.is_gpu(pairs),
        }
    }

    /// True if the GPU looks ahead, where it is wanted.
    pub fn looks_ahead(&self, settings: &MedialSettings) -> bool {
        settings.pipelined && self.look_ahead.answers.is_some() && matches!(self.renderer, Some(Ok(_)))
    }

    /// Takes note of who has culled a step, and of what the step took.
    pub fn note(&mut self, backend: MedialBackend, on_gpu: bool, pairs: usize, time: Duration) {
        if backend == MedialBackend::Auto
            && let Some(name) = self.hardware(pairs).map(|gpu| gpu.name().to_owned())
            && let Some(line) = self.choice.note(on_gpu, pairs, time, &name)
        {
            info!("{line}");
        }
    }

    /// The pairs that may meet, and the time of each pass. Whatever goes wrong is told once; the CPU takes over.
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

    /// The passes; made if they are not there yet.
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

    /// The passes, if they run.
    pub fn culling(&self) -> Option<&GpuCulling> {
        match &self.state {
            State::Ready(culling) => Some(culling),
            State::Unused | State::Failed => None,
        }
    }

    /// The renderer's hardware, for steps of so many primitive pairs; if it is left out the log says why.
    fn hardware(&self, pairs: usize) -> Option<&GpuDevice> {
        match &self.renderer {
            // That has been told.
            _ if matches!(self.state, State::Failed) => {}
            None => info_once!("medial meshes are culled on the CPU: nothing renders on a GPU"),
            Some(Err(error)) => info_once!("medial meshes are culled on the CPU: {error}"),
            Some(Ok(gpu)) if gpu.is_software() => {
                info_once!("medial meshes are culled on the CPU: `{}`, which renders, is a program on it", gpu.name());
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
