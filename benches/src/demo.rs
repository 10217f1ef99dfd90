//! A demo scene as bodies, the same for every engine.

use std::path::Path;

use bevy::prelude::*;
use bevy_medial::{
    builder::{TriangleMesh, load::load},
    geometry::{Aabb, Pose3},
    medial_axis::MedialAxis,
    prelude::{MedialMesh, StaticObb},
    scenes::{Bullet, Model, Scene, SceneEntity, headless_app},
};
use bevy_rapier3d::{
    parry::mass_properties::MassProperties,
    prelude::{Damping, RigidBody, Velocity},
};

use crate::{
    body::{Body, Form, Setup, StandIn, State},
    engines::{Engine, mass},
};

/// The bodies of a scene, and their models.
pub struct Demo {
    pub setup: Setup,
    /// The models of the bodies.
    pub models: Vec<SceneModel>,
    pub bodies: Vec<SceneBody>,
}

/// A model with its exact mesh and its medial mesh.
pub struct SceneModel {
    /// The name of its files.
    pub name: String,
    /// The exact surface.
    pub mesh: TriangleMesh,
    /// The medial mesh.
    pub axis: MedialAxis,
}

/// A body with its model.
pub struct SceneBody {
    pub body: Body,
    /// Index of the model. `None`: the form of the body is exact.
    pub model: Option<usize>,
    /// Mass of the medial mesh, for every engine.
    pub mass: MassProperties,
    /// Max extent in metres.
    pub size: f32,
}

impl SceneBody {
    /// True if forces act on the body.
    pub fn is_dynamic(&self) -> bool {
        self.body.kind == crate::body::Kind::Dynamic
    }

    /// The two ends and the radius of a capsule.
    pub fn capsule(&self) -> Option<([Vec3; 2], f32)> {
        match &self.body.form {
            Form::Medial(axis) => match axis.spheres() {
                [a, b] if a.radius == b.radius => Some(([a.center, b.center], a.radius)),
                _ => None,
            },
            _ => None,
        }
    }
}

impl Demo {
    /// Spawns a scene and reads its entities. `folder` holds the meshes of the models.
    ///
    /// # Errors
    /// If the mesh of a model cannot be read, or if an entity has no shape.
    pub fn new(scene: &Scene, models: &[Model], folder: &Path, dt: f32) -> Result<Self, String> {
        let mut app = headless_app(dt);
        scene.spawn(app.world_mut(), models, SEED);
        let world = app.world_mut();
        type Item = (
            (&'static Name, &'static Transform),
            Option<&'static MedialMesh>,
            Option<&'static StaticObb>,
            Option<&'static RigidBody>,
            Option<&'static Velocity>,
            Option<&'static Damping>,
            Has<Bullet>,
        );
        let mut query = world.query_filtered::<Item, With<SceneEntity>>();
        let assets = world.resource::<Assets<MedialAxis>>();
        let mut result = Self { setup: Setup { dt, ..Setup::default() }, models: Vec::new(), bodies: Vec::new() };
        for ((name, transform), mesh, obb, kind, velocity, damping, is_bullet) in query.iter(world) {
            let form = match (mesh.and_then(|mesh| assets.get(&mesh.0)), obb) {
                (Some(axis), _) => Form::Medial(axis.clone()),
                (None, Some(obb)) => Form::Cuboid(obb.half_extents),
                (None, None) => return Err(format!("{name} has no shape")),
            };
            let is_dynamic = kind == Some(&RigidBody::Dynamic);
            let mut body = if is_dynamic { Body::dynamic(form) } else { Body::fixed(form) };
            body.pose = Pose3::from_parts(transform.translation, transform.rotation);
            body.scale = transform.scale.x;
            let velocity = velocity.copied().unwrap_or_default();
            (body.linear, body.angular) = (velocity.linear, velocity.angular);
            body.damping = damping.map_or([0.0; 2], |damping| [damping.linear_damping, damping.angular_damping]);
            body.fast = is_bullet;
            // Percentages are relative to the smaller body, and a static box is never the smaller one.
            let size = if is_dynamic { body.size() } else { f32::INFINITY };
            let mut body = SceneBody { mass: mass(&body), size, body, model: None };
            if let (Form::Medial(axis), None) = (&body.body.form, body.capsule()) {
                body.model = Some(result.model(name.as_str(), axis, folder)?);
            }
            result.bodies.push(body);
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

    /// Spawns all bodies in an engine. `stand_ins` has one entry per model, or none at all.
    ///
    /// # Errors
    /// If the engine cannot make a shape.
    pub fn fill(&self, mut engine: impl Engine + 'static, stand_ins: &[StandIn]) -> Result<Box<dyn Engine>, String> {
        for SceneBody { body, model, .. } in &self.bodies {
            let stand_in = model.and_then(|model| stand_ins.get(model)).cloned();
            engine.spawn(&Body { stand_in, ..body.clone() })?;
        }
        Ok(Box::new(engine))
    }

    /// The box around a body in its own frame.
    pub fn aabb(&self, body: &SceneBody) -> Aabb {
        match (body.model, &body.body.form) {
            (Some(model), _) => self.models[model].mesh.aabb().transformed(&Pose3::IDENTITY, body.body.scale),
            (None, Form::Cuboid(half)) => Aabb { min: -*half, max: *half },
            (None, form) => form.axis().map_or(Aabb::EMPTY, |axis| axis.aabb()),
        }
    }

    /// Kinetic energy of all bodies over their mass.
    pub fn energy(&self, states: &[State]) -> f32 {
        let (mut energy, mut total) = (0.0, 0.0);
        for (body, state) in self.bodies.iter().zip(states).filter(|(body, _)| body.is_dynamic()) {
            let mass = body.mass.mass();
            let turn = state.pose.rotation * body.mass.principal_inertia_local_frame;
            let local = turn.inverse() * state.angular;
            energy += mass * state.linear.length_squared() + body.mass.principal_inertia().dot(local * local);
            total += 2.0 * mass;
        }
        if total > 0.0 { energy / total } else { 0.0 }
    }

    /// Number of bodies that have fallen through the ground or left the square that it covers.
    pub fn lost(&self, states: &[State]) -> usize {
        let is_lost = |(body, state): &(&SceneBody, &State)| {
            let center = state.pose.transform_point(body.mass.local_com);
            let inside = center.y >= 0.0 && center.x.abs() <= GROUND && center.z.abs() <= GROUND;
            // A position that is not a number is not inside.
            body.is_dynamic() && !inside
        };
        self.bodies.iter().zip(states).filter(is_lost).count()
    }
}

/// Seed of the placement of bodies.
pub const SEED: u64 = 1;

/// Half of the side length of the ground of the scenes, in metres. Its top is at height 0.
const GROUND: f32 = 20.0;
