//! Assemblies of joined bodies: shapes of one rigid body, and rigid bodies on joints.

use super::StepInput;

/// Pairs of assembly and body, sorted. Bodies of one assembly stop together.
#[derive(Debug, Default)]
pub(super) struct Assemblies(Vec<(u64, u32)>);

impl Assemblies {
    /// Sets the assemblies from the bodies of a step that stop at impacts.
    pub fn set(&mut self, input: &StepInput) {
        self.0.clear();
        let stopping = (0..).zip(&input.bodies).filter(|(_, body)| body.stops);
        self.0.extend(stopping.filter_map(|(index, body)| Some((body.assembly?, index))));
        self.0.sort_unstable();
    }

    /// Returns the members of each assembly.
    pub fn iter(&self) -> impl Iterator<Item = &[(u64, u32)]> {
        self.0.chunk_by(|a, b| a.0 == b.0)
    }

    /// Returns the bodies of the assembly of `body`, including `body` itself.
    pub fn of(&self, input: &StepInput, body: u32) -> impl Iterator<Item = u32> {
        let assembly = input.bodies[body as usize].assembly;
        let begin = assembly.map_or(0, |assembly| self.0.partition_point(|(other, _)| *other < assembly));
        let members = self.0[begin..].iter().take_while(move |(other, _)| Some(*other) == assembly);
        members.map(|(_, body)| *body).chain(assembly.is_none().then_some(body))
    }
}
