//! Mid phase: which primitives of a pair may touch within the step, or come within the prediction distance.
//!
//! The boxes of each body's hierarchy are placed once, at the start of the step and at its end, and the two hierarchies of a pair are traversed against
//! each other.
//!
//! Bodies that hardly move relative to their size: all primitives that are near each other at the start, with their distances. That
//! holds whatever the bodies do, as long as they do not come nearer by more than what was counted on.
//!
//! Fast ones: those whose boxes meet on their way. The sagitta of the whole step and the prediction distance widen them, so no pair is
//! lost as long as the bodies keep to their way.

use bevy::tasks::TaskPool;
use glam::{Quat, Vec3, Vec3A};

use super::{
    Culling, Hull, Shape, Statics, StepInput,
    broad_phase::BodyPair,
    motion::{Facing, PairMotion, with_sides},
    moving_boxes::{self, BodyBoxes, MovingBox, MovingBoxes, TimedBoxes},
    near::{Directions, near_part},
    parallel,
};
use crate::{
    constants::{CONTACT_ROUNDING, NEAR_WAY, SLIDE_WAY, SURE_WAY},
    geometry::Placement,
    query::{Separation, separation},
};

/// Indices of a primitive of the first body and one of the second; of a part, which is one, 0.
pub(super) type PrimitivePair = [u32; 2];

/// Two primitives that may meet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Candidate {
    pub primitives: PrimitivePair,
    /// Their distance at the start of the step in metres, or less; minus infinity if it is not known.
    pub distance: f32,
    /// Unit vector, in the frame of the chords at the start, along which they are that far apart; zero if it is not known.
    pub normal: Vec3,
}

/// Primitives of a pair that may meet.
#[derive(Clone, Debug, Default)]
pub(super) struct Candidates {
    /// In ascending order.
    pub pairs: Vec<Candidate>,
    /// How much nearer than at the start any two points of the bodies may come before there are others, in metres. None if these are all only for
    /// as long as the bodies keep to their way.
    pub covers: Option<f32>,
}

impl Candidates {
    /// Primitives of which nothing is known but that they are all.
    pub fn all(pairs: impl IntoIterator<Item = PrimitivePair>, covers: Option<f32>) -> Self {
        let candidate = |primitives| Candidate { primitives, distance: f32::NEG_INFINITY, normal: Vec3::ZERO };
        Self { pairs: pairs.into_iter().map(candidate).collect(), covers }
    }

    /// Those that come within a distance of zero if points come nearer by no more than `way` metres.
    pub fn within(&self, way: f32) -> impl Iterator<Item = &Candidate> {
        self.pairs.iter().filter(move |candidate| candidate.distance <= way)
    }
}

/// Candidate primitive pairs for each motion of each pair.
pub(super) fn run(
    input: &StepInput,
    statics: &Statics,
    pairs: &[BodyPair],
    boxes: &BodyBoxes,
    pool: &TaskPool,
) -> Vec<Vec<Candidates>> {
    parallel::map(pool, pairs, 8, |_, pair| {
        let motions = PairMotion::all(input, statics, pair, |body| input.bodies[body as usize].sweep);
        let boxes = [pair.first, pair.second].map(|side| boxes.between(side, [0.0, 1.0]));
        motions.iter().map(|motion| candidates(motion, input.culling, input.prediction, boxes)).collect()
    })
}

/// Given primitive pairs of each pair, for each of its motions.
pub(super) fn from_candidates(
    input: &StepInput,
    statics: &Statics,
    pairs: &[BodyPair],
    primitives: Vec<Option<Vec<PrimitivePair>>>,
    boxes: &BodyBoxes,
) -> Vec<Vec<Candidates>> {
    let of_motion = |motion: &PairMotion, primitives: &[PrimitivePair]| match &motion.facing {
        Facing::Shape(_) => Candidates::all(primitives.iter().copied(), None),
        Facing::Part(part) => {
            Candidates::all(primitives.iter().filter(|[_, j]| *j == part.id).map(|&[i, _]| [i, 0]), None)
        }
    };
    let of_pair = |(pair, primitives): (&BodyPair, Option<Vec<PrimitivePair>>)| {
        let motions = PairMotion::all(input, statics, pair, |body| input.bodies[body as usize].sweep);
        let boxes = [pair.first, pair.second].map(|side| boxes.between(side, [0.0, 1.0]));
        let of_motion = |motion| match &primitives {
            Some(primitives) => of_motion(motion, primitives),
            None => candidates(motion, input.culling, input.prediction, boxes),
        };
        motions.iter().map(of_motion).collect()
    };
    pairs.iter().zip(primitives).map(of_pair).collect()
}

/// Candidate primitive pairs of one motion. `boxes`: of either side over its time, if they are known; what a body has left its way by is
/// part of `prediction` then.
pub(super) fn candidates(
    motion: &PairMotion,
    culling: Culling,
    prediction: f32,
    boxes: [Option<TimedBoxes>; 2],
) -> Candidates {
    match culling {
        Culling::None => all(motion),
        Culling::Hybrid if motion.way() <= NEAR_WAY * motion.size => {
            // Bodies that stop, each by itself, are covered as far as it costs little.
            let way = motion.nearing().max(motion.ways().min(SURE_WAY * motion.size));
            near(motion, [motion.nearing(), way + (1.0 + 2.0 * SLIDE_WAY) * prediction], boxes)
        }
        Culling::Hybrid => swept(motion, prediction, boxes),
    }
}

