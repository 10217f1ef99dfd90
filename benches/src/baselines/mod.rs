//! Culling by bounding volume hierarchies alone, as in the comparisons of the paper (its figures 8 and 10). These baselines are not part of the library.
//!
//! Each body has a tree with as many leaves as its medial mesh has primitives. In each step
//!
//! 1. **update**: the trees of all bodies that move are refitted, so that each node holds its primitives over the whole step;
//! 2. **broad**: world boxes around the roots, by a sweep over a hierarchy of them, as in the library; where they overlap, the roots
//!    themselves;
//! 3. **mid**: tree against tree, or against the box that a static is; the pairs of leaves that remain are the candidates;
//! 4. the library's narrow phase, stops and reduction, with [`Workspace::step_from_candidates`].
//!
//! Trees split at the median along the longest axis, once for each shape. A node has one of these volumes:
//!
//! | kind | fitted once, to the shape | in each step | two nodes meet if |
//! |---|---|---|---|
//! | [`Aabb`](aabb) | nothing | world box around the primitive's start and end; parents hold their children | boxes overlap |
//! | [`Sphere`](sphere) | smallest sphere | centre at the start and the end | spheres touch at one instant |
//! | [`Medial`](medial) | medial cone around the primitives, or the primitive itself | spheres in the middle of the step, and how far they move | they come near each other in the middle of the step |
//! | [`Obb`](obb) | a small oriented box | pose in the middle of the step, motion of the centre | boxes that move touch at one instant, by 15 separating axes |
//!
//! All bounds are safe, for any rotation, so results have the same bits as those of the library. Statics that are boxes have no tree, because a
//! volume is tested against the box itself. Sleeping bodies are neither refitted nor tested among each other.
//!
//! Not supported, and reported as errors: bodies that are neither medial nor boxes, and moving bodies that do not stop, such as kinematic ones.

pub mod aabb;
pub mod medial;
pub mod obb;
pub mod pair;
pub mod sphere;
pub mod tree;

use std::{ptr, time::Instant};

use bevy::tasks::{ParallelSlice, ParallelSliceMut, TaskPool};
use bevy_medial::{
    constants::{CHORD_TOLERANCE, CONTACT_ROUNDING, LINEAR_SLOP},
    geometry::{Aabb, Bvh, Obb, Pose3, Sweep},
    pipeline::{
        Body, Candidates, PairFilter, Primitives, Shape, Side, Solid, StaticBody, Statics, StepInput, StepOutput,
        Workspace,
    },
};

use tree::{Motion, Tree, Volume};

/// The volume of a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Oriented boxes.
    Obb,
    /// Spheres.
    Sphere,
    /// World boxes.
    Aabb,
    /// Medial primitives.
    Medial,
}

impl Kind {
    /// A baseline without any trees yet.
    pub fn baseline(self) -> Box<dyn Baseline> {
        match self {
            Kind::Obb => Box::new(Trees::<obb::MovingObb>::default()),
            Kind::Sphere => Box::new(Trees::<sphere::MovingSphere>::default()),
            Kind::Aabb => Box::new(Trees::<aabb::SweptAabb>::default()),
            Kind::Medial => Box::new(Trees::<medial::MovingPrimitive>::default()),
        }
    }
}

/// A baseline with the trees that it keeps from step to step.
pub trait Baseline {
    /// Runs a step. The time of the broad phase includes the update of the trees. The construction of trees of new bodies is not timed.
    ///
    /// # Errors
    /// If there is a body that the baselines do not support.
    fn step(&mut self, input: &StepInput, statics: &Statics, pool: &TaskPool) -> Result<StepOutput, String>;
}

/// The trees of all bodies and statics.
struct Trees<V: Volume> {
    bodies: Vec<BodyTree<V>>,
    statics: Vec<Target<V>>,
    /// Over the world boxes of the statics.
    bvh: Bvh,
    workspace: Workspace,
}

