use std::sync::{Arc, OnceLock};

use glam::{Mat3, Vec3};

use super::{MassProperties, MedialAxis};
use crate::geometry::Sphere;

/// The reflection at the plane x = 0.
const MIRROR: Vec3 = Vec3::new(-1.0, 1.0, 1.0);

impl MedialAxis {
    /// The same shape with these mass properties at unit density, for example those of the solid that it approximates. Coarser levels keep theirs.
    #[must_use]
    pub fn with_mass(mut self, mass: MassProperties) -> Self {
        let data = Arc::make_mut(&mut self.0);
        (data.mass, data.mirrored) = (mass.into(), OnceLock::new());
        self
    }

    /// The mirror image at the plane x = 0, without coarser levels and without a skin. Spheres and primitives have the same indices. All clones share it; the
    /// first call computes it.
    pub fn mirrored(&self) -> &MedialAxis {
        self.0.mirrored.get_or_init(|| {
            let spheres = self.spheres().iter().map(|sphere| Sphere::new(sphere.center * MIRROR, sphere.radius));
            Self::derive(spheres.collect(), self.primitives().to_vec()).with_mass(self.mass().mirrored())
        })
    }
}

impl MassProperties {
    /// Mass properties of the mirror image at the plane x = 0.
    fn mirrored(&self) -> Self {
        let mirror = Mat3::from_diagonal(MIRROR);
        Self {
            center_of_mass: self.center_of_mass * MIRROR,
            inertia: mirror * self.inertia * mirror,
            volume: self.volume,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::medial_axis::oracle::Envelope;

    #[test]
    fn a_mirror_image_has_mirrored_points_and_mass() {
        let spheres = [[0.1, 0.0, 0.2, 0.05], [0.9, 0.3, 0.1, 0.1], [0.7, 0.9, -0.3, 0.15], [0.2, 0.4, 0.8, 0.02]];
        let spheres = spheres.map(|[x, y, z, radius]| Sphere::new(Vec3::new(x, y, z), radius)).to_vec();
        let (axis, _) = MedialAxis::from_lists(spheres, &[[1, 3]], &[[0, 1, 2]]).unwrap();
        let image = axis.mirrored();
        assert_eq!(image.primitives(), axis.primitives());
        assert_eq!(image.address(), axis.clone().mirrored().address(), "clones share the image");
        let [a, b] = [&axis, image].map(|axis| Envelope::new(axis.spheres(), axis.primitives()));
        let mut random = crate::random::Random(4);
        for _ in 0..1000 {
            let point = 2.0 * random.in_cube();
            let [near, far] = [a.distance(point.as_dvec3()), b.distance((point * MIRROR).as_dvec3())];
            assert!((near - far).abs() < 1e-6, "{point}: {near} {far}");
        }
        let (stated, found) = (image.mass(), MassProperties::of_union(image.spheres(), image.primitives()));
        assert!((stated.volume / found.volume - 1.0).abs() < 2e-3);
        assert!(stated.center_of_mass.distance(found.center_of_mass) < 2e-3 && stated.center_of_mass.x < -0.3);
        assert!(stated.inertia.abs_diff_eq(found.inertia, 4e-3 * found.inertia.x_axis.x), "{stated:?} {found:?}");
        assert!(stated.inertia.y_axis.x.abs() > 0.05 * found.inertia.x_axis.x, "the product of inertia is not 0");
        assert!(stated.inertia.y_axis.x * axis.mass().inertia.y_axis.x < 0.0);
    }
}
