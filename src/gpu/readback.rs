//! What the passes have found, as it lies in a buffer that is read back: counters, pairs, survivors, times.

use bytemuck::{Pod, pod_collect_to_vec};

use super::{
    GpuCapacity,
    layout::{Counters, Pair, STATIC, Survivor, UNKNOWN},
};
use crate::pipeline::{Candidates, Side};

/// What is on its way from the GPU.
pub(crate) struct Batch {
    pub staging: wgpu::Buffer,
    /// Bytes of it that are of use.
    pub bytes: u64,
    pub(super) room: Room,
    /// What the passes had room for.
    pub(super) capacity: GpuCapacity,
    /// Passes in the order of their times.
    pub(super) labels: Vec<&'static str>,
}

/// For how many pairs and survivors there is room.
#[derive(Clone, Copy)]
pub(super) struct Room {
    pub pairs: u32,
    pub survivors: u32,
}

impl Room {
    /// Where the pairs begin, in bytes.
    pub const PAIRS_AT: u64 = size_of::<Counters>() as u64;

    /// A quarter more than what there is now.
    pub fn for_counts(counts: &Counters) -> Self {
        let [pairs, survivors] =
            [counts.pairs, counts.survivors].map(|count| (count + count / 4).next_multiple_of(256));
        Self { pairs, survivors }
    }

    /// Room for what is expected after a step that took `now`. It goes down slowly: what does not fit is looked for once more.
    pub fn followed_by(self, now: Self) -> Self {
        let most = |before: u32, now: u32| now.max(before - before / 16);
        Self { pairs: most(self.pairs, now.pairs), survivors: most(self.survivors, now.survivors) }
    }

    /// Where the survivors begin.
    pub fn survivors_at(self) -> u64 {
        Self::PAIRS_AT + u64::from(self.pairs) * size_of::<Pair>() as u64
    }

    /// Where the times of the passes begin.
    pub fn times_at(self) -> u64 {
        self.survivors_at() + u64::from(self.survivors) * size_of::<Survivor>() as u64
    }

    /// What the passes have counted.
    pub fn counts(data: &[u8]) -> Counters {
        list(data, 0, 1)[0]
    }

    /// The pairs that were found, with their primitives, all in ascending order; nothing if there was no room for all. The GPU's invocations
    /// come in any order.
    pub fn candidates(self, data: &[u8]) -> Option<Vec<Candidates>> {
        let counts = Self::counts(data);
        if counts.pairs > self.pairs || counts.survivors > self.survivors {
            return None;
        }
        let mut found: Vec<Candidates> =
            list(data, Self::PAIRS_AT, counts.pairs).iter().map(Pair::candidates).collect();
        for survivor in list::<Survivor>(data, self.survivors_at(), counts.survivors) {
            if let Some(primitives) = &mut found[survivor.pair as usize].primitives {
                primitives.push([survivor.first, survivor.second]);
            }
        }
        for primitives in found.iter_mut().filter_map(|pair| pair.primitives.as_mut()) {
            primitives.sort_unstable();
            // Those that meet along several chords.
            primitives.dedup();
        }
        found.sort_unstable_by_key(|pair| pair.sides);
        Some(found)
    }
}

impl Pair {
    /// The pair, as yet without primitives.
    fn candidates(&self) -> Candidates {
        let index = self.second & !(STATIC | UNKNOWN);
        let second = if self.second & STATIC == 0 { Side::Body(index) } else { Side::Static(index) };
        let primitives = if self.second & UNKNOWN == 0 { Some(Vec::new()) } else { None };
        Candidates { sides: [Side::Body(self.first), second], primitives }
    }
}

/// Elements of a list that begins at a byte.
fn list<T: Pod>(data: &[u8], at: u64, count: u32) -> Vec<T> {
    pod_collect_to_vec(&data[at as usize..][..count as usize * size_of::<T>()])
}
