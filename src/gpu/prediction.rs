//! Look-ahead: predicts the motion of undisturbed bodies over the next steps, so that no step waits for the GPU.
//!
//! The GPU sweeps the bodies over several steps and finds the pairs that may meet in any of them, if each body stays near its predicted path. When
//! the answer arrives, most bodies are near that path, and their pairs are valid. Bodies that have left it, are new or have changed are culled on the
//! CPU against all others. So no pair is missed.

use std::collections::HashMap;

use bevy::tasks::TaskPool;

use crate::{
    constants::{LOOK_AHEAD_SLACK, LOOK_AHEAD_STEPS},
    geometry::{Pose3, Sweep},
    pipeline::{self, Body, BoundedPair, Candidates, KinematicReach, Primitives, Side, Statics, StepInput},
};

/// Prediction of the next [`LOOK_AHEAD_STEPS`] steps.
pub struct Prediction {
    /// The bodies, with their motion over all of these steps.
    pub(crate) input: StepInput,
    pub(crate) statics: Statics,
    /// Largest deviation of each body from its path, in metres.
    slack: Vec<f32>,
    /// Index of each body by its key.
    bodies: HashMap<u64, u32>,
    /// Number of the step before the first predicted one.
    after: u64,
}

impl Prediction {
    /// Predicts the steps after a step. Each body continues its motion of that step, from its pose at the end. `keys` identify the bodies across steps. Bodies whose
    /// spheres moved are left out, because their next pose is not known.
    pub fn new(
        input: &StepInput,
        statics: &Statics,
        keys: impl Iterator<Item = u64>,
        end_of: impl Fn(u32) -> Pose3,
        number: u64,
    ) -> Self {
        let mut input = input.clone();
        for (index, body) in (0..).zip(&mut input.bodies) {
            body.sweep = continued(&body.sweep, end_of(index));
        }
        let is_rigid = |body: &Body| body.solid.deforming().is_none_or(|shape| !shape.is_moving());
        let bodies = std::mem::take(&mut input.bodies).into_iter().zip(keys);
        let (bodies, keys): (Vec<Body>, Vec<u64>) = bodies.filter(|(body, _)| is_rigid(body)).unzip();
        input.bodies = bodies;
        let slack = |body: &Body| LOOK_AHEAD_SLACK * body.solid.bounding_sphere().radius + input.prediction;
        Self {
            slack: input.bodies.iter().map(slack).collect(),
            bodies: keys.into_iter().zip(0..).collect(),
            statics: statics.clone(),
            input,
            after: number,
        }
    }

    /// Returns the number of the step before the first predicted one.
    pub fn after(&self) -> u64 {
        self.after
    }

    /// Returns the largest deviation of a body from its path, in metres.
    pub(crate) fn slack(&self, body: usize) -> f32 {
        self.slack[body]
    }

