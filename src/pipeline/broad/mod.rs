//! Broad phase: finds the pairs of bodies that may touch within the step.
//!
//! The bounding sphere of a moving body sweeps a medial cone. Two bodies are a pair if their cones come within the prediction distance of
//! each other (paper, section 4). The bodies need not be there at the same time, because one may stop on its path and the other may hit it there. A body
//! and a static are a pair if the cone comes within the prediction distance of the static's box (section 4.1).

mod kinematic_reach;
mod swept_sphere;

use bevy::tasks::TaskPool;
use glam::Vec3;

use super::{
    Body, Candidates, Culling, PairFilter, Primitives, Shape, Side, Statics, StepInput,
    pairs::BodyPair,
    parallel::{self, Scratches},
    solid::count,
};
use crate::{
    geometry::{Aabb, Bvh, Item, Leaf, Sphere},
    query::{Cuboid, separation},
};

pub(crate) use kinematic_reach::KinematicReach;
use swept_sphere::SweptSphere;

/// Returns the cone that the bounding sphere of a body sweeps: its spheres at the start and at the end of the step, in the world.
#[cfg(feature = "debug")]
pub(crate) fn swept_cone(body: &Body) -> [Sphere; 2] {
    SweptSphere::new(body, 0.0).cone(Vec3::ZERO)
}

/// Returns true if the swept bounding spheres of two bodies meet.
pub(super) fn meet(bodies: &[Body; 2]) -> bool {
    let [first, second] = bodies.each_ref().map(|body| SweptSphere::new(body, 0.0));
    first.meets(&second)
}

/// Buffers that are kept from step to step to avoid allocations.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    kinematic_reach: KinematicReach,
    spheres: Vec<SweptSphere>,
    boxes: Vec<Aabb>,
    bvh: Bvh,
    items: Vec<Item>,
    leaves: Vec<Leaf>,
}

/// Finds the body pairs of a step.
pub(super) fn run(
    input: &StepInput,
    statics: &Statics,
    filter: impl Fn(Side, Side) -> PairFilter,
    buffers: &mut Scratch,
    pairs: &mut Vec<BodyPair>,
    pool: &TaskPool,
) {
    let mut kinematic_reach = std::mem::take(&mut buffers.kinematic_reach);
    kinematic_reach.reset(input);
    if input.culling == Culling::Hybrid || kinematic_reach.has_pushers() {
        loop {
            near(input, statics, &kinematic_reach, buffers, pairs, pool);
            if !kinematic_reach.widen(input, pairs.iter().map(|pair| [pair.first, pair.second])) {
                break;
            }
        }
    }
    if input.culling == Culling::None {
        all_pairs(input, statics, &kinematic_reach, pairs);
    }
    buffers.kinematic_reach = kinematic_reach;
    pairs.retain_mut(|pair| consents(input, statics, pair, filter(pair.first, pair.second)));
}

/// Returns the given candidates that may collide as sorted body pairs, each with its primitive pairs.
pub(super) fn from_candidates(
    input: &StepInput,
    statics: &Statics,
    candidates: Vec<Candidates>,
    filter: impl Fn(Side, Side) -> PairFilter,
) -> Vec<(BodyPair, Primitives)> {
    let mut kinematic_reach = KinematicReach::new(input);
    kinematic_reach.widen(input, candidates.iter().map(|pair| pair.sides));
    let mut pairs: Vec<(BodyPair, Primitives)> = candidates
        .into_iter()
        .filter_map(|Candidates { sides, mut primitives }| {
            let pair = match sides {
                [Side::Body(i), Side::Body(j)] => between(input, &kinematic_reach, i, j),
                [Side::Body(body), Side::Static(item)] | [Side::Static(item), Side::Body(body)] => {
                    with_static(input, statics, &kinematic_reach, body, item)
                }
                [Side::Static(_), Side::Static(_)] => None,
            }?;
            if pair.first != sides[0] {
                primitives.reverse();
            }
            Some((pair, primitives))
        })
        .collect();
    pairs.sort_unstable_by_key(|(pair, _)| *pair);
    pairs.retain_mut(|(pair, _)| consents(input, statics, pair, filter(pair.first, pair.second)));
    pairs
}

