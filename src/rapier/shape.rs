use bevy_rapier3d::parry::{
    bounding_volume::{Aabb as ParryAabb, BoundingSphere},
    mass_properties::MassProperties,
    math::{Matrix, Real, Vector},
    shape::{CompositeShape, Compound, Shape as ParryShape, ShapeType, TypedShape},
};

use super::primitive::{Primitives, compound};
use crate::pipeline::Shape;

/// A medial shape as a collider's shape. What rapier's queries and views make of it: see [`query`](super::query).
#[derive(Clone)]
pub struct MedialShape {
    /// The shape.
    pub shape: Shape,
    /// Tells this collider's contacts in the step's table from those of others; unique for each collider ever made.
    pub key: u64,
    primitives: Primitives,
}

impl MedialShape {
    /// A shape with the key of its collider.
    pub fn new(shape: Shape, key: u64) -> Self {
        Self::sharing(shape, key, Primitives::default())
    }

    /// The same where another collider has the same shape at the same scale.
    pub(super) fn sharing(shape: Shape, key: u64, primitives: Primitives) -> Self {
        Self { shape, key, primitives }
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

    /// Uniform scales only.
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

    /// A compound of the primitives: what is drawn and printed by those who know parry's shapes only.
    fn as_typed_shape(&self) -> TypedShape<'_> {
        TypedShape::Compound(self.compound())
    }

    fn as_composite_shape(&self) -> Option<&dyn CompositeShape> {
        Some(self.compound())
    }

    /// Rapier takes no body with such a thickness for fast: impacts of medial bodies are found by the step, not by rapier's own sweep, which
    /// stops bodies in contact as well and leaves piles restless.
    fn ccd_thickness(&self) -> Real {
        Real::MAX
    }

    fn ccd_angular_thickness(&self) -> Real {
        std::f32::consts::FRAC_PI_2
    }
}
