//! BVH boxes of bodies that move through a step.

use glam::{Vec3, Vec3A};

use crate::{
    geometry::{Aabb, Placement, Pose3, Sphere, Sweep, Values},
    pipeline::{Shape, Side},
};

/// Number of cache rows per thread. A row keeps the boxes of two bodies while a step runs. With fewer rows the boxes of a body in many pairs are computed more
/// often. With more rows a thread needs more memory: 32 kilobytes per row for shapes of 100 primitives.
const ROWS: usize = 128;

/// Cache of the boxes of recently requested bodies. Boxes are relative to the position of their body at the start, with the world's axes.
#[derive(Debug, Default)]
pub(in crate::pipeline) struct BoxCache {
    rows: Vec<[Slot; 2]>,
}

#[derive(Debug, Default)]
struct Slot {
    side: Option<Side>,
    boxes: MovingBoxes,
    /// True for the slot of the row that was requested last. A new body replaces the other slot.
    is_last: bool,
}

/// Location of a body's boxes in the cache. Valid until the boxes of two other bodies have been placed.
#[derive(Clone, Copy)]
pub(in crate::pipeline) struct Place([usize; 2]);

impl BoxCache {
    /// Invalidates all boxes, because the bodies have moved.
    pub fn clear(&mut self) {
        for slot in self.rows.iter_mut().flatten() {
            slot.side = None;
            slot.is_last = false;
        }
    }

    /// Computes the boxes of a body over its motion unless the cache has them, and returns their location.
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

    /// Returns the boxes at a location between two fractions of the motion.
    pub fn between(&self, Place([row, column]): Place, times: [f32; 2]) -> TimedBoxes<'_> {
        self.rows[row][column].boxes.between(times)
    }
}

/// Boxes of all BVH nodes of a moving shape, at the start and at the end of its motion. The boxes include the sagitta of the primitives' arcs, so linear
/// interpolation between both is conservative.
#[derive(Debug, Default)]
pub(in crate::pipeline) struct MovingBoxes {
    nodes: Values<MovingBox>,
    /// Boxes of the spheres.
    spheres: Vec<MovingBox>,
    /// Origin of the boxes' coordinates, in the frame of the sweep.
    origin: Vec3,
}

/// A box whose faces move at constant velocities.
#[derive(Clone, Copy, Debug)]
pub(in crate::pipeline) struct MovingBox {
    /// Minimum corners at the start and at the end.
    min: [Vec3A; 2],
    max: [Vec3A; 2],
}

/// Boxes between two fractions of their motion.
#[derive(Clone, Copy)]
pub(in crate::pipeline) struct TimedBoxes<'a> {
    boxes: &'a MovingBoxes,
    times: [f32; 2],
    is_whole: bool,
}

impl MovingBoxes {
    /// Computes the boxes of a shape's primitives that overlap with `target`, a box in the body's frame. Other primitives get an empty box. The boxes are in
    /// the frame of the sweep, relative to `origin`.
    pub fn place(&mut self, shape: &Shape, sweep: &Sweep, origin: Vec3, target: &Aabb) {
        let frame = Pose3::from_translation(origin);
        let placements = [sweep.start, sweep.end].map(|pose| Placement::from(frame.inv_mul(&pose)));
        // Largest distance of a sphere centre from its chord, per metre from the centre of mass.
        let stray = sweep.sagitta(1.0);
        let place = |sphere: &Sphere| {
            let Sphere { center, radius } = sphere.scaled(shape.scale);
            let reach = Vec3A::splat(radius + stray * center.distance(sweep.local_center));
            let centers = placements.each_ref().map(|placement| Vec3A::from(placement.point(center)));
            MovingBox { min: centers.map(|center| center - reach), max: centers.map(|center| center + reach) }
        };
        let Self { nodes, spheres, .. } = self;
        spheres.clear();
        spheres.extend(shape.axis.spheres().iter().map(place));
        let around = |primitive: u32| {
            let indices = shape.axis.primitives()[primitive as usize].indices();
            indices.iter().fold(MovingBox::NOWHERE, |all, &i| all.merge(&spheres[i as usize]))
        };
        // Scaling back and forth rounds. Without a margin, the face of a flat shape could be outside of its own box.
        let target = target.scaled(shape.scale.recip());
        let target = target.inflated(target.rounding());
        shape.bvh().values(&target, MovingBox::NOWHERE, around, MovingBox::merge, nodes);
        self.origin = origin;
    }

