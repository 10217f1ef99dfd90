//! Many points in blocks, to compute their distances from primitives.

use std::ops::Range;

use glam::DVec3;

use super::{
    hull::{BLOCK, Block, Hull},
    vectors::ROUNDING,
};

/// Points in a list whose neighbours are near each other, split into blocks, and the blocks into groups.
#[derive(Clone, Default)]
pub(super) struct Points {
    pub positions: Vec<DVec3>,
    pub blocks: Vec<PointBlock>,
    pub groups: Vec<Group>,
    /// Middles of the groups.
    pub group_middles: Vec<Block>,
}

/// Some consecutive points.
#[derive(Clone)]
pub(super) struct PointBlock {
    pub points: Block,
    /// Largest distance of the points from their middle, plus an allowance for the rounding of f32 distances.
    pub radius: f32,
}

/// `BLOCK` consecutive blocks.
#[derive(Clone)]
pub(super) struct Group {
    /// Middles of the blocks.
    pub middles: Block,
    /// The same as for a block.
    pub radius: f32,
}

impl Points {
    pub fn new(positions: Vec<DVec3>) -> Self {
        let (middles, radii) = bounds(&positions, BLOCK);
        let (group_middles, group_radii) = bounds(&positions, BLOCK * BLOCK);
        let blocks = positions.chunks(BLOCK).zip(radii);
        let groups = middles.chunks(BLOCK).zip(group_radii);
        Self {
            blocks: blocks.map(|(points, radius)| PointBlock { points: block(points), radius }).collect(),
            groups: groups.map(|(middles, radius)| Group { middles: block(middles), radius }).collect(),
            group_middles: group_middles.chunks(BLOCK).map(block).collect(),
            positions,
        }
    }

    /// Indices of the points of a block.
    pub fn range(&self, block: usize) -> Range<usize> {
        block * BLOCK..self.positions.len().min((block + 1) * BLOCK)
    }

    /// Indices of the blocks of a group.
    pub fn blocks_of(&self, group: usize) -> Range<usize> {
        group * BLOCK..self.blocks.len().min((group + 1) * BLOCK)
    }

    /// For each block, a lower bound of the signed distances of its points from a primitive.
    pub fn gaps(&self, hull: &Hull) -> impl Iterator<Item = f32> {
        let of_groups = self.groups.iter().flat_map(|group| hull.distances(&group.middles));
        of_groups.zip(&self.blocks).map(|(gap, block)| gap - block.radius)
    }

    /// Signed distances of points from a primitive, up to the rounding of an f32, for the blocks that pass `passes`.
    pub fn distances(
        &self,
        hull: &Hull,
        passes: impl Fn(Range<usize>, f32) -> bool,
    ) -> impl Iterator<Item = (usize, f64)> {
        let near = self.gaps(hull).enumerate().filter(move |&(block, gap)| passes(self.range(block), gap));
        near.flat_map(|(block, _)| {
            let distances = hull.distances(&self.blocks[block].points);
            self.range(block).zip(distances.map(f64::from))
        })
    }
}

/// A block of the points. The last block is filled with copies of its last point.
fn block(points: &[DVec3]) -> Block {
    let at = |i: usize| points[i.min(points.len() - 1)];
    Block::new(std::array::from_fn(at))
}

/// Middles and radii of groups of `count` points: the largest distance from the middle, plus an allowance for the rounding of f32 distances.
fn bounds(points: &[DVec3], count: usize) -> (Vec<DVec3>, Vec<f32>) {
    let bound = |points: &[DVec3]| {
        let around = |(lo, hi): (DVec3, DVec3), &p: &DVec3| (lo.min(p), hi.max(p));
        let (min, max) = points.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), around);
        let middle = (min + max) * 0.5;
        let radius = points.iter().map(|p| p.distance(middle)).fold(0.0, f64::max);
        (middle, radius as f32 + ROUNDING)
    };
    points.chunks(count).map(bound).unzip()
}
