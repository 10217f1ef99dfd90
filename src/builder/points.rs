//! Many points in blocks, for their distances to primitives.

use std::ops::Range;

use glam::DVec3;

use super::{
    hull::{BLOCK, Ball, Block, Hull},
    vectors::{ROUNDING, Vectors, WIDTH},
};

/// Points in an order in which neighbours are near, cut into blocks, and these into groups.
#[derive(Clone, Default)]
pub(super) struct Points {
    pub positions: Vec<DVec3>,
    pub blocks: Vec<PointBlock>,
    pub groups: Vec<Group>,
}

/// Some points that follow one another.
#[derive(Clone)]
pub(super) struct PointBlock {
    pub points: Block,
    /// Their greatest distance from their middle, and more than distances in f32 are off.
    pub radius: f32,
}

/// As many blocks as a block has points.
#[derive(Clone)]
pub(super) struct Group {
    /// A ball around all points.
    pub bound: Ball,
    /// Middles of the blocks.
    pub middles: Block,
}

impl Points {
    pub fn new(positions: Vec<DVec3>) -> Self {
        let bounds: Vec<Ball> = positions.chunks(BLOCK).map(bound).collect();
        let blocks = positions
            .chunks(BLOCK)
            .zip(&bounds)
            .map(|(points, bound)| PointBlock { points: block(points), radius: bound.radius as f32 + ROUNDING });
        let blocks = blocks.collect();
        let groups = positions.chunks(BLOCK * BLOCK).zip(bounds.chunks(BLOCK)).map(|(points, bounds)| Group {
            bound: bound(points),
            middles: block(&bounds.iter().map(|b| b.center).collect::<Vec<_>>()),
        });
        let groups = groups.collect();
        Self { positions, blocks, groups }
    }

    /// The places of the points of a block.
    pub fn range(&self, block: usize) -> Range<usize> {
        block * BLOCK..self.positions.len().min((block + 1) * BLOCK)
    }

    /// The blocks of a group.
    pub fn blocks_of(&self, group: usize) -> Range<usize> {
        group * BLOCK..self.blocks.len().min((group + 1) * BLOCK)
    }

    /// Least signed distance from a primitive that a point of each block may have.
    pub fn gaps(&self, hull: &Hull) -> impl Iterator<Item = f32> {
        let of_groups = self.groups.iter().flat_map(|group| hull.distances(&group.middles));
        of_groups.zip(&self.blocks).map(|(gap, block)| gap - block.radius)
    }

    /// Signed distances from a primitive, up to the rounding of an f32, of the points of those blocks that pass.
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

/// The last block is filled up with its last point.
fn block(points: &[DVec3]) -> Block {
    let at = |i: usize| points[i.min(points.len() - 1)];
    std::array::from_fn(|part| Vectors::new(std::array::from_fn(|lane| at(part * WIDTH + lane))))
}

/// A ball around points.
fn bound(points: &[DVec3]) -> Ball {
    let (min, max) = points.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(lo, hi), &p| (lo.min(p), hi.max(p)));
    let center = (min + max) * 0.5;
    Ball { center, radius: points.iter().map(|p| p.distance(center)).fold(0.0, f64::max) }
}