/// Sets [`BodyPair::stops`], which requires the consent of both sides. Returns false if the bodies do not collide.
fn consents(input: &StepInput, statics: &Statics, pair: &mut BodyPair, meeting: PairFilter) -> bool {
    let consent = |side| match side {
        Side::Body(body) => (input.bodies[body as usize].passes, input.bodies[body as usize].stop_groups),
        Side::Static(body) => (statics.bodies[body as usize].passes, statics.bodies[body as usize].stop_groups),
    };
    let [(passes1, groups1), (passes2, groups2)] = [pair.first, pair.second].map(consent);
    pair.stops = meeting == PairFilter::Stopping && !passes1 && !passes2 && groups1.test(&groups2);
    meeting != PairFilter::Apart
}

/// Returns the sides of all pairs that may come within the prediction distance of each other, if bodies leave their paths by at most `kinematic_reach`.
#[cfg(feature = "gpu")]
pub(crate) fn near_sides(
    input: &StepInput,
    statics: &Statics,
    kinematic_reach: &KinematicReach,
    pool: &TaskPool,
) -> Vec<[Side; 2]> {
    let mut pairs = Vec::new();
    near(input, statics, kinematic_reach, &mut Scratch::default(), &mut pairs, pool);
    pairs.into_iter().map(|pair| [pair.first, pair.second]).collect()
}

/// Finds the pairs whose swept spheres, or swept sphere and box, come within the prediction distance of each other.
fn near(
    input: &StepInput,
    statics: &Statics,
    kinematic_reach: &KinematicReach,
    Scratch { spheres, boxes, bvh, items, leaves, .. }: &mut Scratch,
    pairs: &mut Vec<BodyPair>,
    pool: &TaskPool,
) {
    pairs.clear();
    if !(0..input.bodies.len()).any(|body| kinematic_reach.is_awake(input, body)) {
        return;
    }
    let tasks = Scratches::<()>::default();
    parallel::map(pool, &tasks, &input.bodies, 256, spheres, |_, index, body| {
        SweptSphere::new(body, kinematic_reach.margin(input, index))
    });
    boxes.clear();
    boxes.extend(spheres.iter().map(SweptSphere::aabb));
    bvh.update(boxes, items);
    leaves.clear();
    leaves.extend(bvh.leaves());
    let (spheres, boxes, bvh) = (&*spheres, &*boxes, &*bvh);
    parallel::gather(pool, &tasks, leaves, 64, pairs, |_, _, &leaf, pairs| {
        let index = bvh.item(leaf);
        let i = index as usize;
        let sphere = &spheres[i];
        bvh.overlapping_later(leaf, |other| {
            // The lower index comes first, because rounding depends on the order of the spheres and the order of leaves depends on earlier steps.
            let [a, b] = [index.min(other), index.max(other)].map(|i| &spheres[i as usize]);
            let pair = between(input, kinematic_reach, index, other).filter(|_| a.meets(b));
            pairs.extend(pair.filter(|_| chains_meet(input, kinematic_reach, [index.min(other), index.max(other)])));
        });
        if !kinematic_reach.is_awake(input, i) {
            return;
        }
        // The swept sphere includes half of the prediction distance.
        let reach = boxes[i].inflated(0.5 * input.prediction);
        statics.bvh.overlapping(&reach, |item| {
            let Some(pair) = with_static(input, statics, kinematic_reach, index, item) else { return };
            let obb = &statics.boxes[item as usize];
            let to_box = |point| obb.pose.inverse_transform_point(point);
            let cone = [Vec3::ZERO, sphere.motion]
                .map(|motion| Sphere::new(to_box(sphere.sphere.center + motion), sphere.sphere.radius));
            if separation(&cone, &Cuboid { half: obb.half_extents }, 0).distance <= 0.5 * input.prediction {
                pairs.push(pair);
            }
        });
    });
    pairs.sort_unstable();
}

