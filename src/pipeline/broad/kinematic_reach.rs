//! Bounds for pushes: kinematic bodies, and bodies that they push, move other bodies off their paths.

use super::may_collide;
use crate::{
    geometry::{Aabb, Sphere},
    pipeline::{Body, Side, StepInput, joint_islands::JointIslands},
};

/// Upper bounds of the displacement of each body by pushes.
#[derive(Debug, Default)]
pub(crate) struct KinematicReach {
    /// Per body, how far it can push a body that it hits, or be pushed itself, in metres.
    pushes: Vec<f32>,
    /// Per body, the largest rotation of the bodies that may push it, in radians. At most 2, because no chord of a turn is longer than twice the arm.
    /// Empty if no body pushes; the fields below are not used then.
    turns: Vec<f32>,
    /// Joined bodies are pushed together.
    joint_islands: JointIslands,
    /// Per body, the diagonal of the box around its joint island, in metres; 0 for a body without joints.
    spans: Vec<f32>,
}

impl KinematicReach {
    pub fn new(input: &StepInput) -> Self {
        let mut new = Self::default();
        new.reset(input);
        new
    }

    /// Resets to the state in which no pair is known.
    pub(super) fn reset(&mut self, input: &StepInput) {
        let pushes = |body: &Body| {
            if body.stops || body.passes { 0.0 } else { body.push_reach() }
        };
        self.pushes.clear();
        self.pushes.extend(input.bodies.iter().map(pushes));
        self.turns.clear();
        if self.pushes.iter().all(|&push| push == 0.0) {
            return;
        }
        let turn = |(body, &push): (&Body, &f32)| if push > 0.0 { body.sweep.rotation.length().min(2.0) } else { 0.0 };
        self.turns.extend(input.bodies.iter().zip(&self.pushes).map(turn));
        self.spans.clear();
        self.spans.resize(input.bodies.len(), 0.0);
        self.joint_islands.set(input);
        for members in self.joint_islands.iter().filter(|members| members.len() > 1) {
            let sphere = |body: u32| {
                let Body { solid, sweep, .. } = &input.bodies[body as usize];
                let Sphere { center, radius } = solid.bounding_sphere();
                Sphere::new(sweep.start.transform_point(center), radius)
            };
            let around = Aabb::from_spheres(members.iter().map(|&(_, body)| sphere(body)));
            members.iter().for_each(|&(_, body)| self.spans[body as usize] = 2.0 * around.half_extents().length());
        }
    }

    pub(super) fn has_pushers(&self) -> bool {
        !self.turns.is_empty()
    }

    /// Returns the margin around the swept bounding sphere within which a body may meet another one, in metres. Each body of a pair takes half of the
    /// prediction distance.
    pub fn margin(&self, input: &StepInput, body: usize) -> f32 {
        let turn = self.turns.get(body).map_or(0.0, |turn| turn * self.spans[body]);
        0.5 * input.prediction + self.pushed(input, body) + turn
    }

    /// Returns how far a body may be pushed off its path, in metres.
    fn pushed(&self, input: &StepInput, body: usize) -> f32 {
        if input.bodies[body].stops { self.pushes[body] } else { 0.0 }
    }

    /// Returns true if pairs of this body are searched. A sleeping body counts if it may be pushed, because it may then hit other resting bodies.
    pub fn is_awake(&self, input: &StepInput, body: usize) -> bool {
        input.bodies[body].active || self.is_wider(input, body)
    }

    /// Returns true if a body may be pushed off its path.
    pub fn is_wider(&self, input: &StepInput, body: usize) -> bool {
        self.pushed(input, body) > 0.0
    }

    /// Propagates pushes along the given pairs that may collide. Returns true if the reach of a body has grown, so that more pairs have to be searched.
    pub fn widen(&mut self, input: &StepInput, pairs: impl Iterator<Item = [Side; 2]> + Clone) -> bool {
        if !input.stop_at_impact || !self.has_pushers() {
            return false;
        }
        let mut wider = false;
        loop {
            let mut more = false;
            for sides in pairs.clone() {
                let [Some(a), Some(b)] = sides.map(Side::body) else { continue };
                if !may_collide(input, self, [a, b]) {
                    continue;
                }
                let [a, b] = [a, b].map(|body| body as usize);
                for (body, other) in [(a, b), (b, a)].into_iter().filter(|(body, _)| input.bodies[*body].stops) {
                    let farther = self.pushes[other] + self.beyond(input, body, other) - self.pushes[body];
                    if farther > 0.0 {
                        self.pushes[body] += farther;
                        self.turns[body] = self.turns[body].max(self.turns[other]);
                        more = true;
                    }
                }
            }
            more |= self.join(input);
            if !more {
                return wider;
            }
            wider = true;
        }
    }

    /// Gives all members of a joint island the largest push of any member. Returns true if the reach of a body has grown.
    fn join(&mut self, input: &StepInput) -> bool {
        let Self { pushes, turns, joint_islands, .. } = self;
        let mut more = false;
        for members in joint_islands.iter().filter(|members| members.len() > 1) {
            let members = members.iter().map(|&(_, body)| body as usize).filter(|&body| input.bodies[body].stops);
            let most = |values: &[f32]| {
                members.clone().filter(|&body| pushes[body] > 0.0).map(|body| values[body]).fold(0.0, f32::max)
            };
            let (push, turn) = (most(pushes), most(turns));
            for body in members {
                if pushes[body] < push {
                    pushes[body] = push;
                    turns[body] = turns[body].max(turn);
                    more = true;
                }
            }
        }
        more
    }

    /// Returns how much farther than the touched point of a pusher the points of `body` may move, because the pusher turns, in metres.
    fn beyond(&self, input: &StepInput, body: usize, pusher: usize) -> f32 {
        if input.bodies[pusher].stops {
            return 0.0;
        }
        self.turns[pusher] * 2.0 * input.bodies[body].solid.bounding_sphere().radius
    }
}
