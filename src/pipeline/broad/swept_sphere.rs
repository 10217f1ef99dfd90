//! The bounding sphere of a body and its path in a step: a medial cone (paper, section 4).

use glam::Vec3;

use crate::{
    geometry::{Aabb, Sphere},
    pipeline::Body,
    query::separation,
};

/// The bounding sphere of a body at the start of the step, in the world, and its displacement.
#[derive(Clone, Copy, Debug)]
pub(super) struct SweptSphere {
    pub sphere: Sphere,
    pub motion: Vec3,
}

impl SweptSphere {
    /// Sweeps the bounding sphere along the chord of its centre and adds the sagitta to the radius. The sagitta is at most twice the arm, for any rotation.
    pub fn new(body: &Body, margin: f32) -> Self {
        let bound = body.solid.bounding_sphere();
        let arm = bound.center.distance(body.sweep.local_center);
        let start = body.sweep.start.transform_point(bound.center);
        let end = body.sweep.pose_at(1.0).transform_point(bound.center);
        let radius = bound.radius + body.sweep.sagitta(arm) + margin;
        Self { sphere: Sphere::new(start, radius), motion: end - start }
    }

    pub fn aabb(&self) -> Aabb {
        let end = Sphere::new(self.sphere.center + self.motion, self.sphere.radius);
        Aabb::from_spheres([self.sphere, end])
    }

    /// Returns the cone relative to `origin`. An origin near the cone keeps f32 precision far from the world's origin.
    pub fn cone(&self, origin: Vec3) -> [Sphere; 2] {
        [Vec3::ZERO, self.motion].map(|motion| Sphere::new(self.sphere.center - origin + motion, self.sphere.radius))
    }

    pub fn meets(&self, other: &SweptSphere) -> bool {
        let origin = self.sphere.center;
        separation(&self.cone(origin), &other.cone(origin), 0).distance <= 0.0
    }
}
