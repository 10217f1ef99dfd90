//! Joint islands: all shapes of one rigid body, and all rigid bodies that joints connect to it.

use super::StepInput;

/// Pairs of joint island and body, sorted. Bodies of one joint island stop together.
#[derive(Debug, Default)]
pub(super) struct JointIslands(Vec<(u64, u32)>);

impl JointIslands {
    /// Sets the joint islands from the bodies of a step that stop at impacts.
    pub fn set(&mut self, input: &StepInput) {
        self.0.clear();
        let stopping = (0..).zip(&input.bodies).filter(|(_, body)| body.stops);
        self.0.extend(stopping.filter_map(|(index, body)| Some((body.joint_island?, index))));
        self.0.sort_unstable();
    }

    /// Returns the members of each joint island.
    pub fn iter(&self) -> impl Iterator<Item = &[(u64, u32)]> {
        self.0.chunk_by(|a, b| a.0 == b.0)
    }

    /// Returns the bodies of the joint island of `body`, including `body` itself.
    pub fn of(&self, input: &StepInput, body: u32) -> impl Iterator<Item = u32> {
        let joint_island = input.bodies[body as usize].joint_island;
        let begin = joint_island.map_or(0, |joint_island| self.0.partition_point(|(other, _)| *other < joint_island));
        let members = self.0[begin..].iter().take_while(move |(other, _)| Some(*other) == joint_island);
        members.map(|(_, body)| *body).chain(joint_island.is_none().then_some(body))
    }
}
