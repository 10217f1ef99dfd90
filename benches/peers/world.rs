//! A demo scene as plain data, the same for every engine.

use std::path::Path;

use bevy::prelude::*;
use bevy_medial::{
    builder::{TriangleMesh, load::load},
    geometry::{Aabb, Pose3},
    medial_axis::MedialAxis,
    prelude::{MedialMesh, StaticObb},
    scenes::{Model, Scene, SceneEntity, headless_app},
};
use bevy_rapier3d::{
    parry::mass_properties::MassProperties,
    prelude::{Damping, RigidBody, Velocity},
};

/// The bodies of a scene, and the models that they are made of.
pub struct World {
    /// Step in seconds.
    pub dt: f32,
    /// The models that occur.
    pub models: Vec<SceneModel>,
    /// The bodies.
    pub bodies: Vec<Body>,
}

/// A model by its exact mesh and its medial mesh.
pub struct SceneModel {
    /// The name of its files.
    pub name: String,
    /// The exact surface.
    pub mesh: TriangleMesh,
    /// The medial mesh.
    pub axis: MedialAxis,
}

/// What a body is, exactly.
#[derive(Clone, Copy)]
pub enum Form {
    /// A model, at a scale.
    Model(usize, f32),
    /// A capsule between two points of the body's frame.
    Capsule([Vec3; 2], f32),
    /// A box by its half extents.
    Cuboid(Vec3),
}

/// A body at the start.
pub struct Body {
    pub form: Form,
    pub pose: Pose3,
    /// False if it never moves.
    pub dynamic: bool,
    pub velocity: Velocity,
    pub damping: Damping,
    /// Those of the medial mesh, for every engine.
    pub mass: MassProperties,
    /// Greatest extent in metres.
    pub size: f32,
}

/// Where a body is, and how fast.
#[derive(Clone, Copy)]
pub struct State {
    pub pose: Pose3,
    pub linear: Vec3,
    pub angular: Vec3,
}

impl World {
    /// Spawns a scene and reads what is there. `folder`: of the models, which are beside their meshes.
    ///
    /// # Errors
    /// If the mesh of a model cannot be read, or if there is a shape that is neither a model nor a capsule.
    pub fn new(scene: &Scene, models: &[Model], folder: &Path, dt: f32) -> Result<Self, String> {
        let mut app = headless_app(dt);
        scene.spawn(app.world_mut(), models, SEED);
        let world = app.world_mut();
        type Item = (
            &'static Name,
            &'static Transform,
            Option<&'static MedialMesh>,
            Option<&'static StaticObb>,
            Option<&'static RigidBody>,
            Option<&'static Velocity>,
            Option<&'static Damping>,
        );
        let mut query = world.query_filtered::<Item, With<SceneEntity>>();
        let assets = world.resource::<Assets<MedialAxis>>();
        let mut result = Self { dt, models: Vec::new(), bodies: Vec::new() };
        for (name, transform, mesh, obb, kind, velocity, damping) in query.iter(world) {
            let axis = mesh.and_then(|mesh| assets.get(&mesh.0));
            let scale = transform.scale.x;
            let form = match (axis, obb) {
                (Some(axis), _) => match axis.spheres() {
                    [a, b] if a.radius == b.radius => Form::Capsule([a.center, b.center], a.radius),
                    _ => Form::Model(result.model(name.as_str(), axis, folder)?, scale),
                },
                (None, Some(obb)) => Form::Cuboid(obb.half_extents),
                (None, None) => return Err(format!("{name} has no shape")),
            };
            result.bodies.push(Body {
                form,
                pose: Pose3::from_parts(transform.translation, transform.rotation),
                dynamic: kind == Some(&RigidBody::Dynamic),
                velocity: velocity.copied().unwrap_or_default(),
                damping: damping.copied().unwrap_or_default(),
                mass: axis.map(|axis| mass(axis, scale)).unwrap_or_default(),
                size: axis.map_or(f32::INFINITY, |axis| 2.0 * axis.bounding_sphere().radius * scale),
            });
        }
        Ok(result)
    }

    fn model(&mut self, name: &str, axis: &MedialAxis, folder: &Path) -> Result<usize, String> {
        if let Some(known) = self.models.iter().position(|model| model.name == name) {
            return Ok(known);
        }
        let mesh = load(&folder.join(name).with_extension("obj")).map_err(|error| error.to_string())?;
        self.models.push(SceneModel { name: name.into(), mesh, axis: axis.clone() });
        Ok(self.models.len() - 1)
    }

    /// The box around a body in its own frame.
    pub fn aabb(&self, body: &Body) -> Aabb {
        match body.form {
            Form::Model(model, scale) => self.models[model].mesh.aabb().transformed(&Pose3::IDENTITY, scale),
            Form::Capsule([a, b], radius) => Aabb { min: a.min(b) - radius, max: a.max(b) + radius },
            Form::Cuboid(half) => Aabb { min: -half, max: half },
        }
    }

    /// Kinetic energy of all bodies over their mass.
    pub fn energy(&self, states: &[State]) -> f32 {
        let (mut energy, mut total) = (0.0, 0.0);
        for (body, state) in self.bodies.iter().zip(states).filter(|(body, _)| body.dynamic) {
            let mass = body.mass.mass();
            let turn = state.pose.rotation * body.mass.principal_inertia_local_frame;
            let local = turn.inverse() * state.angular;
            energy += mass * state.linear.length_squared() + body.mass.principal_inertia().dot(local * local);
            total += 2.0 * mass;
        }
        if total > 0.0 { energy / total } else { 0.0 }
    }

    /// How many bodies have fallen through the ground, or are out of the square that it covers and that walls surround.
    pub fn lost(&self, states: &[State]) -> usize {
        let is_lost = |(body, state): &(&Body, &State)| {
            let center = state.pose.transform_point(body.mass.local_com);
            let inside = center.y >= 0.0 && center.x.abs() <= GROUND && center.z.abs() <= GROUND;
            // What is not a number is not inside.
            body.dynamic && !inside
        };
        self.bodies.iter().zip(states).filter(is_lost).count()
    }
}

/// Placement of bodies.
pub const SEED: u64 = 1;

/// Half of the side of the scenes' ground, whose top is at a height of 0, in metres.
const GROUND: f32 = 20.0;

fn mass(axis: &MedialAxis, scale: f32) -> MassProperties {
    let mass = axis.mass();
    MassProperties::with_inertia_matrix(
        mass.center_of_mass * scale,
        mass.volume * scale.powi(3),
        bevy_rapier3d::parry::math::Matrix::from_cols_array(&mass.inertia.to_cols_array()) * scale.powi(5),
    )
}
