//! The method of the paper (sections 4 and 4.2): culling of bodies by swept bounding spheres, then the time of impact of *all* primitive pairs of the
//! remaining body pairs, without trees.
//!
//! The bounding sphere of a body sweeps a cone. Two bodies remain if their cones overlap; a body and a static remain if the cone overlaps the static's
//! box, which a BVH finds. Each sphere of a primitive moves on a line over the step. Boxes are medial meshes, which consist of slabs.

use std::time::Instant;

use bevy_medial::{
    geometry::{Aabb, Bvh, Pose3, Sphere, Sweep},
    gpu,
    pipeline::{Side, Solid, Statics, StepInput},
    query::{MovingPair, TimeOfImpactStatus, alternating, separation, time_of_impact, times_of_impact},
};
use glam::Vec3;

use super::distance_to_box;
use crate::{
    for_primitives,
    pairs::{Boxes, Primitive, moving_primitives},
};

/// A time of impact of primitive pairs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Detection {
    /// The published alternation.
    Alternating,
    /// Conservative advancement of this crate, pair by pair.
    Advancement,
    /// The same in SIMD lanes.
    Lanes,
}

/// Result of a step.
#[derive(Clone, Debug, Default)]
pub struct FlatStep {
    /// Time of the culling of bodies, in milliseconds.
    pub culling_ms: f64,
    /// Time of the detection, in milliseconds.
    pub detection_ms: f64,
    /// Number of primitive pairs that were tested.
    pub primitive_pairs: usize,
    /// First touch of each remaining body pair, as a fraction of the step. 1: none.
    pub first_touches: Vec<([Side; 2], f32)>,
}

/// The method with the data that it keeps from step to step.
#[derive(Default)]
pub struct Flat {
    boxes: Boxes,
    statics: Bvh,
}

/// The primitives of all sides of the remaining pairs.
struct Placed {
    bodies: Vec<Primitives>,
    statics: Vec<Primitives>,
}

/// Primitives of a side, made when they are first needed.
type Primitives = Option<Vec<Primitive>>;

impl Placed {
    fn of(&self, side: Side) -> &[Primitive] {
        let known = match side {
            Side::Body(i) => &self.bodies[i as usize],
            Side::Static(i) => &self.statics[i as usize],
        };
        known.as_deref().unwrap_or_default()
    }
}

impl Flat {
    /// Runs a step on one thread.
    ///
    /// # Errors
    /// If there is a body that is neither medial nor a box.
    pub fn step(&mut self, input: &StepInput, statics: &Statics, detection: Detection) -> Result<FlatStep, String> {
        let begin = Instant::now();
        let pairs = self.body_pairs(input, statics);
        let culling_ms = begin.elapsed().as_secs_f64() * 1e3;

        let begin = Instant::now();
        let placed = self.place(&pairs, input, statics)?;
        let mut step = FlatStep { culling_ms, ..FlatStep::default() };
        for sides in pairs {
            let [first, second] = sides.map(|side| placed.of(side));
            step.primitive_pairs += first.len() * second.len();
            step.first_touches.push((sides, detection.first_touch(first, second)));
        }
        step.detection_ms = begin.elapsed().as_secs_f64() * 1e3;
        Ok(step)
    }

    /// The primitive pairs of a step, for a GPU.
    ///
    /// # Errors
    /// If there is a body that is neither medial nor a box.
    pub fn moving_pairs(&mut self, input: &StepInput, statics: &Statics) -> Result<Vec<gpu::MovingPair>, String> {
        let pairs = self.body_pairs(input, statics);
        let placed = self.place(&pairs, input, statics)?;
        let mut moving = Vec::new();
        for [first, second] in pairs.iter().map(|sides| sides.map(|side| placed.of(side))) {
            for a in first {
                moving
                    .extend(second.iter().map(|b| for_primitives!(Primitive: a, b, |a, b| gpu::MovingPair::new(a, b))));
            }
        }
        Ok(moving)
    }

    /// Places the primitives of all sides of some pairs.
    fn place(&mut self, pairs: &[[Side; 2]], input: &StepInput, statics: &Statics) -> Result<Placed, String> {
        let mut placed = Placed { bodies: vec![None; input.bodies.len()], statics: vec![None; statics.bodies().len()] };
        // Coordinates are relative to the first body.
        let origin = input.bodies.first().map_or(Vec3::ZERO, |body| body.sweep.start.translation);
        for &side in pairs.as_flattened() {
            let (known, solid, sweep) = match side {
                Side::Body(i) => {
                    let body = &input.bodies[i as usize];
                    (&mut placed.bodies[i as usize], &body.solid, body.sweep)
                }
                Side::Static(i) => {
                    let body = &statics.bodies()[i as usize];
                    let pose = if body.solid.medial().is_some() { body.pose } else { body.obb().pose };
                    (&mut placed.statics[i as usize], &body.solid, Sweep::at_rest(pose))
                }
            };
            if known.is_none() {
                *known = Some(self.primitives(solid, &sweep, origin)?);
            }
        }
        Ok(placed)
    }

