//! Animated characters in an app: the cost of a step, bullets against fine steps on the skinned triangles, and a crowd of bodies.

pub mod cost;
pub mod crowd;
pub mod hits;

use std::{error::Error, ops::ControlFlow};

use bevy::{math::Affine3A, prelude::*};
use bevy_medial::{
    builder::{FitOptions, SkinnedTriangleMesh, TwoSidedError, fit_skinned, measure_without_folds},
    medial_axis::{JointPose, MedialAxis},
    prelude::*,
    scenes::{characters::Character, headless_app},
};

/// A character with its skinned triangle mesh and its medial mesh.
pub struct Actor {
    pub character: Character,
    pub mesh: SkinnedTriangleMesh,
    pub axis: MedialAxis,
    /// Velocity of the whole character along x, in metres per second.
    pub speed: f32,
}

impl Actor {
    /// Fits a medial mesh with a number of spheres; the binding adds some.
    ///
    /// # Errors
    /// Those of the builder.
    pub fn new(character: Character, spheres: usize, speed: f32) -> Result<Self, Box<dyn Error>> {
        let mesh = character.mesh()?;
        let options = FitOptions { spheres: Some(spheres), ..FitOptions::default() };
        let chain = fit_skinned(&mesh, &options, &|_| ControlFlow::Continue(()))?;
        let axis = chain.levels.into_iter().next().ok_or("the character has no level")?.axis;
        Ok(Self { character, mesh, axis, speed })
    }

    /// Places of the joints at a time in seconds, in the world.
    pub fn places(&self, time: f32) -> Vec<Affine3A> {
        let displacement = Affine3A::from_translation(self.displacement(time));
        self.character.pose(time).into_iter().map(|place| displacement * place).collect()
    }

    /// Displacement of the whole character since the start.
    pub fn displacement(&self, time: f32) -> Vec3 {
        Vec3::X * self.speed * time
    }

    /// Motion of the joints from the bind pose to places.
    pub fn poses(&self, places: &[Affine3A]) -> Vec<JointPose> {
        let mut poses = vec![];
        self.mesh.skin().joint_poses(places, &mut poses);
        poses
    }

    /// Max and mean error of the medial mesh in either direction, at places of the joints, in metres. The truth is the skinned triangle mesh without its folds.
    ///
    /// # Errors
    /// If a posed sphere is not valid.
    pub fn error(&self, places: &[Affine3A]) -> Result<[f32; 2], Box<dyn Error>> {
        let poses = self.poses(places);
        let TwoSidedError { mesh_to_envelope: to, envelope_to_mesh: from, diagonal } =
            measure_without_folds(&self.mesh.posed(&poses), &self.axis.posed(&poses)?);
        let metres = |percent: f32| percent / 100.0 * diagonal;
        Ok([metres(to.max.max(from.max)), metres(to.mean.max(from.mean))])
    }

    /// The largest error over a cycle of the gait, in metres.
    ///
    /// # Errors
    /// Those of [`error`](Self::error).
    pub fn fit_error(&self, frames: u32) -> Result<f32, Box<dyn Error>> {
        let times = (0..frames).map(|frame| frame as f32 / frames as f32 * self.character.period);
        let mut most = 0.0f32;
        for time in times {
            let [max, _] = self.error(&self.character.pose(time))?;
            most = most.max(max);
        }
        Ok(most)
    }
}

/// A character in an app.
pub struct Cast {
    pub root: Entity,
    pub joints: Vec<Entity>,
    /// Place of the character relative to the [`Actor`]'s.
    pub offset: Vec3,
}

impl Cast {
    /// Spawns the joints below a root without a shape.
    pub fn spawn(app: &mut App, actor: &Actor, offset: Vec3) -> Self {
        let world = app.world_mut();
        let root = world.spawn(Transform::default()).id();
        let mut joints: Vec<Entity> = Vec::new();
        for joint in &actor.character.joints {
            let parent = joint.parent.map_or(root, |parent| joints[parent]);
            joints.push(world.spawn((Name::new(joint.name.clone()), Transform::default(), ChildOf(parent))).id());
        }
        Self { root, joints, offset }
    }

    /// Moves the joints to their places at a time in seconds.
    pub fn animate(&self, app: &mut App, actor: &Actor, time: f32) {
        let places = actor.places(time);
        for ((joint, entity), place) in actor.character.joints.iter().zip(&self.joints).zip(&places) {
            let local = match joint.parent {
                Some(parent) => places[parent].inverse() * *place,
                None => Affine3A::from_translation(self.offset) * *place,
            };
            if let Some(mut transform) = app.world_mut().get_mut::<Transform>(*entity) {
                *transform = Transform::from_matrix(local.into());
            }
        }
    }
}

/// An app on the CPU without a character.
fn cpu_app(dt: f32) -> App {
    let mut app = headless_app(dt);
    app.world_mut().resource_mut::<MedialSettings>().backend = MedialBackend::Cpu;
    app
}

/// Adds a medial mesh to an app.
fn add_axis(app: &mut App, axis: &MedialAxis) -> Handle<MedialAxis> {
    app.world_mut().resource_mut::<Assets<MedialAxis>>().add(axis.clone())
}
