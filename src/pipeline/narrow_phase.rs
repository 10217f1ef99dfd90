//! Narrow phase: the first impact of each pair within the step, and its contacts at the end.

use bevy::tasks::TaskPool;
use glam::Vec3;

use super::{
    Contact, Core, Impact, Second, Side, Solid, Statics, StepInput,
    broad_phase::BodyPair,
    contact,
    mid_phase::PrimitivePair,
    motion::{Facing, PairMotion},
    parallel,
    parting::Parting,
    stop::Stops,
    with_spheres,
};
use crate::{
    constants::TOUCH_DISTANCE,
    geometry::{Pose3, Sphere},
    query::{Cuboid, Support, TimeOfImpactStatus, rigid_impact, rigid_start},
};

/// Runs an expression with a primitive of the first body and what it faces: another, or a part, by whose rounding the first is larger.
macro_rules! with_sides {
    ($motion:expr, $primitives:expr, |$first:ident, $second:ident| $body:expr) => {{
        let [primitive1, primitive2] = $primitives;
        with_spheres!($motion.shape1.hull(primitive1), |$first| match &$motion.facing {
            Facing::Shape(shape2) => with_spheres!(&shape2.hull(primitive2), |$second| $body),
            Facing::Part(part) => {
                let $first = $first.map(|s| Sphere::new(s.center, s.radius + part.rounding));
                match &part.core {
                    Core::Cuboid(half) => {
                        let $second = &Cuboid { half: *half };
                        $body
                    }
                    Core::Support(shape) => {
                        let $second = &Support(&**shape);
                        $body
                    }
                    Core::Hull(hull) => with_spheres!(hull, |$second| $body),
                }
            }
        })
    }};
}

/// The first impact of a pair, and what it took to find.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ImpactResult {
    pub impact: Option<Impact>,
    /// Overlap that the pair may gain, in metres.
    pub slop: f32,
    /// True if the pair was in touch at the start.
    pub in_touch: bool,
    /// Unit normal between the primitives that were nearest to each other at the start, in the world; zero if none was looked at.
    pub normal: Vec3,
    pub toi_tests: usize,
    pub unresolved: usize,
}

/// The first impact of each pair, were no body to stop.
pub(super) fn impacts(
    input: &StepInput,
    statics: &Statics,
    pairs: &[BodyPair],
    candidates: &[Vec<Vec<PrimitivePair>>],
    pool: &TaskPool,
) -> Vec<ImpactResult> {
    parallel::map(pool, pairs, 4, |i, pair| {
        let motions = PairMotion::all(input, statics, pair, |body| input.bodies[body as usize].sweep);
        first_impact(motions.iter().zip(&candidates[i]), Vec3::ZERO)
    })
}

/// The contacts of each pair where its bodies end the step.
pub(super) fn contacts(
    input: &StepInput,
    statics: &Statics,
    pairs: &[BodyPair],
    candidates: &[Vec<Vec<PrimitivePair>>],
    stops: &Stops,
    pool: &TaskPool,
) -> Vec<Vec<Contact>> {
    parallel::map(pool, pairs, 4, |i, pair| {
        let [(first, pose1), (second, pose2)] =
            [pair.first, pair.second].map(|side| place(input, statics, side, |body| stops.final_pose(input, body)));
        let mut contacts = Vec::new();
        let Some(shape1) = first.medial() else { return contacts };
        let pose12 = pose1.inv_mul(&pose2);
        match second.second() {
            // Candidates are those of the whole motion.
            Second::Shape(shape2) if !pair.bodies().any(|body| stops.is_stopped(body)) => {
                contact::collect(shape1, shape2, &pose12, input.prediction, &candidates[i][0], &mut contacts);
            }
            second => contact::find(shape1, second, &pose12, input.prediction, &mut contacts),
        }
        contacts
    })
}

