//! Relative motion of a pair, in the frame in which its primitives are placed.

use glam::Vec3;
use smallvec::{SmallVec, smallvec};

use crate::{
    constants::{INTERVAL_PATH, MANY_PRIMITIVES},
    geometry::{Aabb, Pose3, Sphere, Sweep},
    pipeline::{
        Part, Side, Solid, Statics, StepInput,
        deforming::MovingPart,
        pairs::{BodyPair, PrimitivePair},
        shape::Shape,
        tolerances::Tolerances,
    },
    query::Chord,
};

/// The second side of a pair motion.
pub(in crate::pipeline) enum OtherPart<'a> {
    /// A medial mesh.
    Shape(&'a Shape),
    /// A convex part of any other body.
    Part(Part<'a>),
    /// A primitive whose spheres move within its body.
    Moving(MovingPart<'a>),
}

impl OtherPart<'_> {
    /// Returns the distance of a part's surface from its core, in metres; 0 for a medial mesh.
    pub fn rounding(&self) -> f32 {
        match self {
            OtherPart::Shape(_) | OtherPart::Moving(_) => 0.0,
            OtherPart::Part(part) => part.rounding,
        }
    }

    /// Returns the number of primitives.
    pub fn len(&self) -> usize {
        if let OtherPart::Shape(shape) = self { shape.len() } else { 1 }
    }

    /// Returns the index of a primitive in its body.
    pub fn id(&self, primitive: u32) -> u32 {
        match self {
            OtherPart::Shape(_) => primitive,
            OtherPart::Part(part) => part.id,
            OtherPart::Moving(part) => part.id,
        }
    }
}

/// Runs an expression with the core of a part.
macro_rules! with_core {
    ($part:expr, |$second:ident| $body:expr) => {
        match &$part.core {
            $crate::pipeline::Core::Cuboid(half) => {
                let $second = &$crate::query::Cuboid { half: *half };
                $body
            }
            $crate::pipeline::Core::Support(shape) => {
                let $second = &$crate::query::Support(&**shape);
                $body
            }
            $crate::pipeline::Core::Hull(hull) => $crate::pipeline::with_spheres!(hull, |$second| $body),
        }
    };
}
pub(in crate::pipeline) use with_core;

/// Runs an expression with a primitive of the first side and one of the second: a primitive of a medial mesh, the core of a part, or moving spheres. The
/// rounding of a part is added to the radii of the first primitive.
macro_rules! with_sides {
    ($other:expr, $hull:expr, $primitive2:expr, |$first:ident, $second:ident| $body:expr) => {
        $crate::pipeline::with_spheres!($hull, |$first| match &$other {
            $crate::pipeline::sweep::motion::OtherPart::Shape(shape2) => {
                $crate::pipeline::with_spheres!(&shape2.hull($primitive2), |$second| $body)
            }
            $crate::pipeline::sweep::motion::OtherPart::Part(part) => {
                let $first = $first.map(|s| $crate::geometry::Sphere::new(s.center, s.radius + part.rounding));
                $crate::pipeline::sweep::motion::with_core!(part, |$second| $body)
            }
            $crate::pipeline::sweep::motion::OtherPart::Moving(part) => {
                $crate::pipeline::deforming::with_moving!(&part.hull, |$second| $body)
            }
        })
    };
}
pub(in crate::pipeline) use with_sides;

/// A medial body and a second side, in relative coordinates.
///
/// If the second side is a medial mesh, the frame has the world's axes and its origin is the position of body 1 at the start. If it is a part, the
/// frame is the part's frame at the start. Relative coordinates keep f32 precision far from the world's origin.
pub(in crate::pipeline) struct PairMotion<'a> {
    pub shape1: &'a Shape,
    pub other: OtherPart<'a>,
    pub sweep1: Sweep,
    pub sweep2: Sweep,
    /// Pose of the frame in the world.
    pub frame: Pose3,
    /// Per body, distance from the centre of mass to the farthest point that moves on an arc, in metres. For a medial mesh this is a sphere centre, because
    /// rotation does not change a radius.
    pub arms: [f32; 2],
    pub tolerances: Tolerances,
}

/// The paths of both sides of a pair motion.
pub(in crate::pipeline) struct Paths<'a> {
    sweeps: [Sweep; 2],
    moving: Option<MovingPart<'a>>,
}

/// The motions of a pair. Most pairs have one.
pub(in crate::pipeline) type Motions<'a> = SmallVec<[PairMotion<'a>; 1]>;

