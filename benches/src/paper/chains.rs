//! Chains of cones (paper, section 4, figure 5): the bounding sphere of a body swept along a curved path in several links.
//!
//! Each link is widened by the sagitta of its part of the rotation, so a chain of one link is the first test of
//! `bevy_medial`.

use bevy_medial::{
    geometry::{Aabb, Sphere, Sweep},
    pipeline::{Body, Statics, StepInput},
    query::separation,
};

use super::distance_to_box;

/// The cones that the bounding sphere of a body sweeps.
fn chain(body: &Body, links: usize) -> Vec<[Sphere; 2]> {
    let bound = body.solid.bounding_sphere();
    let arm = bound.center.distance(body.sweep.local_center);
    let link = |number: usize| {
        let part = body.sweep.part([number, number + 1].map(|i| i as f32 / links as f32));
        let radius = bound.radius + part.sagitta(arm);
        [&part.start, &part.end].map(|pose| Sphere::new(pose.transform_point(bound.center), radius))
    };
    (0..links).map(link).collect()
}

/// The number of pairs of bodies, and of a body and a static, whose chains come within the prediction distance of each other.
pub fn pairs(input: &StepInput, statics: &Statics, links: usize) -> usize {
    let chains: Vec<Vec<[Sphere; 2]>> = input.bodies.iter().map(|body| chain(body, links)).collect();
    let boxes: Vec<Aabb> =
        chains.iter().map(|chain| Aabb::from_spheres(chain.as_flattened().iter().copied())).collect();
    let mut count = 0;
    for (i, chain) in chains.iter().enumerate() {
        let reach = boxes[i].inflated(input.prediction);
        for (other, aabb) in chains[i + 1..].iter().zip(&boxes[i + 1..]) {
            let meets =
                |one: &[Sphere; 2]| other.iter().any(|other| separation(one, other, 0).distance <= input.prediction);
            count += usize::from(reach.overlaps(aabb) && chain.iter().any(meets));
        }
        for target in statics.bodies() {
            let obb = target.obb();
            let meets = |cone: &[Sphere; 2]| distance_to_box(cone, &obb) <= input.prediction;
            count += usize::from(reach.overlaps(&obb.aabb()) && chain.iter().any(meets));
        }
    }
    count
}

/// The same bodies with motions that continue for a number of steps.
pub fn continued(input: &StepInput, steps: usize) -> StepInput {
    let mut input = input.clone();
    for body in &mut input.bodies {
        let Sweep { start, local_center, translation, rotation, .. } = body.sweep;
        body.sweep = Sweep::at_rates(start, local_center, translation * steps as f32, rotation * steps as f32);
    }
    input
}
