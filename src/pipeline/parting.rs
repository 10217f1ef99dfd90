//! A cheap separation test for many primitive pairs: along a direction that separates some primitives of two bodies, most others are separated too.

use glam::{BVec4A, Vec3, Vec4};

use super::{
    Core, Part, Shape,
    directions::Directions,
    motion::{Facing, PairMotion},
    with_spheres,
};
use crate::{
    constants::{CONTACT_ROUNDING, MAX_PARTING_CHORDS},
    geometry::{Placement, Primitive, Sphere},
    query::{Chords, Convex, Cuboid, Support},
};

/// Directions that separate primitives of a pair.
pub(super) struct Parting<'a> {
    first: Placed<'a>,
    second: Second<'a>,
    /// Smallest gaps that count as separation, in metres: at the start of the motion, and later.
    least: [f32; 2],
    directions: Directions,
}

/// Buffers for the spheres of both sides.
#[derive(Debug, Default)]
pub(super) struct Room([Vec<Sphere>; 2]);

/// The spheres of a shape at all ends of chords.
struct Placed<'a> {
    primitives: &'a [Primitive],
    /// Index: sphere * instants + instant.
    spheres: &'a [Sphere],
    instants: usize,
}

enum Second<'a> {
    Shape(Placed<'a>),
    /// A part at rest in the frame of the chords, and its smallest coordinate along each direction.
    Part(&'a Part<'a>, Vec4),
}

impl<'a> Parting<'a> {
    /// Creates the test with a first direction: a unit vector from the first side to the second, in the frame of the chords. Returns `None` if there are more
    /// than [`MAX_PARTING_CHORDS`] chords.
    pub fn new(motion: &'a PairMotion, chords: &Chords, direction: Vec3, room: &'a mut Room) -> Option<Self> {
        let placements = chords.placements();
        if placements.len() > MAX_PARTING_CHORDS + 1 {
            return None;
        }
        let growth = chords.deviation() + motion.facing.rounding();
        let Room([room1, room2]) = room;
        let first = Placed::new(motion.shape1, placements.iter().map(|p| &p[0]), growth, room1);
        let second = match &motion.facing {
            Facing::Shape(shape) => Second::Shape(Placed::new(shape, placements.iter().map(|p| &p[1]), 0.0, room2)),
            Facing::Part(part) => Second::Part(part, Vec4::ZERO),
        };
        let extent = match &second {
            Second::Shape(placed) => placed.extent(),
            Second::Part(part, _) => part.aabb().extent_squared().sqrt(),
        };
        let rounding = CONTACT_ROUNDING * first.extent().max(extent);
        let least = [rounding.max(motion.tolerances.touch), rounding];
        let mut parting = Self { first, second, least, directions: Directions::default() };
        parting.learn(direction);
        Some(parting)
    }

    /// Adds a direction that separates a pair of primitives, because it may separate others.
    pub fn learn(&mut self, direction: Vec3) {
        let lane = self.directions.learn(direction);
        if let Second::Part(part, low) = &mut self.second {
            low[lane] = match &part.core {
                Core::Cuboid(half) => Cuboid { half: *half }.low(direction),
                Core::Hull(hull) => with_spheres!(hull, |spheres| spheres.low(direction)),
                Core::Support(shape) => Support(&**shape).low(direction),
            };
        }
    }

    /// Returns true if one known direction separates two primitives over the whole motion, and if they are not in touch at the start. Pairs in touch always get
    /// a full test; otherwise the tested pairs would depend on the order of the pairs.
    ///
    /// Spheres move on lines between the instants, so the gap of two spheres along a direction is smallest at one of the instants.
    pub fn is_apart(&self, [first, second]: [u32; 2]) -> bool {
        let mut apart = BVec4A::TRUE;
        (0..self.first.instants).all(|instant| {
            let high = self.directions.high(self.first.at(first, instant));
            let low = match &self.second {
                Second::Shape(placed) => self.directions.low(placed.at(second, instant)),
                Second::Part(_, low) => *low,
            };
            apart &= (low - high).cmpgt(Vec4::splat(self.least[instant.min(1)]));
            apart.any()
        })
    }
}

impl<'a> Placed<'a> {
    fn new<'p>(
        shape: &'a Shape,
        placements: impl ExactSizeIterator<Item = &'p Placement> + Clone,
        growth: f32,
        spheres: &'a mut Vec<Sphere>,
    ) -> Self {
        let instants = placements.len();
        spheres.clear();
        for sphere in shape.axis.spheres() {
            let Sphere { center, radius } = sphere.scaled(shape.scale);
            spheres.extend(placements.clone().map(|placement| Sphere::new(placement.point(center), radius + growth)));
        }
        Self { primitives: shape.axis.primitives(), spheres, instants }
    }

    /// Returns the spheres of a primitive at an instant.
    fn at(&self, primitive: u32, instant: usize) -> impl Iterator<Item = &Sphere> {
        let indices = self.primitives[primitive as usize].indices();
        indices.iter().map(move |&sphere| &self.spheres[sphere as usize * self.instants + instant])
    }

    /// Returns the largest absolute coordinate or radius, in metres.
    fn extent(&self) -> f32 {
        let most = |s: &Sphere| s.center.abs().max_element().max(s.radius);
        self.spheres.iter().map(most).fold(0.0, f32::max)
    }
}

#[cfg(test)]
mod tests {
    use glam::Quat;

    use super::*;
    use crate::{
        geometry::{Obb, Pose3, Sweep},
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
    fn what_is_apart_never_touches() {
        let mut random = Random(4);
        let torus = Shape { axis: MedialAxis::torus(0.2, 0.05, 12).unwrap(), scale: 1.5 };
        let (mut apart, mut touching, mut parting_from_touch, mut many_chords) = (0, 0, 0, 0);
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
                for motion in PairMotion::all(&input, &statics, &pair, |body| input.bodies[body as usize].sweep) {
                    let (mut chords, mut room) = (Chords::default(), Room::default());
                    motion.set_chords(&mut chords);
                    many_chords += usize::from(chords.placements().len() > 2);
                    let mut parting = Parting::new(&motion, &chords, Vec3::Y, &mut room).unwrap();
                    let count = if second == Side::Static(0) { 1 } else { torus.len() as u32 };
                    for pair in (0..torus.len() as u32).flat_map(|i| (0..count).map(move |j| [i, j])) {
                        parting.learn(random.in_cube().normalize());
                        let [begin, least] = distances(&motion, pair);
                        if parting.is_apart(pair) {
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
        println!(
            "{apart} apart, {touching} touching, {parting_from_touch} touching at first, {many_chords} with many chords"
        );
        assert!(apart > 3000 && touching > 500 && parting_from_touch > 10 && many_chords > 20);
    }
}