impl<'a> PairMotion<'a> {
    /// Creates the motions of a pair: one for a medial second side, or one for each part of another collider that is in reach.
    ///
    /// `is_idle`: returns true for motions without an impact, from an upper bound of the path length of any point relative to the other body, in metres. They
    /// are left out.
    /// `sweep_of`: the motion of a body over the rest of the step, which begins at the fraction `from`.
    pub fn all(
        input: &'a StepInput,
        statics: &'a Statics,
        pair: &BodyPair,
        is_idle: impl Fn(f32, &Tolerances) -> bool,
        from: f32,
        sweep_of: impl Fn(u32) -> Sweep,
    ) -> Motions<'a> {
        let side = |side: Side| {
            let (solid, sweep) = input.side(statics, side);
            (solid, side.body().map_or(sweep, &sweep_of))
        };
        let ((first, sweep1), (second, sweep2)) = (side(pair.first), side(pair.second));
        let Some(shape1) = first.medial() else { return Motions::new() };
        let bound2 = second.bounding_sphere();
        let arm2 = match second.medial() {
            Some(shape2) => shape2.arm(sweep2.local_center),
            None => bound2.farthest(sweep2.local_center),
        };
        let arms = [shape1.arm(sweep1.local_center), arm2];
        let size = shape1.bounding_sphere().radius.min(bound2.radius);
        let turning = sweep1.turning(arms[0]) + sweep2.turning(arms[1]);
        let tolerances = Tolerances::new(input, statics, pair, size, turning);
        let path = relative_path([&sweep1, &sweep2], arms);
        if second.deforming().is_none() && is_idle(path, &tolerances) {
            return Motions::new();
        }
        let motion = |frame: Pose3, sweep2: Sweep, other: OtherPart<'a>| Self {
            shape1,
            other,
            sweep1: sweep1.seen_from(&frame),
            sweep2: sweep2.seen_from(&frame),
            frame,
            arms,
            tolerances,
        };
        let of_part = |pose: Pose3, other: OtherPart<'a>| motion(sweep2.start * pose, sweep2.of_part(&pose), other);
        let reach = || reach(shape1, &sweep1, &sweep2, arm2);
        match second {
            Solid::Medial(shape2) => {
                smallvec![motion(Pose3::from_translation(sweep1.start.translation), sweep2, OtherPart::Shape(shape2))]
            }
            Solid::Parts(parts) => {
                parts.within(&reach()).into_iter().map(|part| of_part(part.pose, OtherPart::Part(part))).collect()
            }
            Solid::Deforming(shape2) => {
                let reach = reach();
                let parts = shape2.moving_within(&reach, from);
                let parts = parts.filter(|part| !is_idle(path + part.path(), &tolerances));
                parts.map(|part| of_part(Pose3::IDENTITY, OtherPart::Moving(part))).collect()
            }
        }
    }

    /// Creates the motions of a pair over the whole step: see [`all`](Self::all).
    pub fn of_step(
        input: &'a StepInput,
        statics: &'a Statics,
        pair: &BodyPair,
        is_idle: impl Fn(f32, &Tolerances) -> bool,
    ) -> Motions<'a> {
        Self::all(input, statics, pair, is_idle, 0.0, |body| input.bodies[body as usize].sweep)
    }

    /// Returns the chord of the motion. For a moving part, it is that of the first side in the part's frame, because kernels for boxes require a box at
    /// rest.
    pub fn chord(&self) -> Chord {
        let sweeps = [&self.sweep1, &self.sweep2];
        match self.other {
            OtherPart::Part(_) if !self.sweep2.is_at_rest() => Chord::in_frame_of_second(sweeps, self.arms[0]),
            _ => Chord::new(sweeps, self.arms),
        }
    }

    /// Returns the paths of both sides.
    pub fn paths(&self) -> Paths<'a> {
        let moving = if let OtherPart::Moving(moving) = &self.other { Some(*moving) } else { None };
        Paths { sweeps: [self.sweep1, self.sweep2], moving }
    }

    /// Replaces the motion by a part of the given paths, between two fractions of them.
    pub fn follow(&mut self, Paths { sweeps, moving }: &Paths<'a>, part: [f32; 2]) {
        [self.sweep1, self.sweep2] = sweeps.map(|sweep| sweep.part(part));
        if let Some(moving) = moving {
            self.other = OtherPart::Moving(moving.part(part));
        }
    }

    /// Returns the fraction of the motion at which the first line of spheres that move within their body ends; `None` if there is only one line.
    pub fn first_corner(&self) -> Option<f32> {
        if let OtherPart::Moving(moving) = &self.other { moving.first_corner() } else { None }
    }

    /// Returns true if the motion is short enough for one search: points move almost on lines, and few primitives come near each other.
    pub fn is_one_interval(&self, chord: &Chord) -> bool {
        let has_few = self.shape1.len() * self.other.len() <= MANY_PRIMITIVES;
        self.first_corner().is_none()
            && chord.deviation() <= self.tolerances.chord_deviation()
            && (has_few || self.path() <= INTERVAL_PATH * self.tolerances.size)
    }

    /// Returns the pose of the chord's frame in the world at a fraction of the motion.
    pub fn frame_at(&self, fraction: f32) -> Pose3 {
        match self.other {
            OtherPart::Part(_) if !self.sweep2.is_at_rest() => self.frame * self.sweep2.pose_at(fraction),
            _ => self.frame,
        }
    }

    /// Transforms a direction from the world to the frame of the chord at the start.
    pub fn to_chord(&self, direction: Vec3) -> Vec3 {
        self.frame_at(0.0).rotation.inverse() * direction
    }

    /// Returns the unit vector from the centre of the first shape to the centre of the second side at the start, in the frame of the chord.
    pub fn center_line(&self) -> Vec3 {
        let center1 = self.sweep1.start.transform_point(self.shape1.bounding_sphere().center);
        let center2 = self.sweep2.start.transform_point(match &self.other {
            OtherPart::Shape(shape2) => shape2.bounding_sphere().center,
            OtherPart::Part(part) => part.aabb().center(),
            OtherPart::Moving(part) => part.boxes()[0].center(),
        });
        self.to_chord(self.frame.rotation * (center2 - center1).normalize_or(Vec3::Y))
    }

    /// Returns [`Tolerances::core_overlap`] of two primitives.
    pub fn core_overlap(&self, [first, second]: PrimitivePair) -> f32 {
        let radius2 = match &self.other {
            OtherPart::Shape(shape2) => shape2.hull(second).min_radius(),
            OtherPart::Part(_) | OtherPart::Moving(_) => 0.0,
        };
        self.tolerances.core_overlap([self.shape1.hull(first).min_radius(), radius2])
    }

    /// Returns the summed thickness of two primitives in metres. The thickness is the largest radius of a primitive, or half of the smallest width of another
    /// part.
    pub fn thickness(&self, [first, second]: PrimitivePair) -> f32 {
        let second = match &self.other {
            OtherPart::Shape(shape2) => shape2.hull(second).max_radius(),
            OtherPart::Part(part) => part.thickness(),
            OtherPart::Moving(part) => part.max_radius(),
        };
        self.shape1.hull(first).max_radius() + second
    }

    /// Returns an upper bound of the path length of any point of one body relative to the other, in metres.
    pub fn path(&self) -> f32 {
        let within = if let OtherPart::Moving(part) = &self.other { part.path() } else { 0.0 };
        relative_path([&self.sweep1, &self.sweep2], self.arms) + within
    }
}

