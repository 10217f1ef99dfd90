//! The hierarchies of bodies on their way through a step.

use glam::{Vec3, Vec3A};

use super::{Shape, Side};
use crate::geometry::{Aabb, Placement, Pose3, Sphere, Sweep, Values};

/// Rows of two bodies of which the boxes are kept while a step runs. Fewer, and those of a body in many pairs are placed again; more, and they take more
/// memory, tens of kilobytes each.
const ROWS: usize = 16;

/// The boxes of the bodies that were asked for last, relative to where each is at the start, with the world's axes.
#[derive(Debug, Default)]
pub(super) struct BoxCache {
    rows: Vec<[Slot; 2]>,
}

#[derive(Debug, Default)]
struct Slot {
    side: Option<Side>,
    boxes: MovingBoxes,
    /// Of the row the one that was asked for last: the other is given up for a third.
    is_last: bool,
}

/// Where the boxes of a body are, until those of two others have been placed.
#[derive(Clone, Copy)]
pub(super) struct Place([usize; 2]);

impl BoxCache {
    /// Knows no body any more: they have moved.
    pub fn clear(&mut self) {
        for slot in self.rows.iter_mut().flatten() {
            slot.side = None;
            slot.is_last = false;
        }
    }

    /// Places the boxes of a body on its motion.
    pub fn place(&mut self, side: Side, shape: &Shape, sweep: &Sweep) -> Place {
        let (Side::Body(index) | Side::Static(index)) = side;
        let row = index as usize % ROWS;
        self.rows.resize_with(ROWS, Default::default);
        let slots = &mut self.rows[row];
        let known = slots.iter().position(|slot| slot.side == Some(side));
        let column = known.unwrap_or(usize::from(slots[0].is_last));
        let slot = &mut slots[column];
        if known.is_none() {
            slot.boxes.place(shape, sweep, sweep.start.translation, &shape.aabb());
            slot.side = Some(side);
        }
        slots[column].is_last = true;
        slots[1 - column].is_last = false;
        Place([row, column])
    }

    /// The boxes at a place between two times of the motion.
    pub fn between(&self, Place([row, column]): Place, times: [f32; 2]) -> TimedBoxes<'_> {
        self.rows[row][column].boxes.between(times)
    }
}

/// Boxes around a shape's primitives, and around those: for each node of its hierarchy where it is at the start of a motion and at its
/// end, with room for what its primitives stray from their chords in between.
#[derive(Debug, Default)]
pub(super) struct MovingBoxes {
    nodes: Values<MovingBox>,
    /// What they are relative to, in the frame of the sweep.
    origin: Vec3,
}

/// A box whose faces move steadily.
#[derive(Clone, Copy, Debug)]
pub(super) struct MovingBox {
    /// At the start and at the end.
    min: [Vec3A; 2],
    max: [Vec3A; 2],
}

/// Boxes between two times of their motion, fractions of it.
#[derive(Clone, Copy)]
pub(super) struct TimedBoxes<'a> {
    boxes: &'a MovingBoxes,
    times: [f32; 2],
    is_whole: bool,
}

impl MovingBoxes {
    /// Become those of the primitives of a shape that are within `target`, a box in the body's frame; others are nowhere. In the frame of the sweep, relative to
    /// `origin`.
    pub fn place(&mut self, shape: &Shape, sweep: &Sweep, origin: Vec3, target: &Aabb) {
        let frame = Pose3::from_translation(origin);
        let placements = [sweep.start, sweep.end].map(|pose| Placement::from(frame.inv_mul(&pose)));
        // How far a sphere strays from its chord, for each metre from the centre of mass.
        let stray = sweep.sagitta(1.0, 1);
        let place = |sphere: &Sphere| {
            let Sphere { center, radius } = sphere.scaled(shape.scale);
            let reach = Vec3A::splat(radius + stray * center.distance(sweep.local_center));
            let centers = placements.each_ref().map(|placement| Vec3A::from(placement.point(center)));
            MovingBox { min: centers.map(|center| center - reach), max: centers.map(|center| center + reach) }
        };
        let around = |primitive: u32| {
            let indices = shape.axis.primitives()[primitive as usize].indices();
            indices.iter().fold(MovingBox::NOWHERE, |all, &i| all.merge(&place(&shape.axis.spheres()[i as usize])))
        };
        // Back and forth a flat shape's face would be rounded out of its own box.
        let target = target.scaled(shape.scale.recip());
        let target = target.inflated(target.rounding());
        shape.bvh().values(&target, MovingBox::NOWHERE, around, MovingBox::merge, &mut self.nodes);
        self.origin = origin;
    }

