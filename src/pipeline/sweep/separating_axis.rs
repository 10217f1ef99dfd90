//! A cheap separation test for many primitive pairs: along a direction that separates some primitives of two bodies, most others are separated too.

use glam::{BVec4A, Vec3, Vec4};

use crate::{
    constants::CONTACT_ROUNDING,
    geometry::{Placement, Pose3, Primitive, Sphere},
    pipeline::{
        Part, Shape,
        deforming::MovingPart,
        directions::Directions,
        sweep::motion::{OtherPart, PairMotion, with_core},
    },
    query::{Chord, Convex},
};

/// Directions that separate primitives of a pair.
pub(in crate::pipeline) struct SeparatingAxis<'a> {
    first: Placed<'a>,
    second: OtherSide<'a>,
    /// Smallest gaps that count as separation, in metres: at the start of the motion, and later.
    least: [f32; 2],
    directions: Directions,
}

/// The spheres of a shape at the start and at the end of a chord.
struct Placed<'a> {
    primitives: &'a [Primitive],
    spheres: &'a [[Sphere; 2]],
}

enum OtherSide<'a> {
    Shape(Placed<'a>),
    /// A part at rest in the frame of the chord, and its smallest coordinate along each direction.
    Part(&'a Part<'a>, Vec4),
    /// A part whose spheres move within its body, the poses of the body at the start and at the end, and the smallest coordinates there.
    Moving(&'a MovingPart<'a>, [Pose3; 2], [Vec4; 2]),
}

impl<'a> SeparatingAxis<'a> {
    /// Creates the test with a first direction: a unit vector from the first side to the second, in the frame of the chord. `spheres`: buffers for both sides.
    pub fn new(motion: &'a PairMotion, chord: &Chord, direction: Vec3, spheres: &'a mut [Vec<[Sphere; 2]>; 2]) -> Self {
        let [start, end] = chord.ends();
        let growth = chord.deviation() + motion.other.rounding();
        let [spheres1, spheres2] = spheres;
        let first = Placed::new(motion.shape1, [&start[0], &end[0]], growth, spheres1);
        let second = match &motion.other {
            OtherPart::Shape(shape) => OtherSide::Shape(Placed::new(shape, [&start[1], &end[1]], 0.0, spheres2)),
            OtherPart::Part(part) => OtherSide::Part(part, Vec4::ZERO),
            OtherPart::Moving(part) => {
                OtherSide::Moving(part, [motion.sweep2.start, motion.sweep2.end], [Vec4::ZERO; 2])
            }
        };
        let extent = match &second {
            OtherSide::Shape(placed) => placed.extent(),
            OtherSide::Part(part, _) => part.aabb().extent_squared().sqrt(),
            OtherSide::Moving(part, ..) => part.boxes().map(|aabb| aabb.extent_squared().sqrt())[0],
        };
        let rounding = CONTACT_ROUNDING * first.extent().max(extent);
        let least = [rounding.max(motion.tolerances.touch), rounding];
        let mut separating_axis = Self { first, second, least, directions: Directions::default() };
        separating_axis.push_axis(direction);
        separating_axis
    }

    /// Adds a direction that separates a pair of primitives, because it may separate others.
    pub fn push_axis(&mut self, direction: Vec3) {
        let lane = self.directions.push_axis(direction);
        match &mut self.second {
            OtherSide::Shape(_) => {}
            OtherSide::Part(part, low) => low[lane] = with_core!(part, |core| core.low(direction)),
            OtherSide::Moving(part, poses, lows) => {
                for (instant, (pose, low)) in poses.iter().zip(lows).enumerate() {
                    low[lane] =
                        part.low(pose.rotation.inverse() * direction, instant) + pose.translation.dot(direction);
                }
            }
        }
    }

    /// Returns true if one known direction separates two primitives over the whole motion, and if they are not in touch at the start. Pairs in touch always get
    /// a full test; otherwise the tested pairs would depend on the order of the pairs.
    ///
    /// Spheres move on lines, so the gap of two spheres along a direction is smallest at the start or at the end.
    pub fn is_apart(&self, [first, second]: [u32; 2]) -> bool {
        let mut apart = BVec4A::TRUE;
        (0..2).all(|instant| {
            let high = self.directions.high(self.first.at(first, instant));
            let low = match &self.second {
                OtherSide::Shape(placed) => self.directions.low(placed.at(second, instant)),
                OtherSide::Part(_, low) => *low,
                OtherSide::Moving(.., lows) => lows[instant],
            };
            apart &= (low - high).cmpgt(Vec4::splat(self.least[instant]));
            apart.any()
        })
    }
}

