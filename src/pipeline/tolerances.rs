//! Overlaps that impacts leave to the solver, as functions of a few lengths of a pair.

use super::{Statics, StepInput, pairs::BodyPair};
use crate::constants::{CHORD_TOLERANCE, CORE_FRACTION, KNOWN_OVERLAP, LINEAR_SLOP};

/// Returns the overlap that the solver leaves at a contact at rest, in metres. `size`: bounding radius of the body, or of the smaller
/// one of a pair, in metres.
pub(super) fn slop(length_unit: f32, size: f32) -> f32 {
    (LINEAR_SLOP * length_unit).min(KNOWN_OVERLAP * size)
}

/// Lengths of a pair of bodies, in metres.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tolerances {
    /// Bounding radius of the smaller body.
    pub size: f32,
    /// Distance at which the bodies are in touch.
    pub touch: f32,
    /// Overlap that the solver leaves at a contact at rest.
    slop: f32,
    /// Overlap that a contact may gain in addition, because the bodies turn and the solver moves the points of a contact on lines.
    turning: f32,
    /// Per side, difference of the radii of primitive and core, if the primitive is thick enough.
    core_depths: [f32; 2],
    /// Overlap up to which the solver handles contacts that it had in the last step.
    known_limit: f32,
}

impl Tolerances {
    /// Returns the tolerances of a pair. `size`: bounding radius of the smaller body, in metres. `turning`: largest distance in metres between the end of a
    /// point's path and the end of the line that it begins on, summed over both bodies.
    pub fn new(input: &StepInput, statics: &Statics, pair: &BodyPair, size: f32, turning: f32) -> Self {
        let touch = LINEAR_SLOP * input.length_unit;
        let bodies = || pair.bodies().map(|body| &input.bodies[body as usize]);
        // In long steps gravity moves bodies farther between two solves.
        let fall = bodies().filter_map(|body| body.next_displacement).map(|next| next.fall).fold(0.0, f32::max);
        let core_depths = [pair.first, pair.second].map(|side| size * input.core_depth(statics, side));
        Self {
            size,
            touch,
            slop: slop(input.length_unit, size),
            turning: turning.min(core_depths[0] + core_depths[1]),
            core_depths,
            known_limit: (12.0 * touch).max(KNOWN_OVERLAP * size).max(fall),
        }
    }

    /// Returns true if a path of this length is too short for an impact, because no overlap can grow by more than the slop. `path`: in metres.
    pub fn is_short(&self, path: f32) -> bool {
        path <= self.slop
    }

    /// Returns the deviation of points from their chords that is small enough, in metres.
    pub fn chord_deviation(&self) -> f32 {
        CHORD_TOLERANCE * self.size
    }

    /// Returns the distance within which primitives are candidates, along a chord, in metres.
    pub fn reach(&self) -> f32 {
        (2.0 * self.chord_deviation()).max(self.touch)
    }

    /// Uses surfaces instead of cores, and no slop: any growth of an overlap is an impact.
    pub fn use_surfaces(&mut self) {
        (self.core_depths, self.slop, self.turning, self.known_limit) = ([0.0; 2], 0.0, 0.0, f32::INFINITY);
    }

    /// Returns the overlap at which the cores of two primitives touch, in metres.
    ///
    /// A core has the same centres as its primitive and smaller radii. The difference is [`CORE_FRACTION`] of the primitive's smallest radius, or the core
    /// depth of the side if that is less. `radii`: the smallest radius of each primitive; 0 for a part of another collider, because it has no core.
    pub fn core_overlap(&self, radii: [f32; 2]) -> f32 {
        let core = |side: usize| (CORE_FRACTION * radii[side]).min(self.core_depths[side]);
        core(0) + core(1)
    }

    /// Returns the overlap up to which the solver handles the contact of two primitives, in metres. The bodies were in touch at the start of the step.
    ///
    /// `thickness`: summed thickness of both primitives. `overlap`: overlap of both primitives at the start of the step. `deepest`: largest overlap of any
    /// primitives of the bodies at that time. It counts because a sliding body meets the next primitives at the same depth.
    ///
    /// The result is the deepest overlap plus the slop and the part for turning, up to [`Self::known_limit`]. Other primitives of bodies that overlap by more may get as deep, so that the
    /// bodies can turn about each other. Bodies that overlap by more than twice the limit were spawned inside each other. They may gain that much in each step, so
    /// that they can come apart.
    ///
    /// Thin primitives gain at most a fraction of their thickness, because a contact beyond their middle pushes to the wrong side.
    pub fn known_overlap(&self, thickness: f32, overlap: f32, deepest: f32) -> f32 {
        let thin = CORE_FRACTION * thickness;
        // Cores may be deeper than the limit.
        let spawned = (2.0 * self.known_limit).max(self.core_depths[0] + self.core_depths[1] + self.slop);
        if deepest > spawned {
            return overlap + spawned.min(thin);
        }
        let limit = self.known_limit.max(deepest);
        (deepest + (self.slop + self.turning).min(thin)).min(limit.min(2.0 * thin)).max(overlap)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PAIR: Tolerances =
        Tolerances { size: 0.5, touch: 1e-3, slop: 1e-3, turning: 0.0, core_depths: [4e-3; 2], known_limit: 0.01 };

    #[test]
    fn cores_are_a_part_of_thin_primitives_and_absent_in_other_colliders() {
        assert_eq!(PAIR.core_overlap([0.1, 0.1]), 8e-3);
        assert_eq!(PAIR.core_overlap([0.01, 0.1]), CORE_FRACTION * 0.01 + 4e-3);
        assert_eq!(PAIR.core_overlap([0.1, 0.0]), 4e-3);
    }

    #[test]
    fn known_contacts_gain_a_slop_a_step_up_to_a_limit() {
        let known = |deepest: f32| PAIR.known_overlap(0.2, 0.0, deepest);
        assert_eq!([0.0, 0.005, 0.0095].map(known), [1e-3, 0.005 + 1e-3, 0.01]);
        let turning = Tolerances { turning: 3e-3, ..PAIR };
        assert_eq!(turning.known_overlap(0.2, 0.0, 0.005), 0.005 + 4e-3);
        assert_eq!(turning.known_overlap(0.2, 0.0, 0.0095), 0.01);
        assert!(!turning.is_short(2e-3), "turning does not excuse pairs that are apart from a search");
        // No overlap is limited to less than the deepest one.
        assert_eq!(known(0.012), 0.012);
        // The result is never less than the overlap at the start.
        assert_eq!(PAIR.known_overlap(0.2, 0.012, 0.012), 0.012);
    }

    #[test]
    fn bodies_that_were_put_into_each_other_may_come_apart() {
        assert_eq!(PAIR.known_overlap(0.2, 0.05, 0.05), 0.07);
        assert_eq!(PAIR.known_overlap(0.2, 0.0, 0.05), 0.02);
        // Deep cores overlap as far without being spawned inside each other.
        let deep = Tolerances { core_depths: [0.03; 2], ..PAIR };
        assert_eq!(deep.known_overlap(0.2, 0.05, 0.05), 0.05);
    }

    #[test]
    fn thin_primitives_gain_less_than_their_thickness() {
        let thickness = 1e-3;
        assert!(PAIR.known_overlap(thickness, 0.0, 0.0) < 0.5 * thickness);
        assert!(PAIR.known_overlap(thickness, 0.0, 5e-3) < thickness);
        assert!(PAIR.known_overlap(thickness, 0.0, 0.1) < 0.5 * thickness);
    }
}
