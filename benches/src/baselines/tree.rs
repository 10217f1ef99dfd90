//! Binary trees over the primitives of a body, refitted as it moves.

use bevy_medial::{
    geometry::{Aabb, Obb, Pose3, Sphere, Sweep},
    pipeline::{Hull, Shape},
};
use glam::{Affine3A, Quat, Vec3};

/// The volume of a node. Lengths are metres, positions are in the world.
pub trait Volume: Copy + Send + Sync + 'static {
    /// The part of the volume in the body's frame.
    type Local: Copy + Send + Sync;
    /// A fixed box, in the form in which it is tested.
    type Fixed: Send + Sync;

    /// Bounds some primitives in the body's frame.
    fn fit(hulls: &[Hull]) -> Self::Local;

    /// Bounds the primitives over the step. An inner node gets the volumes of its children.
    fn refit(local: &Self::Local, motion: &Motion, children: Option<[&Self; 2]>) -> Self;

    /// Converts a fixed box.
    fn fixed(obb: &Obb) -> Self::Fixed;

    /// The world box around the volume over the step.
    fn aabb(&self) -> Aabb;

    /// A measure of the size. The larger of two nodes is split first.
    fn size(&self) -> f32;

    /// True if the two volumes come within `margin` of each other at one instant.
    fn meets(&self, other: &Self, margin: f32) -> bool;

    /// True if the two volumes come within `margin` of each other at any two instants. One body may stop, and the other may hit it later.
    fn meets_whenever(&self, other: &Self, margin: f32) -> bool;

    /// True if the volume comes within `margin` of a fixed box.
    fn meets_fixed(&self, fixed: &Self::Fixed, margin: f32) -> bool;
}

/// The motion of a body over the step.
pub struct Motion {
    start: Affine3A,
    end: Affine3A,
    /// Orientation in the middle of the step.
    pub middle: Quat,
    /// Angle of the rotation in radians.
    pub angle: f32,
    /// Max distance of a point from the chord of its path, per metre of distance from the centre of mass.
    sagitta: f32,
    local_center: Vec3,
}

impl Motion {
    /// The motion of a sweep.
    pub fn new(sweep: &Sweep) -> Self {
        let affine = |pose: Pose3| Affine3A::from_rotation_translation(pose.rotation, pose.translation);
        Self {
            start: affine(sweep.start),
            end: affine(sweep.end),
            middle: sweep.pose_at(0.5).rotation,
            angle: sweep.rotation.length(),
            sagitta: sweep.sagitta(1.0),
            local_center: sweep.local_center,
        }
    }

    /// World positions of a point of the body at the start and at the end.
    pub fn ends(&self, point: Vec3) -> [Vec3; 2] {
        [self.start.transform_point3(point), self.end.transform_point3(point)]
    }

    /// Max distance of a point of the body from the chord between these positions.
    pub fn sagitta(&self, point: Vec3) -> f32 {
        self.sagitta * point.distance(self.local_center)
    }
}

/// A tree with one primitive per leaf. Nodes are in depth-first order: the left child follows its parent.
pub struct Tree<V: Volume> {
    nodes: Vec<Node<V::Local>>,
    /// The volumes of the nodes over the step.
    volumes: Vec<V>,
}

struct Node<L> {
    local: L,
    link: Link,
}

#[derive(Clone, Copy)]
enum Link {
    Primitive(u32),
    RightChild(u32),
}

impl<V: Volume> Tree<V> {
    /// A tree of a shape that does not move.
    pub fn new(shape: &Shape, pose: Pose3) -> Self {
        let hulls: Vec<Hull> = (0..shape.len() as u32).map(|primitive| shape.hull(primitive)).collect();
        let mut items: Vec<u32> = (0..hulls.len() as u32).collect();
        let mut tree = Self { nodes: Vec::new(), volumes: Vec::new() };
        tree.build(&hulls, &mut items);
        tree.refit(&Motion::new(&Sweep::at_rest(pose)));
        tree
    }

