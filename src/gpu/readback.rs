//! Results of the passes in the readback buffer: counters, pairs, survivors, times.

use bytemuck::{Pod, pod_collect_to_vec};

use super::{
    GpuCapacity,
    layout::{Counters, NEAR_AT_END, Pair, STATIC, Survivor, UNKNOWN},
};
use crate::pipeline::{BoundedPair, Candidates, Primitives, Side};

/// Results that the GPU is computing.
pub(crate) struct Batch {
    pub staging: wgpu::Buffer,
    /// Number of used bytes in the buffer.
    pub bytes: u64,
    pub(super) room: Room,
    /// Capacity of the buffers that the passes write.
    pub(super) capacity: GpuCapacity,
    /// Names of the passes, in the order of their times.
    pub(super) labels: Vec<&'static str>,
}

/// Number of pairs and survivors that fit into the readback buffer.
#[derive(Clone, Copy)]
pub(super) struct Room {
    pub pairs: u32,
    pub survivors: u32,
}

impl Room {
    /// Offset of the pairs, in bytes.
    pub const PAIRS_AT: u64 = size_of::<Counters>() as u64;

    /// Room of small steps. Copying it takes less time than the round trip, and bodies that come together need it suddenly.
    pub const LEAST: Self = Self { pairs: 256, survivors: 4096 };

    /// Room for these counts and a quarter more, as a multiple of the least room.
    pub fn for_counts(counts: &Counters) -> Self {
        let room = |count: u32, least: u32| (count + count / 4).max(1).next_multiple_of(least);
        Self { pairs: room(counts.pairs, Self::LEAST.pairs), survivors: room(counts.survivors, Self::LEAST.survivors) }
    }

    /// Expected room after a step that needed `now`. It decreases slowly, because a step with too little room is culled again.
    pub fn followed_by(self, now: Self) -> Self {
        let most = |before: u32, now: u32| now.max(before - before / 16);
        Self { pairs: most(self.pairs, now.pairs), survivors: most(self.survivors, now.survivors) }
    }

    /// Offset of the survivors, in bytes.
    pub fn survivors_at(self) -> u64 {
        Self::PAIRS_AT + u64::from(self.pairs) * size_of::<Pair>() as u64
    }

    /// Offset of the times of the passes, in bytes.
    pub fn times_at(self) -> u64 {
        self.survivors_at() + u64::from(self.survivors) * size_of::<Survivor>() as u64
    }

    /// Returns the counters of the passes.
    pub fn counts(data: &[u8]) -> Counters {
        list(data, 0, 1)[0]
    }

    /// Returns the pairs with their primitives, in any order, because the invocations of the GPU finish in any order. `None` if there was not enough room.
    pub fn candidates(self, data: &[u8]) -> Option<Vec<Candidates>> {
        let counts = Self::counts(data);
        if counts.pairs > self.pairs || counts.survivors > self.survivors {
            return None;
        }
        let pairs: Vec<Pair> = list(data, Self::PAIRS_AT, counts.pairs);
        let mut found: Vec<Candidates> = pairs.iter().map(Pair::candidates).collect();
        for survivor in list::<Survivor>(data, self.survivors_at(), counts.survivors) {
            if let Primitives::Bounded(bounded) = &mut found[survivor.pair as usize].primitives {
                bounded.push(survivor.bounded());
            }
        }
        for (pair, found) in pairs.iter().zip(&mut found) {
            if let Primitives::Bounded(bounded) = &mut found.primitives
                && pair.chords > 1
            {
                join_chords(bounded);
            }
        }
        Some(found)
    }
}

/// Joins the bounds of primitives that are near along several chords.
fn join_chords(bounded: &mut Vec<BoundedPair>) {
    bounded.sort_unstable_by_key(|pair| pair.primitives);
    bounded.dedup_by(|next, pair| {
        let is_same = next.primitives == pair.primitives;
        if is_same {
            pair.touch_bound = pair.touch_bound.min(next.touch_bound);
            pair.is_near_at_end |= next.is_near_at_end;
        }
        is_same
    });
}

impl Pair {
    /// Converts the pair, without primitives.
    fn candidates(&self) -> Candidates {
        let index = self.second & !(STATIC | UNKNOWN);
        let second = if self.second & STATIC == 0 { Side::Body(index) } else { Side::Static(index) };
        let is_known = self.second & UNKNOWN == 0;
        let primitives = if is_known { Primitives::Bounded(Vec::new()) } else { Primitives::Unknown };
        Candidates { sides: [Side::Body(self.first), second], primitives }
    }
}

impl Survivor {
    fn bounded(&self) -> BoundedPair {
        BoundedPair {
            primitives: [self.first, self.second & !NEAR_AT_END],
            // Not a number counts as 0.
            touch_bound: self.touch.max(0.0),
            is_near_at_end: self.second & NEAR_AT_END != 0,
        }
    }
}

/// Returns the elements of a list that begins at an offset in bytes.
fn list<T: Pod>(data: &[u8], at: u64, count: u32) -> Vec<T> {
    pod_collect_to_vec(&data[at as usize..][..count as usize * size_of::<T>()])
}
