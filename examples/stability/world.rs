//! What hazards are made of, as plain data, the same for every method.

use bevy_medial::{
    geometry::{Pose3, Primitive, Sphere},
    medial_axis::{MassProperties, MedialAxis},
};
use glam::{Quat, Vec3};

/// What holds for all bodies.
#[derive(Clone, Copy, Debug)]
pub struct Setup {
    /// Length of a step in seconds.
    pub dt: f32,
    /// Size of a typical body in metres, as every engine asks for it.
    pub unit: f32,
    /// Downwards, in metres per second squared.
    pub gravity: f32,
}

impl Default for Setup {
    fn default() -> Self {
        Self { dt: 1.0 / 60.0, unit: 1.0, gravity: 9.81 }
    }
}

impl Setup {
    /// Nothing falls.
    pub fn weightless() -> Self {
        Self { gravity: 0.0, ..Self::default() }
    }
}

/// A shape, by what it is exactly.
#[derive(Clone, Debug)]
pub enum Form {
    /// A sharp box by its half extents.
    Cuboid(Vec3),
    /// A union of spheres, cones and slabs.
    Medial(MedialAxis),
    /// A surface of triangles, for what does not move.
    Triangles(Vec<Vec3>, Vec<[u32; 3]>),
}

impl Form {
    /// A ball by its radius.
    pub fn ball(radius: f32) -> Self {
        Self::medial(vec![Sphere::new(Vec3::ZERO, radius)], Vec::new())
    }

    /// A capsule along x, by half the length of its axis and its radius.
    pub fn capsule(half: f32, radius: f32) -> Self {
        Self::cone(Sphere::new(Vec3::X * -half, radius), Sphere::new(Vec3::X * half, radius))
    }

    /// The hull of two balls.
    pub fn cone(a: Sphere, b: Sphere) -> Self {
        Self::medial(vec![a, b], vec![Primitive::Cone([0, 1])])
    }

    /// The hull of three balls.
    pub fn slab(balls: [Sphere; 3]) -> Self {
        Self::medial(balls.to_vec(), vec![Primitive::Slab([0, 1, 2])])
    }

    /// A torus around y.
    pub fn torus(major: f32, minor: f32) -> Self {
        Self::Medial(MedialAxis::torus(major, minor, 24).expect("the radii are positive"))
    }

    /// A box whose edges are rounded within its extents.
    pub fn rounded(half: Vec3, radius: f32) -> Self {
        Self::Medial(MedialAxis::rounded_box(half, radius).expect("the radius fits"))
    }

    /// Any spheres, cones and slabs that span a shape.
    pub fn medial(spheres: Vec<Sphere>, primitives: Vec<Primitive>) -> Self {
        Self::Medial(MedialAxis::new(spheres, primitives).expect("finite spheres").0)
    }

    /// The shape as a medial mesh; none for triangles.
    pub fn axis(&self) -> Option<MedialAxis> {
        match self {
            Self::Cuboid(half) => MedialAxis::rounded_box(*half, 0.0).ok(),
            Self::Medial(axis) => Some(axis.clone()),
            Self::Triangles(..) => None,
        }
    }
}

/// How a body moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Never.
    Fixed,
    /// At its velocity, whatever it meets.
    Kinematic,
    /// As it is pushed.
    Dynamic,
}

/// A body at the start.
#[derive(Clone, Debug)]
pub struct Body {
    pub form: Form,
    pub kind: Kind,
    pub pose: Pose3,
    pub scale: f32,
    /// Of the centre of mass, in metres per second.
    pub linear: Vec3,
    /// In radians per second.
    pub angular: Vec3,
    /// In kilograms per cubic metre.
    pub density: f32,
    /// Slows both motions, per second.
    pub damping: f32,
    /// Without friction, whatever it touches.
    pub slippery: bool,
    /// A bullet: what an engine does about fast bodies if it is asked to, is asked for, and no limit of speed holds.
    pub fast: bool,
}

impl Body {
    fn new(kind: Kind, form: Form) -> Self {
        Self {
            form,
            kind,
            pose: Pose3::IDENTITY,
            scale: 1.0,
            linear: Vec3::ZERO,
            angular: Vec3::ZERO,
            density: 1.0,
            damping: 0.0,
            slippery: false,
            fast: false,
        }
    }

    pub fn fixed(form: Form) -> Self {
        Self::new(Kind::Fixed, form)
    }

    pub fn kinematic(form: Form) -> Self {
        Self::new(Kind::Kinematic, form)
    }

    pub fn dynamic(form: Form) -> Self {
        Self::new(Kind::Dynamic, form)
    }

    /// A place for the origin of its frame.
    pub fn at(mut self, place: Vec3) -> Self {
        self.pose.translation = place;
        self
    }

    pub fn turned(mut self, rotation: Quat) -> Self {
        self.pose.rotation = rotation;
        self
    }

    pub fn moving(self, linear: Vec3) -> Self {
        Self { linear, ..self }
    }

    pub fn spinning(self, angular: Vec3) -> Self {
        Self { angular, ..self }
    }

    pub fn dense(self, density: f32) -> Self {
        Self { density, ..self }
    }

    pub fn slippery(self) -> Self {
        Self { slippery: true, ..self }
    }

    /// A little damping stands in for rolling friction, which no engine has.
    pub fn damped(self) -> Self {
        Self { damping: 0.5, ..self }
    }

    pub fn fast(self) -> Self {
        Self { fast: true, ..self }
    }

    /// Mass, centre and inertia at the body's scale and density, the same for every engine. Nothing for triangles.
    pub fn mass(&self) -> MassProperties {
        let axis = self.form.axis();
        let Some(unit) = axis.as_ref().map(MedialAxis::mass) else {
            return MassProperties { volume: 0.0, center_of_mass: Vec3::ZERO, inertia: glam::Mat3::ZERO };
        };
        MassProperties {
            volume: unit.volume * self.density * self.scale.powi(3),
            center_of_mass: unit.center_of_mass * self.scale,
            inertia: unit.inertia * (self.density * self.scale.powi(5)),
        }
    }

    /// Diameter of the ball around it, in metres; without bounds for triangles.
    pub fn size(&self) -> f32 {
        self.form.axis().map_or(f32::INFINITY, |axis| 2.0 * axis.bounding_sphere().radius * self.scale)
    }
}

/// Where a body is, and how fast.
#[derive(Clone, Copy, Debug)]
pub struct State {
    pub pose: Pose3,
    /// Velocity of the centre of mass.
    pub linear: Vec3,
    pub angular: Vec3,
}

/// SplitMix64: the same numbers everywhere.
pub struct Random(pub u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// From 0 to 1.
    pub fn unit(&mut self) -> f32 {
        (self.next() >> 40) as f32 / (1u64 << 24) as f32
    }

    /// From -1 to 1.
    pub fn signed(&mut self) -> f32 {
        2.0 * self.unit() - 1.0
    }

    /// A point of the unit ball.
    pub fn vector(&mut self) -> Vec3 {
        loop {
            let point = Vec3::new(self.signed(), self.signed(), self.signed());
            if point.length_squared() <= 1.0 {
                return point;
            }
        }
    }

    pub fn rotation(&mut self) -> Quat {
        Quat::from_scaled_axis(self.vector().normalize_or(Vec3::X) * self.unit() * std::f32::consts::PI)
    }
}