    /// Splits at the median, along the axis with the largest spread of middles.
    fn build(&mut self, hulls: &[Hull], items: &mut [u32]) {
        let of_node: Vec<Hull> = items.iter().map(|&item| hulls[item as usize]).collect();
        let local = V::fit(&of_node);
        let node = self.nodes.len();
        if let [item] = *items {
            self.nodes.push(Node { local, link: Link::Primitive(item) });
            return;
        }
        let center = |item: u32| Aabb::from_spheres(spheres(&hulls[item as usize]).iter().copied()).center();
        let middles = items.iter().map(|&item| Sphere::new(center(item), 0.0));
        let axis = Aabb::from_spheres(middles).half_extents().max_position();
        let half = items.len() / 2;
        items.select_nth_unstable_by(half, |&a, &b| center(a)[axis].total_cmp(&center(b)[axis]).then(a.cmp(&b)));
        let (left, right) = items.split_at_mut(half);
        self.nodes.push(Node { local, link: Link::RightChild(0) });
        self.build(hulls, left);
        self.nodes[node].link = Link::RightChild(self.nodes.len() as u32);
        self.build(hulls, right);
    }

    /// Bounds every node over the step, children first.
    pub fn refit(&mut self, motion: &Motion) {
        let Self { nodes, volumes } = self;
        // Children follow their parents, so volumes are filled from the end.
        let count = nodes.len();
        volumes.clear();
        for (index, node) in nodes.iter().enumerate().rev() {
            let at = |node: usize| &volumes[count - 1 - node];
            let children = match node.link {
                Link::Primitive(_) => None,
                Link::RightChild(right) => Some([at(index + 1), at(right as usize)]),
            };
            let volume = V::refit(&node.local, motion, children);
            volumes.push(volume);
        }
        volumes.reverse();
    }

    /// Bytes of the nodes and of their volumes.
    pub fn memory(&self) -> usize {
        size_of_val(&*self.nodes) + size_of_val(&*self.volumes)
    }

    /// The volume around all primitives.
    pub fn root(&self) -> &V {
        &self.volumes[0]
    }

    /// Primitives whose leaves, and all nodes above them, come within `margin` of a fixed box. The second index is 0, because the box is a single part.
    pub fn against_fixed(&self, fixed: &V::Fixed, margin: f32) -> Vec<[u32; 2]> {
        let mut found = Vec::new();
        let mut stack = vec![0];
        while let Some(node) = stack.pop() {
            if !self.volumes[node].meets_fixed(fixed, margin) {
                continue;
            }
            match self.nodes[node].link {
                Link::Primitive(primitive) => found.push([primitive, 0]),
                Link::RightChild(right) => stack.extend([right as usize, node + 1]),
            }
        }
        found
    }

    /// Pairs of primitives whose leaves, and all nodes above them, come within `margin` of each other. Also returns the number of tested node pairs.
    pub fn against(&self, other: &Self, margin: f32) -> (Vec<[u32; 2]>, usize) {
        let (mut found, mut tests) = (Vec::new(), 0);
        let mut stack = vec![(0, 0)];
        while let Some((node1, node2)) = stack.pop() {
            tests += 1;
            let (volume1, volume2) = (&self.volumes[node1], &other.volumes[node2]);
            if !volume1.meets(volume2, margin) {
                continue;
            }
            match (self.nodes[node1].link, other.nodes[node2].link) {
                (Link::Primitive(primitive1), Link::Primitive(primitive2)) => found.push([primitive1, primitive2]),
                (Link::RightChild(right), Link::Primitive(_)) => {
                    stack.extend([(right as usize, node2), (node1 + 1, node2)]);
                }
                (Link::RightChild(right), Link::RightChild(_)) if volume1.size() >= volume2.size() => {
                    stack.extend([(right as usize, node2), (node1 + 1, node2)]);
                }
                (_, Link::RightChild(right)) => stack.extend([(node1, right as usize), (node1, node2 + 1)]),
            }
        }
        (found, tests)
    }
}

/// The spheres of a primitive.
pub fn spheres(hull: &Hull) -> &[Sphere] {
    match hull {
        Hull::Sphere(spheres) => spheres,
        Hull::Cone(spheres) => spheres,
        Hull::Slab(spheres) => spheres,
    }
}