    /// Between two times of the motion.
    fn between(&self, times: [f32; 2]) -> TimedBoxes<'_> {
        TimedBoxes { boxes: self, times, is_whole: times == [0.0, 1.0] }
    }

    /// The whole motion.
    pub fn whole(&self) -> TimedBoxes<'_> {
        self.between([0.0, 1.0])
    }
}

/// Visits the primitives of two shapes whose boxes pass a test, which is asked with two boxes, and by what the second is to be shifted.
pub(super) fn visit_pairs(
    [shape1, shape2]: [&Shape; 2],
    [boxes1, boxes2]: [TimedBoxes; 2],
    test: impl Fn(&MovingBox, &MovingBox, Vec3A) -> bool,
    visit: impl FnMut(u32, u32),
) {
    let offset = boxes1.offset(&boxes2);
    if boxes1.is_whole && boxes2.is_whole {
        let [nodes1, nodes2] = [boxes1, boxes2].map(|boxes| &boxes.boxes.nodes);
        shape1.bvh().visit_pairs(shape2.bvh(), |i, j| test(&nodes1[i], &nodes2[j], offset), visit);
    } else {
        let test = |i, j| test(&boxes1.node(i), &boxes2.node(j), offset);
        shape1.bvh().visit_pairs(shape2.bvh(), test, visit);
    }
}

impl TimedBoxes<'_> {
    /// The box of a node.
    pub fn node(&self, index: usize) -> MovingBox {
        let boxes = &self.boxes.nodes[index];
        if self.is_whole { *boxes } else { boxes.between(self.times) }
    }

    /// What they are relative to, in the frame of the motion.
    pub fn origin(&self) -> Vec3A {
        self.boxes.origin.into()
    }

    /// By how much the other's boxes are to be shifted to be in the same coordinates.
    pub fn offset(&self, other: &Self) -> Vec3A {
        other.origin() - self.origin()
    }
}

impl MovingBox {
    /// Holds nothing, and meets nothing.
    const NOWHERE: Self = Self { min: [Vec3A::INFINITY; 2], max: [Vec3A::NEG_INFINITY; 2] };

    /// From where it is at the start and at the end.
    pub fn new(boxes: [Aabb; 2]) -> Self {
        Self { min: boxes.map(|aabb| aabb.min.into()), max: boxes.map(|aabb| aabb.max.into()) }
    }

    fn merge(&self, other: &Self) -> Self {
        let both = [0, 1];
        Self { min: both.map(|i| self.min[i].min(other.min[i])), max: both.map(|i| self.max[i].max(other.max[i])) }
    }

    /// The part of its way between two times.
    fn between(&self, times: [f32; 2]) -> Self {
        let at = |[start, end]: [Vec3A; 2]| {
            let way = end - start;
            [start + way * times[0], start + way * times[1]]
        };
        Self { min: at(self.min), max: at(self.max) }
    }

    /// How far the other is beyond this one along each axis, and along each axis' reverse, at the start or at the end.
    #[inline]
    fn gaps(&self, other: &Self, offset: Vec3A, time: usize) -> [Vec3A; 2] {
        [other.min[time] + offset - self.max[time], self.min[time] - other.max[time] - offset]
    }

