//! World boxes.

use bevy_medial::{
    geometry::{Aabb, Obb, Sphere},
    pipeline::Hull,
};

use super::tree::{Motion, Volume, spheres};

/// A world box around a node over the whole step.
#[derive(Clone, Copy)]
pub struct SweptAabb(Aabb);

impl Volume for SweptAabb {
    /// The primitive of a leaf; inner nodes need nothing.
    type Local = Hull;
    type Fixed = Aabb;

    fn fit(hulls: &[Hull]) -> Hull {
        hulls[0]
    }

    fn refit(hull: &Hull, motion: &Motion, children: Option<[&Self; 2]>) -> Self {
        if let Some([left, right]) = children {
            return Self(left.0.merge(right.0));
        }
        Self(Aabb::from_spheres(spheres(hull).iter().flat_map(|sphere| {
            let radius = sphere.radius + motion.sagitta(sphere.center);
            motion.ends(sphere.center).map(|center| Sphere::new(center, radius))
        })))
    }

    fn fixed(obb: &Obb) -> Aabb {
        obb.aabb()
    }

    fn aabb(&self) -> Aabb {
        self.0
    }

    fn size(&self) -> f32 {
        self.0.extent_squared()
    }

    fn meets(&self, other: &Self, margin: f32) -> bool {
        self.0.inflated(margin).overlaps(&other.0)
    }

    fn meets_whenever(&self, other: &Self, margin: f32) -> bool {
        self.meets(other, margin)
    }

    fn meets_fixed(&self, fixed: &Aabb, margin: f32) -> bool {
        self.0.inflated(margin).overlaps(fixed)
    }
}
