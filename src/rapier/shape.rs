use std::sync::Arc;

use bevy_rapier3d::parry::{
    bounding_volume::{Aabb as ParryAabb, BoundingSphere},
    mass_properties::MassProperties,
    math::{Matrix, Real, Vector},
    shape::{CompositeShape, Compound, Shape as ParryShape, ShapeType, TypedShape},
};

use super::primitive::{Primitives, compound};
use crate::pipeline::{ConvexParts, Deforming, Shape, ShapeId};

/// A medial shape as a collider's shape. See [`query`](super::query) for its support in rapier's queries and views.
#[derive(Clone)]
pub struct MedialShape {
    /// The shape.
    pub shape: Shape,
    /// Key of this collider's contacts in the contact table. Unique among all colliders ever made.
    pub key: u64,
    /// The motion of a skinned shape within the last step. The shape is its pose at the end.
    pub(super) skin: Option<Arc<Deforming>>,
    primitives: Primitives,
}

/// A bit that only the keys of skinned shapes have.
const SKINNED: u64 = 1 << 63;

impl MedialShape {
    /// Creates a shape with the key of its collider.
    pub fn new(shape: Shape, key: u64) -> Self {
        Self::sharing(shape, key, Primitives::default())
    }

    /// Creates a shape that shares its compound with colliders of the same shape and scale.
    pub(super) fn sharing(shape: Shape, key: u64, primitives: Primitives) -> Self {
        Self { shape, key, primitives, skin: None }
    }

    /// Creates the shape of a skinned collider.
    pub(super) fn deforming(skin: Arc<Deforming>) -> Self {
        let key = SKINNED | skin.address() as u64;
        Self { skin: Some(skin.clone()), ..Self::new(Shape::new(skin.axis().clone()), key) }
    }

    /// Returns the identity of the shape in the pipeline.
    pub(super) fn id(&self) -> ShapeId {
        self.skin.as_ref().map_or_else(|| ShapeId::from(&self.shape), |skin| ShapeId::of_parts(&**skin))
    }

    fn compound(&self) -> &Compound {
        self.primitives.get_or_init(|| compound(&self.shape))
    }
}

impl ParryShape for MedialShape {
    fn compute_local_aabb(&self) -> ParryAabb {
        let aabb = self.shape.aabb();
        ParryAabb::new(aabb.min, aabb.max)
    }

    fn compute_local_bounding_sphere(&self) -> BoundingSphere {
        let sphere = self.shape.bounding_sphere();
        BoundingSphere::new(sphere.center, sphere.radius)
    }

    fn clone_dyn(&self) -> Box<dyn ParryShape> {
        Box::new(self.clone())
    }

    /// Returns `None` for a scale that is not uniform and positive.
    fn scale_dyn(&self, scale: Vector, _: u32) -> Option<Box<dyn ParryShape>> {
        let uniform = scale.x > 0.0 && scale.x == scale.y && scale.x == scale.z;
        uniform.then(|| {
            let shape = Shape { axis: self.shape.axis.clone(), scale: self.shape.scale * scale.x };
            Box::new(Self::new(shape, self.key)) as Box<dyn ParryShape>
        })
    }

    fn mass_properties(&self, density: Real) -> MassProperties {
        let mass = self.shape.axis.mass();
        let scale = self.shape.scale;
        MassProperties::with_inertia_matrix(
            self.shape.center_of_mass(),
            mass.volume * scale.powi(3) * density,
            Matrix::from_cols_array(&mass.inertia.to_cols_array()) * (scale.powi(5) * density),
        )
    }

    fn shape_type(&self) -> ShapeType {
        ShapeType::Custom
    }

    /// Returns a compound of the primitives. Code that knows only parry's shapes draws and prints it.
    fn as_typed_shape(&self) -> TypedShape<'_> {
        TypedShape::Compound(self.compound())
    }

    fn as_composite_shape(&self) -> Option<&dyn CompositeShape> {
        Some(self.compound())
    }

    /// Returns the maximum, so that rapier does not treat the body as fast. The step finds the impacts of medial bodies. Rapier's own CCD would also stop
    /// bodies that are in contact, and piles would not come to rest.
    fn ccd_thickness(&self) -> Real {
        Real::MAX
    }

    fn ccd_angular_thickness(&self) -> Real {
        std::f32::consts::FRAC_PI_2
    }
}