impl<V: Volume> Default for Trees<V> {
    fn default() -> Self {
        Self { bodies: Vec::new(), statics: Vec::new(), bvh: Bvh::default(), workspace: Workspace::default() }
    }
}

/// The tree of a body, and the motion that it is fitted to.
struct BodyTree<V: Volume> {
    shape: Shape,
    tree: Tree<V>,
    sweep: Sweep,
}

/// A fixed object that a moving body may meet.
struct Target<V: Volume> {
    pose: Pose3,
    kind: TargetKind<V>,
}

enum TargetKind<V: Volume> {
    Medial(Shape, Tree<V>),
    Box(Obb, V::Fixed),
}

/// Min number of bodies or pairs of a task.
const LEAST_PER_TASK: usize = 8;

impl<V: Volume> Baseline for Trees<V> {
    fn step(&mut self, input: &StepInput, statics: &Statics, pool: &TaskPool) -> Result<StepOutput, String> {
        self.make(input, statics)?;
        let chunk = |items: usize| items.div_ceil(pool.thread_num().max(1) * 4).max(LEAST_PER_TASK);

        let begin = Instant::now();
        if self.bodies.len() <= LEAST_PER_TASK {
            update(&mut self.bodies, &input.bodies);
        } else {
            let size = chunk(self.bodies.len());
            self.bodies.par_chunk_map_mut(pool, size, |index, trees| update(trees, &input.bodies[index * size..]));
        }
        let pairs = self.body_pairs(input);
        let broad = begin.elapsed();

        let begin = Instant::now();
        let of_pair = |sides: &[Side; 2]| Candidates {
            sides: *sides,
            primitives: Primitives::MayTouch(self.primitives(sides, input, statics)),
        };
        let candidates = if pairs.len() <= LEAST_PER_TASK {
            pairs.iter().map(of_pair).collect()
        } else {
            pairs
                .par_chunk_map(pool, chunk(pairs.len()), |_, pairs| pairs.iter().map(of_pair).collect::<Vec<_>>())
                .concat()
        };
        let mid = begin.elapsed();

        let (mut output, filter) = (StepOutput::default(), |_, _| PairFilter::Stopping);
        self.workspace.step_from_candidates(input, statics, candidates, filter, pool, &mut output);
        (output.times.broad, output.times.mid) = (broad, mid);
        Ok(output)
    }
}

impl<V: Volume> Trees<V> {
    /// Makes the trees of bodies that are new or have changed.
    fn make(&mut self, input: &StepInput, statics: &Statics) -> Result<(), String> {
        self.bodies.truncate(input.bodies.len());
        for (index, body) in input.bodies.iter().enumerate() {
            let shape = body.solid.medial().ok_or_else(|| format!("body {index} is not medial"))?;
            if !body.stops && !body.sweep.is_at_rest() {
                return Err(format!("body {index} moves and does not stop"));
            }
            if self.bodies.get(index).is_some_and(|known| same(&known.shape, shape)) {
                continue;
            }
            let sweep = Sweep::at_rest(body.sweep.start);
            let new = BodyTree { shape: shape.clone(), tree: Tree::new(shape, sweep.start), sweep };
            match self.bodies.get_mut(index) {
                Some(known) => *known = new,
                None => self.bodies.push(new),
            }
        }
        let targets = statics.bodies();
        if self.statics.len() != targets.len() || !self.statics.iter().zip(targets).all(|(known, body)| known.is(body))
        {
            self.statics = targets.iter().map(Target::new).collect::<Result<_, _>>()?;
            self.bvh = Bvh::new(&targets.iter().map(|target| target.obb().aabb()).collect::<Vec<_>>());
        }
        Ok(())
    }

