//! Culling of one pair of shapes by trees of bounding volumes.

use bevy_medial::{
    geometry::{Pose3, Sweep},
    pipeline::Shape,
};

use super::{
    Kind, aabb, medial, obb, sphere,
    tree::{Motion, Tree, Volume},
};

/// The trees of two shapes.
pub trait TreePair {
    /// Bounds both trees over the sweeps.
    fn refit(&mut self, sweeps: &[Sweep; 2]);

    /// The pairs of primitives that may touch, and the number of tested node pairs.
    fn between(&self) -> (Vec<[u32; 2]>, usize);

    /// Bytes of both trees.
    fn memory(&self) -> usize;
}

/// The trees of two shapes, of a kind of volume.
pub fn tree_pair(kind: Kind, shapes: [&Shape; 2]) -> Box<dyn TreePair> {
    match kind {
        Kind::Obb => Box::new(trees::<obb::MovingObb>(shapes)),
        Kind::Sphere => Box::new(trees::<sphere::MovingSphere>(shapes)),
        Kind::Aabb => Box::new(trees::<aabb::SweptAabb>(shapes)),
        Kind::Medial => Box::new(trees::<medial::MovingPrimitive>(shapes)),
    }
}

fn trees<V: Volume>(shapes: [&Shape; 2]) -> [Tree<V>; 2] {
    shapes.map(|shape| Tree::new(shape, Pose3::IDENTITY))
}

impl<V: Volume> TreePair for [Tree<V>; 2] {
    fn refit(&mut self, sweeps: &[Sweep; 2]) {
        for (tree, sweep) in self.iter_mut().zip(sweeps) {
            tree.refit(&Motion::new(sweep));
        }
    }

    fn between(&self) -> (Vec<[u32; 2]>, usize) {
        self[0].against(&self[1], 0.0)
    }

    fn memory(&self) -> usize {
        self.iter().map(Tree::memory).sum()
    }
}
