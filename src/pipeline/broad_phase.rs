//! Broad phase: which bodies may touch within the step.
//!
//! The sphere around a moving body sweeps a medial cone. Two bodies are a pair if their cones come within the prediction distance of
//! each other (paper, section 4), whenever that is: one may stop on its way, and the other run into it. A body and a static
//! are a pair if the cone comes as near to the static's box (section 4.1).

use bevy::tasks::TaskPool;
use glam::Vec3;

use super::{Body, Culling, Statics, StepInput, Target, parallel};
use crate::{
    geometry::{Aabb, Bvh, Sphere},
    query::{Cuboid, separation},
};

/// A body pair.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct BodyPair {
    pub body1: u32,
    pub target: Target,
}

/// The sphere around a body at the start of the step, and where it goes.
#[derive(Clone, Copy)]
struct SweptSphere {
    sphere: Sphere,
    motion: Vec3,
}

impl SweptSphere {
    /// The sphere around all that the body can reach by turning about its centre of mass, which moves on a line.
    /// For a body that hardly turns, the tighter bounding sphere with its centre's chord, and the sagitta as margin.
    fn new(body: &Body, prediction: f32) -> Self {
        let bound = body.shape.bounding_sphere();
        let arm = bound.center.distance(body.sweep.local_center);
        let start = body.sweep.start.transform_point(bound.center);
        let end = body.sweep.pose_at(1.0).transform_point(bound.center);
        let radius = bound.radius + body.sweep.sagitta(arm, 1) + 0.5 * prediction;
        Self { sphere: Sphere::new(start, radius), motion: end - start }
    }

    fn aabb(&self) -> Aabb {
        let end = Sphere::new(self.sphere.center + self.motion, self.sphere.radius);
        Aabb::from_spheres([self.sphere, end])
    }

    /// The cone, with a place near it as the origin.
    fn cone(&self, origin: Vec3) -> [Sphere; 2] {
        [Vec3::ZERO, self.motion].map(|motion| Sphere::new(self.sphere.center - origin + motion, self.sphere.radius))
    }

    fn meets(&self, other: &SweptSphere) -> bool {
        let origin = self.sphere.center;
        separation(&self.cone(origin), &other.cone(origin), 0).distance <= 0.0
    }
}

pub(super) fn run(input: &StepInput, statics: &Statics, pool: &TaskPool) -> Vec<BodyPair> {
    if input.culling == Culling::None {
        return all_pairs(input, statics).collect();
    }
    let spheres = parallel::map(pool, &input.bodies, 256, |_, body| SweptSphere::new(body, input.prediction));
    let boxes: Vec<Aabb> = spheres.iter().map(SweptSphere::aabb).collect();
    let bvh = Bvh::new(&boxes);
    let found = parallel::map(pool, &input.bodies, 64, |i, body| {
        let mut pairs = Vec::new();
        let sphere = &spheres[i];
        bvh.visit(
            |aabb| aabb.overlaps(&boxes[i]),
            |other| {
                if other as usize > i
                    && may_collide(input, body, &input.bodies[other as usize])
                    && sphere.meets(&spheres[other as usize])
                {
                    pairs.push(BodyPair { body1: i as u32, target: Target::Body(other) });
                }
            },
        );
        if body.active {
            // The sphere has half of the prediction distance already.
            let reach = boxes[i].inflated(0.5 * input.prediction);
            statics.bvh.visit(
                |aabb| aabb.overlaps(&reach),
                |item| {
                    let target = &statics.bodies[item as usize];
                    if body.groups.test(&target.groups) {
                        let to_box = |point| target.obb.pose.inverse_transform_point(point);
                        let cone = [Vec3::ZERO, sphere.motion]
                            .map(|motion| Sphere::new(to_box(sphere.sphere.center + motion), sphere.sphere.radius));
                        let cuboid = Cuboid { half: target.obb.half_extents };
                        if separation(&cone, &cuboid, 0).distance <= 0.5 * input.prediction {
                            pairs.push(BodyPair { body1: i as u32, target: Target::Static(item) });
                        }
                    }
                },
            );
        }
        pairs.sort_unstable();
        pairs
    });
    found.into_iter().flatten().collect()
}

fn may_collide(input: &StepInput, body1: &Body, body2: &Body) -> bool {
    let kept_apart = match (body1.owner, body2.owner) {
        (Some(a), Some(b)) => a == b || input.apart.contains(&[a.min(b), a.max(b)]),
        _ => false,
    };
    (body1.active || body2.active) && body1.groups.test(&body2.groups) && !kept_apart
}

/// Every pair that may collide.
fn all_pairs<'a>(input: &'a StepInput, statics: &'a Statics) -> impl Iterator<Item = BodyPair> + 'a {
    input.bodies.iter().enumerate().flat_map(move |(i, body)| {
        let bodies = (i + 1..input.bodies.len())
            .filter(move |&j| may_collide(input, body, &input.bodies[j]))
            .map(|j| Target::Body(j as u32));
        let statics = (0..statics.bodies.len())
            .filter(move |&j| body.active && body.groups.test(&statics.bodies[j].groups))
            .map(|j| Target::Static(j as u32));
        bodies.chain(statics).map(move |target| BodyPair { body1: i as u32, target })
    })
}

/// Number of primitive pairs in all body pairs, groups and sleep aside.
pub(super) fn primitive_pairs(input: &StepInput, statics: &Statics) -> usize {
    let primitives = |body: &Body| body.shape.len();
    let sum: usize = input.bodies.iter().map(primitives).sum();
    let squares: usize = input.bodies.iter().map(|body| primitives(body).pow(2)).sum();
    let of_statics: usize =
        statics.bodies.iter().map(|body| body.shape.as_ref().map_or(1, |(shape, _)| shape.len())).sum();
    (sum * sum - squares) / 2 + sum * of_statics
}
