//! Culling of one pair of shapes by trees of bounding volumes.

use bevy_medial::{
    geometry::{Pose3, Sweep},
    pipeline::Shape,
};
use bevy_medial_compare::baselines::{
    Kind, aabb, obb, sphere,
    tree::{Motion, Tree, Volume},
};

/// The trees of two shapes.
pub trait Pairs {
    /// The pairs of primitives that may touch along the sweeps.
    fn between(&mut self, sweeps: &[Sweep; 2]) -> Vec<[u32; 2]>;
}

/// The trees of two shapes, of a kind of volume.
pub fn pairs(kind: Kind, shapes: [&Shape; 2]) -> Box<dyn Pairs> {
    match kind {
        Kind::Obb => Box::new(trees::<obb::MovingObb>(shapes)),
        Kind::Sphere => Box::new(trees::<sphere::MovingSphere>(shapes)),
        Kind::Aabb => Box::new(trees::<aabb::SweptAabb>(shapes)),
    }
}

fn trees<V: Volume>(shapes: [&Shape; 2]) -> [Tree<V>; 2] {
    shapes.map(|shape| Tree::new(shape, Pose3::IDENTITY))
}

impl<V: Volume> Pairs for [Tree<V>; 2] {
    fn between(&mut self, sweeps: &[Sweep; 2]) -> Vec<[u32; 2]> {
        for (tree, sweep) in self.iter_mut().zip(sweeps) {
            tree.refit(&Motion::new(sweep));
        }
        let [first, second] = self;
        first.against(second, 0.0)
    }
}
