//! The share of each sphere of a primitive in a point of its surface.

use glam::Vec3;

use super::{Hull, with_spheres};
use crate::{
    geometry::Sphere,
    query::{Separation, separation},
};

impl Hull {
    /// Returns the barycentric weights of the sphere within the primitive that is nearest to a point. Weights of missing spheres are 0.
    pub fn shares(&self, point: Vec3) -> [f32; 3] {
        let found: Separation = with_spheres!(self, |spheres| { separation(spheres, &[Sphere::new(point, 0.0)], 0) });
        match *self {
            Hull::Sphere(_) => [1.0, 0.0, 0.0],
            Hull::Cone(spheres) => shares_of_cone(spheres, &found),
            Hull::Slab(spheres) => shares_of_slab(spheres, &found),
        }
    }
}

/// The surface point `p` on the sphere with the weights `w` satisfies `p = sum(w (c + r n))`, where `n` is the normal. So `w` are the barycentric weights of `p`
/// among the points `c + r n`, which lie on the tangent plane.
fn tangents<const N: usize>(spheres: [Sphere; N], found: &Separation) -> ([Vec3; N], Vec3) {
    (spheres.map(|s| s.center + s.radius * found.normal), found.point1)
}

fn shares_of_cone(spheres: [Sphere; 2], found: &Separation) -> [f32; 3] {
    let ([a, b], point) = tangents(spheres, found);
    let edge = b - a;
    let share = ((point - a).dot(edge) / edge.length_squared()).clamp(0.0, 1.0);
    let share = if share.is_nan() { 0.0 } else { share };
    [1.0 - share, share, 0.0]
}

fn shares_of_slab(spheres: [Sphere; 3], found: &Separation) -> [f32; 3] {
    let ([a, b, c], point) = tangents(spheres, found);
    let area = (b - a).cross(c - a);
    let share = |p: Vec3, q: Vec3| (p - point).cross(q - point).dot(area).max(0.0);
    let shares = Vec3::new(share(b, c), share(c, a), share(a, b));
    let sum = shares.element_sum();
    if sum > 0.0 { (shares / sum).to_array() } else { shares_of_cone([spheres[0], spheres[1]], found) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    #[test]
    fn shares_give_the_nearest_sphere() {
        let mut random = Random(13);
        let mut inner = [0; 3];
        for case in 0..600 {
            let spheres = [(); 3].map(|()| Sphere::new(random.in_cube() * 2.0, 0.05 + 0.2 * random.unit()));
            let hull = match case % 3 {
                0 => Hull::Sphere([spheres[0]]),
                1 => Hull::Cone([spheres[0], spheres[1]]),
                _ => Hull::Slab(spheres),
            };
            let middle = spheres.iter().map(|s| s.center).sum::<Vec3>() / 3.0;
            let point = middle + random.in_cube();
            let found = with_spheres!(hull, |s| separation(&s, &[Sphere::new(point, 0.0)], 0));
            if found.distance < 0.0 {
                continue;
            }
            let shares = hull.shares(point);
            let center = spheres.iter().zip(shares).map(|(s, share)| s.center * share).sum::<Vec3>();
            let radius = spheres.iter().zip(shares).map(|(s, share)| s.radius * share).sum::<f32>();
            assert!((shares.iter().sum::<f32>() - 1.0).abs() < 1e-5 && shares.iter().all(|share| *share >= 0.0));
            let distance = point.distance(center) - radius;
            assert!((distance - found.distance).abs() < 1e-3, "case {case}: {shares:?}, {distance} {found:?}");
            inner[case % 3] += usize::from(shares.iter().filter(|share| **share > 0.01).count() == 1 + case % 3);
        }
        assert!(inner[1] > 40 && inner[2] > 10, "{inner:?}");
    }
}
