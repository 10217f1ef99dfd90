#[cfg(feature = "gpu")]
use std::sync::Arc;
use std::{mem, time::Duration};

#[cfg(feature = "gpu")]
use bevy::platform::time::Instant;
use bevy::{prelude::*, tasks::ComputeTaskPool};
#[cfg(feature = "rapier")]
use bevy_rapier3d::rapier::geometry::ColliderHandle;

#[cfg(feature = "gpu")]
use super::{gpu::GpuBackend, pipelined::Answer};
#[cfg(feature = "gpu")]
use crate::gpu::Prediction;
use crate::{
    constants::CORE_DEPTH,
    geometry::Pose3,
    pipeline::{
        Candidates, Culling, Meeting, Pair, Side, Solid, Statics, StepInput, StepOutput, Workspace, relative_pose,
    },
};

/// Where the pairs that may meet are found. What they do to each other is found on the CPU always, so results are the same.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Reflect)]
#[cfg_attr(feature = "serialize", derive(serde::Serialize, serde::Deserialize), reflect(Serialize, Deserialize))]
#[reflect(Default, Clone, PartialEq)]
pub enum MedialBackend {
    /// Whichever is faster, by trial: the CPU in small scenes, without the feature `gpu`, and where no hardware renders.
    #[default]
    Auto,
    /// The CPU.
    Cpu,
    /// The GPU, even if it is a program on the CPU: that of the renderer, or else the fastest. Without one the CPU, after a warning.
    Gpu,
}

/// What holds for all medial bodies.
#[derive(Resource, Clone, Copy, Debug, PartialEq, Reflect)]
#[cfg_attr(feature = "serialize", derive(serde::Serialize, serde::Deserialize), reflect(Serialize, Deserialize))]
#[reflect(Resource, Default, Clone, PartialEq)]
pub struct MedialSettings {
    /// Bodies stop at their first impact within a step. Without the feature `rapier` none does. Default: true.
    pub stop_at_impact: bool,
    /// Skip all culling and test every primitive pair, on the CPU, to measure what culling gains. Default: false.
    pub brute_force: bool,
    /// How much smaller the core of a body is than the body itself, in bounding radii. A body stops within a step only where its core touches another one: this
    /// is the deepest overlap that one step can add, per body. Smaller values are more exact; with larger ones fewer bodies stop. Thin primitives have
    /// thinner cores: at most 30 % of a radius counts. Default: 0.0075.
    pub core_depth: f32,
    /// Where the pairs that may meet are found. Default: [`MedialBackend::Auto`].
    pub backend: MedialBackend,
    /// Where the renderer's GPU finds the pairs, nobody waits for it: it looks some steps ahead, and what has left its way until it answers is culled
    /// on the CPU. Default: false.
    pub pipelined: bool,
}

impl Default for MedialSettings {
    fn default() -> Self {
        Self {
            stop_at_impact: true,
            core_depth: CORE_DEPTH,
            brute_force: false,
            backend: MedialBackend::Auto,
            pipelined: false,
        }
    }
}

/// Who a dense index of the pipeline is.
#[derive(Clone, Copy, Debug)]
pub struct BodyInfo {
    /// The entity.
    pub entity: Entity,
    /// Its collider.
    #[cfg(feature = "rapier")]
    pub collider: ColliderHandle,
    /// True if it has no response.
    pub sensor: bool,
    /// True if it sleeps.
    pub asleep: bool,
    /// Centre of mass at the start of the step, in the world.
    pub center: Vec3,
    /// Velocity of the centre of mass before the step, in metres per second.
    pub linear: Vec3,
    /// Angular velocity before the step, in radians per second.
    pub angular: Vec3,
}

impl BodyInfo {
    /// An entity that does not move.
    pub(crate) fn at_rest(entity: Entity) -> Self {
        Self {
            entity,
            #[cfg(feature = "rapier")]
            collider: ColliderHandle::invalid(),
            sensor: false,
            asleep: false,
            center: Vec3::ZERO,
            linear: Vec3::ZERO,
            angular: Vec3::ZERO,
        }
    }

    /// Tells it from others of all steps.
    #[cfg(feature = "gpu")]
    fn key(&self) -> u64 {
        self.entity.to_bits()
    }

    /// Velocity of a point of the body, before the step.
    pub fn velocity_at(&self, point: Vec3) -> Vec3 {
        self.linear + self.angular.cross(point - self.center)
    }
}