    /// The pairs whose swept bounding spheres overlap, or overlap the box of a static.
    fn body_pairs(&mut self, input: &StepInput, statics: &Statics) -> Vec<[Side; 2]> {
        if self.statics.leaves().count() != statics.bodies().len() {
            self.statics = Bvh::new(&statics.bodies().iter().map(|body| body.obb().aabb()).collect::<Vec<_>>());
        }
        let cones: Vec<[Sphere; 2]> = input
            .bodies
            .iter()
            .map(|body| {
                let bound = body.solid.bounding_sphere();
                [&body.sweep.start, &body.sweep.end]
                    .map(|pose| Sphere::new(pose.transform_point(bound.center), bound.radius))
            })
            .collect();
        let mut pairs = Vec::new();
        for (i, (body, cone)) in input.bodies.iter().zip(&cones).enumerate() {
            for (j, other) in cones.iter().enumerate().skip(i + 1) {
                let active = body.active || input.bodies[j].active;
                if active && separation(cone, other, 0).distance <= 0.0 {
                    pairs.push([Side::Body(i as u32), Side::Body(j as u32)]);
                }
            }
            if body.active {
                self.statics.overlapping(&Aabb::from_spheres(*cone), |item| {
                    let obb = statics.bodies()[item as usize].obb();
                    if distance_to_box(cone, &obb) <= 0.0 {
                        pairs.push([Side::Body(i as u32), Side::Static(item)]);
                    }
                });
            }
        }
        pairs
    }

    fn primitives(&mut self, solid: &Solid, sweep: &Sweep, origin: Vec3) -> Result<Vec<Primitive>, String> {
        let shape = match solid.medial() {
            Some(shape) => Some(shape.clone()),
            None if solid.len() == 1 => self.boxes.shape(solid.aabb().half_extents()),
            None => None,
        };
        let shape = shape.ok_or("a body is neither medial nor a box")?;
        let near = |pose: &Pose3| Pose3::from_parts(pose.translation - origin, pose.rotation);
        Ok(moving_primitives(&shape, [&near(&sweep.start), &near(&sweep.end)]).collect())
    }
}

impl Detection {
    /// The first touch of any two primitives. 1 without a touch, 0 for an overlap at the start.
    fn first_touch(self, first: &[Primitive], second: &[Primitive]) -> f32 {
        if self == Detection::Lanes {
            return first_in_lanes(first, second);
        }
        let mut earliest = 1.0f32;
        for a in first {
            for b in second {
                let found = for_primitives!(Primitive: a, b, |a, b| match self {
                    Detection::Alternating => alternating(a, b),
                    _ => time_of_impact(a, b, 1.0),
                });
                if found.status != TimeOfImpactStatus::Separated {
                    earliest = earliest.min(found.fraction);
                }
            }
        }
        earliest
    }
}

fn first_in_lanes(first: &[Primitive], second: &[Primitive]) -> f32 {
    fn of_kind<const N: usize, const M: usize>(first: &[Primitive], second: &[Primitive]) -> f32 {
        let seconds: Vec<_> = second.iter().filter_map(Primitive::moving::<M>).collect();
        let pairs: Vec<MovingPair<N, M>> = (first.iter().filter_map(Primitive::moving::<N>))
            .flat_map(|first| seconds.iter().map(move |second| (first, *second)))
            .collect();
        let touches = times_of_impact(&pairs, 1.0);
        let hits = touches.iter().filter(|touch| touch.status != TimeOfImpactStatus::Separated);
        hits.map(|touch| touch.fraction).fold(1.0, f32::min)
    }
    let kinds = [
        of_kind::<1, 1>,
        of_kind::<1, 2>,
        of_kind::<1, 3>,
        of_kind::<2, 1>,
        of_kind::<2, 2>,
        of_kind::<2, 3>,
        of_kind::<3, 1>,
        of_kind::<3, 2>,
        of_kind::<3, 3>,
    ];
    kinds.iter().map(|of_kind| of_kind(first, second)).fold(1.0, f32::min)
}
