use bevy_rapier3d::{
    parry::math::Matrix,
    parry::{
        bounding_volume::{Aabb as ParryAabb, BoundingSphere},
        mass_properties::MassProperties,
        math::{Real, Vector},
        query::{PointProjection, PointQuery, Ray, RayCast, RayIntersection},
        shape::{FeatureId, Shape as ParryShape, ShapeType, TypedShape},
    },
};
use glam::Vec3;

use crate::{
    geometry::Sphere,
    pipeline::{Shape, with_spheres},
    query::{ray_cast, separation},
};

/// A medial shape as a collider's shape.
#[derive(Clone)]
pub struct MedialShape {
    /// The shape.
    pub shape: Shape,
    /// Tells this collider's contacts in the step's table from those of others; unique for each collider ever made.
    pub key: u64,
}

impl MedialShape {
    /// The point of the surface of a primitive that is nearest to `point`, with the signed distance.
    fn project(&self, point: Vec3) -> (PointProjection, FeatureId) {
        let mut best = (f32::INFINITY, point, 0);
        for primitive in 0..self.shape.len() as u32 {
            let found = with_spheres!(self.shape.hull(primitive), |spheres| {
                separation(&spheres, &[Sphere::new(point, 0.0)], 0)
            });
            if found.distance < best.0 {
                best = (found.distance, found.point1, primitive);
            }
        }
        let (distance, nearest, primitive) = best;
        (PointProjection::new(distance <= 0.0, nearest), FeatureId::Face(primitive))
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
            let mut scaled = self.clone();
            scaled.shape.scale *= scale.x;
            Box::new(scaled) as Box<dyn ParryShape>
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

    fn as_typed_shape(&self) -> TypedShape<'_> {
        TypedShape::Custom(self)
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

impl RayCast for MedialShape {
    fn cast_local_ray_and_get_normal(&self, ray: &Ray, max_time: Real, solid: bool) -> Option<RayIntersection> {
        let mut nearest: Option<RayIntersection> = None;
        for primitive in 0..self.shape.len() as u32 {
            let limit = nearest.map_or(max_time, |hit| hit.time_of_impact);
            let hit =
                with_spheres!(self.shape.hull(primitive), |spheres| { ray_cast(&spheres, ray.origin, ray.dir, limit) });
            if let Some(hit) = hit
                && nearest.is_none_or(|best| hit.time < best.time_of_impact)
                && (solid || hit.time > 0.0)
            {
                nearest = Some(RayIntersection::new(hit.time, hit.normal, FeatureId::Face(primitive)));
            }
        }
        nearest
    }
}

impl PointQuery for MedialShape {
    fn project_local_point(&self, point: Vector, solid: bool) -> PointProjection {
        let (projection, _) = self.project(point);
        if solid && projection.is_inside { PointProjection::new(true, point) } else { projection }
    }

    fn project_local_point_and_get_feature(&self, point: Vector) -> (PointProjection, FeatureId) {
        self.project(point)
    }
}