/// Input and output of the last step, and who the indices in them are.
///
/// Reflection shows what is told of the step as a whole.
#[derive(Resource, Default, Reflect)]
#[reflect(Resource, Default)]
pub struct MedialStep {
    /// A copy of the settings.
    pub(crate) settings: MedialSettings,
    /// Poses, shapes, motions.
    #[reflect(ignore)]
    pub input: StepInput,
    /// Static bodies.
    #[reflect(ignore)]
    pub statics: Statics,
    /// Pairs, contacts, impacts, counts and times.
    #[reflect(ignore)]
    pub output: StepOutput,
    #[reflect(ignore)]
    workspace: Workspace,
    /// Number of the step. What the GPU looks ahead for counts by it, so a saved one must not come back.
    #[reflect(ignore)]
    pub(super) number: u64,
    /// Entity and velocities of each body.
    #[reflect(ignore)]
    pub infos: Vec<BodyInfo>,
    /// Entity of each static.
    #[reflect(ignore)]
    pub static_infos: Vec<BodyInfo>,
    /// The rapier context of each world.
    #[cfg(feature = "rapier")]
    #[reflect(ignore)]
    pub(crate) worlds: Vec<Entity>,
    /// Length of the step in seconds; of several worlds that of the first.
    pub dt: f32,
    /// Time that it took to note where bodies were before rapier's step, and to gather the input after it.
    #[cfg(feature = "rapier")]
    pub snapshot_time: Duration,
    /// Time that it took to move bodies to where they stop, and to hand the manifolds to rapier.
    #[cfg(feature = "rapier")]
    pub table_time: Duration,
    #[cfg(feature = "gpu")]
    #[reflect(ignore)]
    pub(super) gpu: GpuBackend,
    /// By how many steps the answer of the GPU was late that the last step went by, 0 if it was waited for; none if the CPU has culled the step.
    #[cfg(feature = "gpu")]
    pub gpu_latency: Option<u32>,
    /// Bodies that have been culled on the CPU then, as they were not where the GPU had expected them.
    #[cfg(feature = "gpu")]
    pub gpu_departed: usize,
    /// Time of each pass of that answer.
    #[cfg(feature = "gpu")]
    #[reflect(ignore)]
    gpu_times: Vec<(&'static str, Duration)>,
}

impl MedialStep {
    /// Who a side of a pair is.
    pub fn info(&self, side: Side) -> &BodyInfo {
        match side {
            Side::Body(body) => &self.infos[body as usize],
            Side::Static(body) => &self.static_infos[body as usize],
        }
    }

    /// What a side of a pair is made of.
    pub fn solid(&self, side: Side) -> &Solid {
        match side {
            Side::Body(body) => &self.input.bodies[body as usize].solid,
            Side::Static(body) => &self.statics.bodies()[body as usize].solid,
        }
    }

    /// The rapier context that a side of a pair is in.
    #[cfg(feature = "rapier")]
    pub fn context(&self, side: Side) -> Entity {
        let world = match side {
            Side::Body(body) => self.input.bodies[body as usize].world,
            Side::Static(body) => self.statics.bodies()[body as usize].world,
        };
        self.worlds[world as usize]
    }

    /// Where a side of a pair is at the end of the step.
    pub fn final_pose(&self, side: Side) -> Pose3 {
        match side {
            Side::Body(body) => {
                self.output.stop_of(body).map_or(self.input.bodies[body as usize].sweep.end, |stop| stop.pose)
            }
            Side::Static(body) => self.statics.bodies()[body as usize].pose,
        }
    }

    /// Pose of the second side of a pair in the frame of the first at the end of the step, where its manifolds are.
    pub fn final_pose12(&self, pair: &Pair) -> Pose3 {
        relative_pose([pair.first, pair.second].map(|side| {
            let order = match side {
                Side::Body(body) => self.input.bodies[body as usize].order,
                Side::Static(body) => self.statics.bodies()[body as usize].order,
            };
            (self.final_pose(side), order)
        }))
    }

