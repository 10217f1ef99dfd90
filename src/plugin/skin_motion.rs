//! The motion of a skinned shape from one pose of its joints to the next.

use std::sync::Arc;

use bevy::prelude::*;

use super::{
    screw::{Screw, turns_by_more},
    skinned::{Bound, SkinPose, SkinnedMedialMesh},
};
use crate::{
    constants::{MAX_JOINT_TURN, TELEPORT},
    geometry::{Aabb, Pose3, Sphere},
    medial_axis::{JointPose, MedialAxis},
    pipeline::Deforming,
};

impl SkinPose {
    /// Creates the pose of a shape that is placed for the first time.
    pub(super) fn new(
        axis: &MedialAxis,
        joints: Vec<Entity>,
        poses: Vec<JointPose>,
        mesh: &SkinnedMedialMesh,
        frame: Option<Pose3>,
    ) -> Self {
        let bound = Bound { axis: axis.clone(), joints: joints.into() };
        let regions = regions(axis, mesh);
        let spheres = posed(axis, &poses);
        let frame = frame.unwrap_or_else(|| frame_around(&spheres));
        let shape = Arc::new(Deforming::new(axis, vec![seen_from(&frame, spheres.clone())]));
        let (before, span) = (poses.clone(), 1);
        Self { bound, regions, before, poses, spheres, span, shape, frame, age: 0, teleports: false, has_jumped: false }
    }

    /// Moves the shape to the pose of its joints. Returns the displacement in metres if it is too long to be swept, for the first time.
    ///
    /// `interval`: number of steps between two updates.
    pub(super) fn advance(
        &mut self,
        axis: &MedialAxis,
        poses: Vec<JointPose>,
        frame: Option<Pose3>,
        interval: u32,
    ) -> Option<f32> {
        self.age += 1;
        let teleports = std::mem::take(&mut self.teleports);
        let is_due = self.age >= interval || teleports;
        if is_due {
            self.before = std::mem::replace(&mut self.poses, poses);
            (self.span, self.age) = (self.age, 0);
        }
        let before = if is_due { &self.before } else { &self.poses };
        let is_known = axis.address() == self.bound.axis.address();
        let rests = self.poses == *before && is_known && frame.is_none_or(|frame| frame == self.frame);
        if rests && !self.shape.is_moving() {
            return None;
        }
        // Another level of detail has other spheres.
        let start = if is_known { std::mem::take(&mut self.spheres) } else { posed(axis, before) };
        let end = posed(axis, &self.poses);
        let squares = std::iter::zip(&start, &end).map(|(a, b)| a.center.distance_squared(b.center));
        let displacement = squares.fold(0.0, f32::max).sqrt();
        let jumps = displacement > TELEPORT * self.shape.axis().bounding_sphere().radius;
        let mut knots = if jumps || teleports { Vec::new() } else { between(axis, before, &self.poses) };
        if jumps || teleports {
            self.before.clone_from(&self.poses);
        }
        self.frame = frame.unwrap_or_else(|| if rests { self.frame } else { frame_around(&end) });
        if !jumps && !teleports {
            knots.insert(0, start);
        }
        self.spheres.clone_from(&end);
        knots.push(end);
        let knots = knots.into_iter().map(|knot| seen_from(&self.frame, knot)).collect();
        self.shape = Arc::new(Deforming::new(axis, knots));
        self.bound.axis = axis.clone();
        let is_new = jumps && !teleports && !self.has_jumped;
        self.has_jumped |= is_new;
        is_new.then_some(displacement)
    }
}

/// Returns the hit region of each joint.
pub(super) fn regions(axis: &MedialAxis, mesh: &SkinnedMedialMesh) -> Vec<Option<String>> {
    let joints = axis.skin().map_or(&[][..], |skin| skin.joints());
    joints.iter().map(|joint| mesh.regions.get(&joint.name).cloned()).collect()
}

fn posed(axis: &MedialAxis, poses: &[JointPose]) -> Vec<Sphere> {
    let mut spheres = Vec::new();
    if let Some(skin) = axis.skin() {
        skin.pose(axis.spheres(), poses, &mut spheres);
    }
    spheres
}

/// Returns the spheres at equal fractions between two poses, so that no joint turns by more than [`MAX_JOINT_TURN`] from one to the next.
fn between(axis: &MedialAxis, before: &[JointPose], now: &[JointPose]) -> Vec<Vec<Sphere>> {
    if !std::iter::zip(before, now).any(|(before, now)| turns_by_more([before, now], MAX_JOINT_TURN)) {
        return Vec::new();
    }
    let screws: Vec<Screw> = std::iter::zip(before, now).map(|(before, now)| Screw::new([*before, *now])).collect();
    let turn = screws.iter().map(Screw::angle).fold(0.0, f32::max);
    let segments = (turn / MAX_JOINT_TURN).ceil() as usize;
    let at = |fraction: f32| screws.iter().map(|screw| screw.at(fraction)).collect::<Vec<_>>();
    (1..segments).map(|i| posed(axis, &at(i as f32 / segments as f32))).collect()
}

/// Returns a frame with the axes of the world in the middle of the spheres.
fn frame_around(spheres: &[Sphere]) -> Pose3 {
    Pose3::from_translation(Aabb::from_spheres(spheres.iter().copied()).center())
}

fn seen_from(frame: &Pose3, mut spheres: Vec<Sphere>) -> Vec<Sphere> {
    let turn = frame.rotation.inverse();
    spheres.iter_mut().for_each(|sphere| sphere.center = turn * (sphere.center - frame.translation));
    spheres
}
