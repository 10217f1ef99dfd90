//! Bounding spheres.

use glam::{DVec3, Vec3};

use crate::geometry::{Aabb, Sphere};

/// A small sphere around all spheres: its centre moves towards the sphere that sticks out most, in ever smaller steps.
pub(super) fn bounding_sphere(spheres: &[Sphere]) -> Sphere {
    const ROUNDS: u32 = 256;
    const SHRINK: f64 = 0.97;
    let reach = |center: DVec3| {
        let reaches = spheres.iter().map(|s| (center.distance(s.center.as_dvec3()) + f64::from(s.radius), s));
        reaches.max_by(|a, b| a.0.total_cmp(&b.0))
    };
    let mut center = Aabb::from_spheres(spheres.iter().copied()).center().as_dvec3();
    let (mut best, mut least) = (center, f64::INFINITY);
    let mut step = 0.25;
    for _ in 0..ROUNDS {
        let Some((radius, farthest)) = reach(center) else { break };
        if radius < least {
            (best, least) = (center, radius);
        }
        center += (farthest.center.as_dvec3() - center).normalize_or_zero() * (radius * step);
        step *= SHRINK;
    }
    // Radius measured from the rounded f32 centre, and rounded up.
    let center: Vec3 = best.as_vec3();
    let radius = reach(center.as_dvec3()).map_or(0.0, |(radius, _)| radius as f32);
    Sphere::new(center, radius.next_up())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    fn ball(x: f32, y: f32, z: f32, radius: f32) -> Sphere {
        Sphere::new(Vec3::new(x, y, z), radius)
    }

    #[test]
    fn bounding_sphere_is_least_where_that_is_known() {
        let two = bounding_sphere(&[ball(0.0, 0.0, 0.0, 1.0), ball(4.0, 0.0, 0.0, 2.0)]);
        assert!((two.radius - 3.5).abs() < 0.01, "{two:?}");
        let one_inside = bounding_sphere(&[ball(1.0, 2.0, 3.0, 5.0), ball(2.0, 2.0, 3.0, 1.0)]);
        assert!((one_inside.radius - 5.0).abs() < 0.01, "{one_inside:?}");
        let corners: Vec<_> = (0..8)
            .map(|i| ball((i & 1) as f32 * 2.0, (i >> 1 & 1) as f32 * 4.0, (i >> 2) as f32 * 6.0, 0.25))
            .collect();
        let cube = bounding_sphere(&corners);
        assert!((cube.radius - (14f32.sqrt() + 0.25)).abs() < 0.02, "{cube:?}");
        // A regular triangle, whose bounding box and bounding ball have different centres.
        let triangle = [0.0, 120.0, 240f32].map(|a| ball(a.to_radians().cos(), a.to_radians().sin(), 0.0, 0.0));
        assert!((bounding_sphere(&triangle).radius - 1.0).abs() < 0.005);
    }

    #[test]
    fn bounding_sphere_holds_all() {
        let mut random = Random(1);
        for _ in 0..200 {
            let offset = 1000.0 * random.signed();
            let spheres: Vec<_> = (0..1 + random.below(40))
                .map(|_| ball(random.signed() + offset, random.signed(), random.signed() * 0.1, random.unit() * 0.3))
                .collect();
            let bound = bounding_sphere(&spheres);
            assert!(spheres.iter().all(|s| bound.contains(s)));
        }
    }
}
