/// Disjoint sets of numbered items. Each is known by its least member.
#[derive(Debug, Default)]
pub(crate) struct DisjointSets(Vec<u32>);

impl DisjointSets {
    /// So many items, each by itself.
    pub fn new(count: usize) -> Self {
        let mut sets = Self::default();
        sets.reset(count);
        sets
    }

    /// The same in the memory that there is.
    pub fn reset(&mut self, count: usize) {
        self.0.clear();
        self.0.extend(0..count as u32);
    }

    /// The least member of an item's set. Ways to it get shorter each time.
    pub fn find(&mut self, mut item: u32) -> u32 {
        while self.0[item as usize] != item {
            self.0[item as usize] = self.0[self.0[item as usize] as usize];
            item = self.0[item as usize];
        }
        item
    }

    /// Joins two sets; false if they were one.
    pub fn join(&mut self, a: u32, b: u32) -> bool {
        let [a, b] = [a, b].map(|item| self.find(item));
        self.0[a.max(b) as usize] = a.min(b);
        a != b
    }
}
