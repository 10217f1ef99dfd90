//! The bounding sphere of a body and its path in a step: a medial cone, or a chain of cones for a curved path (paper, section 4).

use arrayvec::ArrayVec;
use glam::Vec3;

use crate::{
    constants::{CULLING_CHORD_TOLERANCE, MAX_LINKS},
    geometry::{Aabb, Sphere, Sweep},
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
    /// Sweeps the bounding sphere of a body over its step.
    pub fn new(body: &Body, margin: f32) -> Self {
        Self::along(body.solid.bounding_sphere(), &body.sweep, margin)
    }

    /// Sweeps a sphere along the chord of its centre and adds the sagitta to the radius. The sagitta is at most twice the arm, for any rotation.
    fn along(bound: Sphere, sweep: &Sweep, margin: f32) -> Self {
        let arm = bound.center.distance(sweep.local_center);
        let start = sweep.start.transform_point(bound.center);
        let end = sweep.pose_at(1.0).transform_point(bound.center);
        let radius = bound.radius + sweep.sagitta(arm) + margin;
        Self { sphere: Sphere::new(start, radius), motion: end - start }
    }

    /// Returns the number of cones in the chain along the path of a body: as many as it takes for a small sagitta, up to [`MAX_LINKS`].
    pub fn links(body: &Body) -> u32 {
        let bound = body.solid.bounding_sphere();
        let sagitta = body.sweep.sagitta(bound.center.distance(body.sweep.local_center));
        let mut links = 1;
        while links < MAX_LINKS && sagitta > CULLING_CHORD_TOLERANCE * bound.radius * (links * links) as f32 {
            links *= 2;
        }
        links
    }

    /// Returns the chain of cones along the path of a body.
    pub fn chain(body: &Body, links: u32, margin: f32) -> ArrayVec<Self, { MAX_LINKS as usize }> {
        let link = |number: u32| {
            let times = [number, number + 1].map(|i| i as f32 / links as f32);
            Self::along(body.solid.bounding_sphere(), &body.sweep.part(times), margin)
        };
        (0..links).map(link).collect()
    }

    pub fn aabb(&self) -> Aabb {
        let end = Sphere::new(self.sphere.center + self.motion, self.sphere.radius);
        Aabb::from_spheres([self.sphere, end])
    }

    /// Returns the cone relative to `origin`. An origin near the cone keeps f32 precision far from the world's origin.
    pub fn cone(&self, origin: Vec3) -> [Sphere; 2] {
        [Vec3::ZERO, self.motion].map(|motion| Sphere::new(self.sphere.center - origin + motion, self.sphere.radius))
    }

    /// Returns true if the cones touch.
    pub fn meets(&self, other: &SweptSphere) -> bool {
        let origin = self.sphere.center;
        // Most bodies of a pile overlap at the start, and the distance of cones takes longer.
        let radii = self.sphere.radius + other.sphere.radius;
        if origin.distance_squared(other.sphere.center) <= radii * radii {
            return true;
        }
        separation(&self.cone(origin), &other.cone(origin), 0).distance <= 0.0
    }
}
