use arrayvec::ArrayVec;
use bytemuck::{Pod, Zeroable};
use glam::Vec3;

use super::{Aabb, aabb::Box3A};

/// Bounding volume hierarchy of boxes in one flat list of nodes. Each leaf holds one item.
///
/// Nodes lie in depth-first order: the left child follows its parent, and the right child follows the left child's subtree. A traversal that
/// skips a subtree goes on at the node behind it. The tree of `n` items has `2 n - 1` nodes.
#[derive(Clone, Debug, Default)]
pub struct Bvh {
    nodes: Vec<Node>,
    /// The smallest search cost since the tree was built: see [`cost`](Self::cost).
    least_cost: f32,
    /// Number of refits since the tree was built.
    updates: u32,
}

/// 32 bytes: two nodes fill a cache line.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Node {
    min: Vec3,
    /// The index of the node behind the subtree; for a leaf, `LEAF` plus the item.
    link: u32,
    max: Vec3,
    _unused: u32,
}

const LEAF: u32 = 1 << 31;
/// Each child has at most three quarters of its parent's items, so a tree of `LEAF` items has at most 75 levels.
const MAX_DEPTH: usize = 80;
/// A refitted tree is built again when its search cost exceeds its smallest cost by this factor.
const MOST_COST: f32 = 1.25;
/// The tree is built again after this many refits in any case. A distant item dominates the cost, so the cost alone may not show that the others have mixed.
const MOST_UPDATES: u32 = 64;

impl Node {
    fn new(Aabb { min, max }: Aabb, link: u32) -> Self {
        Self { min, link, max, _unused: 0 }
    }

    fn item(&self) -> Option<u32> {
        (self.link & LEAF != 0).then_some(self.link & !LEAF)
    }

    fn aabb(&self) -> Aabb {
        Aabb { min: self.min, max: self.max }
    }
}

impl Bvh {
    /// A hierarchy over `boxes`, whose positions in the slice are the items.
    pub fn new(boxes: &[Aabb]) -> Self {
        let mut bvh = Self { nodes: Vec::with_capacity(2 * boxes.len()), least_cost: 0.0, updates: 0 };
        bvh.rebuild(boxes, &mut Vec::with_capacity(boxes.len()));
        bvh
    }

    /// Replaces the boxes. The tree's structure is kept and refitted if the number of items is the same and the boxes have moved little: a refit takes a small
    /// part of the time of a rebuild. `items` is scratch memory.
    pub(crate) fn update(&mut self, boxes: &[Aabb], items: &mut Vec<Item>) {
        let has_as_many = self.nodes.len().div_ceil(2) == boxes.len();
        let cost = if has_as_many && self.updates < MOST_UPDATES { self.refit(boxes) } else { f32::INFINITY };
        if cost.is_finite() && cost <= MOST_COST * self.least_cost {
            self.updates += 1;
            self.least_cost = self.least_cost.min(cost);
        } else {
            self.rebuild(boxes, items);
        }
    }

    /// The same tree over other boxes of the same items, such as those of the same body in another pose. Its structure is kept.
    pub(crate) fn refitted(&self, boxes: &[Aabb]) -> Self {
        let mut bvh = self.clone();
        bvh.refit(boxes);
        bvh
    }

    fn rebuild(&mut self, boxes: &[Aabb], items: &mut Vec<Item>) {
        items.clear();
        items.extend((0..).zip(boxes).map(|(index, aabb)| Item { center: aabb.center(), index }));
        self.nodes.clear();
        if !items.is_empty() {
            self.build(boxes, items);
        }
        (self.least_cost, self.updates) = (self.cost(), 0);
    }

    fn build(&mut self, boxes: &[Aabb], items: &mut [Item]) -> Aabb {
        let node = self.nodes.len();
        if let [Item { index, .. }] = *items {
            let aabb = boxes[index as usize];
            self.nodes.push(Node::new(aabb, LEAF | index));
            return aabb;
        }
        let (left, right) = split(items);
        self.nodes.push(Node::new(Aabb::EMPTY, 0));
        let aabb = self.build(boxes, left).merge(self.build(boxes, right));
        self.nodes[node] = Node::new(aabb, self.nodes.len() as u32);
        aabb
    }

    /// Replaces the boxes and keeps the structure. Returns the new search cost.
    fn refit(&mut self, boxes: &[Aabb]) -> f32 {
        let mut cost = 0.0;
        // Children have larger indices than their parents.
        for index in (0..self.nodes.len()).rev() {
            let aabb = match self.nodes[index].item() {
                Some(item) => boxes[item as usize],
                None => {
                    let [left, right] = self.children(index).map(|child| self.nodes[child].aabb());
                    left.merge(right)
                }
            };
            cost += aabb.area();
            let node = &mut self.nodes[index];
            (node.min, node.max) = (aabb.min, aabb.max);
        }
        cost
    }

