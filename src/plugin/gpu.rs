//! The GPU back end in an app: on which device it runs, and when it is worth it.

use std::time::{Duration, Instant};

use bevy::{
    prelude::*,
    render::renderer::{RenderAdapterInfo, RenderDevice, RenderQueue},
};

use super::{MedialBackend, MedialSettings, MedialStep, pipelined::LookAhead};
use crate::{
    gpu::{GpuCapacity, GpuCulling, GpuDevice, GpuError},
    pipeline::{Candidates, Statics, StepInput, Times},
};

/// Primitive pairs below which the CPU is done before a GPU could answer.
const LEAST_PAIRS: usize = 1 << 18;
/// Steps after which both are compared anew.
const COMPARE_AFTER: u32 = 600;

/// The back end, as far as it is there.
#[derive(Default)]
pub(super) struct GpuBackend {
    /// The renderer's device.
    renderer: Option<GpuDevice>,
    state: State,
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

/// What [`MedialBackend::Auto`] goes by.
#[derive(Default)]
struct Choice {
    gpu_is_faster: bool,
    /// What culling took at the last comparison, and the steps since.
    compared: Option<(usize, u32)>,
    cpu: Duration,
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
    /// True if the GPU is to look ahead.
    pub fn looks_ahead(&self, settings: &MedialSettings, pairs: usize) -> bool {
        settings.pipelined
            && self.look_ahead.answers.is_some()
            && match settings.backend {
                MedialBackend::Cpu => false,
                MedialBackend::Gpu => true,
                MedialBackend::Auto => self.is_hardware() && pairs >= LEAST_PAIRS,
            }
    }

    /// True if the renderer runs on hardware.
    fn is_hardware(&self) -> bool {
        self.renderer.as_ref().is_some_and(|gpu| !gpu.is_software())
    }

    /// The pairs that may meet, if the GPU is to find them and does. Whatever goes wrong is told once; the CPU takes over.
    pub fn cull(
        &mut self,
        backend: MedialBackend,
        input: &StepInput,
        statics: &Statics,
        pairs: usize,
    ) -> Option<Vec<Candidates>> {
        let compares = match backend {
            MedialBackend::Cpu => return None,
            MedialBackend::Gpu => false,
            MedialBackend::Auto => {
                if !self.is_hardware() || pairs < LEAST_PAIRS {
                    return None;
                }
                let compares = self.choice.compares(pairs);
                if !compares && !self.choice.gpu_is_faster {
                    return None;
                }
                compares
            }
        };
        let culling = self.start(backend)?;
        let clock = Instant::now();
        match culling.cull(input, statics) {
            Ok(found) => {
                if compares {
                    let name = culling.device().name().to_owned();
                    self.choice.compare(clock.elapsed(), pairs, &name);
                }
                Some(found)
            }
            // Only this step is too large.
            Err(error @ GpuError::Limit { .. }) => {
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

    /// Notes what the CPU took to cull a step.
    pub fn note(&mut self, times: &Times) {
        self.choice.cpu = times.broad + times.mid;
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

impl Choice {
    /// True if the GPU is to be tried in this step: for the first time, a while after, or because there is far more or less to do.
    fn compares(&mut self, pairs: usize) -> bool {
        match &mut self.compared {
            Some((known, steps)) => {
                *steps += 1;
                *steps > COMPARE_AFTER || pairs > 2 * *known || 2 * pairs < *known
            }
            None => self.cpu > Duration::ZERO,
        }
    }

    fn compare(&mut self, gpu: Duration, pairs: usize, name: &str) {
        let faster = gpu < self.cpu;
        if self.compared.is_none() || faster != self.gpu_is_faster {
            let chosen = if faster { "the GPU" } else { "the CPU" };
            info!(
                "medial meshes are culled on {chosen}: {pairs} primitive pairs take {gpu:?} on `{name}`, {:?} on the CPU",
                self.cpu
            );
        }
        self.gpu_is_faster = faster;
        self.compared = Some((pairs, 0));
    }
}
