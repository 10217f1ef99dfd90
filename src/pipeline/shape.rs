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
    /// Factor on all lengths, positive.
    pub scale: f32,
}

impl Shape {
    /// A shape at scale 1.
    pub fn new(axis: MedialAxis) -> Self {
        Self { axis, scale: 1.0 }
    }

    /// Number of primitives.
    pub fn len(&self) -> usize {
        self.axis.primitives().len()
    }

    /// False: a shape has at least one primitive.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Hierarchy over the primitives, *unscaled*.
    pub fn bvh(&self) -> &Bvh {
        self.axis.bvh()
    }

    /// Box around the shape.
    pub fn aabb(&self) -> Aabb {
        self.axis.aabb().scaled(self.scale)
    }

    /// Sphere around the shape.
    pub fn bounding_sphere(&self) -> Sphere {
        self.axis.bounding_sphere().scaled(self.scale)
    }

    /// Centre of mass.
    pub fn center_of_mass(&self) -> Vec3 {
        self.axis.mass().center_of_mass * self.scale
    }

    /// Distance from `point` to the farthest centre of a sphere, or a little more.
    pub(crate) fn arm(&self, point: Vec3) -> f32 {
        self.bounding_sphere().center.distance(point) + self.axis.center_reach() * self.scale
    }

    /// Distance from `point` to the farthest point of the shape, or a little more.
    pub(crate) fn radius_about(&self, point: Vec3) -> f32 {
        self.bounding_sphere().farthest(point)
    }

    /// Spheres of a primitive.
    pub fn hull(&self, primitive: u32) -> Hull {
        let spheres = self.axis.spheres();
        let sphere = |i: u32| spheres[i as usize].scaled(self.scale);
        match self.axis.primitives()[primitive as usize] {
            Primitive::Sphere(index) => Hull::Sphere(index.map(sphere)),
            Primitive::Cone(index) => Hull::Cone(index.map(sphere)),
            Primitive::Slab(index) => Hull::Slab(index.map(sphere)),
        }
    }

    /// Where the ray `origin + time * direction` first enters the shape for a `time` from 0 to `max_time`, and by which primitive; at 0 if it starts
    /// inside.
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

    /// Calls `visit` with the primitives whose boxes the ray crosses before the time that `limit` holds.
    pub(crate) fn visit_crossed(
        &self,
        origin: Vec3,
        direction: Vec3,
        limit: &Cell<f32>,
        mut visit: impl FnMut(u32, Hull),
    ) {
        let (origin, direction) = (origin / self.scale, direction / self.scale);
        // Far from the shape, the ray's own coordinates are no more exact.
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
    /// The primitive in the frame in which its own has the given placement.
    pub fn placed(self, placement: &Placement) -> Self {
        let place = |s: Sphere| Sphere::new(placement.point(s.center), s.radius);
        match self {
            Hull::Sphere(s) => Hull::Sphere(s.map(place)),
            Hull::Cone(s) => Hull::Cone(s.map(place)),
            Hull::Slab(s) => Hull::Slab(s.map(place)),
        }
    }

    /// The least radius of its spheres, in metres.
    pub fn min_radius(&self) -> f32 {
        with_spheres!(self, |spheres| spheres.iter().map(|s| s.radius).fold(f32::INFINITY, f32::min))
    }

    /// Largest radius, in metres.
    pub fn max_radius(&self) -> f32 {
        with_spheres!(self, |spheres| spheres.iter().map(|s| s.radius).fold(0.0, f32::max))
    }

    /// Box around it.
    pub fn aabb(&self) -> Aabb {
        with_spheres!(*self, |spheres| Aabb::from_spheres(spheres))
    }

    /// The greatest of `direction . x` over the primitive, relative to that of `origin`; `direction` is a unit vector.
    pub(super) fn height(&self, origin: Vec3, direction: Vec3) -> f32 {
        let height = |s: &Sphere| (s.center - origin).dot(direction) + s.radius;
        with_spheres!(self, |spheres| spheres.iter().map(height).fold(f32::NEG_INFINITY, f32::max))
    }

    /// How a sphere and the primitive lie to each other, the sphere relative to `origin`, a point nearby.
    pub(super) fn separation_from(&self, origin: Vec3, sphere: [Sphere; 1]) -> Separation {
        with_spheres!(*self, |spheres| {
            separation(&sphere, &spheres.map(|s| Sphere::new(s.center - origin, s.radius)), 0)
        })
    }
}
