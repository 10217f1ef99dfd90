//! The GPU back end in the render world. It looks some steps ahead, so that no step waits for it.
//!
//! | place | action |
//! |---|---|
//! | main world, after a step | predicts the next steps for undisturbed bodies |
//! | `ExtractSchedule` | copies the prediction to the render world |
//! | `RenderSystems::PrepareResources` | takes earlier answers, uploads poses |
//! | `RenderGraph` | runs the passes of [`GpuCulling`] |
//! | `RenderSystems::Cleanup` | requests the answer |
//! | main world, two or three steps later | takes the pairs of that step from the latest answer |

use std::{
    collections::HashMap,
    sync::{
        Arc, Mutex,
        mpsc::{Receiver, Sender, channel},
    },
};

use bevy::{
    prelude::*,
    render::{
        Extract, ExtractSchedule, Render, RenderApp, RenderStartup, RenderSystems,
        render_resource::{
            CachedComputePipelineId, CachedPipelineState, ComputePipelineDescriptor, Pipeline, PipelineCache,
        },
        renderer::{
            FlushCommands, RenderAdapterInfo, RenderContext, RenderDevice, RenderGraph, RenderGraphSystems, RenderQueue,
        },
    },
    shader::ShaderCacheError,
};

use super::{MedialStep, look_ahead::Answer};
use crate::{
    gpu::{
        Batch, GpuCapacity, GpuCulling, GpuDevice, GpuError, Pass, Passes, Prediction, copy_when_mapped, entry_point,
        shaders,
    },
    pipeline::KinematicReach,
};