/// Returns true if the chains of cones of two bodies meet. The bodies need not be at the same place of their paths at the same time, so each link is tested
/// against each other one.
fn chains_meet(input: &StepInput, kinematic_reach: &KinematicReach, bodies: [u32; 2]) -> bool {
    let links = bodies.map(|index| SweptSphere::links(&input.bodies[index as usize]));
    // Single links are the cones that were tested before.
    if links == [1, 1] {
        return true;
    }
    let [first, second] = [0, 1].map(|side| {
        let index = bodies[side] as usize;
        SweptSphere::chain(&input.bodies[index], links[side], kinematic_reach.margin(input, index))
    });
    first.iter().any(|link| second.iter().any(|other| link.meets(other)))
}

/// Returns true if two rigid bodies are the same, or if a joint disables their collisions. Joints do not affect sensors.
fn kept_apart(input: &StepInput, [rigid_body1, rigid_body2]: [Option<u64>; 2], sensor: bool) -> bool {
    match (rigid_body1, rigid_body2) {
        (Some(a), Some(b)) => a == b || !sensor && input.apart.contains(&[a.min(b), a.max(b)]),
        _ => false,
    }
}

fn may_collide(input: &StepInput, kinematic_reach: &KinematicReach, bodies: [u32; 2]) -> bool {
    let [body1, body2] = bodies.map(|body| &input.bodies[body as usize]);
    bodies.iter().any(|&body| kinematic_reach.is_awake(input, body as usize))
        && body1.world == body2.world
        && (body1.solid.medial().is_some() || body2.solid.medial().is_some())
        && body1.groups.test(&body2.groups)
        && body1.types.test_either(&body2.types)
        && !kept_apart(input, [body1.rigid_body, body2.rigid_body], body1.sensor || body2.sensor)
}

/// Returns the pair of two bodies if they may collide.
fn between(input: &StepInput, kinematic_reach: &KinematicReach, i: u32, j: u32) -> Option<BodyPair> {
    let [lesser, greater] = [i.min(j), i.max(j)];
    let is_medial = input.bodies[lesser as usize].solid.medial().is_some();
    let (first, second) = if is_medial { (lesser, greater) } else { (greater, lesser) };
    may_collide(input, kinematic_reach, [first, second]).then(|| BodyPair::new(Side::Body(first), Side::Body(second)))
}

/// Returns the pair of a body and a static if they may collide.
fn with_static(
    input: &StepInput,
    statics: &Statics,
    kinematic_reach: &KinematicReach,
    index: u32,
    item: u32,
) -> Option<BodyPair> {
    let (body, target) = (&input.bodies[index as usize], &statics.bodies[item as usize]);
    let sides = if body.solid.medial().is_some() {
        Some((Side::Body(index), Side::Static(item)))
    } else {
        target.solid.medial().map(|_| (Side::Static(item), Side::Body(index)))
    };
    let collide = kinematic_reach.is_awake(input, index as usize)
        && body.world == target.world
        && body.groups.test(&target.groups)
        && body.types.test_either(&target.types)
        && !kept_apart(input, [body.rigid_body, target.rigid_body], body.sensor || target.sensor);
    sides.filter(|_| collide).map(|(first, second)| BodyPair::new(first, second))
}

/// Collects every pair that may collide, without culling.
fn all_pairs(input: &StepInput, statics: &Statics, kinematic_reach: &KinematicReach, pairs: &mut Vec<BodyPair>) {
    pairs.clear();
    let [bodies, still] = [input.bodies.len(), statics.bodies.len()].map(|count| count as u32);
    for i in 0..bodies {
        pairs.extend((i + 1..bodies).filter_map(|j| between(input, kinematic_reach, i, j)));
        pairs.extend((0..still).filter_map(|item| with_static(input, statics, kinematic_reach, i, item)));
    }
    pairs.sort_unstable();
}

