//! The view of a medial shape for parry's own algorithms: a compound of convex primitives.

use std::sync::{Arc, OnceLock};

use bevy_rapier3d::parry::{
    bounding_volume::{Aabb as ParryAabb, BoundingSphere},
    mass_properties::MassProperties,
    math::{Real, Vector},
    shape::{
        Compound, Cylinder, PackedFeatureId, PolygonalFeature, PolygonalFeatureMap, Shape as ParryShape, ShapeType,
        SharedShape, SupportMap, TypedShape,
    },
};

use glam::{Quat, Vec3};

use crate::{
    geometry::{Aabb, Placement, Pose3, Sphere},
    pipeline::{Hull, Shape, with_spheres},
};

/// The compound of a shape's primitives. It is created on first use and shared by all colliders of the same shape and scale.
pub(super) type Primitives = Arc<OnceLock<Compound>>;

/// One primitive, in a frame whose y axis is its longest edge.
#[derive(Clone)]
pub(super) struct PrimitiveShape {
    pub hull: Hull,
    /// A cylinder along that edge. Code that knows only parry's shapes draws, prints and scales it in place of the primitive. It is a cylinder because rapier's
    /// CCD skips cylinders in a compound, which leaves medial shapes to the step.
    stand_in: Cylinder,
}

/// Smallest radius of a stand-in cylinder, in metres.
const THINNEST: f32 = 1.0e-6;

/// Creates the compound of a shape's primitives.
pub(super) fn compound(shape: &Shape) -> Compound {
    let primitives = (0..shape.len() as u32).map(|primitive| {
        let (pose, primitive) = PrimitiveShape::new(shape.hull(primitive));
        (pose, SharedShape::new(primitive))
    });
    Compound::new(primitives.collect())
}

impl PrimitiveShape {
    /// Creates the primitive, and returns it with the pose of its frame in the shape's frame.
    fn new(hull: Hull) -> (Pose3, Self) {
        let (ends, radius) = with_spheres!(hull, |spheres| {
            let edges = (0..spheres.len()).map(|i| [spheres[i].center, spheres[(i + 1) % spheres.len()].center]);
            let length = |[a, b]: &[Vec3; 2]| a.distance_squared(*b);
            let longest = edges.max_by(|a, b| length(a).total_cmp(&length(b)));
            let radii: f32 = spheres.iter().map(|sphere| sphere.radius).sum();
            (longest.unwrap_or_default(), (radii / spheres.len() as f32).max(THINNEST))
        });
        let edge = ends[1] - ends[0];
        let turn = Quat::from_rotation_arc(Vec3::Y, edge.try_normalize().unwrap_or(Vec3::Y));
        let pose = Pose3::from_parts((ends[0] + ends[1]) * 0.5, turn);
        let stand_in = Cylinder::new(0.5 * edge.length() + radius, radius);
        (pose, Self { hull: hull.placed(&Placement::from(pose.inverse())), stand_in })
    }
}

impl ParryShape for PrimitiveShape {
    fn compute_local_aabb(&self) -> ParryAabb {
        let aabb = with_spheres!(self.hull, |spheres| Aabb::from_spheres(spheres));
        ParryAabb::new(aabb.min, aabb.max)
    }

    fn compute_local_bounding_sphere(&self) -> BoundingSphere {
        self.compute_local_aabb().bounding_sphere()
    }

    fn clone_dyn(&self) -> Box<dyn ParryShape> {
        Box::new(self.clone())
    }

    fn scale_dyn(&self, scale: Vector, subdivisions: u32) -> Option<Box<dyn ParryShape>> {
        self.stand_in.scale_dyn(scale, subdivisions)
    }

    fn mass_properties(&self, density: Real) -> MassProperties {
        self.stand_in.mass_properties(density)
    }

    fn shape_type(&self) -> ShapeType {
        ShapeType::Custom
    }

    fn as_typed_shape(&self) -> TypedShape<'_> {
        TypedShape::Cylinder(&self.stand_in)
    }

    fn ccd_thickness(&self) -> Real {
        self.stand_in.ccd_thickness()
    }

    fn ccd_angular_thickness(&self) -> Real {
        self.stand_in.ccd_angular_thickness()
    }

    fn is_convex(&self) -> bool {
        true
    }

    fn as_support_map(&self) -> Option<&dyn SupportMap> {
        Some(self)
    }

    fn as_polygonal_feature_map(&self) -> Option<(&dyn PolygonalFeatureMap, Real)> {
        Some((self, 0.0))
    }
}

impl SupportMap for PrimitiveShape {
    fn local_support_point(&self, direction: Vector) -> Vector {
        with_spheres!(self.hull, |spheres| SphereHull(&spheres).local_support_point(direction))
    }

    fn local_support_point_toward(&self, direction: Vector) -> Vector {
        with_spheres!(self.hull, |spheres| SphereHull(&spheres).local_support_point_toward(direction))
    }
}

impl PolygonalFeatureMap for PrimitiveShape {
    /// Returns a single point, because a round surface has one support point per direction.
    fn local_support_feature(&self, direction: Vector, feature: &mut PolygonalFeature) {
        *feature = PolygonalFeature {
            vertices: [self.local_support_point(direction); 4],
            vids: [PackedFeatureId::vertex(0); 4],
            eids: [PackedFeatureId::edge(0); 4],
            fid: PackedFeatureId::face(0),
            num_vertices: 1,
        };
    }
}

/// The convex hull of spheres for parry's algorithms.
pub(super) struct SphereHull<'a>(pub &'a [Sphere]);

impl SupportMap for SphereHull<'_> {
    fn local_support_point(&self, direction: Vector) -> Vector {
        self.local_support_point_toward(direction.try_normalize().unwrap_or(Vec3::Y))
    }

    fn local_support_point_toward(&self, direction: Vector) -> Vector {
        let reach = |sphere: &Sphere| sphere.center.dot(direction) + sphere.radius;
        let farthest = self.0.iter().max_by(|a, b| reach(a).total_cmp(&reach(b)));
        farthest.map_or(Vec3::ZERO, |sphere| sphere.center + direction * sphere.radius)
    }
}