    /// Returns the pairs that may meet in a step, from those found for all predicted steps, and the number of bodies that were culled on the CPU.
    /// None if the step was not predicted, if its prediction distance is larger, or if its length unit is larger, or if statics have changed.
    pub fn candidates(
        &self,
        found: &[Candidates],
        input: &StepInput,
        statics: &Statics,
        keys: impl Iterator<Item = u64>,
        number: u64,
        pool: &TaskPool,
    ) -> Option<(Vec<Candidates>, usize)> {
        let step = u32::try_from(number.checked_sub(self.after)?).ok()?;
        let holds = statics.id() == self.statics.id()
            && input.prediction <= self.input.prediction
            && input.length_unit <= self.input.length_unit;
        if !holds || !(1..=LOOK_AHEAD_STEPS).contains(&step) {
            return None;
        }
        let mut now = vec![None; self.input.bodies.len()];
        let mut departed = vec![true; input.bodies.len()];
        for ((index, body), key) in (0..).zip(&input.bodies).zip(keys) {
            let Some(known) = self.bodies.get(&key).map(|known| *known as usize) else { continue };
            if is_same(&self.input.bodies[known], body) && self.deviation(known, body, step) <= self.slack[known] {
                departed[index as usize] = false;
                now[known] = Some(index);
            }
        }
        let side_now = |side: Side| match side {
            Side::Body(body) => now[body as usize].map(Side::Body),
            Side::Static(_) => Some(side),
        };
        let mut kept: Vec<Candidates> = found
            .iter()
            .filter_map(|Candidates { sides: [first, second], primitives }| {
                let sides = [side_now(*first)?, side_now(*second)?];
                Some(Candidates { sides, primitives: in_step(primitives, step) })
            })
            .collect();
        // A body that is pushed leaves its path.
        let mut widening = KinematicReach::new(input);
        loop {
            let is_departed = |side: &Side| side.body().is_some_and(|body| departed[body as usize]);
            kept.retain(|pair| !pair.sides.iter().any(is_departed));
            let mut near = Vec::new();
            if departed.contains(&true) {
                near = pipeline::near_sides(input, statics, &widening, pool);
                near.retain(|sides| sides.iter().any(is_departed));
            }
            if !widening.widen(input, kept.iter().map(|pair| pair.sides).chain(near.iter().copied())) {
                kept.extend(near.into_iter().map(|sides| Candidates { sides, primitives: Primitives::Unknown }));
                return Some((kept, departed.iter().filter(|departed| **departed).count()));
            }
            for (body, departed) in departed.iter_mut().enumerate() {
                *departed |= widening.is_wider(input, body);
            }
        }
    }

    /// Returns the largest distance of a point of a body from its predicted position, at any time of the step, in metres.
    fn deviation(&self, known: usize, body: &Body, step: u32) -> f32 {
        let expected = self.input.bodies[known].sweep;
        let Sweep { local_center, .. } = body.sweep;
        // The centre follows from poses in the world, with another rounding error in each step. The path of a point differs by at most twice that error.
        let shift = 2.0 * local_center.distance(expected.local_center);
        let arm = body.solid.bounding_sphere().farthest(local_center);
        let steps = LOOK_AHEAD_STEPS as f32;
        let at = |pose: &Pose3, step: u32| {
            let expected = expected.pose_at(step as f32 / steps);
            let apart = pose.transform_point(local_center) - expected.transform_point(local_center);
            let turn = (pose.rotation * expected.rotation.inverse()).xyz().length().min(1.0).asin();
            apart.length() + 2.0 * turn * arm
        };
        // Between the ends of the step, different rates add to the deviation.
        let rates = (body.sweep.rotation - expected.rotation / steps).length() * arm;
        at(&body.sweep.start, step - 1).max(at(&body.sweep.end, step)) + rates + shift
    }
}

/// Returns the primitive pairs of one of the predicted steps.
fn in_step(primitives: &Primitives, step: u32) -> Primitives {
    let Primitives::Bounded(bounded) = primitives else { return Primitives::Unknown };
    let earlier = (step - 1) as f32;
    let in_step = |pair: &BoundedPair| BoundedPair {
        touch_bound: (pair.touch_bound * LOOK_AHEAD_STEPS as f32 - earlier).max(0.0),
        is_near_at_end: true,
        ..*pair
    };
    Primitives::Bounded(bounded.iter().map(in_step).collect())
}

/// Returns a motion that continues from `start` over the predicted steps.
fn continued(sweep: &Sweep, start: Pose3) -> Sweep {
    let steps = LOOK_AHEAD_STEPS as f32;
    Sweep::at_rates(start, sweep.local_center, sweep.translation * steps, sweep.rotation * steps)
}

/// Returns true if the pairs of a body, apart from its motion, are valid for another body.
fn is_same(known: &Body, body: &Body) -> bool {
    known.solid.id() == body.solid.id()
        && (known.groups, known.rigid_body, known.world) == (body.groups, body.rigid_body, body.world)
        && (known.active || !body.active)
        && (known.stops || !body.stops)
}