    /// The sum of the surface areas of all nodes' boxes, in square metres. It is proportional to the expected number of nodes that a query visits.
    fn cost(&self) -> f32 {
        self.nodes.iter().map(|node| node.aabb().area()).sum()
    }

    /// The nodes as bytes for upload, 32 bytes each: `min, link, max, 0`. The link is the index of the node behind the subtree. The link of a leaf is
    /// the item with the highest bit set.
    #[cfg(feature = "gpu")]
    pub(crate) fn bytes(&self) -> &[u8] {
        bytemuck::cast_slice(&self.nodes)
    }

    /// Memory of the nodes, in bytes.
    pub(crate) fn memory(&self) -> usize {
        size_of_val(self.nodes.as_slice())
    }

    /// The box around all items.
    pub fn aabb(&self) -> Aabb {
        self.nodes.first().map_or(Aabb::EMPTY, Node::aabb)
    }

    /// The boxes of the inner nodes, parents before children.
    #[cfg(feature = "debug")]
    pub(crate) fn inner_boxes(&self) -> impl Iterator<Item = Aabb> {
        self.nodes.iter().filter(|node| node.item().is_none()).map(Node::aabb)
    }

    /// The index of the node behind a node's subtree.
    fn end(&self, index: usize) -> usize {
        let node = &self.nodes[index];
        if node.item().is_some() { index + 1 } else { node.link as usize }
    }

    /// Calls `visit` with every item whose box and whose ancestors' boxes pass `test`.
    pub fn visit(&self, test: impl Fn(&Aabb) -> bool, visit: impl FnMut(u32)) {
        self.visit_tested(|index| test(&self.nodes[index].aabb()), visit);
    }

    /// Calls `visit` with every item whose box overlaps with `other`.
    pub fn overlapping(&self, other: &Aabb, visit: impl FnMut(u32)) {
        let other = Box3A::from(*other);
        self.visit_from(0, |index| Box3A::from(self.nodes[index].aabb()).overlaps(&other), visit);
    }

    /// The leaves in depth-first order: neighbours in the list are mostly near in space. [`item`](Self::item) returns the item of a leaf.
    pub fn leaves(&self) -> impl Iterator<Item = Leaf> {
        (0..self.nodes.len()).filter(|&index| self.nodes[index].item().is_some()).map(Leaf)
    }

    /// The item of a leaf of this hierarchy.
    pub fn item(&self, leaf: Leaf) -> u32 {
        self.nodes[leaf.0].link & !LEAF
    }

    /// Calls `visit` with every item of a later leaf whose box overlaps with the box of `leaf`. Calls for all leaves report each overlapping pair once.
    pub fn overlapping_later(&self, leaf: Leaf, visit: impl FnMut(u32)) {
        let bounds = Box3A::from(self.nodes[leaf.0].aabb());
        self.visit_from(leaf.0 + 1, |index| Box3A::from(self.nodes[index].aabb()).overlaps(&bounds), visit);
    }

    /// The item with the smallest cost, and that cost. `None` if there are no items.
    ///
    /// `bound` of a box must not exceed the `cost` of any item in the box. The child with the smaller bound is searched first. Boxes whose bound is at
    /// least the smallest cost found so far are skipped.
    pub fn least(&self, mut bound: impl FnMut(&Aabb) -> f32, mut cost: impl FnMut(u32) -> f32) -> Option<(u32, f32)> {
        let root = self.nodes.first()?;
        let mut best: Option<(u32, f32)> = None;
        let mut stack = Stack::from_iter([(0, bound(&root.aabb()))]);
        while let Some((index, least)) = stack.pop() {
            if best.is_some_and(|(_, best)| least >= best) {
                continue;
            }
            match self.nodes[index].item() {
                Some(item) => {
                    let cost = cost(item);
                    if best.is_none_or(|(_, best)| cost < best) {
                        best = Some((item, cost));
                    }
                }
                None => {
                    let [left, right] = self.children(index).map(|i| (i, bound(&self.nodes[i].aabb())));
                    let (near, far) = if right.1 < left.1 { (right, left) } else { (left, right) };
                    stack.push(far);
                    stack.push(near);
                }
            }
        }
        best
    }

