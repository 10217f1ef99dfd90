use std::sync::{Arc, OnceLock};

use glam::Vec3;

use super::{Data, MedialAxis};
use crate::geometry::{Aabb, Sphere};

impl MedialAxis {
    /// The same primitives with other spheres, such as those of a pose. The mass properties stay those of this shape, and there are no levels of detail.
    ///
    /// Primitives may be degenerate then. They fill the hulls of their spheres all the same.
    ///
    /// # Panics
    /// If the number of spheres is another one.
    #[must_use]
    pub(crate) fn with_spheres(&self, spheres: Vec<Sphere>) -> Self {
        let Data { primitives, bvh, .. } = &*self.0;
        assert_eq!(spheres.len(), self.0.spheres.len());
        let boxes: Vec<Aabb> =
            primitives.iter().map(|p| Aabb::from_spheres(p.indices().iter().map(|&i| spheres[i as usize]))).collect();
        let bvh = bvh.refitted(&boxes);
        let (aabb, center) = (bvh.aabb(), bvh.aabb().center());
        let most = |value: fn(&Sphere, Vec3) -> f32| spheres.iter().map(|s| value(s, center)).fold(0.0, f32::max);
        let radius = most(|s, center| s.center.distance(center) + s.radius).next_up();
        Self(Arc::new(Data {
            bvh,
            aabb,
            bounding_sphere: Sphere::new(center, radius),
            center_reach: most(|s, center| s.center.distance(center)),
            mass: OnceLock::from(*self.mass()),
            min_radius: spheres.iter().fold(f32::INFINITY, |least, s| least.min(s.radius)),
            coarser: Vec::new(),
            skin: None,
            primitives: primitives.clone(),
            spheres: spheres.into(),
        }))
    }
}
