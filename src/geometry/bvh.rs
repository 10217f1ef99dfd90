use arrayvec::ArrayVec;

use super::Aabb;

/// Bounding volume hierarchy of boxes: one item a leaf, balanced, flat.
///
/// Nodes lie in depth-first order, so the left child follows its parent and the tree of `n` items has `2 n - 1` nodes
/// and a depth of at most 33.
#[derive(Clone, Debug, Default)]
pub struct Bvh {
    nodes: Vec<Node>,
}

#[derive(Clone, Copy, Debug)]
struct Node {
    aabb: Aabb,
    /// Right child, or `LEAF` plus the item.
    link: u32,
}

const LEAF: u32 = 1 << 31;
const MAX_DEPTH: usize = 34;

impl Node {
    fn item(&self) -> Option<u32> {
        (self.link & LEAF != 0).then_some(self.link & !LEAF)
    }
}

impl Bvh {
    /// A hierarchy over `boxes`, whose positions in the slice are the items.
    pub fn new(boxes: &[Aabb]) -> Self {
        let mut bvh = Self::default();
        bvh.rebuild(boxes);
        bvh
    }

    /// The same without new allocations once the hierarchy has been as large.
    pub fn rebuild(&mut self, boxes: &[Aabb]) {
        self.nodes.clear();
        if boxes.is_empty() {
            return;
        }
        let mut items: Vec<u32> = (0..boxes.len() as u32).collect();
        self.build(boxes, &mut items);
    }

    /// Splits at the median along the axis in which the centres spread most.
    fn build(&mut self, boxes: &[Aabb], items: &mut [u32]) {
        let node = self.nodes.len();
        if let [item] = *items {
            self.nodes.push(Node { aabb: boxes[item as usize], link: LEAF | item });
            return;
        }
        let centers = items.iter().map(|&i| boxes[i as usize].center());
        let spread = centers.fold(Aabb::EMPTY, |aabb, c| aabb.merge(Aabb { min: c, max: c })).half_extents();
        let axis = spread.max_position();
        let middle = items.len() / 2;
        // Ties by index: the tree depends on nothing but the boxes.
        items.select_nth_unstable_by(middle, |&a, &b| {
            let key = |i: u32| boxes[i as usize].center()[axis];
            key(a).total_cmp(&key(b)).then(a.cmp(&b))
        });
        let (left, right) = items.split_at_mut(middle);
        self.nodes.push(Node { aabb: Aabb::EMPTY, link: 0 });
        self.build(boxes, left);
        let right_child = self.nodes.len();
        self.build(boxes, right);
        let aabb = self.nodes[node + 1].aabb.merge(self.nodes[right_child].aabb);
        self.nodes[node] = Node { aabb, link: right_child as u32 };
    }

    /// The box around all items.
    pub fn aabb(&self) -> Aabb {
        self.nodes.first().map_or(Aabb::EMPTY, |root| root.aabb)
    }

    /// Calls `visit` with every item whose box and whose ancestors' boxes pass `test`.
    pub fn visit(&self, mut test: impl FnMut(&Aabb) -> bool, mut visit: impl FnMut(u32)) {
        if self.nodes.is_empty() {
            return;
        }
        let mut stack = Stack::<u32>::from_iter([0]);
        while let Some(index) = stack.pop() {
            let node = &self.nodes[index as usize];
            if !test(&node.aabb) {
                continue;
            }
            match node.item() {
                Some(item) => visit(item),
                None => {
                    stack.push(node.link);
                    stack.push(index + 1);
                }
            }
        }
    }

    /// The item of least cost with its cost; none if there are no items.
    ///
    /// `bound` of a box must not exceed the `cost` of an item in it. Nearer boxes come first, and those whose bound is no less than the best cost
    /// so far are left out.
    pub fn least(&self, mut bound: impl FnMut(&Aabb) -> f32, mut cost: impl FnMut(u32) -> f32) -> Option<(u32, f32)> {
        let root = self.nodes.first()?;
        let mut best: Option<(u32, f32)> = None;
        let mut stack = Stack::from_iter([(0, bound(&root.aabb))]);
        while let Some((index, least)) = stack.pop() {
            if best.is_some_and(|(_, best)| least >= best) {
                continue;
            }
            let node = &self.nodes[index as usize];
            match node.item() {
                Some(item) => {
                    let cost = cost(item);
                    if best.is_none_or(|(_, best)| cost < best) {
                        best = Some((item, cost));
                    }
                }
                None => {
                    let [left, right] = [index + 1, node.link].map(|i| (i, bound(&self.nodes[i as usize].aabb)));
                    let (near, far) = if right.1 < left.1 { (right, left) } else { (left, right) };
                    stack.push(far);
                    stack.push(near);
                }
            }
        }
        best
    }

