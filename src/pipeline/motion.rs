//! The motion of a body pair in the frame in which its primitives are placed.

use glam::{Mat3, Vec3};

use super::{Statics, StepInput, Target, broad_phase::BodyPair, contact::Second, shape::Shape};
use crate::{
    constants::{CHORD_TOLERANCE, STOP_ALLOWED, STOP_ROUNDINGS, STOP_SLOP},
    geometry::{Aabb, Placement, Pose3, Sphere, Sweep, part_within},
    query::Chords,
};

/// A body pair in relative coordinates.
///
/// The axes are the world's and the origin is body 1's position at the start, so nothing is lost far from the world's
/// origin; against a box, which never moves, the frame is that of the part of the box that is in reach.
pub(super) struct PairMotion<'a> {
    pub shape1: &'a Shape,
    pub second: Second<'a>,
    pub sweep1: Sweep,
    pub sweep2: Sweep,
    /// Takes the frame's vectors to the world.
    pub frame: Pose3,
    /// Distance from each body's centre of mass to the farthest centre of a sphere; 0 for a box. Radii do not turn.
    pub arms: [f32; 2],
    /// Bounding radius of the smaller body, in metres.
    pub size: f32,
    /// Overlap that the pair may gain, in metres.
    pub slop: f32,
}

impl<'a> PairMotion<'a> {
    /// `sweep_of`: the motion of a body, the whole step's or what is left of it.
    pub fn new(input: &'a StepInput, statics: &'a Statics, pair: &BodyPair, sweep_of: impl Fn(u32) -> Sweep) -> Self {
        let shape1 = &input.bodies[pair.body1 as usize].shape;
        let sweep1 = sweep_of(pair.body1);
        let origin = Pose3::from_translation(sweep1.start.translation);
        let mut rounding = 0.0;
        let (second, sweep2, frame) = match pair.target {
            Target::Body(i) => (Second::Shape(&input.bodies[i as usize].shape), sweep_of(i), origin),
            Target::Static(i) => match statics.bodies[i as usize].side() {
                (Second::Cuboid(half), pose) => {
                    let (center, part) = part_within(half, &reach(shape1, &sweep1.seen_from(&pose)));
                    rounding = f32::EPSILON * half.max_element();
                    let frame = pose * Pose3::from_translation(center);
                    (Second::Cuboid(part), Sweep::at_rest(frame), frame)
                }
                (second, pose) => (second, Sweep::at_rest(pose), origin),
            },
        };
        let (sweep1, sweep2) = (sweep1.seen_from(&frame), sweep2.seen_from(&frame));
        let (arm1, radius1) = (shape1.arm(sweep1.local_center), shape1.bounding_sphere().radius);
        let (arm2, size) = match second {
            Second::Shape(shape2) => (shape2.arm(sweep2.local_center), radius1.min(shape2.bounding_sphere().radius)),
            Second::Cuboid(_) | Second::Hull(_) | Second::Support(_) => (0.0, radius1),
        };
        let arms = [arm1, arm2];
        let slop = (STOP_SLOP * size).max(STOP_ALLOWED * input.allowed_overlap).max(STOP_ROUNDINGS * rounding);
        Self { shape1, second, sweep1, sweep2, frame, arms, size, slop }
    }

    /// The motion as chords.
    pub fn chords(&self) -> Chords {
        Chords::new([&self.sweep1, &self.sweep2], self.arms, CHORD_TOLERANCE * self.size)
    }

    /// The longest way of any point of one body relative to the other, or more, in metres.
    pub fn way(&self) -> f32 {
        let turn = self.sweep1.rotation.length() * self.arms[0] + self.sweep2.rotation.length() * self.arms[1];
        (self.sweep1.translation - self.sweep2.translation).length() + turn
    }

    /// True if neither body moves.
    pub fn is_at_rest(&self) -> bool {
        [&self.sweep1, &self.sweep2].iter().all(|sweep| sweep.translation == Vec3::ZERO && sweep.rotation == Vec3::ZERO)
    }

    /// How far any point strays from its chord over the whole step, both sides together.
    pub fn whole_sagitta(&self) -> f32 {
        self.sweep1.sagitta(self.arms[0], 1) + self.sweep2.sagitta(self.arms[1], 1)
    }
}

/// Box around the shape over its sweep, by its bounding sphere.
fn reach(shape: &Shape, sweep: &Sweep) -> Aabb {
    let radius = shape.radius_about(sweep.local_center);
    let start = sweep.start.transform_point(sweep.local_center);
    Aabb::from_spheres([start, start + sweep.translation].map(|center| Sphere::new(center, radius)))
}

/// Bounds the motion of the boxes of one body's hierarchy over the step, seen from a fixed frame.
pub(super) struct SweptBoxes {
    start: Placement,
    /// Moves a local point by its chord.
    chord: Placement,
    extents: Mat3,
    /// Angle of the rotation, at most a half turn.
    angle: f32,
    scale: f32,
}

/// A moving box: the middle goes from `center` by `motion`, the half extents hold for the whole step.
#[derive(Clone, Copy)]
pub(super) struct SweptBox {
    pub center: Vec3,
    pub motion: Vec3,
    pub half: Vec3,
}

impl SweptBoxes {
    /// `frame`: rotation from the parent frame into that in which boxes are compared.
    pub fn new(sweep: &Sweep, frame: Mat3, scale: f32) -> Self {
        let [start, end] = [0.0, 1.0].map(|fraction| {
            let placement = Placement::from(sweep.pose_at(fraction));
            Placement { rotation: frame * placement.rotation, translation: frame * placement.translation }
        });
        let chord =
            Placement { rotation: end.rotation - start.rotation, translation: end.translation - start.translation };
        let extents =
            Mat3::from_cols(start.rotation.x_axis.abs(), start.rotation.y_axis.abs(), start.rotation.z_axis.abs());
        Self { start, chord, extents, angle: sweep.rotation.length().min(2.0), scale }
    }

    /// The box over the step. A turn by an angle moves a corner by at most the angle, or twice, its distance from the middle.
    pub fn place(&self, aabb: &Aabb) -> SweptBox {
        let (center, half) = (aabb.center() * self.scale, aabb.half_extents() * self.scale);
        let grown = if self.angle > 0.0 { self.angle * half.length() } else { 0.0 };
        SweptBox {
            center: self.start.point(center),
            motion: self.chord.point(center),
            half: self.extents * half + grown,
        }
    }
}

impl SweptBox {
    /// A box that does not move.
    pub fn at_rest(aabb: &Aabb) -> Self {
        Self { center: aabb.center(), motion: Vec3::ZERO, half: aabb.half_extents() }
    }

    /// True if the boxes come within `margin` of each other at some instant, each axis by itself counted at the same time.
    pub fn meets(&self, other: &SweptBox, margin: f32) -> bool {
        let offset = other.center - self.center;
        let motion = other.motion - self.motion;
        let reach = self.half + other.half + margin;
        let (mut enter, mut leave) = (0.0f32, 1.0f32);
        for axis in 0..3 {
            if motion[axis].abs() > 1e-12 {
                let inverse = 1.0 / motion[axis];
                let (a, b) = ((-reach[axis] - offset[axis]) * inverse, (reach[axis] - offset[axis]) * inverse);
                enter = enter.max(a.min(b));
                leave = leave.min(a.max(b));
            } else if offset[axis].abs() > reach[axis] {
                return false;
            }
        }
        enter <= leave
    }
}
