//! Spheres.

use bevy_medial::{
    geometry::{Aabb, Obb, Sphere},
    pipeline::Hull,
    query::separation,
};
use glam::Vec3;

use super::tree::{Motion, Volume, spheres};

/// A sphere whose centre moves on a line.
#[derive(Clone, Copy)]
pub struct MovingSphere {
    start: Vec3,
    motion: Vec3,
    radius: f32,
}

impl MovingSphere {
    fn cone(&self, origin: Vec3) -> [Sphere; 2] {
        [Vec3::ZERO, self.motion].map(|motion| Sphere::new(self.start - origin + motion, self.radius))
    }
}

impl Volume for MovingSphere {
    type Local = Sphere;
    type Fixed = Obb;

    fn fit(hulls: &[Hull]) -> Sphere {
        least_sphere(&hulls.iter().flat_map(spheres).copied().collect::<Vec<_>>())
    }

    fn refit(local: &Sphere, motion: &Motion, _: Option<[&Self; 2]>) -> Self {
        let [start, end] = motion.ends(local.center);
        Self { start, motion: end - start, radius: local.radius + motion.sagitta(local.center) }
    }

    fn fixed(obb: &Obb) -> Obb {
        *obb
    }

    fn aabb(&self) -> Aabb {
        Aabb::from_spheres(self.cone(Vec3::ZERO))
    }

    fn size(&self) -> f32 {
        self.radius
    }

    fn meets(&self, other: &Self, margin: f32) -> bool {
        let (offset, motion) = (other.start - self.start, other.motion - self.motion);
        let squared = motion.length_squared();
        let nearest = if squared > 0.0 { (-offset.dot(motion) / squared).clamp(0.0, 1.0) } else { 0.0 };
        let reach = self.radius + other.radius + margin;
        (offset + motion * nearest).length_squared() <= reach * reach
    }

    fn meets_whenever(&self, other: &Self, margin: f32) -> bool {
        separation(&self.cone(self.start), &other.cone(self.start), 0).distance <= margin
    }

    fn meets_fixed(&self, fixed: &Obb, margin: f32) -> bool {
        let reach = fixed.half_extents + self.radius + margin;
        let start = fixed.pose.inverse_transform_point(self.start);
        let motion = fixed.pose.rotation.inverse() * self.motion;
        Aabb { min: -reach, max: reach }.crossing(start, motion, 1.0).is_some()
    }
}

/// The smallest sphere around others, to 1 %. Its centre moves towards the sphere that protrudes most, in shorter and shorter steps.
fn least_sphere(spheres: &[Sphere]) -> Sphere {
    let mut center = Aabb::from_spheres(spheres.iter().copied()).center();
    let mut best = Sphere::new(center, f32::INFINITY);
    let mut step = 0.25;
    for _ in 0..256 {
        let reach = |sphere: &&Sphere| sphere.farthest(center);
        let Some(farthest) = spheres.iter().max_by(|a, b| reach(a).total_cmp(&reach(b))) else { break };
        let radius = farthest.farthest(center);
        if radius < best.radius {
            best = Sphere::new(center, radius);
        }
        center += (farthest.center - center).normalize_or_zero() * (radius * step);
        step *= 0.97;
    }
    best
}
