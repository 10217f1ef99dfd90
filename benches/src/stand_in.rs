//! Stand-ins for the models in engines without medial meshes, made once per model.

use std::{collections::HashMap, sync::Arc};

use bevy_medial::builder::Deviation;
use bevy_rapier3d::parry::{
    shape::{ConvexPolyhedron, SharedShape},
    transformation::vhacd::VHACDParameters,
};

use crate::{
    body::StandIn,
    demo::{Demo, SceneModel},
    hulls::hull_error,
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

/// The stand-in of a model.
#[derive(Clone)]
pub struct ModelShape {
    pub stand_in: StandIn,
    /// Number of hulls or triangles.
    pub parts: usize,
    /// Distance from the mesh to the surface of the stand-in, in percent of the mesh's diagonal.
    pub error: Deviation,
}

/// All stand-ins made so far.
#[derive(Default)]
pub struct Shapes(HashMap<(Kind, String), ModelShape>);

impl Shapes {
    /// The stand-in of a model.
    pub fn of(&mut self, kind: Kind, model: &SceneModel) -> &ModelShape {
        self.0.entry((kind, model.name.clone())).or_insert_with(|| make(kind, model))
    }

    /// The stand-ins of the models of a scene.
    pub fn of_demo(&mut self, kind: Kind, demo: &Demo) -> Vec<ModelShape> {
        demo.models.iter().map(|model| self.of(kind, model).clone()).collect()
    }
}

/// The stand-ins alone.
pub fn stand_ins(shapes: &[ModelShape]) -> Vec<StandIn> {
    shapes.iter().map(|shape| shape.stand_in.clone()).collect()
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
        (_, Kind::TriMesh) => {
            return ModelShape {
                stand_in: StandIn::Surface(Arc::new(mesh.clone())),
                parts: mesh.triangles.len(),
                error: Deviation { max: 0.0, mean: 0.0 },
            };
        }
        (Some(shape), _) => {
            let parts = shape.as_compound().map_or(&[][..], |compound| compound.shapes());
            parts.iter().filter_map(|(_, part)| part.as_convex_polyhedron().cloned()).collect()
        }
        (None, _) => ConvexPolyhedron::from_convex_hull(&mesh.positions).into_iter().collect(),
    };
    ModelShape {
        stand_in: StandIn::Hulls(hulls.iter().map(|hull| hull.points().to_vec()).collect()),
        parts: hulls.len(),
        error: hull_error(mesh, &hulls.iter().collect::<Vec<_>>()),
    }
}

/// The max of all errors, and the mean of the means.
pub fn worst(errors: impl ExactSizeIterator<Item = Deviation>) -> Deviation {
    let count = errors.len().max(1) as f32;
    errors.fold(Deviation { max: 0.0, mean: 0.0 }, |all, one| Deviation {
        max: all.max.max(one.max),
        mean: all.mean + one.mean / count,
    })
}