    /// Returns the boxes between two fractions of the motion.
    fn between(&self, times: [f32; 2]) -> TimedBoxes<'_> {
        TimedBoxes { boxes: self, times, is_whole: times == [0.0, 1.0] }
    }

    /// Returns the boxes of the whole motion.
    pub fn whole(&self) -> TimedBoxes<'_> {
        self.between([0.0, 1.0])
    }
}

/// Visits the pairs of primitives of two shapes whose boxes pass `test`. The arguments of `test` are two boxes and the offset to add to the second.
pub(in crate::pipeline) fn visit_pairs(
    [shape1, shape2]: [&Shape; 2],
    [boxes1, boxes2]: [TimedBoxes; 2],
    test: impl Fn(&MovingBox, &MovingBox, Vec3A) -> bool,
    visit: impl FnMut(u32, u32),
) {
    let offset = boxes2.origin() - boxes1.origin();
    if boxes1.is_whole && boxes2.is_whole {
        let [nodes1, nodes2] = [boxes1, boxes2].map(|boxes| &boxes.boxes.nodes);
        shape1.bvh().visit_pairs(shape2.bvh(), |i, j| test(&nodes1[i], &nodes2[j], offset), visit);
    } else {
        let test = |i, j| test(&boxes1.node(i), &boxes2.node(j), offset);
        shape1.bvh().visit_pairs(shape2.bvh(), test, visit);
    }
}

impl TimedBoxes<'_> {
    /// Returns the box of a BVH node.
    pub fn node(&self, index: usize) -> MovingBox {
        let boxes = &self.boxes.nodes[index];
        if self.is_whole { *boxes } else { boxes.between(self.times) }
    }

    /// Returns the origin of the boxes' coordinates, in the frame of the sweep.
    pub fn origin(&self) -> Vec3A {
        self.boxes.origin.into()
    }
}

impl MovingBox {
    /// An empty box. It meets no other box.
    const NOWHERE: Self = Self { min: [Vec3A::INFINITY; 2], max: [Vec3A::NEG_INFINITY; 2] };

    /// Creates a moving box from the boxes at the start and at the end.
    pub fn new(boxes: [Aabb; 2]) -> Self {
        Self { min: boxes.map(|aabb| aabb.min.into()), max: boxes.map(|aabb| aabb.max.into()) }
    }

    fn merge(&self, other: &Self) -> Self {
        let both = [0, 1];
        Self { min: both.map(|i| self.min[i].min(other.min[i])), max: both.map(|i| self.max[i].max(other.max[i])) }
    }

    /// Returns the part of the motion between two fractions.
    fn between(&self, times: [f32; 2]) -> Self {
        let at = |[start, end]: [Vec3A; 2]| {
            let displacement = end - start;
            [start + displacement * times[0], start + displacement * times[1]]
        };
        Self { min: at(self.min), max: at(self.max) }
    }

    /// Returns the gaps to the other box along each positive axis and along each negative axis. `time`: 0 for the start, 1 for the end.
    #[inline]
    fn gaps(&self, other: &Self, offset: Vec3A, time: usize) -> [Vec3A; 2] {
        [other.min[time] + offset - self.max[time], self.min[time] - other.max[time] - offset]
    }

    /// Returns true if, at some time, the boxes are within `reach` of each other along all axes. `offset` is added to the other box.
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
        // Each axis alone has a time without a gap. A gap at the start closes at its crossing, and a gap at the end opens there.
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
        /// Returns the box at rest that contains the whole path.
        fn span(&self) -> Self {
            Self { min: [self.min[0].min(self.min[1]); 2], max: [self.max[0].max(self.max[1]); 2] }
        }

        /// Returns true if the boxes are within `reach` of each other along each axis at the start. `offset` is added to the other box.
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
    fn every_pair_of_touching_boxes_is_found() {
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
            assert!(meets || !sampled, "boxes that meet are missed");
            met += usize::from(sampled);
            apart += usize::from(!meets);
            apart_though_swept += usize::from(!meets && first.span().meets(&second.span(), offset, reach));
        }
        assert!(met > 150 && apart > 500 && apart_though_swept > 300, "{met} {apart} {apart_though_swept}");
    }
}
