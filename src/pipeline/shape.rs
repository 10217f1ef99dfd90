use std::cell::Cell;

use glam::Vec3;

use crate::{
    geometry::{Aabb, Bvh, Placement, Primitive, Sphere},
    medial_axis::MedialAxis,
    query::{RayHit, Separation, ray_cast, separation},
};

/// Runs an expression with the spheres of a [`Hull`] bound to an array of the right length.
macro_rules! with_spheres {
    ($hull:expr, |$spheres:pat_param| $body:expr) => {
        match $hull {
            $crate::pipeline::Hull::Sphere($spheres) => $body,
            $crate::pipeline::Hull::Cone($spheres) => $body,
            $crate::pipeline::Hull::Slab($spheres) => $body,
        }
    };
}
pub(crate) use with_spheres;

/// A medial axis at a uniform scale.
#[derive(Clone, Debug)]
pub struct Shape {
    /// The shared asset.
    pub axis: MedialAxis,
    /// Scale factor of all lengths. It is positive.
    pub scale: f32,
}

impl Shape {
    /// Creates a shape at scale 1.
    pub fn new(axis: MedialAxis) -> Self {
        Self { axis, scale: 1.0 }
    }

    /// Creates a shape at a scale. A negative scale stands for a mirror image: x is scaled by it, y and z by its absolute value.
    pub fn scaled(axis: &MedialAxis, scale: f32) -> Self {
        let axis = if scale < 0.0 { axis.mirrored() } else { axis };
        Self { axis: axis.clone(), scale: scale.abs() }
    }

    /// Returns the number of primitives.
    pub fn len(&self) -> usize {
        self.axis.primitives().len()
    }

    /// Returns false, because a shape has at least one primitive.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns the BVH of the *unscaled* primitives.
    pub fn bvh(&self) -> &Bvh {
        self.axis.bvh()
    }

    /// Returns the bounding box in the shape's frame.
    pub fn aabb(&self) -> Aabb {
        self.axis.aabb().scaled(self.scale)
    }

    /// Returns a bounding sphere in the shape's frame.
    pub fn bounding_sphere(&self) -> Sphere {
        self.axis.bounding_sphere().scaled(self.scale)
    }

    /// Returns the centre of mass in the shape's frame.
    pub fn center_of_mass(&self) -> Vec3 {
        self.axis.mass().center_of_mass * self.scale
    }

    /// Returns an upper bound of the distance from `point` to the farthest sphere centre.
    pub(crate) fn arm(&self, point: Vec3) -> f32 {
        self.bounding_sphere().center.distance(point) + self.axis.center_reach() * self.scale
    }

    /// Returns an upper bound of the distance from `point` to the farthest point of the shape.
    pub(crate) fn radius_about(&self, point: Vec3) -> f32 {
        self.bounding_sphere().farthest(point)
    }

    /// Returns the scaled spheres of a primitive.
    pub fn hull(&self, primitive: u32) -> Hull {
        let spheres = self.axis.spheres();
        let sphere = |i: u32| spheres[i as usize].scaled(self.scale);
        Hull::new(self.axis.primitives()[primitive as usize], sphere)
    }

    /// Returns the first hit of the ray `origin + time * direction` for times from 0 to `max_time`, and the primitive that is hit. A ray that starts inside
    /// hits at time 0.
    pub fn ray_cast(&self, origin: Vec3, direction: Vec3, max_time: f32) -> Option<(RayHit, u32)> {
        let limit = Cell::new(max_time);
        let mut first: Option<(RayHit, u32)> = None;
        self.visit_crossed(origin, direction, &limit, |primitive, hull| {
            let hit = with_spheres!(&hull, |spheres| ray_cast(spheres, origin, direction, limit.get()));
            if let Some(hit) = hit
                && first.is_none_or(|(first, _)| hit.time < first.time)
            {
                limit.set(hit.time);
                first = Some((hit, primitive));
            }
        });
        first
    }

    /// Calls `visit` for each primitive whose box the ray crosses before the time `limit`. `visit` may lower the limit.
    pub(crate) fn visit_crossed(
        &self,
        origin: Vec3,
        direction: Vec3,
        limit: &Cell<f32>,
        mut visit: impl FnMut(u32, Hull),
    ) {
        let (origin, direction) = (origin / self.scale, direction / self.scale);
        // The coordinates of a ray that starts far from the shape are rounded by this much.
        let rounding = f32::EPSILON * origin.length();
        let crosses = |aabb: &Aabb| aabb.inflated(rounding).crossing(origin, direction, limit.get()).is_some();
        self.bvh().visit(crosses, |primitive| visit(primitive, self.hull(primitive)));
    }
}

/// The spheres of one primitive.
#[derive(Clone, Copy, Debug)]
pub enum Hull {
    /// A sphere.
    Sphere([Sphere; 1]),
    /// A medial cone.
    Cone([Sphere; 2]),
    /// A medial slab.
    Slab([Sphere; 3]),
}

impl Hull {
    /// Creates the hull of a primitive.
    pub(super) fn new(primitive: Primitive, sphere: impl Fn(u32) -> Sphere) -> Self {
        match primitive {
            Primitive::Sphere(index) => Hull::Sphere(index.map(sphere)),
            Primitive::Cone(index) => Hull::Cone(index.map(sphere)),
            Primitive::Slab(index) => Hull::Slab(index.map(sphere)),
        }
    }

    /// Transforms the primitive to the frame in which its own frame has the given placement.
    pub fn placed(self, placement: &Placement) -> Self {
        let place = |s: Sphere| Sphere::new(placement.point(s.center), s.radius);
        match self {
            Hull::Sphere(s) => Hull::Sphere(s.map(place)),
            Hull::Cone(s) => Hull::Cone(s.map(place)),
            Hull::Slab(s) => Hull::Slab(s.map(place)),
        }
    }

    /// Returns the smallest radius, in metres.
    pub fn min_radius(&self) -> f32 {
        with_spheres!(self, |spheres| spheres.iter().map(|s| s.radius).fold(f32::INFINITY, f32::min))
    }

    /// Returns the largest radius, in metres.
    pub fn max_radius(&self) -> f32 {
        with_spheres!(self, |spheres| spheres.iter().map(|s| s.radius).fold(0.0, f32::max))
    }

    /// Returns the bounding box of the primitive.
    pub fn aabb(&self) -> Aabb {
        with_spheres!(*self, |spheres| Aabb::from_spheres(spheres))
    }

    /// Returns the maximum of `direction . (x - origin)` over the primitive. `direction` is a unit vector.
    pub(super) fn height(&self, origin: Vec3, direction: Vec3) -> f32 {
        let height = |s: &Sphere| (s.center - origin).dot(direction) + s.radius;
        with_spheres!(self, |spheres| spheres.iter().map(height).fold(f32::NEG_INFINITY, f32::max))
    }

    /// Returns the separation of a sphere and the primitive. The sphere and the result are relative to `origin`, a point nearby.
    pub(super) fn separation_from(&self, origin: Vec3, sphere: [Sphere; 1]) -> Separation {
        with_spheres!(*self, |spheres| {
            separation(&sphere, &spheres.map(|s| Sphere::new(s.center - origin, s.radius)), 0)
        })
    }
}