    /// Computes values of the nodes that overlap with `other` and whose ancestors do. Values of leaves come from their items, values of inner nodes are merged
    /// from their children. A child that does not overlap gets `none`; the values below it are stale.
    pub fn values<T: Copy>(
        &self,
        other: &Aabb,
        none: T,
        leaf: impl Fn(u32) -> T,
        merge: impl Fn(&T, &T) -> T,
        Values { of_nodes, overlapping }: &mut Values<T>,
    ) {
        of_nodes.resize(self.nodes.len().max(of_nodes.len()), none);
        overlapping.clear();
        let other = Box3A::from(*other);
        let mut index = 0;
        while let Some(node) = self.nodes.get(index) {
            if Box3A::from(node.aabb()).overlaps(&other) {
                overlapping.push(index as u32);
                index += 1;
            } else {
                of_nodes[index] = none;
                index = self.end(index);
            }
        }
        // Children have larger indices than their parents.
        for index in overlapping.iter().rev().map(|&index| index as usize) {
            of_nodes[index] = match self.nodes[index].item() {
                Some(item) => leaf(item),
                None => {
                    let [left, right] = self.children(index).map(|child| &of_nodes[child]);
                    merge(left, right)
                }
            };
        }
    }

    fn children(&self, index: usize) -> [usize; 2] {
        [index + 1, self.end(index + 1)]
    }

    /// Calls `visit` with every item whose node and all ancestors pass `test`. `test` takes indices of nodes, which also index [`values`](Self::values).
    pub fn visit_tested(&self, test: impl Fn(usize) -> bool, visit: impl FnMut(u32)) {
        self.visit_from(0, test, visit);
    }

    /// The same, starting at the node `index`.
    fn visit_from(&self, mut index: usize, test: impl Fn(usize) -> bool, mut visit: impl FnMut(u32)) {
        while let Some(node) = self.nodes.get(index) {
            if test(index) {
                if let Some(item) = node.item() {
                    visit(item);
                }
                index += 1;
            } else {
                index = self.end(index);
            }
        }
    }

    /// Calls `visit` with every pair of items, one of each tree, whose nodes and visited ancestors pass `test`. `test` takes indices of nodes, which
    /// also index [`values`](Self::values).
    pub fn visit_pairs(&self, other: &Bvh, test: impl Fn(usize, usize) -> bool, mut visit: impl FnMut(u32, u32)) {
        if self.nodes.is_empty() || other.nodes.is_empty() || !test(0, 0) {
            return;
        }
        let mut stack = Stack::from_iter([(0, 0)]);
        while let Some((index1, index2)) = stack.pop() {
            let mut descend = |index1, index2| {
                if test(index1, index2) {
                    stack.push((index1, index2));
                }
            };
            match (self.nodes[index1].item(), other.nodes[index2].item()) {
                (Some(item1), Some(item2)) => visit(item1, item2),
                (None, Some(_)) => self.children(index1).into_iter().for_each(|child| descend(child, index2)),
                (Some(_), None) => other.children(index2).into_iter().for_each(|child| descend(index1, child)),
                (None, None) => {
                    let [left, right] = other.children(index2);
                    for child in self.children(index1) {
                        descend(child, left);
                        descend(child, right);
                    }
                }
            }
        }
    }
}

/// Values of some nodes of a [`Bvh`], indexed by node.
#[derive(Clone, Debug)]
pub struct Values<T> {
    of_nodes: Vec<T>,
    /// The nodes that overlap, parents before children.
    overlapping: Vec<u32>,
}

impl<T> Default for Values<T> {
    fn default() -> Self {
        Self { of_nodes: Vec::new(), overlapping: Vec::new() }
    }
}

impl<T> std::ops::Index<usize> for Values<T> {
    type Output = T;

    fn index(&self, node: usize) -> &T {
        &self.of_nodes[node]
    }
}

/// A leaf of a [`Bvh`].
#[derive(Clone, Copy, Debug)]
pub struct Leaf(usize);

/// An item of a future leaf.
#[derive(Debug)]
pub(crate) struct Item {
    center: Vec3,
    index: u32,
}

/// Splits items at the middle of the axis along which their centres spread most. Splits at the median if the middle would leave less than a
/// quarter of the items on one side.
fn split(items: &mut [Item]) -> (&mut [Item], &mut [Item]) {
    let spread = items.iter().map(|item| Aabb { min: item.center, max: item.center }).fold(Aabb::EMPTY, Aabb::merge);
    let axis = spread.half_extents().max_position();
    let plane = spread.center()[axis];
    let mut left = 0;
    // Free of branches on the side, because the branch predictor would miss every other item.
    for i in 0..items.len() {
        let goes_left = items[i].center[axis] < plane;
        items.swap(i, left);
        left += usize::from(goes_left);
    }
    if 4 * left.min(items.len() - left) < items.len() {
        left = items.len() / 2;
        // Ties are broken by index, so the tree depends on the boxes alone.
        items
            .select_nth_unstable_by(left, |a, b| a.center[axis].total_cmp(&b.center[axis]).then(a.index.cmp(&b.index)));
    }
    items.split_at_mut(left)
}

/// A stack with a fixed capacity, without allocation. Each level leaves at most one node pending in a search of one tree, and three pairs for two trees.
type Stack<T> = ArrayVec<T, { 3 * MAX_DEPTH }>;

#[cfg(test)]
mod tests;
