//! The published alternating time of impact in place of this crate's own. Bodies stop at its times, and everything else is the same.
//!
//! As in the publication, each sphere of a primitive moves on a line over the step. Boxes are tested as medial meshes, which consist of slabs.

use bevy::prelude::*;
use bevy_medial::{
    geometry::{Pose3, Sphere, Sweep},
    pipeline::{Shape, Side},
    plugin::{MedialStep, MedialSystems},
    query::{Moving, TimeOfImpactStatus, alternating},
};
use bevy_rapier3d::{
    plugin::context::{RapierContextColliders, RapierRigidBodySet},
    prelude::PhysicsSet,
};

use crate::{
    for_primitives,
    pairs::{Boxes, Primitive, moving_primitives},
};

/// Adds a system that stops bodies after this crate's detection, whose setting `stop_at_impact` must be off.
pub fn add(app: &mut App) {
    app.add_systems(PostUpdate, stop.after(MedialSystems::Detect).before(PhysicsSet::Writeback));
}

/// All primitives of a shape, each with a ball around its path.
fn hulls(shape: &Shape, poses: [&Pose3; 2]) -> Vec<(Primitive, Sphere)> {
    let with_bound = |primitive: Primitive| {
        let bound = match &primitive {
            Primitive::Sphere(moving) => bound(moving),
            Primitive::Cone(moving) => bound(moving),
            Primitive::Slab(moving) => bound(moving),
        };
        (primitive, bound)
    };
    moving_primitives(shape, poses).map(with_bound).collect()
}

fn bound<const N: usize>(moving: &Moving<N>) -> Sphere {
    let ends =
        || moving.start.iter().zip(moving.motion).flat_map(|(sphere, motion)| [sphere.center, sphere.center + motion]);
    let middle = ends().sum::<Vec3>() / (2 * N) as f32;
    let thickest = moving.start.iter().map(|sphere| sphere.radius).fold(0.0, f32::max);
    Sphere::new(middle, ends().map(|end| end.distance(middle)).fold(0.0, f32::max) + thickest)
}

/// The time of impact of two primitives, if they hit each other.
fn first_touch(first: &Primitive, second: &Primitive) -> Option<f32> {
    let found = for_primitives!(Primitive: first, second, |a, b| alternating(a, b));
    (found.status == TimeOfImpactStatus::Hit).then_some(found.fraction)
}

fn meet(one: &Sphere, other: &Sphere) -> bool {
    let reach = one.radius + other.radius;
    one.center.distance_squared(other.center) < reach * reach
}

/// A body or a static with all its moving primitives.
struct MovingSide {
    side: Side,
    hulls: Vec<(Primitive, Sphere)>,
    bound: Sphere,
}

impl MovingSide {
    /// `None` for triangles, which only have contacts and no stops.
    fn new(step: &MedialStep, side: Side, origin: Vec3, boxes: &mut Boxes) -> Option<Self> {
        let (shape, sweep) = match side {
            Side::Body(body) => {
                let body = &step.input.bodies[body as usize];
                (body.solid.medial()?.clone(), body.sweep)
            }
            Side::Static(body) => {
                let body = &step.statics.bodies()[body as usize];
                let obb = body.obb();
                match body.solid.medial() {
                    Some(shape) => (shape.clone(), Sweep::at_rest(body.pose)),
                    None if body.solid.len() > 1 => return None,
                    None => (boxes.shape(obb.half_extents)?, Sweep::at_rest(obb.pose)),
                }
            }
        };
        let near = |pose: &Pose3| Pose3::from_parts(pose.translation - origin, pose.rotation);
        let hulls = hulls(&shape, [&near(&sweep.start), &near(&sweep.end)]);
        let middle = hulls.iter().map(|(_, bound)| bound.center).sum::<Vec3>() / hulls.len().max(1) as f32;
        let radius = hulls.iter().map(|(_, bound)| bound.farthest(middle)).fold(0.0, f32::max);
        Some(Self { side, hulls, bound: Sphere::new(middle, radius) })
    }

    /// The fraction of the step at which the scheme reports a touch with another side. 1 without a touch.
    fn first_touch(&self, other: &Self) -> f32 {
        let mut first = 1.0f32;
        for (hull1, bound1) in self.hulls.iter().filter(|(_, bound)| meet(bound, &other.bound)) {
            for (hull2, _) in other.hulls.iter().filter(|(_, bound)| meet(bound, bound1)) {
                first = first_touch(hull1, hull2).map_or(first, |time| first.min(time));
            }
        }
        first
    }
}

fn stop(
    step: Res<MedialStep>,
    contexts: Single<(&mut RapierRigidBodySet, &RapierContextColliders)>,
    mut boxes: Local<Boxes>,
) {
    let bodies = (0..step.input.bodies.len() as u32).map(Side::Body);
    let statics = (0..step.statics.bodies().len() as u32).map(Side::Static);
    // Coordinates are relative to the first body.
    let origin = step.input.bodies.first().map_or(Vec3::ZERO, |body| body.sweep.start.translation);
    let sides: Vec<MovingSide> =
        bodies.chain(statics).filter_map(|side| MovingSide::new(&step, side, origin, &mut boxes)).collect();
    let mut stops = vec![1.0f32; step.input.bodies.len()];
    for (i, one) in sides.iter().enumerate() {
        for other in &sides[i + 1..] {
            let indices = [one.side.body(), other.side.body()];
            let active = indices.iter().flatten().any(|&body| step.input.bodies[body as usize].active);
            if !active || !meet(&one.bound, &other.bound) {
                continue;
            }
            let first = one.first_touch(other);
            for body in indices.into_iter().flatten() {
                stops[body as usize] = stops[body as usize].min(first);
            }
        }
    }
    let (mut set, colliders) = contexts.into_inner();
    for ((body, info), fraction) in step.input.bodies.iter().zip(&step.infos).zip(stops) {
        let parent = colliders.colliders.get(info.collider()).and_then(|collider| collider.parent());
        let rigid = parent.and_then(|parent| set.bodies.get_mut(parent));
        if let Some(rigid) = rigid.filter(|_| fraction < 1.0 && body.stops) {
            rigid.set_position(body.sweep.pose_at(fraction), true);
        }
    }
}