impl<'a> Placed<'a> {
    fn new(shape: &'a Shape, ends: [&Placement; 2], growth: f32, spheres: &'a mut Vec<[Sphere; 2]>) -> Self {
        spheres.clear();
        spheres.extend(shape.axis.spheres().iter().map(|sphere| {
            let Sphere { center, radius } = sphere.scaled(shape.scale);
            ends.map(|placement| Sphere::new(placement.point(center), radius + growth))
        }));
        Self { primitives: shape.axis.primitives(), spheres }
    }

    /// Returns the spheres of a primitive at the start or at the end.
    fn at(&self, primitive: u32, end: usize) -> impl Iterator<Item = &Sphere> {
        let indices = self.primitives[primitive as usize].indices();
        indices.iter().map(move |&sphere| &self.spheres[sphere as usize][end])
    }

    /// Returns the largest absolute coordinate or radius, in metres.
    fn extent(&self) -> f32 {
        let most = |s: &Sphere| s.center.abs().max_element().max(s.radius);
        self.spheres.as_flattened().iter().map(most).fold(0.0, f32::max)
    }
}

#[cfg(test)]
mod tests {
    use glam::Quat;

    use super::*;
    use crate::{
        geometry::{Obb, Sweep},
        medial_axis::MedialAxis,
        pipeline::{Body, Side, StaticBody, Statics, StepInput, pairs::BodyPair},
        random::Random,
    };

    /// Returns the distance of two primitives at the start of the step, and the smallest sampled distance over the step.
    fn distances(motion: &PairMotion, pair: [u32; 2]) -> [f32; 2] {
        let at = |instant: u8| motion.distance_at(f32::from(instant) / 64.0, pair);
        [at(0), (0..=64).map(at).fold(f32::INFINITY, f32::min)]
    }

    #[test]
    fn separated_primitives_never_touch() {
        let mut random = Random(4);
        let torus = Shape { axis: MedialAxis::torus(0.2, 0.05, 12).unwrap(), scale: 1.5 };
        let (mut apart, mut touching, mut parting_from_touch, mut curved) = (0, 0, 0, 0);
        for case in 0..60 {
            let mut sweep = |speed: f32, turn: f32| {
                let rotation = Quat::from_scaled_axis(random.in_cube() * 3.0);
                let start = Pose3::from_parts(random.in_cube() * 0.4, rotation);
                let turn = random.in_cube() * turn;
                let end = Pose3::from_parts(
                    start.translation + random.in_cube() * speed,
                    (Quat::from_scaled_axis(turn) * rotation).normalize(),
                );
                Sweep::between(start, end, Vec3::ZERO, turn)
            };
            let turn = [0.0, 0.05, 0.4][case % 3];
            let bodies = vec![Body::new(torus.clone(), sweep(0.3, turn)), Body::new(torus.clone(), sweep(0.3, turn))];
            let obb = Obb { pose: sweep(0.0, 0.0).start, half_extents: Vec3::new(0.3, 0.02, 0.1) };
            let statics = Statics::new(vec![StaticBody::solid_box(obb)]);
            // With this length unit, primitives at a distance of 1 cm are in touch.
            let input = StepInput { bodies, length_unit: 10.0, ..Default::default() };
            for second in [Side::Body(1), Side::Static(0)] {
                let pair = BodyPair { first: Side::Body(0), second, stops: true };
                for motion in PairMotion::of_step(&input, &statics, &pair, |_, _| false) {
                    let (chord, mut spheres) = (motion.chord(), Default::default());
                    curved += usize::from(!motion.is_one_interval(&chord));
                    let mut separating_axis = SeparatingAxis::new(&motion, &chord, Vec3::Y, &mut spheres);
                    let count = if second == Side::Static(0) { 1 } else { torus.len() as u32 };
                    for pair in (0..torus.len() as u32).flat_map(|i| (0..count).map(move |j| [i, j])) {
                        separating_axis.push_axis(random.in_cube().normalize());
                        let [begin, least] = distances(&motion, pair);
                        if separating_axis.is_apart(pair) {
                            apart += 1;
                            assert!(least > 0.0, "{pair:?} of case {case} come within {least} m");
                            assert!(begin > motion.tolerances.touch, "{pair:?} of case {case} begin {begin} m apart");
                        } else {
                            touching += usize::from(least <= 0.0);
                            parting_from_touch += usize::from(least > 0.0 && begin <= motion.tolerances.touch);
                        }
                    }
                }
            }
        }
        println!("{apart} apart, {touching} touching, {parting_from_touch} touching at first, {curved} curved");
        assert!(apart > 3000 && touching > 500 && parting_from_touch > 10 && curved > 20);
    }
}
