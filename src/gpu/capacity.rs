use bevy::prelude::*;

use super::{kinds::KINDS, layout::Counters};

/// Initial capacity of the buffers, in elements. The buffers grow if a step needs more.
#[derive(Resource, Clone, Copy, Debug, PartialEq, Eq, Reflect)]
#[reflect(Resource, Default, Clone, PartialEq)]
pub struct GpuCapacity {
    /// Body pairs.
    pub pairs: u32,
    /// Chords of their motions.
    pub chords: u32,
    /// Primitive pairs that the mid phase leaves, by kind: two cones, a cone and a slab, two slabs, a cone and a box, a slab and a box.
    pub candidates: [u32; KINDS],
    /// Primitive pairs that the narrow phase leaves.
    pub survivors: u32,
}

impl Default for GpuCapacity {
    /// A few MiB in total.
    fn default() -> Self {
        Self { pairs: 1 << 12, chords: 1 << 13, candidates: [1 << 15; KINDS], survivors: 1 << 15 }
    }
}

impl GpuCapacity {
    /// Index of the first candidate of each kind, and the capacity for all candidates.
    pub(super) fn candidate_begins(&self) -> [u64; KINDS + 1] {
        let mut begins = [0; KINDS + 1];
        for (kind, count) in self.candidates.into_iter().enumerate() {
            begins[kind + 1] = begins[kind] + u64::from(count);
        }
        begins
    }

    /// The larger capacity of both, for each buffer.
    pub(super) fn max(self, other: Self) -> Self {
        Self {
            pairs: self.pairs.max(other.pairs),
            chords: self.chords.max(other.chords),
            candidates: std::array::from_fn(|kind| self.candidates[kind].max(other.candidates[kind])),
            survivors: self.survivors.max(other.survivors),
        }
    }

    /// Returns a capacity of twice the counts that do not fit into this one. `None` if all fit.
    pub(super) fn for_counts(&self, counts: &Counters) -> Option<Self> {
        let larger = |room: u32, count: u32| if count > room { count.saturating_mul(2) } else { room };
        let needed = Self {
            pairs: larger(self.pairs, counts.pairs),
            chords: larger(self.chords, counts.chords),
            candidates: std::array::from_fn(|kind| larger(self.candidates[kind], counts.candidates[kind])),
            survivors: larger(self.survivors, counts.survivors),
        };
        (needed != *self).then_some(needed)
    }
}
