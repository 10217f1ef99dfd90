//! Pairs of bodies and of their primitives, as the stages hand them on.

use super::Side;

/// Indices of a primitive of the first body and one of the second; 0 for the second if that is a part.
pub(super) type PrimitivePair = [u32; 2];

/// A body pair, its first side medial.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct BodyPair {
    pub first: Side,
    pub second: Side,
    /// True if they stop at each other.
    pub stops: bool,
}

impl BodyPair {
    pub fn new(first: Side, second: Side) -> Self {
        Self { first, second, stops: false }
    }

    /// The bodies among its sides.
    pub fn bodies(&self) -> impl Iterator<Item = u32> + use<> {
        [self.first.body(), self.second.body()].into_iter().flatten()
    }
}

/// The numbers of the pairs of each body.
#[derive(Debug, Default)]
pub(super) struct PairsOf {
    pairs: Vec<u32>,
    /// Where those of a body begin; one more for the end.
    begins: Vec<u32>,
}

impl PairsOf {
    /// Becomes the lists of so many bodies.
    pub fn set(&mut self, bodies: usize, pairs: &[BodyPair]) {
        let Self { pairs: sorted, begins } = self;
        // Each pair counts for the body after the next, so that a list begins where the one before it ends once all are filled.
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

    /// The numbers of a body's pairs, in ascending order.
    pub fn of(&self, body: u32) -> impl Iterator<Item = usize> {
        let [begin, end] = [0, 1].map(|i| self.begins[body as usize + i] as usize);
        self.pairs[begin..end].iter().map(|&pair| pair as usize)
    }
}