/// State of the back end in the render world.
#[derive(Resource)]
struct RenderCulling {
    /// Shader of each entry point.
    shaders: Vec<(&'static str, Handle<Shader>)>,
    state: State,
    capacity: GpuCapacity,
    asked: Option<Arc<Prediction>>,
    /// The prediction that is uploaded but not recorded yet.
    uploaded: Option<Arc<Prediction>>,
    recorded: Option<(Arc<Prediction>, Batch)>,
    mapped: (Sender<Mapped>, Mutex<Receiver<Mapped>>),
    answers: Sender<Answer>,
}

/// A batch and its data, or none if the device was lost.
type Mapped = (Arc<Prediction>, Batch, Option<Vec<u8>>);

enum State {
    Unused,
    /// The cache creates the pipelines of the entry points.
    Waiting(HashMap<&'static str, CachedComputePipelineId>),
    Ready(Box<GpuCulling>),
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
fn of_renderer(device: &RenderDevice, queue: &RenderQueue, info: &RenderAdapterInfo) -> Result<GpuDevice, GpuError> {
    let queue: &wgpu::Queue = queue;
    GpuDevice::new(device.wgpu_device().clone(), queue.clone(), (***info).clone())
}

/// Adds the back end to the render world, if there is one.
pub(super) fn add(app: &mut App) {
    if app.get_sub_app(RenderApp).is_none() {
        return;
    }
    let mut assets = app.world_mut().resource_mut::<Assets<Shader>>();
    let mut add = |label, text| assets.add(Shader::from_wgsl(text, format!("bevy_medial/{label}.wgsl")));
    let shaders = shaders().map(|(label, text)| (label, add(label, text))).collect();
    let Some(render_app) = app.get_sub_app_mut(RenderApp) else { return };
    let (answers, receiver) = channel();
    let (mapped, arrived) = channel();
    render_app
        .insert_resource(RenderCulling {
            shaders,
            state: State::Unused,
            capacity: GpuCapacity::default(),
            asked: None,
            uploaded: None,
            recorded: None,
            mapped: (mapped, Mutex::new(arrived)),
            answers,
        })
        .add_systems(RenderStartup, forget)
        .add_systems(ExtractSchedule, extract)
        .add_systems(Render, upload.in_set(RenderSystems::PrepareResources))
        .add_systems(RenderGraph, record.in_set(RenderGraphSystems::Render))
        // No other system does so without the core pipeline.
        .add_systems(RenderGraph, (|mut commands: FlushCommands| commands.flush()).in_set(RenderGraphSystems::Submit))
        .add_systems(Render, read_back.in_set(RenderSystems::Cleanup));
    app.world_mut().resource_mut::<MedialStep>().gpu.look_ahead.answers = Some(Mutex::new(receiver));
}

/// Resets the state, when the renderer starts or has recovered from a lost device.
fn forget(mut culling: ResMut<RenderCulling>) {
    culling.state = State::Unused;
    (culling.uploaded, culling.recorded) = (None, None);
    culling.mapped.1.lock().iter().for_each(|mapped| mapped.try_iter().for_each(drop));
}

fn extract(step: Extract<Res<MedialStep>>, mut culling: ResMut<RenderCulling>) {
    culling.asked.clone_from(&step.gpu.look_ahead.asked);
    culling.capacity = step.gpu.capacity;
}

fn upload(
    mut culling: ResMut<RenderCulling>,
    device: Res<RenderDevice>,
    queue: Res<RenderQueue>,
    info: Res<RenderAdapterInfo>,
    cache: Res<PipelineCache>,
    mut last: Local<u64>,
) {
    let culling = &mut *culling;
    let asked = culling.asked.take().filter(|asked| asked.after() != std::mem::replace(&mut *last, asked.after()));
    if asked.is_some() {
        let gpu = || of_renderer(&device, &queue, &info);
        let capacity = culling.capacity;
        let state = std::mem::replace(&mut culling.state, State::Failed);
        match prepare(state, &culling.shaders, &cache, |passes| GpuCulling::with_passes(&gpu()?, passes, capacity)) {
            Ok(state) => culling.state = state,
            Err(error) => warn!("medial meshes are culled on the CPU: {error}"),
        }
    }
    match culling.take_and_upload(asked) {
        Ok(()) => {}
        Err(error) if error.is_of_one_step() => warn_once!("steps are culled on the CPU: {error}"),
        Err(error) => {
            warn!("medial meshes are culled on the CPU from now on: {error}");
            culling.state = State::Failed;
        }
    }
}

impl RenderCulling {
    /// Sends received answers, and uploads the next prediction.
    fn take_and_upload(&mut self, asked: Option<Arc<Prediction>>) -> Result<(), GpuError> {
        let State::Ready(passes) = &mut self.state else { return Ok(()) };
        // This runs the callbacks of finished work. After the loss of the device they receive none.
        passes.device().poll(wgpu::PollType::Poll)?;
        let arrived: Vec<Mapped> =
            self.mapped.1.lock().map_or_else(|_| Vec::new(), |mapped| mapped.try_iter().collect());
        for (prediction, batch, data) in arrived {
            let data = data.ok_or_else(|| passes.device().lost())?;
            if let Some(found) = passes.take(batch, &data) {
                // The receiver is gone if the app is shutting down.
                let _ = self.answers.send(Answer { prediction, found, times: passes.times().to_vec() });
            }
        }
        if let Some(asked) = asked {
            let widening = KinematicReach::new(&asked.input);
            passes.upload(&asked.input, &asked.statics, &widening, |body| asked.slack(body))?;
            self.uploaded = Some(asked);
        }
        Ok(())
    }
}

/// Advances the state towards passes that can run.
fn prepare(
    state: State,
    shaders: &[(&'static str, Handle<Shader>)],
    cache: &PipelineCache,
    culling: impl FnOnce(Passes) -> Result<GpuCulling, GpuError>,
) -> Result<State, Box<dyn std::error::Error>> {
    let queue = |(label, shader): &(&'static str, Handle<Shader>)| {
        let descriptor = ComputePipelineDescriptor {
            label: Some((*label).into()),
            shader: shader.clone(),
            entry_point: Some(entry_point(label).into()),
            ..default()
        };
        (*label, cache.queue_compute_pipeline(descriptor))
    };
    let pipelines = match state {
        State::Unused => return Ok(State::Waiting(shaders.iter().map(queue).collect())),
        State::Waiting(pipelines) => pipelines,
        State::Ready(_) | State::Failed => return Ok(state),
    };
    let passes = Passes::each(|label| match cache.get_compute_pipeline_state(pipelines[label]) {
        CachedPipelineState::Ok(Pipeline::ComputePipeline(pipeline)) => Ok(Pass::of(label, (**pipeline).clone())),
        // The shader is being loaded.
        CachedPipelineState::Err(
            ShaderCacheError::ShaderNotLoaded(_) | ShaderCacheError::ShaderImportNotYetAvailable,
        ) => Err(None),
        CachedPipelineState::Err(error) => Err(Some(format!("the pass `{label}` is refused: {error}"))),
        _ => Err(None),
    });
    match passes {
        Ok(passes) => Ok(State::Ready(Box::new(culling(passes)?))),
        Err(None) => Ok(State::Waiting(pipelines)),
        Err(Some(error)) => Err(error.into()),
    }
}

fn record(mut culling: ResMut<RenderCulling>, mut context: RenderContext) {
    let culling = &mut *culling;
    let (State::Ready(passes), Some(prediction)) = (&mut culling.state, culling.uploaded.take()) else { return };
    match passes.encode(context.command_encoder()) {
        Ok(batch) => culling.recorded = Some((prediction, batch)),
        Err(error) => warn_once!("steps are culled on the CPU: {error}"),
    }
}

/// Requests the results. The passes have been submitted before.
fn read_back(mut culling: ResMut<RenderCulling>) {
    let Some((prediction, batch)) = culling.recorded.take() else { return };
    let sender = culling.mapped.0.clone();
    let staging = batch.staging.clone();
    copy_when_mapped(&staging, batch.bytes, move |data| {
        // The receiver is gone if the render world is.
        let _ = sender.send((prediction, batch, data));
    });
}