/// Those that may meet on their way, within `slack` metres of it, and no others: for one look at them.
pub(super) fn on_the_way(
    motion: &PairMotion,
    culling: Culling,
    slack: f32,
    boxes: [Option<TimedBoxes>; 2],
) -> Candidates {
    match culling {
        Culling::None => all(motion),
        Culling::Hybrid => swept(motion, slack, boxes),
    }
}

/// The primitives that come within `covers` metres of each other at the start. Their distance is exact where it is less than `nearing`.
fn near(motion: &PairMotion, [nearing, covers]: [f32; 2], boxes: [Option<TimedBoxes>; 2]) -> Candidates {
    let pose12 = motion.pose12();
    // Boxes and directions are not exact.
    let reach = covers * (1.0 + CONTACT_ROUNDING) + CONTACT_ROUNDING * motion.size;
    // Chords that face a part are in its frame.
    let turn = match motion.facing {
        Facing::Shape(_) => motion.sweep2.start.rotation,
        Facing::Part(_) => Quat::IDENTITY,
    };
    let mut directions = Directions::new(turn.inverse() * motion.center_line());
    let mut pairs = Vec::new();
    let mut add = |primitives: PrimitivePair, hull: Hull| {
        with_sides!(motion.facing, hull, primitives[1], |first, second| {
            let (distance, normal) = directions.parting(&first, second, [nearing, reach]).unwrap_or_else(|| {
                let Separation { distance, normal, .. } = separation(&first, second, 0);
                directions.learn(normal);
                (distance, normal)
            });
            if distance <= reach {
                pairs.push(Candidate { primitives, distance, normal: turn * normal });
            }
        });
    };
    match &motion.facing {
        Facing::Shape(shape2) => {
            let to_second = Placement::from(pose12.inverse());
            let mut last = None;
            for [i, j] in pairs_of_boxes(motion, shape2, boxes, reach, MovingBox::is_near) {
                let hull = match last {
                    Some((last, hull)) if last == i => hull,
                    _ => motion.shape1.hull(i).placed(&to_second),
                };
                last = Some((i, hull));
                add([i, j], hull);
            }
        }
        Facing::Part(part) => near_part(motion.shape1, part, &pose12, reach, |i, hull| add([i, 0], hull)),
    }
    Candidates { pairs, covers: Some(covers) }
}

/// The primitives that come within the prediction distance of each other on their way.
fn swept(motion: &PairMotion, prediction: f32, boxes: [Option<TimedBoxes>; 2]) -> Candidates {
    let pairs = match &motion.facing {
        Facing::Shape(shape2) => pairs_of_boxes(motion, shape2, boxes, prediction, MovingBox::meets),
        Facing::Part(part) => {
            // Boxes with the world's axes do if those are the part's as well.
            let own;
            let (boxes, offset) = match (boxes[0], motion.world_offset()) {
                (Some(boxes), Some(frame)) => (boxes, Vec3A::from(frame) - boxes.origin()),
                _ => {
                    own = MovingBoxes::new(motion.shape1, &motion.sweep1, Vec3::ZERO);
                    (own.whole(), Vec3A::ZERO)
                }
            };
            let [start, end] = [motion.sweep2.start, motion.sweep2.end];
            let target = MovingBox::new([start, end].map(|pose| part.aabb().transformed(&pose, 1.0)));
            let mut pairs = Vec::new();
            let margin = prediction + boxes.sagitta() + motion.sagitta_of_second();
            let meets = |node: usize| boxes.node(node).meets(&target, offset, margin);
            motion.shape1.bvh().visit_tested(meets, |i| pairs.push([i, 0]));
            pairs.sort_unstable();
            pairs
        }
    };
    Candidates::all(pairs, None)
}

/// The primitives of two shapes whose boxes, widened by `reach`, pass a test, in ascending order.
fn pairs_of_boxes(
    motion: &PairMotion,
    shape2: &Shape,
    boxes: [Option<TimedBoxes>; 2],
    reach: f32,
    test: impl Fn(&MovingBox, &MovingBox, Vec3A, f32) -> bool,
) -> Vec<PrimitivePair> {
    let mut pairs = Vec::new();
    let shapes = [motion.shape1, shape2];
    let reach = reach + CONTACT_ROUNDING * motion.size;
    let mut visit = |boxes| moving_boxes::visit_pairs(shapes, boxes, reach, &test, |i, j| pairs.push([i, j]));
    match boxes {
        [Some(boxes1), Some(boxes2)] => visit([boxes1, boxes2]),
        _ => {
            let boxes = [(motion.shape1, &motion.sweep1), (shape2, &motion.sweep2)];
            let boxes = boxes.map(|(shape, sweep)| MovingBoxes::new(shape, sweep, Vec3::ZERO));
            visit(boxes.each_ref().map(MovingBoxes::whole));
        }
    }
    pairs.sort_unstable();
    pairs
}

fn all(motion: &PairMotion) -> Candidates {
    let count2 = match &motion.facing {
        Facing::Shape(shape2) => shape2.len() as u32,
        Facing::Part(_) => 1,
    };
    let pairs = (0..motion.shape1.len() as u32).flat_map(|i| (0..count2).map(move |j| [i, j]));
    Candidates::all(pairs, Some(f32::INFINITY))
}