    /// True if they come within `reach` of each other along all axes at some time, the other shifted by `offset`.
    #[inline]
    pub fn meets(&self, other: &Self, offset: Vec3A, reach: f32) -> bool {
        let reach = Vec3A::splat(reach);
        let [starts, ends] = [self.gaps(other, offset, 0), self.gaps(other, offset, 1)];
        let apart = starts[0].min(ends[0]).max(starts[1].min(ends[1]));
        if apart.cmpgt(reach).any() {
            return false;
        }
        if starts[0].max(starts[1]).cmple(reach).all() || ends[0].max(ends[1]).cmple(reach).all() {
            return true;
        }
        // Along each axis by itself they meet. A gap that is there at the start only ends, one at the end begins.
        let (mut enter, mut leave) = (Vec3A::ZERO, Vec3A::ONE);
        for (start, end) in starts.into_iter().zip(ends) {
            let (start, end) = (start - reach, end - reach);
            let crossing = start / (start - end);
            enter = Vec3A::select(start.cmpgt(Vec3A::ZERO), enter.max(crossing), enter);
            leave = Vec3A::select(end.cmpgt(Vec3A::ZERO), leave.min(crossing), leave);
        }
        enter.max_element() <= leave.min_element()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{geometry::Primitive, medial_axis::MedialAxis, random::Random};

    impl MovingBox {
        /// The box at rest that holds the whole path.
        fn span(&self) -> Self {
            Self { min: [self.min[0].min(self.min[1]); 2], max: [self.max[0].max(self.max[1]); 2] }
        }

        /// True if they come within `reach` of each other along each axis at the start, the other shifted by `offset`.
        fn is_near(&self, other: &Self, offset: Vec3A, reach: f32) -> bool {
            let [above, below] = self.gaps(other, offset, 0);
            above.max(below).cmple(Vec3A::splat(reach)).all()
        }
    }

    #[test]
    fn the_boxes_of_both_bodies_of_a_pair_are_there() {
        let mut random = Random(5);
        let shape = Shape { axis: MedialAxis::torus(0.2, 0.05, 6).unwrap(), scale: 1.0 };
        let row = ROWS as u32;
        let sides = [Side::Body(1), Side::Body(1 + row), Side::Body(1 + 2 * row), Side::Static(1), Side::Body(2)];
        let sweeps = sides.map(|_| {
            let start = Pose3::from_translation(random.in_cube());
            Sweep::between(start, Pose3::from_translation(random.in_cube()), Vec3::ZERO, Vec3::ZERO)
        });
        let mut cache = BoxCache::default();
        let mut shared = 0;
        for _ in 0..200 {
            let pair = [(); 2].map(|()| random.below(sides.len()));
            let places = pair.map(|i| cache.place(sides[i], &shape, &sweeps[i]));
            shared += usize::from(pair[0] != pair[1] && places[0].0[0] == places[1].0[0]);
            for (i, place) in pair.into_iter().zip(places) {
                let mut own = MovingBoxes::default();
                own.place(&shape, &sweeps[i], sweeps[i].start.translation, &shape.aabb());
                let [kept, own] = [cache.between(place, [0.0, 1.0]), own.whole()].map(|boxes| boxes.node(3));
                assert_eq!((kept.min, kept.max), (own.min, own.max), "{pair:?}");
                assert_eq!(cache.between(place, [0.0, 1.0]).origin(), Vec3A::from(sweeps[i].start.translation));
            }
        }
        assert!(shared > 50, "only {shared} pairs share a row");
    }

    #[test]
    fn a_sheet_far_from_its_origin_is_within_its_own_box() {
        let sphere = |y: f32, z: f32| Sphere::new(Vec3::new(100.0, y, z), 0.0);
        let spheres = vec![sphere(0.0, 0.0), sphere(1.0, 0.0), sphere(0.0, 1.0)];
        let axis = MedialAxis::new(spheres, vec![Primitive::Slab([0, 1, 2])]).unwrap().0;
        for scale in (1..40).map(|i| 0.7 * i as f32) {
            let shape = Shape { axis: axis.clone(), scale };
            let mut cache = BoxCache::default();
            let place = cache.place(Side::Body(0), &shape, &Sweep::at_rest(Pose3::IDENTITY));
            assert!(cache.between(place, [0.0, 1.0]).node(0).min[0].is_finite(), "scale {scale}");
        }
    }

    #[test]
    fn boxes_that_meet_are_not_missed() {
        let mut random = Random(3);
        let (mut met, mut apart, mut apart_though_swept) = (0, 0, 0);
        for _ in 0..3000 {
            let mut moving = || {
                let half = random.in_cube().abs() * 0.5 + 0.05;
                let start = random.in_cube() * 2.0;
                let end = start + random.in_cube() * 3.0;
                MovingBox::new([start, end].map(|center| Aabb { min: center - half, max: center + half }))
            };
            let (first, second) = (moving(), moving());
            let offset = Vec3A::from(random.in_cube());
            let reach = 0.1;
            let touches = |time: f32| {
                let [first, second] = [first, second].map(|moving| moving.between([time; 2]));
                first.is_near(&second, offset, reach)
            };
            let sampled = (0..=100).any(|i| touches(i as f32 / 100.0));
            let meets = first.meets(&second, offset, reach);
            assert!(meets || !sampled, "they meet");
            met += usize::from(sampled);
            apart += usize::from(!meets);
            apart_though_swept += usize::from(!meets && first.span().meets(&second.span(), offset, reach));
        }
        assert!(met > 150 && apart > 500 && apart_though_swept > 300, "{met} {apart} {apart_though_swept}");
    }
}