/// Returns the number of primitive pairs in all body pairs with a medial side. Ignores groups and sleep.
pub(super) fn primitive_pairs(input: &StepInput, statics: &Statics) -> usize {
    let [all, medial] = count(input.bodies.iter().map(|body| &body.solid));
    let [still, still_medial] = statics.primitives;
    let squares: usize = input.bodies.iter().map(|body| body.solid.medial().map_or(0, Shape::len).pow(2)).sum();
    let others = all - medial;
    (medial * medial - squares) / 2 + medial * (others + still) + others * still_medial
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        geometry::{Obb, Pose3, Sweep},
        medial_axis::MedialAxis,
        pipeline::{Shape, StaticBody, step, step_from_candidates},
    };

    /// A kinematic ball moves through a ball that sleeps on a floor, and a joint may disable their collisions. External culling may report all three pairs.
    #[test]
    fn external_candidates_that_may_not_collide_wake_no_body() {
        let body = |center: Vec3, displacement: f32, rigid_body: u64, is_dynamic: bool| {
            let shape = Shape { axis: MedialAxis::sphere(0.1).unwrap(), scale: 1.0 };
            let sweep =
                Sweep::at_rates(Pose3::from_translation(center), Vec3::ZERO, Vec3::X * displacement, Vec3::ZERO);
            Body { stops: is_dynamic, active: !is_dynamic, rigid_body: Some(rigid_body), ..Body::new(shape, sweep) }
        };
        let bodies = vec![body(Vec3::X * -0.5, 0.5, 1, false), body(Vec3::ZERO, 0.0, 2, true)];
        let mut input = StepInput { bodies, prediction: 0.02, stop_at_impact: true, ..Default::default() };
        let floor = Obb { pose: Pose3::from_translation(Vec3::Y * -0.2), half_extents: Vec3::new(1.0, 0.1, 1.0) };
        let statics = Statics::new(vec![StaticBody::solid_box(floor)]);
        for is_apart in [false, true] {
            input.apart.extend(is_apart.then_some([1, 2]));
            let sides =
                [[Side::Body(0), Side::Body(1)], [Side::Body(0), Side::Static(0)], [Side::Body(1), Side::Static(0)]];
            let candidates = sides.map(|sides| Candidates { sides, primitives: Primitives::Unknown }).to_vec();
            let found = step(&input, &statics, &TaskPool::new());
            let known =
                step_from_candidates(&input, &statics, candidates, |_, _| PairFilter::Stopping, &TaskPool::new());
            assert_eq!(found.pairs, known.pairs);
            let rests = found.pairs.iter().any(|pair| [pair.first, pair.second] == sides[2]);
            assert_eq!(rests, !is_apart, "{:?}", found.pairs);
        }
    }

    /// A piston hits one of two joined balls that are far from each other. The other one moves with it and has to stop at a wall.
    #[test]
    fn a_body_joined_with_a_pushed_body_stops_at_a_wall() {
        const RADIUS: f32 = 0.1;
        let body = |center: Vec3, displacement: f32, joint_island: Option<u64>| {
            let shape = Shape { axis: MedialAxis::sphere(RADIUS).unwrap(), scale: 1.0 };
            let sweep =
                Sweep::at_rates(Pose3::from_translation(center), Vec3::ZERO, Vec3::X * displacement, Vec3::ZERO);
            Body { stops: joint_island.is_some(), joint_island, ..Body::new(shape, sweep) }
        };
        let [near, far] = [Vec3::X * 0.25, Vec3::new(0.25, 3.0, 0.0)];
        let bodies = vec![body(Vec3::ZERO, 0.5, None), body(near, 0.0, Some(1)), body(far, 0.0, Some(1))];
        let input = StepInput { bodies, prediction: 0.02, stop_at_impact: true, ..Default::default() };
        let displacements = |walls: Vec<StaticBody>| {
            let output = step(&input, &Statics::new(walls), &TaskPool::new());
            [(1, near), (2, far)].map(|(body, start)| output.stop_of(body).unwrap().pose.translation.x - start.x)
        };
        assert!(
            displacements(vec![]).iter().all(|displacement| *displacement > 0.44),
            "the piston does not push both balls: {:?}",
            displacements(vec![])
        );
        let pose = Pose3::from_translation(far + Vec3::X * (RADIUS + 0.2));
        let stopped =
            displacements(vec![StaticBody::solid_box(Obb { pose, half_extents: Vec3::new(0.005, 1.0, 1.0) })]);
        assert!(stopped.iter().all(|displacement| *displacement < 0.2 && *displacement > 0.15), "{stopped:?}");
    }
}
