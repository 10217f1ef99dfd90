//! The GPU back end in an app: on which device it runs, and when it is worth it.

use std::time::Duration;

use bevy::{
    prelude::*,
    render::renderer::{RenderAdapterInfo, RenderDevice, RenderQueue},
};

use super::{
    MedialBackend, MedialSettings, MedialStep,
    choice::{Choice, LEAST_PAIRS},
    pipelined::LookAhead,
};
use crate::{
    gpu::{GpuCapacity, GpuCulling, GpuDevice, GpuError},
    pipeline::{Candidates, Statics, StepInput},
};

/// The back end, as far as it is there.
#[derive(Default)]
pub(super) struct GpuBackend {
    /// The renderer's device.
    renderer: Option<GpuDevice>,
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
    match of_renderer(&device, &queue, &info) {
        Ok(gpu) => step.gpu.renderer = Some(gpu),
        Err(error) => info!("medial meshes are culled on the CPU: {error}"),
    }
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
            MedialBackend::Auto => hardware(self.renderer.as_ref(), pairs).is_some() && self.choice.is_gpu(pairs),
        }
    }

    /// True if the GPU looks ahead, where it is wanted.
    pub fn looks_ahead(&self, settings: &MedialSettings) -> bool {
        settings.pipelined && self.look_ahead.answers.is_some()
    }

    /// Takes note of who has culled a step, and of what the step took.
    pub fn note(&mut self, backend: MedialBackend, on_gpu: bool, pairs: usize, time: Duration) {
        if backend == MedialBackend::Auto
            && let Some(gpu) = hardware(self.renderer.as_ref(), pairs)
            && let Some(line) = self.choice.note(on_gpu, pairs, time, gpu.name())
        {
            info!("{line}");
        }
    }

    /// The pairs that may meet. Whatever goes wrong is told once; the CPU takes over.
    pub fn cull(&mut self, backend: MedialBackend, input: &StepInput, statics: &Statics) -> Option<Vec<Candidates>> {
        match self.start(backend)?.cull(input, statics) {
            Ok(found) => Some(found),
            Err(error) if error.is_of_one_step() => {
                warn_once!("this step is culled on the CPU: {error}");
                None
            }
            Err(error) => {
                warn!("medial meshes are culled on the CPU from now on: {error}");
                self.state = State::Failed;
                None
            }
        }
    }

    /// The passes; made if they are not there yet.
    fn start(&mut self, backend: MedialBackend) -> Option<&mut GpuCulling> {
        if let State::Unused = self.state {
            let device = self.renderer.clone().map_or_else(GpuDevice::request, Ok);
            self.state = match device.and_then(|gpu| GpuCulling::new(&gpu, self.capacity)) {
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

    /// Time of each pass of the last answer.
    pub fn times(&self) -> &[(&'static str, Duration)] {
        match &self.look_ahead.latest {
            Some(answer) => &answer.times,
            None => self.culling().map_or(&[], GpuCulling::times),
        }
    }

    /// The passes, if they run.
    pub fn culling(&self) -> Option<&GpuCulling> {
        match &self.state {
            State::Ready(culling) => Some(culling),
            State::Unused | State::Failed => None,
        }
    }
}

/// The renderer's hardware, for scenes that are large enough; if it has none the log says so.
fn hardware(renderer: Option<&GpuDevice>, pairs: usize) -> Option<&GpuDevice> {
    if pairs < LEAST_PAIRS {
        return None;
    }
    match renderer {
        None => info_once!("medial meshes are culled on the CPU: nothing renders on a GPU"),
        Some(gpu) if gpu.is_software() => {
            info_once!("medial meshes are culled on the CPU: `{}`, which renders, is a program on it", gpu.name());
        }
        Some(gpu) => return Some(gpu),
    }
    None
}
