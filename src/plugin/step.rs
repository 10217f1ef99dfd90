#[cfg(feature = "gpu")]
use std::sync::Arc;
use std::{mem, time::Duration};

#[cfg(feature = "gpu")]
use bevy::platform::time::Instant;
use bevy::{ecs::entity::EntityHashMap, prelude::*, tasks::ComputeTaskPool};

use super::{MedialSettings, skinned::Bound};
#[cfg(feature = "gpu")]
use super::{gpu::GpuBackend, look_ahead::Answer};
#[cfg(feature = "gpu")]
use crate::gpu::Prediction;
use crate::{
    geometry::Pose3,
    pipeline::{
        Candidates, ContactCache, Culling, Pair, PairFilter, Side, Solid, Statics, StepInput, StepOutput, Workspace,
    },
};

/// Entity and motion of a body or static that the pipeline knows by its index.
#[derive(Clone, Copy, Debug)]
pub struct BodyInfo {
    /// The entity.
    pub entity: Entity,
    /// Its rigid body, which may be the same entity. `None` for a collider without a rigid body.
    pub body: Option<Entity>,
    /// The raw parts of the handle of its collider.
    #[cfg(feature = "rapier")]
    pub(crate) collider: (u32, u32),
    /// True if it is a sensor, which has no response.
    pub sensor: bool,
    /// True if it is asleep.
    pub asleep: bool,
    /// Centre of mass at the start of the step, in the world.
    pub center: Vec3,
    /// Velocity of the centre of mass before the step, in metres per second.
    pub linear: Vec3,
    /// Angular velocity before the step, in radians per second.
    pub angular: Vec3,
}

impl BodyInfo {
    /// Info of an entity that does not move.
    pub(crate) fn at_rest(entity: Entity) -> Self {
        Self {
            entity,
            body: None,
            #[cfg(feature = "rapier")]
            collider: (u32::MAX, u32::MAX),
            sensor: false,
            asleep: false,
            center: Vec3::ZERO,
            linear: Vec3::ZERO,
            angular: Vec3::ZERO,
        }
    }

    /// Identifies the entity across steps.
    #[cfg(feature = "gpu")]
    fn key(&self) -> u64 {
        self.entity.to_bits()
    }

    /// Returns the velocity of a point in the world before the step, in metres per second.
    pub fn velocity_at(&self, point: Vec3) -> Vec3 {
        self.linear + self.angular.cross(point - self.center)
    }
}

/// Internal: input and output of the last step, and the entities behind the indices in them. For debug views, measurements and tests. Its fields follow
/// the pipeline and change with it, so games use [`MedialContacts`](super::MedialContacts), messages and diagnostics instead.
///
/// Reflection shows only the fields that describe the step as a whole.
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
    /// Number of the step. Predictions for the GPU refer to it, so a saved number must not be restored.
    #[reflect(ignore)]
    pub(super) number: u64,
    /// Entity and velocities of each body.
    #[reflect(ignore)]
    pub infos: Vec<BodyInfo>,
    /// Entity of each static.
    #[reflect(ignore)]
    pub static_infos: Vec<BodyInfo>,
    /// Shape and joints of each skinned body.
    #[reflect(ignore)]
    pub(super) skins: EntityHashMap<Bound>,
    /// The rapier context of each world.
    #[cfg(feature = "rapier")]
    #[reflect(ignore)]
    pub(crate) worlds: Vec<Entity>,
    /// Impulse that rapier's solver has given to the second side of each pair of the output along the normals of its contacts, in newton seconds.
    #[cfg(feature = "rapier")]
    #[reflect(ignore)]
    pub(crate) impulses: Vec<Vec3>,
    /// Length of the step in seconds. For several worlds it is that of the first.
    pub dt: f32,
    /// Time to record the poses of bodies and to pass contacts to rapier before its step, and to gather the input after it.
    #[cfg(feature = "rapier")]
    pub snapshot_time: Duration,
    /// Time to move bodies to their stops.
    #[cfg(feature = "rapier")]
    pub move_time: Duration,
    #[cfg(feature = "gpu")]
    #[reflect(ignore)]
    pub(super) gpu: GpuBackend,
    /// Delay of the GPU's answer that the last step used, in steps; 0 if the step waited for the answer. None if the CPU culled the step.
    #[cfg(feature = "gpu")]
    pub gpu_latency: Option<u32>,
    /// Number of bodies that were culled on the CPU then, because they were not at their predicted place.
    #[cfg(feature = "gpu")]
    pub gpu_departed: usize,
    /// Time of each pass of that answer.
    #[cfg(feature = "gpu")]
    #[reflect(ignore)]
    gpu_times: Vec<(&'static str, Duration)>,
}

impl MedialStep {
    /// Returns the contacts of the last step. They are part of the state of a world, because pairs that hardly move keep them.
    pub fn contacts(&self) -> &ContactCache {
        self.workspace.contacts()
    }

    /// Restores the contacts of a saved state.
    pub fn set_contacts(&mut self, contacts: ContactCache) {
        self.workspace.set_contacts(contacts);
    }

    /// Returns entity and motion of a side of a pair.
    pub fn info(&self, side: Side) -> &BodyInfo {
        match side {
            Side::Body(body) => &self.infos[body as usize],
            Side::Static(body) => &self.static_infos[body as usize],
        }
    }

    /// Returns the solid of a side of a pair.
    pub fn solid(&self, side: Side) -> &Solid {
        match side {
            Side::Body(body) => &self.input.bodies[body as usize].solid,
            Side::Static(body) => &self.statics.bodies()[body as usize].solid,
        }
    }

