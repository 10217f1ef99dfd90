use std::sync::{Arc, OnceLock};

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
        assert_eq!(spheres.len(), self.0.spheres.len());
        let aabb = Aabb::from_spheres(spheres.iter().copied());
        let center = aabb.center();
        let (mut radius, mut center_reach, mut min_radius) = (0.0f32, 0.0f32, f32::INFINITY);
        for sphere in &spheres {
            let distance = sphere.center.distance(center);
            radius = radius.max(distance + sphere.radius);
            center_reach = center_reach.max(distance);
            min_radius = min_radius.min(sphere.radius);
        }
        Self(Arc::new(Data {
            bvh: OnceLock::new(),
            bind: Some(self.0.bind.as_ref().unwrap_or(self).clone()),
            aabb,
            bounding_sphere: Sphere::new(center, radius.next_up()),
            center_reach,
            min_radius,
            mass: OnceLock::from(*self.mass()),
            mirrored: OnceLock::new(),
            coarser: Vec::new(),
            skin: None,
            primitives: self.0.primitives.clone(),
            spheres: spheres.into(),
        }))
    }
}
