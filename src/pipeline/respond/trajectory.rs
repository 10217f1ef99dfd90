//! Motions of bodies after their impacts within the step.

use glam::Vec3;

use crate::{
    geometry::{Pose3, Sweep},
    pipeline::{Side, StepInput, pairs::BodyPair},
};

/// The state of a body within the step. A body only ever changes to a later state.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(in crate::pipeline) enum State {
    /// The body follows its own path.
    Free,
    /// The body rests where an impact has stopped it.
    Stopped,
    /// A kinematic body pushes the body, directly or through others.
    Pushed,
    /// The body was pushed against an obstacle and rests there.
    Wedged,
}

/// The motion of a body after an impact.
#[derive(Clone, Copy, Debug)]
pub(in crate::pipeline) struct Trajectory {
    /// Time of the impact, as a fraction of the step.
    pub from: f32,
    /// Motion over the rest of the step.
    pub rest: Sweep,
    /// State of the body after the impact.
    pub state: State,
    /// Total length of the pushes of the body in the step, in metres.
    pub pushed: f32,
    /// Upper limit of that length, in metres: the pusher's own points move no farther.
    pub push_reach: f32,
}

/// The trajectories of the bodies that have left their own paths.
#[derive(Debug, Default)]
pub(in crate::pipeline) struct Trajectories {
    trajectories: Vec<Trajectory>,
    /// Index of each body's trajectory, or [`NONE`].
    of: Vec<u32>,
}

const NONE: u32 = u32::MAX;

impl Trajectories {
    /// Puts all bodies on their own paths. `bodies`: the number of bodies.
    pub(in crate::pipeline) fn reset(&mut self, bodies: usize) {
        self.trajectories.clear();
        self.of.clear();
        self.of.resize(bodies, NONE);
    }

    pub(in crate::pipeline) fn get(&self, body: u32) -> Option<&Trajectory> {
        // NONE is out of range.
        self.trajectories.get(self.of[body as usize] as usize)
    }

    pub(in crate::pipeline) fn set(&mut self, body: u32, trajectory: Trajectory) {
        let of = &mut self.of[body as usize];
        match self.trajectories.get_mut(*of as usize) {
            Some(known) => *known = trajectory,
            None => {
                *of = self.trajectories.len() as u32;
                self.trajectories.push(trajectory);
            }
        }
    }

    pub(in crate::pipeline) fn state(&self, body: u32) -> State {
        self.get(body).map_or(State::Free, |trajectory| trajectory.state)
    }

    /// Returns the total length of the pushes of a body in the step, in metres.
    pub(in crate::pipeline) fn pushed(&self, body: u32) -> f32 {
        self.get(body).map_or(0.0, |trajectory| trajectory.pushed)
    }

    /// Returns how far a pusher can move other bodies, in metres. A pusher is a kinematic body or a pushed body.
    pub(in crate::pipeline) fn push_reach(&self, input: &StepInput, body: u32) -> f32 {
        self.get(body).map_or_else(|| input.bodies[body as usize].push_reach(), |trajectory| trajectory.push_reach)
    }

    /// Returns the pose of a body at the end of the step.
    pub fn final_pose(&self, input: &StepInput, body: u32) -> Pose3 {
        self.get(body).map_or(input.bodies[body as usize].sweep.end, |trajectory| trajectory.rest.end)
    }

    /// Returns the fraction of the step for which a body has moved: less than 1 for a body that an impact has stopped.
    pub fn moved_until(&self, body: u32) -> f32 {
        self.get(body).filter(|trajectory| trajectory.state != State::Pushed).map_or(1.0, |trajectory| trajectory.from)
    }

    /// Returns true if a body leaves its own path.
    pub fn leaves_path(&self, body: u32) -> bool {
        self.get(body).is_some()
    }

    /// Returns the bodies that leave their own paths, in ascending order.
    pub fn bodies(&self) -> impl Iterator<Item = u32> + '_ {
        (0..self.of.len() as u32).filter(|&body| self.leaves_path(body))
    }

    /// Returns the fraction of the step from which a pair has to be searched again, because one of its bodies has left its path before the fraction `impact`.
    pub(in crate::pipeline) fn searched_from(&self, pair: &BodyPair, impact: f32) -> Option<f32> {
        let from = pair.bodies().filter_map(|body| self.get(body)).map(|trajectory| trajectory.from);
        let [first, last] = from.fold([f32::INFINITY, 0.0], |[first, last], from| [from.min(first), from.max(last)]);
        (first < impact && first <= last).then_some(last)
    }

    /// Returns the fractions of its own path between which a body moves from `fraction` on. `None` for a pushed or wedged body, because it is off its path.
    pub(in crate::pipeline) fn times(&self, side: Side, fraction: f32) -> Option<[f32; 2]> {
        let end = side.body().map_or(Some(1.0), |body| self.path_end(body))?;
        Some([fraction.min(end), end])
    }

    /// Returns the fraction of its own path at which a body ends the step. `None` for a pushed or wedged body, because it is off its path.
    pub fn path_end(&self, body: u32) -> Option<f32> {
        match self.get(body) {
            None => Some(1.0),
            Some(Trajectory { state: State::Stopped, from, .. }) => Some(*from),
            Some(_) => None,
        }
    }

    /// Returns the motion of a body from a fraction of the step on.
    pub(in crate::pipeline) fn sweep_from(&self, input: &StepInput, body: u32, fraction: f32) -> Sweep {
        match self.get(body) {
            Some(trajectory) if fraction > trajectory.from => {
                trajectory.rest.rest_from((fraction - trajectory.from) / (1.0 - trajectory.from))
            }
            Some(trajectory) => trajectory.rest,
            None => input.bodies[body as usize].sweep.rest_from(fraction),
        }
    }
}

/// Returns the displacement of a point that moves with a body, in metres.
pub(in crate::pipeline) fn displacement_at(sweep: &Sweep, point: Vec3) -> Vec3 {
    sweep.end.transform_point(sweep.start.inverse_transform_point(point)) - point
}

/// Returns the motion with an additional displacement at its end, in metres.
pub(in crate::pipeline) fn displaced(sweep: &Sweep, more: Vec3) -> Sweep {
    let end = Pose3::from_parts(sweep.end.translation + more, sweep.end.rotation);
    Sweep { end, translation: sweep.translation + more, ..*sweep }
}