    /// Returns the velocity of a point of a primitive, in metres per second: the velocity of its body before the step, and of its spheres in the step. `fraction`:
    /// the time at which the point, in the world, is on the primitive.
    pub(crate) fn velocity_at(&self, side: Side, primitive: u32, point: Vec3, fraction: f32) -> Vec3 {
        let of_body = self.info(side).velocity_at(point);
        let Some(shape) = self.solid(side).deforming().filter(|_| self.dt > 0.0) else { return of_body };
        let pose = self.final_pose(side);
        of_body + pose.rotation * shape.displacement(primitive, pose.inverse_transform_point(point), fraction) / self.dt
    }

    /// Returns the joint of a skinned body with the largest weight at a point of a primitive, in the world.
    pub(super) fn joint_at(&self, side: Side, primitive: u32, point: Vec3, fraction: f32) -> Option<Entity> {
        let shape = self.solid(side).deforming()?;
        let point = self.final_pose(side).inverse_transform_point(point);
        self.skins.get(&self.info(side).entity)?.joint_at(shape, primitive, point, fraction)
    }

    /// Returns the rapier context of a side of a pair.
    #[cfg(feature = "rapier")]
    pub fn context(&self, side: Side) -> Entity {
        let world = match side {
            Side::Body(body) => self.input.bodies[body as usize].world,
            Side::Static(body) => self.statics.bodies()[body as usize].world,
        };
        self.worlds[world as usize]
    }

    /// Returns the pose of a side of a pair at the end of the step.
    pub fn final_pose(&self, side: Side) -> Pose3 {
        match side {
            Side::Body(body) => {
                self.output.stop_of(body).map_or(self.input.bodies[body as usize].sweep.end, |stop| stop.pose)
            }
            Side::Static(body) => self.statics.bodies()[body as usize].pose,
        }
    }

    /// Returns the pose of the second side of a pair in the frame of the first at the end of the step, to which its manifolds refer.
    pub fn final_pose12(&self, pair: &Pair) -> Pose3 {
        self.input.pose12(&self.statics, [pair.first, pair.second], |body| self.final_pose(Side::Body(body)))
    }

    /// Runs the pipeline. The filter is called for each pair that may collide.
    pub(crate) fn run(&mut self, filter: impl Fn(&Self, Side, Side) -> PairFilter) {
        self.input.culling = if self.settings.brute_force { Culling::None } else { Culling::Hybrid };
        self.input.recycle_contacts = self.settings.recycle_contacts && !self.settings.brute_force;
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
            if self.input.culling == Culling::None {
                self.gpu.look_ahead.asked = None;
            } else {
                let (clock, time) = (Instant::now(), self.output.times.total());
                self.look_ahead();
                let asking = clock.elapsed();
                self.output.times.broad += asking;
                let time = if on_gpu { time + asking } else { time };
                self.gpu.note(&self.settings, on_gpu, self.input.bodies.len(), time);
            }
        }
    }

    /// Returns the pairs that the GPU has found, and the time that it took. None if the CPU culls the step.
    #[cfg(feature = "gpu")]
    fn cull(&mut self) -> Option<(Vec<Candidates>, Duration)> {
        (self.gpu_latency, self.gpu_departed) = (None, 0);
        self.gpu_times.clear();
        if self.input.culling == Culling::None || !self.gpu.is_wanted(self.settings.backend) {
            return None;
        }
        let clock = Instant::now();
        let candidates = if self.gpu.looks_ahead(&self.settings) { self.look_up() } else { self.wait() }?;
        Some((candidates, clock.elapsed()))
    }

    /// Returns the pairs of this step, and waits for the GPU.
    #[cfg(feature = "gpu")]
    fn wait(&mut self) -> Option<Vec<Candidates>> {
        let (candidates, times) = self.gpu.cull(self.settings.backend, &self.input, &self.statics)?;
        self.gpu_latency = Some(0);
        self.gpu_times.extend_from_slice(times);
        Some(candidates)
    }

    /// Returns the pairs of this step, from the latest answer to a prediction.
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

    /// Passes a prediction of the next steps to the GPU.
    #[cfg(feature = "gpu")]
    fn look_ahead(&mut self) {
        self.gpu.look_ahead.asked = self.gpu.asks(&self.settings).then(|| {
            let keys = self.infos.iter().map(BodyInfo::key);
            let end_of = |body| self.final_pose(Side::Body(body));
            Arc::new(Prediction::new(&self.input, &self.statics, keys, end_of, self.number))
        });
    }

    #[cfg(not(feature = "gpu"))]
    fn cull(&mut self) -> Option<(Vec<Candidates>, Duration)> {
        if self.settings.backend == super::MedialBackend::Gpu {
            warn_once!("medial meshes are culled on the CPU: bevy_medial is built without the feature `gpu`");
        }
        None
    }

    /// Time of each GPU pass of the answer that the last step used. Empty if the CPU culled the step, or if the device cannot measure times.
    #[cfg(feature = "gpu")]
    pub fn gpu_times(&self) -> &[(&'static str, Duration)] {
        &self.gpu_times
    }

    /// The GPU passes of steps that wait for them, after their first use, with counts and times of the last step that they culled.
    #[cfg(feature = "gpu")]
    pub fn gpu_culling(&self) -> Option<&crate::gpu::GpuCulling> {
        self.gpu.culling()
    }
}