    /// Calls `visit` with every pair of items, one of each tree, whose boxes and ancestors' boxes pass `test`.
    ///
    /// `place1` and `place2` take the boxes of this tree and of the other to where they are compared.
    pub fn visit_pairs<A: Copy, B: Copy>(
        &self,
        other: &Bvh,
        place1: impl Fn(&Aabb) -> A,
        place2: impl Fn(&Aabb) -> B,
        test: impl Fn(&A, &B) -> bool,
        mut visit: impl FnMut(u32, u32),
    ) {
        let (Some(root1), Some(root2)) = (self.nodes.first(), other.nodes.first()) else { return };
        let mut stack = Stack::from_iter([((0, place1(&root1.aabb)), (0, place2(&root2.aabb)))]);
        while let Some(((index1, placed1), (index2, placed2))) = stack.pop() {
            if !test(&placed1, &placed2) {
                continue;
            }
            let (node1, node2) = (&self.nodes[index1 as usize], &other.nodes[index2 as usize]);
            match (node1.item(), node2.item()) {
                (Some(item1), Some(item2)) => visit(item1, item2),
                (None, item2) if item2.is_some() || node1.aabb.extent_squared() >= node2.aabb.extent_squared() => {
                    for child in [node1.link, index1 + 1] {
                        let placed1 = place1(&self.nodes[child as usize].aabb);
                        stack.push(((child, placed1), (index2, placed2)));
                    }
                }
                _ => {
                    for child in [node2.link, index2 + 1] {
                        let placed2 = place2(&other.nodes[child as usize].aabb);
                        stack.push(((index1, placed1), (child, placed2)));
                    }
                }
            }
        }
    }
}

/// A stack that never allocates: every level of either tree leaves at most one node waiting.
type Stack<T> = ArrayVec<T, { 2 * MAX_DEPTH }>;

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    /// Boxes of mixed sizes at places from a fixed sequence.
    fn boxes(count: u32, seed: u32) -> Vec<Aabb> {
        let mut state = seed;
        let mut next = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 24) as f32
        };
        (0..count)
            .map(|_| {
                let min = Vec3::new(next(), next(), next()) * 8.0;
                Aabb { min, max: min + Vec3::new(next(), next(), next()) * 4.0 }
            })
            .collect()
    }

    #[test]
    fn visits_what_brute_force_finds() {
        let mut found = 0;
        for count in [0, 1, 2, 3, 17, 200] {
            let items = boxes(count, count);
            let bvh = Bvh::new(&items);
            for query in boxes(50, 7) {
                let mut visited = Vec::new();
                bvh.visit(|aabb| aabb.overlaps(&query), |item| visited.push(item));
                visited.sort_unstable();
                let expected: Vec<u32> = (0..count).filter(|&i| items[i as usize].overlaps(&query)).collect();
                assert_eq!(visited, expected);
                found += expected.len();
            }
        }
        assert!(found > 500, "only {found} overlaps: the queries miss");
    }

    #[test]
    fn the_least_item_is_the_one_of_brute_force() {
        let mut visited = 0;
        for count in [0, 1, 2, 3, 17, 200] {
            let items = boxes(count, count);
            let bvh = Bvh::new(&items);
            for query in boxes(50, 7) {
                let distance = |item: u32| items[item as usize].center().distance(query.min);
                let cost = |item: u32| {
                    visited += 1;
                    distance(item)
                };
                let found = bvh.least(|aabb| aabb.distance(query.min), cost).map(|(_, distance)| distance);
                assert_eq!(found, (0..count).map(distance).reduce(f32::min));
            }
        }
        assert!(visited < 50 * 223 / 2, "{visited} items visited: nothing is left out");
    }

    #[test]
    fn visits_each_overlapping_pair_once() {
        let mut found = 0;
        for (count1, count2) in [(0, 5), (1, 1), (1, 90), (130, 1), (64, 65)] {
            let (items1, items2) = (boxes(count1, 3), boxes(count2, 4));
            let mut visited = Vec::new();
            let shifted = |aabb: &Aabb| aabb.swept(Vec3::X, [1.0, 1.0]);
            Bvh::new(&items1).visit_pairs(&Bvh::new(&items2), shifted, shifted, Aabb::overlaps, |i, j| {
                visited.push((i, j));
            });
            visited.sort_unstable();
            let all = (0..count1).flat_map(|i| (0..count2).map(move |j| (i, j)));
            let expected: Vec<_> = all.filter(|&(i, j)| items1[i as usize].overlaps(&items2[j as usize])).collect();
            assert_eq!(visited, expected);
            found += expected.len();
        }
        assert!(found > 100, "only {found} overlaps");
    }
}
