//! Bodies as plain data, the same for every engine.

use std::sync::Arc;

use bevy_medial::{
    builder::TriangleMesh,
    geometry::{Pose3, Primitive, Sphere},
    medial_axis::{MassProperties, MedialAxis, triangulate},
};
use glam::{Quat, Vec3};

/// Number of vertices around a cone in the surface of a medial mesh.
const SEGMENTS: u32 = 16;

/// Properties of the world.
#[derive(Clone, Copy, Debug)]
pub struct Setup {
    /// Length of a step in seconds.
    pub dt: f32,
    /// Size of a typical body in metres: the unit of length of every engine.
    pub unit: f32,
    /// Downward acceleration, in metres per second squared.
    pub gravity: f32,
}

impl Default for Setup {
    fn default() -> Self {
        Self { dt: 1.0 / 60.0, unit: 1.0, gravity: 9.81 }
    }
}

impl Setup {
    /// A world without gravity.
    pub fn weightless() -> Self {
        Self { gravity: 0.0, ..Self::default() }
    }
}

/// An exact shape.
#[derive(Clone, Debug)]
pub enum Form {
    /// A sharp box by its half extents.
    Cuboid(Vec3),
    /// A union of spheres, cones and slabs.
    Medial(MedialAxis),
    /// A surface of triangles, for fixed bodies.
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

    /// The shape as a medial mesh. `None` for triangles.
    pub fn axis(&self) -> Option<MedialAxis> {
        match self {
            Self::Cuboid(half) => MedialAxis::rounded_box(*half, 0.0).ok(),
            Self::Medial(axis) => Some(axis.clone()),
            Self::Triangles(..) => None,
        }
    }
}

/// The shape that engines without medial meshes simulate instead, at scale 1.
#[derive(Clone, Debug)]
pub enum StandIn {
    /// A union of convex hulls, each by its corners.
    Hulls(Arc<[Vec<Vec3>]>),
    /// A surface of triangles.
    Surface(Arc<TriangleMesh>),
}

/// The kind of a body.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// The body does not move.
    Fixed,
    /// The body moves at its velocity, and contacts do not affect it.
    Kinematic,
    /// Forces and contacts move the body.
    Dynamic,
}

/// A body at the start.
#[derive(Clone, Debug)]
pub struct Body {
    pub form: Form,
    /// `None`: engines without medial meshes get the primitives of the form one by one.
    pub stand_in: Option<StandIn>,
    pub kind: Kind,
    pub pose: Pose3,
    pub scale: f32,
    /// Velocity of the centre of mass, in metres per second.
    pub linear: Vec3,
    /// Angular velocity, in radians per second.
    pub angular: Vec3,
    /// Density, in kilograms per cubic metre.
    pub density: f32,
    /// Damping of the translation and of the rotation, in 1/s.
    pub damping: [f32; 2],
    /// True if no contact of the body has friction.
    pub slippery: bool,
    /// True for a bullet: the continuous collision detection of an engine is requested, and its limits of speed are lifted.
    pub fast: bool,
}

impl Body {
    fn new(kind: Kind, form: Form) -> Self {
        Self {
            form,
            stand_in: None,
            kind,
            pose: Pose3::IDENTITY,
            scale: 1.0,
            linear: Vec3::ZERO,
            angular: Vec3::ZERO,
            density: 1.0,
            damping: [0.0; 2],
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

    /// Sets the position of the origin of its frame.
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

    /// Adds a little damping in place of rolling friction, which no engine has.
    pub fn damped(self) -> Self {
        Self { damping: [0.5; 2], ..self }
    }

    pub fn fast(self) -> Self {
        Self { fast: true, ..self }
    }

    /// Replaces the form by its surface, for engines without medial meshes.
    ///
    /// # Errors
    /// If the form has no surface.
    pub fn hollow(self) -> Result<Self, String> {
        let axis = self.form.axis().ok_or("triangles have no medial mesh")?;
        let surface = triangulate(axis.spheres(), axis.primitives(), SEGMENTS);
        let positions = surface.positions.iter().map(|position| Vec3::from(*position)).collect();
        let triangles = surface.indices.chunks_exact(3).map(|corners| [corners[0], corners[1], corners[2]]).collect();
        let mesh = TriangleMesh::new(positions, triangles).map_err(|error| error.to_string())?;
        Ok(Self { stand_in: Some(StandIn::Surface(Arc::new(mesh))), ..self })
    }

    /// True if continuous collision detection is requested for the body, in engines where it is a setting of a body.
    pub fn is_bullet(&self) -> bool {
        self.fast || self.linear.length() > 20.0
    }

    /// Mass, centre and inertia at the body's scale and density, the same for every engine. Zero for triangles.
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

    /// Diameter of the bounding sphere, in metres. Infinite for triangles.
    pub fn size(&self) -> f32 {
        self.form.axis().map_or(f32::INFINITY, |axis| 2.0 * axis.bounding_sphere().radius * self.scale)
    }
}

/// Pose and velocity of a body.
#[derive(Clone, Copy, Debug)]
pub struct State {
    pub pose: Pose3,
    /// Velocity of the centre of mass.
    pub linear: Vec3,
    pub angular: Vec3,
}
