//! Mid phase: which primitives of a pair may touch within the step, or come within the prediction distance.
//!
//! Bodies that hardly move relative to their size: all primitives that are near each other at the start, with their distances. That
//! holds whatever the bodies do, as long as they do not come nearer by more than what was counted on.
//!
//! Fast ones: the two hierarchies are traversed against each other in the frame of body 2 at the start; boxes move along their middles'
//! chords. The sagitta of the whole step and the prediction distance widen them, so no pair is lost as long as the bodies keep to their way.

use super::{
    Culling, Hull, Statics, StepInput,
    broad_phase::BodyPair,
    motion::{Facing, PairMotion, SweptBoxes, with_sides},
    near::{Directions, near_part, near_shape},
    parallel,
};
use crate::{
    constants::{CONTACT_ROUNDING, NEAR_WAY, SLIDE_WAY, SURE_WAY},
    query::{Separation, separation},
};
use bevy::tasks::TaskPool;
use glam::{Quat, Vec3};

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
pub(super) fn run(input: &StepInput, statics: &Statics, pairs: &[BodyPair], pool: &TaskPool) -> Vec<Vec<Candidates>> {
    parallel::map(pool, pairs, 8, |_, pair| {
        let motions = PairMotion::all(input, statics, pair, |body| input.bodies[body as usize].sweep);
        motions.iter().map(|motion| candidates(motion, input.culling, input.prediction)).collect()
    })
}

/// Given primitive pairs of each pair, for each of its motions.
pub(super) fn from_candidates(
    input: &StepInput,
    statics: &Statics,
    pairs: &[BodyPair],
    primitives: Vec<Vec<PrimitivePair>>,
) -> Vec<Vec<Candidates>> {
    let of_motion = |motion: &PairMotion, primitives: &[PrimitivePair]| match &motion.facing {
        Facing::Shape(_) => Candidates::all(primitives.iter().copied(), None),
        Facing::Part(part) => {
            Candidates::all(primitives.iter().filter(|[_, j]| *j == part.id).map(|&[i, _]| [i, 0]), None)
        }
    };
    let of_pair = |(pair, primitives): (&BodyPair, Vec<PrimitivePair>)| {
        let motions = PairMotion::all(input, statics, pair, |body| input.bodies[body as usize].sweep);
        motions.iter().map(|motion| of_motion(motion, &primitives)).collect()
    };
    pairs.iter().zip(primitives).map(of_pair).collect()
}

/// Candidate primitive pairs of one motion.
pub(super) fn candidates(motion: &PairMotion, culling: Culling, prediction: f32) -> Candidates {
    match culling {
        Culling::None => all(motion),
        Culling::Hybrid if motion.way() <= NEAR_WAY * motion.size => {
            // Bodies that stop, each by itself, are covered as far as it costs little.
            let way = motion.nearing().max(motion.ways().min(SURE_WAY * motion.size));
            near(motion, [motion.nearing(), way + (1.0 + 2.0 * SLIDE_WAY) * prediction])
        }
        Culling::Hybrid => swept(motion, prediction),
    }
}

/// The primitives that come within `covers` metres of each other at the start. Their distance is exact where it is less than `nearing`.
fn near(motion: &PairMotion, [nearing, covers]: [f32; 2]) -> Candidates {
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
        Facing::Shape(shape2) => near_shape(motion.shape1, shape2, &pose12, reach, add),
        Facing::Part(part) => near_part(motion.shape1, part, &pose12, reach, |i, hull| add([i, 0], hull)),
    }
    Candidates { pairs, covers: Some(covers) }
}

fn swept(motion: &PairMotion, prediction: f32) -> Candidates {
    let frame = motion.sweep2.start.rotation.inverse();
    let boxes1 = SweptBoxes::new(&motion.sweep1, frame, motion.shape1.scale);
    let margin = prediction + motion.whole_sagitta();
    let mut pairs = Vec::new();
    match &motion.facing {
        Facing::Shape(shape2) => {
            let boxes2 = SweptBoxes::new(&motion.sweep2, frame, shape2.scale);
            motion.shape1.bvh().visit_pairs(
                shape2.bvh(),
                |aabb1| boxes1.place(aabb1),
                |aabb2| boxes2.place(aabb2),
                |swept1, swept2| swept1.meets(swept2, margin),
                |i, j| pairs.push([i, j]),
            );
        }
        Facing::Part(part) => {
            let target = SweptBoxes::new(&motion.sweep2, frame, 1.0).place(&part.aabb());
            motion.shape1.bvh().visit(|aabb| boxes1.place(aabb).meets(&target, margin), |i| pairs.push([i, 0]));
        }
    }
    pairs.sort_unstable();
    Candidates::all(pairs, None)
}

fn all(motion: &PairMotion) -> Candidates {
    let count2 = match &motion.facing {
        Facing::Shape(shape2) => shape2.len() as u32,
        Facing::Part(_) => 1,
    };
    let pairs = (0..motion.shape1.len() as u32).flat_map(|i| (0..count2).map(move |j| [i, j]));
    Candidates::all(pairs, Some(f32::INFINITY))
}
