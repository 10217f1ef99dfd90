//! A cheap look at many primitives: along a direction in which some of two bodies are apart, most others are as well.

use glam::{Vec3, Vec4};

use super::{
    Core, Part, Shape,
    motion::{Facing, PairMotion},
    with_spheres,
};
use crate::{
    constants::{CONTACT_ROUNDING, MAX_PARTING_CHORDS, PARTING_DIRECTIONS},
    geometry::{Placement, Primitive, Sphere},
    query::{Chords, Convex, Cuboid, Support},
};

/// Directions along which primitives of a pair were apart.
pub(super) struct Parting<'a> {
    first: Placed<'a>,
    second: Second<'a>,
    rounding: f32,
    /// The latest that was of use comes first.
    directions: Vec<Direction>,
}

/// The spheres of a shape wherever a chord begins or ends.
struct Placed<'a> {
    primitives: &'a [Primitive],
    /// Centre and radius, sphere by sphere, each instant by instant.
    spheres: Vec<Vec4>,
    instants: usize,
}

enum Second<'a> {
    /// The fourth components are the negative radii.
    Shape(Placed<'a>),
    /// It rests in the frame of the chords.
    Part(&'a Part<'a>),
}

#[derive(Clone, Copy)]
struct Direction {
    /// A unit vector, and 1.
    vector: Vec4,
    /// How far a part reaches against it.
    low: f32,
}

impl<'a> Parting<'a> {
    /// `direction`: a unit vector of the frame of the chords, from the first side to the second. None if there are too many chords.
    pub fn new(motion: &'a PairMotion, chords: &'a Chords, direction: Vec3) -> Option<Self> {
        let placements = chords.placements();
        if placements.len() > MAX_PARTING_CHORDS + 1 {
            return None;
        }
        let growth = chords.deviation() + motion.facing.rounding();
        let first = Placed::new(motion.shape1, placements.iter().map(|p| &p[0]), |radius| radius + growth);
        let second = match &motion.facing {
            Facing::Shape(shape) => {
                Second::Shape(Placed::new(shape, placements.iter().map(|p| &p[1]), |radius| -radius))
            }
            Facing::Part(part) => Second::Part(part),
        };
        let extent = match &second {
            Second::Shape(placed) => placed.extent(),
            Second::Part(part) => part.aabb().extent_squared().sqrt(),
        };
        let rounding = CONTACT_ROUNDING * first.extent().max(extent);
        let mut parting = Self { first, second, rounding, directions: Vec::new() };
        parting.learn(direction);
        Some(parting)
    }

    /// Remembers a direction: where a pair was apart, others may be.
    pub fn learn(&mut self, direction: Vec3) {
        let low = match &self.second {
            Second::Shape(_) => 0.0,
            Second::Part(part) => match &part.core {
                Core::Cuboid(half) => Cuboid { half: *half }.low(direction),
                Core::Hull(hull) => with_spheres!(hull, |spheres| spheres.low(direction)),
                Core::Support(shape) => Support(&**shape).low(direction),
            },
        };
        self.directions.insert(0, Direction { vector: direction.extend(1.0), low });
        self.directions.truncate(PARTING_DIRECTIONS);
    }

    /// True if two primitives stay apart along a direction that is known, all the way.
    pub fn is_apart(&mut self, pair: [u32; 2]) -> bool {
        let found = (0..self.directions.len()).find(|&i| self.is_apart_along(pair, &self.directions[i]));
        if let Some(i) = found {
            self.directions[..=i].rotate_right(1);
        }
        found.is_some()
    }

    /// Spheres move on lines between the instants, so the gap of any two is least at one of them.
    fn is_apart_along(&self, [first, second]: [u32; 2], direction: &Direction) -> bool {
        (0..self.first.instants).all(|instant| {
            let high = self.first.reaches(first, instant, direction.vector).fold(f32::NEG_INFINITY, f32::max);
            let low = match &self.second {
                Second::Shape(placed) => {
                    placed.reaches(second, instant, direction.vector).fold(f32::INFINITY, f32::min)
                }
                Second::Part(_) => direction.low,
            };
            low - high > self.rounding
        })
    }
}

impl<'a> Placed<'a> {
    fn new(
        shape: &'a Shape,
        placements: impl ExactSizeIterator<Item = &'a Placement> + Clone,
        radius: impl Fn(f32) -> f32,
    ) -> Self {
        let instants = placements.len();
        let mut spheres = Vec::with_capacity(shape.axis.spheres().len() * instants);
        for sphere in shape.axis.spheres() {
            let Sphere { center, radius: unsigned } = sphere.scaled(shape.scale);
            spheres.extend(placements.clone().map(|placement| placement.point(center).extend(radius(unsigned))));
        }
        Self { primitives: shape.axis.primitives(), spheres, instants }
    }

    /// How far the spheres of a primitive reach along a direction.
    fn reaches(&self, primitive: u32, instant: usize, direction: Vec4) -> impl Iterator<Item = f32> {
        let indices = self.primitives[primitive as usize].indices();
        indices.iter().map(move |&sphere| self.spheres[sphere as usize * self.instants + instant].dot(direction))
    }

    /// The largest coordinate or radius.
    fn extent(&self) -> f32 {
        self.spheres.iter().fold(Vec4::ZERO, |most, sphere| most.max(sphere.abs())).max_element()
    }
}
