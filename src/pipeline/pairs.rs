//! Pairs of bodies and of their primitives, as passed from stage to stage.

use super::Side;

/// Index of a primitive of the first body, and of a primitive of the second. The second index is 0 for a part of another collider.
pub(super) type PrimitivePair = [u32; 2];

/// A body pair. The first side is medial.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct BodyPair {
    pub first: Side,
    pub second: Side,
    /// True if the bodies stop at each other.
    pub stops: bool,
}

impl BodyPair {
    pub fn new(first: Side, second: Side) -> Self {
        Self { first, second, stops: false }
    }

    /// Returns the sides that are not static.
    pub fn bodies(&self) -> impl Iterator<Item = u32> + use<> {
        [self.first.body(), self.second.body()].into_iter().flatten()
    }
}

/// Lists of the pairs of each body.
#[derive(Debug, Default)]
pub(super) struct PairsOf {
    pairs: Vec<u32>,
    /// Start of each body's list in `pairs`; one more entry for the end.
    begins: Vec<u32>,
}

impl PairsOf {
    /// Builds the lists. `bodies`: the number of bodies.
    pub fn set(&mut self, bodies: usize, pairs: &[BodyPair]) {
        let Self { pairs: sorted, begins } = self;
        // Counting sort. Counts are shifted by two entries, because filling the lists moves each start to the end of its list.
        begins.clear();
        begins.resize(bodies + 2, 0);
        pairs.iter().flat_map(BodyPair::bodies).for_each(|body| begins[body as usize + 2] += 1);
        (1..begins.len()).for_each(|i| begins[i] += begins[i - 1]);
        sorted.clear();
        sorted.resize(begins[bodies + 1] as usize, 0);
        for (i, pair) in (0..).zip(pairs) {
            for body in pair.bodies() {
                let place = &mut begins[body as usize + 1];
                sorted[*place as usize] = i;
                *place += 1;
            }
        }
    }

    /// Returns the indices of a body's pairs, in ascending order.
    pub fn of(&self, body: u32) -> impl Iterator<Item = usize> {
        let [begin, end] = [0, 1].map(|i| self.begins[body as usize + i] as usize);
        self.pairs[begin..end].iter().map(|&pair| pair as usize)
    }
}
