/// Disjoint sets (union-find) of numbered items. The smallest member identifies a set.
#[derive(Debug, Default)]
pub(crate) struct DisjointSets(Vec<u32>);

impl DisjointSets {
    /// Creates `count` sets of one item each.
    pub fn new(count: usize) -> Self {
        let mut sets = Self::default();
        sets.reset(count);
        sets
    }

    /// Becomes `count` sets of one item each. The allocation is used again.
    pub fn reset(&mut self, count: usize) {
        self.0.clear();
        self.0.extend(0..count as u32);
    }

    /// Returns the smallest member of an item's set. Each call shortens the path to it.
    pub fn find(&mut self, mut item: u32) -> u32 {
        while self.0[item as usize] != item {
            self.0[item as usize] = self.0[self.0[item as usize] as usize];
            item = self.0[item as usize];
        }
        item
    }

    /// Joins two sets. Returns false if they were the same set.
    pub fn join(&mut self, a: u32, b: u32) -> bool {
        let [a, b] = [a, b].map(|item| self.find(item));
        self.0[a.max(b) as usize] = a.min(b);
        a != b
    }
}