#[cfg(test)]
impl PairMotion<'_> {
    /// Returns the distance of two primitives at a fraction of the motion, in metres.
    pub fn distance_at(&self, fraction: f32, [first, second]: [u32; 2]) -> f32 {
        use crate::{
            pipeline::{deforming::with_moving, with_spheres},
            query::separation,
        };
        let [pose1, pose2] = [&self.sweep1, &self.sweep2].map(|sweep| sweep.pose_at(fraction));
        let ours = self.shape1.hull(first).placed(&pose2.inv_mul(&pose1).into());
        with_spheres!(ours, |ours| match &self.other {
            OtherPart::Shape(shape2) => {
                with_spheres!(&shape2.hull(second), |theirs| separation(&ours, theirs, 0).distance)
            }
            OtherPart::Part(part) => with_core!(part, |theirs| separation(&ours, theirs, 0).distance) - part.rounding,
            OtherPart::Moving(part) => {
                let moving = part.part([fraction; 2]).hull;
                with_moving!(moving, |theirs| separation(&ours, &theirs.start, 0).distance)
            }
        })
    }
}

/// Returns an upper bound of the path length of any point of one body relative to the other, in metres. `arms`: see [`PairMotion`].
fn relative_path([sweep1, sweep2]: [&Sweep; 2], arms: [f32; 2]) -> f32 {
    let turn = sweep1.rotation.length() * arms[0] + sweep2.rotation.length() * arms[1];
    (sweep1.translation - sweep2.translation).length() + turn
}

/// Returns a box in the frame of the second body that contains all of its points that the shape may touch.
fn reach(shape1: &Shape, sweep1: &Sweep, sweep2: &Sweep, arm2: f32) -> Aabb {
    let radius = shape1.radius_about(sweep1.local_center);
    let seen = sweep1.seen_from(&sweep2.start);
    let start = seen.start.transform_point(seen.local_center);
    if sweep2.is_at_rest() {
        return Aabb::from_spheres([start, start + seen.translation].map(|center| Sphere::new(center, radius)));
    }
    // Two points that touch were apart by at most their relative displacement at the start.
    let displacement = (sweep1.translation - sweep2.translation).length() + sweep2.rotation.length().min(2.0) * arm2;
    Aabb::from_spheres([Sphere::new(start, radius + displacement)])
}