    /// The pairs whose roots meet.
    fn body_pairs(&self, input: &StepInput) -> Vec<[Side; 2]> {
        let margin = input.prediction;
        let boxes: Vec<Aabb> = self.bodies.iter().map(|body| body.tree.root().aabb()).collect();
        let bvh = Bvh::new(&boxes);
        let mut pairs = Vec::new();
        for (i, (body, own)) in input.bodies.iter().zip(&self.bodies).enumerate() {
            let reach = boxes[i].inflated(margin);
            let root = own.tree.root();
            let near = |aabb: &Aabb| aabb.overlaps(&reach);
            bvh.visit(near, |j| {
                let (index, other) = (j as usize, &self.bodies[j as usize]);
                let once = index > i && (body.active || input.bodies[index].active);
                if once && root.meets_whenever(other.tree.root(), margin) {
                    pairs.push([Side::Body(i as u32), Side::Body(j)]);
                }
            });
            if body.active {
                self.bvh.visit(near, |item| {
                    let meets = match &self.statics[item as usize].kind {
                        TargetKind::Medial(_, tree) => root.meets_whenever(tree.root(), margin),
                        TargetKind::Box(_, fixed) => root.meets_fixed(fixed, margin),
                    };
                    if meets {
                        pairs.push([Side::Body(i as u32), Side::Static(item)]);
                    }
                });
            }
        }
        pairs
    }

    /// The primitives of a pair that may touch.
    fn primitives(&self, sides: &[Side; 2], input: &StepInput, statics: &Statics) -> Vec<[u32; 2]> {
        let [Side::Body(i), second] = *sides else { return Vec::new() };
        let first = &self.bodies[i as usize].tree;
        let solid = match second {
            Side::Body(j) => &input.bodies[j as usize].solid,
            Side::Static(item) => &statics.bodies()[item as usize].solid,
        };
        let reach = reach([&input.bodies[i as usize].solid, solid], input.length_unit);
        match second {
            Side::Body(j) => first.against(&self.bodies[j as usize].tree, reach).0,
            Side::Static(item) => match &self.statics[item as usize].kind {
                TargetKind::Medial(_, tree) => first.against(tree, reach).0,
                TargetKind::Box(_, fixed) => first.against_fixed(fixed, reach),
            },
        }
    }
}

/// Max distance of primitives that matter to the narrow phase, in metres.
fn reach(solids: [&Solid; 2], length_unit: f32) -> f32 {
    let [radius1, radius2] = solids.map(|solid| solid.bounding_sphere().radius);
    let size = radius1.min(radius2);
    (2.0 * CHORD_TOLERANCE * size).max(LINEAR_SLOP * length_unit) + CONTACT_ROUNDING * size
}

impl<V: Volume> Target<V> {
    fn new(body: &StaticBody) -> Result<Self, String> {
        let kind = match body.solid.medial() {
            Some(shape) => TargetKind::Medial(shape.clone(), Tree::new(shape, body.pose)),
            None if body.solid.len() == 1 => TargetKind::Box(body.obb(), V::fixed(&body.obb())),
            None => return Err("a static is neither medial nor of one part".into()),
        };
        Ok(Self { pose: body.pose, kind })
    }

    /// True if the target was made for this body, with its present pose and shape.
    fn is(&self, body: &StaticBody) -> bool {
        self.pose == body.pose
            && match (&self.kind, body.solid.medial()) {
                (TargetKind::Medial(known, _), Some(shape)) => same(known, shape),
                (TargetKind::Box(known, _), None) => *known == body.obb(),
                _ => false,
            }
    }
}

/// True if two shapes share their spheres and have the same scale.
fn same(shape1: &Shape, shape2: &Shape) -> bool {
    ptr::eq(shape1.axis.spheres(), shape2.axis.spheres()) && shape1.scale == shape2.scale
}

/// Fits trees to the motions of their bodies.
fn update<V: Volume>(trees: &mut [BodyTree<V>], bodies: &[Body]) {
    for (known, body) in trees.iter_mut().zip(bodies) {
        if known.sweep != body.sweep {
            known.tree.refit(&Motion::new(&body.sweep));
            known.sweep = body.sweep;
        }
    }
}