/// True if a pair that has met is in touch where its bodies are.
pub(super) fn are_in_touch(
    input: &StepInput,
    statics: &Statics,
    pair: &BodyPair,
    met: &Impact,
    pose_of: impl Fn(u32) -> Pose3,
) -> bool {
    let [(first, pose1), (second, pose2)] = [pair.first, pair.second].map(|side| place(input, statics, side, &pose_of));
    let met = [met.primitive1, met.primitive2];
    first
        .medial()
        .is_some_and(|shape1| contact::is_within(shape1, second.second(), &pose1.inv_mul(&pose2), TOUCH_DISTANCE, met))
}

/// A side of a pair, and where it is.
fn place<'a>(
    input: &'a StepInput,
    statics: &'a Statics,
    side: Side,
    pose_of: impl Fn(u32) -> Pose3,
) -> (&'a Solid, Pose3) {
    match side {
        Side::Body(body) => (&input.bodies[body as usize].solid, pose_of(body)),
        Side::Static(body) => (&statics.bodies[body as usize].solid, statics.bodies[body as usize].pose),
    }
}

/// The earliest impact of the candidates of a pair's motions: where an overlap grows by more than a slop, which contacts never do that the
/// solver knows about; for primitives that are apart before that, where they touch. None where what is left of the motion is less than a
/// slop itself: a pile that settles must come to rest.
///
/// What slides over a seam takes the overlap that it has along to the next part. `normal`: a direction in the world, from the first body to the
/// second, along which many of the candidates may be apart; zero if none is known.
pub(super) fn first_impact<'a>(
    motions: impl Iterator<Item = (&'a PairMotion<'a>, &'a Vec<PrimitivePair>)>,
    normal: Vec3,
) -> ImpactResult {
    let mut result = ImpactResult::default();
    let mut carried = 0.0f32;
    let mut approaching = Vec::new();
    let mut nearest = f32::INFINITY;
    for (motion, candidates) in motions.filter(|(_, candidates)| !candidates.is_empty()) {
        let chords = motion.chords();
        result.slop = result.slop.max(motion.slop);
        result.toi_tests += candidates.len();
        let direction = if normal == Vec3::ZERO { motion.center_line() } else { motion.to_frame(normal) };
        let mut parting = Parting::new(motion, &chords, direction);
        let mut starts = Vec::new();
        for &pair in candidates {
            if parting.as_mut().is_some_and(|parting| parting.is_apart(pair)) {
                continue;
            }
            let start = with_sides!(motion, pair, |first, second| rigid_start(&first, second, &chords));
            if let Some(parting) = &mut parting {
                parting.learn(start.normal());
            }
            if start.distance() < nearest {
                nearest = start.distance();
                result.normal = motion.frame_at(0.0).rotation * start.normal();
            }
            if !start.stay_apart() {
                carried = carried.max(start.overlap().min(motion.allowed));
                result.in_touch |= start.distance() <= TOUCH_DISTANCE;
                starts.push((pair, start));
            }
        }
        if !starts.is_empty() {
            approaching.push((motion, chords, starts));
        }
    }
    for (motion, chords, starts) in &approaching {
        let slop = [carried, motion.slop];
        for (pair, start) in starts {
            let limit = result.impact.map_or(1.0, |impact| impact.fraction);
            let toi = with_sides!(motion, *pair, |first, second| {
                rigid_impact(&first, second, chords, start, limit, slop)
            });
            result.unresolved += usize::from(toi.status == TimeOfImpactStatus::IterationLimit);
            let earlier = result.impact.is_none_or(|first| toi.fraction < first.fraction);
            if toi.status == TimeOfImpactStatus::Separated
                || !earlier
                || (1.0 - toi.fraction) * motion.way() <= motion.slop
            {
                continue;
            }
            let frame = motion.frame_at(toi.fraction);
            let normal = frame.rotation * toi.contact.normal;
            let primitive2 = match &motion.facing {
                Facing::Shape(_) => pair[1],
                Facing::Part(part) => part.id,
            };
            let middle = frame.transform_point((toi.contact.point1 + toi.contact.point2) * 0.5);
            let point = middle - normal * motion.facing.rounding();
            result.impact = Some(Impact { fraction: toi.fraction, point, normal, primitive1: pair[0], primitive2 });
        }
    }
    result
}