    /// Runs the pipeline. The filter is asked about each pair that may collide.
    pub(crate) fn run(&mut self, filter: impl Fn(&Self, Side, Side) -> Meeting) {
        self.input.culling = if self.settings.brute_force { Culling::None } else { Culling::Hybrid };
        self.input.stop_at_impact = self.settings.stop_at_impact;
        let pool = ComputeTaskPool::get_or_init(Default::default);
        self.number += 1;
        let culled = self.cull();
        #[cfg(feature = "gpu")]
        let on_gpu = culled.is_some();
        let (mut workspace, mut output) = (mem::take(&mut self.workspace), mem::take(&mut self.output));
        let filter = |first, second| filter(self, first, second);
        let (input, statics) = (&self.input, &self.statics);
        match culled {
            Some((candidates, time)) => {
                workspace.step_from_candidates(input, statics, candidates, filter, pool, &mut output);
                output.times.broad += time;
            }
            None => workspace.step(input, statics, filter, pool, &mut output),
        }
        (self.workspace, self.output) = (workspace, output);
        #[cfg(feature = "gpu")]
        {
            let pairs = self.output.counts.primitive_pairs;
            if self.input.culling == Culling::None {
                self.gpu.look_ahead.asked = None;
            } else {
                let clock = Instant::now();
                self.look_ahead(pairs);
                self.output.times.broad += clock.elapsed();
                self.gpu.note(self.settings.backend, on_gpu, pairs, self.output.times.total());
            }
        }
    }

    /// What the GPU has found, if it was asked, and how long it took.
    #[cfg(feature = "gpu")]
    fn cull(&mut self) -> Option<(Vec<Candidates>, Duration)> {
        (self.gpu_latency, self.gpu_departed) = (None, 0);
        self.gpu_times.clear();
        // As many as in the step before.
        let pairs = self.output.counts.primitive_pairs;
        if self.input.culling == Culling::None || !self.gpu.is_wanted(self.settings.backend, pairs) {
            return None;
        }
        let clock = Instant::now();
        let candidates = if self.gpu.looks_ahead(&self.settings) { self.look_up() } else { self.wait() }?;
        Some((candidates, clock.elapsed()))
    }

    /// The pairs of this step, which the GPU finds meanwhile.
    #[cfg(feature = "gpu")]
    fn wait(&mut self) -> Option<Vec<Candidates>> {
        let (candidates, times) = self.gpu.cull(self.settings.backend, &self.input, &self.statics)?;
        self.gpu_latency = Some(0);
        self.gpu_times.extend_from_slice(times);
        Some(candidates)
    }

    /// The pairs of this step, by what the GPU has found by looking ahead.
    #[cfg(feature = "gpu")]
    fn look_up(&mut self) -> Option<Vec<Candidates>> {
        let pool = ComputeTaskPool::get_or_init(Default::default);
        let keys = self.infos.iter().map(BodyInfo::key);
        let Answer { prediction, found, times } = self.gpu.look_ahead.latest()?;
        let (candidates, departed) =
            prediction.candidates(found, &self.input, &self.statics, keys, self.number, pool)?;
        self.gpu_latency = Some((self.number - prediction.after()) as u32);
        self.gpu_departed = departed;
        self.gpu_times.extend_from_slice(times);
        Some(candidates)
    }

    /// Asks the GPU to look at the next steps.
    #[cfg(feature = "gpu")]
    fn look_ahead(&mut self, pairs: usize) {
        let asks = self.gpu.looks_ahead(&self.settings) && self.gpu.is_wanted(self.settings.backend, pairs);
        self.gpu.look_ahead.asked = asks.then(|| {
            let keys = self.infos.iter().map(BodyInfo::key);
            let end_of = |body| self.final_pose(Side::Body(body));
            Arc::new(Prediction::new(&self.input, &self.statics, keys, end_of, self.number))
        });
    }

    #[cfg(not(feature = "gpu"))]
    fn cull(&mut self) -> Option<(Vec<Candidates>, Duration)> {
        if self.settings.backend == MedialBackend::Gpu {
            warn_once!("medial meshes are culled on the CPU: bevy_medial is built without the feature `gpu`");
        }
        None
    }

    /// Time of each pass on the GPU of the answer that the last step went by; none if the CPU has culled it, or the device cannot tell.
    #[cfg(feature = "gpu")]
    pub fn gpu_times(&self) -> &[(&'static str, Duration)] {
        &self.gpu_times
    }

    /// The passes on the GPU that are waited for, once they have been asked for: counts and times of the last step that they culled.
    #[cfg(feature = "gpu")]
    pub fn gpu_culling(&self) -> Option<&crate::gpu::GpuCulling> {
        self.gpu.culling()
    }
}
