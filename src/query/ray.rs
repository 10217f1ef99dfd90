//! Ray cast on a primitive, as the time of impact of a moving point.

use glam::Vec3;

use super::{
    moving::Moving,
    separation::Convex,
    time_of_impact::{TimeOfImpactStatus, time_of_impact},
};
use crate::geometry::Sphere;

/// The point where a ray enters a shape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RayHit {
    /// Distance from the origin, in lengths of the direction vector; 0 if the origin is inside.
    pub time: f32,
    /// Outward unit normal of the surface at the hit. If the origin is inside: the approximate direction to the nearest surface.
    pub normal: Vec3,
}

/// First point of `spheres` on the ray `origin + time * direction` for `time` from 0 to `max_time`. A zero direction hits only if the
/// origin is inside the primitive.
pub fn ray_cast<const N: usize>(spheres: &[Sphere; N], origin: Vec3, direction: Vec3, max_time: f32) -> Option<RayHit> {
    // Only the part near the primitive is searched, so the accuracy depends on the primitive's size and not on the ray's length.
    let middle = spheres.origin();
    let radius = spheres.iter().map(|s| s.center.distance(middle) + s.radius).fold(0.0, f32::max);
    let speed = direction.length();
    let (begin, end) = if speed > 0.0 {
        let closest = (middle - origin).dot(direction) / (speed * speed);
        let reach = radius / speed;
        ((closest - reach).max(0.0), (closest + reach).min(max_time))
    } else {
        (0.0, 0.0)
    };
    if begin > end {
        return None;
    }
    let local = spheres.map(|s| Sphere::new(s.center - middle, s.radius));
    let still = Moving { start: local, motion: [Vec3::ZERO; N] };
    let start = Sphere::new((origin - middle) + direction * begin, 0.0);
    let point = Moving { start: [start], motion: [direction * (end - begin)] };
    let impact = time_of_impact(&point, &still, 1.0);
    (impact.status != TimeOfImpactStatus::Separated)
        .then(|| RayHit { time: begin + impact.fraction * (end - begin), normal: -impact.contact.normal })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    /// Compares hits of random slabs with the distance of points along the ray, and hits of one sphere with exact values.
    #[test]
    fn enters_where_the_distance_falls_to_zero() {
        let mut random = Random(1);
        let mut hits = 0;
        for _ in 0..5_000 {
            let mut vector = |scale: f32| random.in_cube() * scale;
            let slab = [vector(1.0), vector(1.0), vector(1.0)].map(|c| Sphere::new(c, 0.1 + 0.2 * c.x.abs()));
            let origin = vector(30.0);
            let direction = (vector(1.5) - origin) * 0.1;
            let Some(hit) = ray_cast(&slab, origin, direction, f32::MAX) else { continue };
            hits += 1;
            let at = |time: f32| {
                let point = (origin.as_dvec3() + direction.as_dvec3() * f64::from(time)).as_vec3();
                crate::query::separation(&[Sphere::new(point, 0.0)], &slab, 0).distance
            };
            assert!(at(hit.time).abs() < 2e-4, "off the surface by {}", at(hit.time));
            let before = hit.time - 0.01 / direction.length();
            assert!(at(before) > -1e-4, "{before} of {} is inside by {}", hit.time, at(before));
            assert!((hit.normal.length() - 1.0).abs() < 1e-4);
        }
        assert!(hits > 500, "only {hits} hits");
        let ball = [Sphere::new(Vec3::ZERO, 1.0)];
        let hit = ray_cast(&ball, Vec3::new(-3.0, 0.0, 0.0), Vec3::X, 10.0).unwrap();
        assert!((hit.time - 2.0).abs() < 1e-5 && hit.normal.dot(-Vec3::X) > 0.9999);
        assert!(ray_cast(&ball, Vec3::new(-3.0, 0.0, 0.0), Vec3::X, 1.9).is_none());
        assert!(ray_cast(&ball, Vec3::new(-3.0, 0.0, 0.0), -Vec3::X, 10.0).is_none());
        assert_eq!(ray_cast(&ball, Vec3::new(0.5, 0.0, 0.0), Vec3::X, 10.0).map(|h| h.time), Some(0.0));
        assert!(ray_cast(&ball, Vec3::new(3.0, 0.0, 0.0), Vec3::ZERO, 10.0).is_none());
    }
}
