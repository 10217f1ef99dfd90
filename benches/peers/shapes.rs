//! What stands for the models in engines that know no medial meshes, made once for each model.

use std::collections::HashMap;

use bevy_medial::builder::Deviation;
use bevy_rapier3d::parry::{
    math::Pose,
    shape::{ConvexPolyhedron, SharedShape},
    transformation::vhacd::VHACDParameters,
};
use glam::Vec3;

use crate::{
    hulls::hull_error,
    world::{Body, Form, SceneModel, World},
};

/// A kind of shape.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Kind {
    /// Convex decomposition with VHACD's default parameters: a resolution of 64, a concavity of 0.01.
    Decomposition,
    /// The same at a resolution of 128 and a concavity of 0.005.
    FineDecomposition,
    /// One convex hull.
    Hull,
    /// The triangle mesh itself.
    TriMesh,
}

/// The shapes of a model at scale 1.
#[derive(Clone)]
pub struct ModelShape {
    /// The corners of each hull; none for a triangle mesh.
    pub hulls: Vec<Vec<Vec3>>,
    /// From the mesh to the surface of the union, in percent of the mesh's diagonal.
    pub error: Deviation,
}

/// All shapes made so far.
#[derive(Default)]
pub struct Shapes(HashMap<(Kind, String), ModelShape>);

impl Shapes {
    /// The shape of a model.
    pub fn of(&mut self, kind: Kind, model: &SceneModel) -> &ModelShape {
        self.0.entry((kind, model.name.clone())).or_insert_with(|| make(kind, model))
    }

    /// Makes those of a world.
    pub fn of_world(&mut self, kind: Kind, world: &World) -> Vec<ModelShape> {
        world.models.iter().map(|model| self.of(kind, model).clone()).collect()
    }
}

fn make(kind: Kind, model: &SceneModel) -> ModelShape {
    let mesh = &model.mesh;
    let shape = match kind {
        Kind::Decomposition => Some(VHACDParameters::default()),
        Kind::FineDecomposition => {
            Some(VHACDParameters { resolution: 128, concavity: 0.005, ..VHACDParameters::default() })
        }
        Kind::Hull | Kind::TriMesh => None,
    }
    .map(|parameters| SharedShape::convex_decomposition_with_params(&mesh.positions, &mesh.triangles, &parameters));
    let hulls: Vec<ConvexPolyhedron> = match (&shape, kind) {
        (_, Kind::TriMesh) => Vec::new(),
        (Some(shape), _) => {
            let parts = shape.as_compound().map_or(&[][..], |compound| compound.shapes());
            parts.iter().filter_map(|(_, part)| part.as_convex_polyhedron().cloned()).collect()
        }
        (None, _) => ConvexPolyhedron::from_convex_hull(&mesh.positions).into_iter().collect(),
    };
    let error = match kind {
        Kind::TriMesh => Deviation { max: 0.0, mean: 0.0 },
        _ => hull_error(mesh, &hulls.iter().collect::<Vec<_>>()),
    };
    ModelShape { hulls: hulls.iter().map(|hull| hull.points().to_vec()).collect(), error }
}

/// The shape of a body in rapier. `models`: as for the world.
///
/// # Errors
/// If corners span no volume.
pub fn collider(world: &World, body: &Body, models: &[ModelShape]) -> Result<SharedShape, String> {
    let (index, scale) = match body.form {
        Form::Cuboid(half) => return Ok(SharedShape::cuboid(half.x, half.y, half.z)),
        Form::Capsule([a, b], radius) => return Ok(SharedShape::capsule(a, b, radius)),
        Form::Model(index, scale) => (index, scale),
    };
    let scaled = |points: &[Vec3]| points.iter().map(|point| *point * scale).collect::<Vec<_>>();
    let name = &world.models[index].name;
    if models[index].hulls.is_empty() {
        let mesh = &world.models[index].mesh;
        return SharedShape::trimesh(scaled(&mesh.positions), mesh.triangles.clone())
            .map_err(|error| format!("{name}: {error}"));
    }
    let hulls = models[index].hulls.iter().map(|hull| {
        let shape =
            SharedShape::convex_hull(&scaled(hull)).ok_or_else(|| format!("{name}: a hull without a volume"))?;
        Ok((Pose::IDENTITY, shape))
    });
    let mut hulls = hulls.collect::<Result<Vec<_>, String>>()?;
    Ok(if hulls.len() == 1 { hulls.remove(0).1 } else { SharedShape::compound(hulls) })
}

/// The greatest of all errors, and the mean of the means.
pub fn worst(errors: impl ExactSizeIterator<Item = Deviation>) -> Deviation {
    let count = errors.len().max(1) as f32;
    errors.fold(Deviation { max: 0.0, mean: 0.0 }, |all, one| Deviation {
        max: all.max.max(one.max),
        mean: all.mean + one.mean / count,
    })
}
