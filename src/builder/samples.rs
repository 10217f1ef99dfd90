//! Points spread evenly over the surfaces of triangles, spheres and medial cones.

use std::collections::{BTreeMap, BTreeSet};
use std::f32::consts::{PI, TAU};

use glam::Vec3;

use crate::{
    geometry::{Primitive, Sphere},
    medial_axis::face_normals,
    random::GOLDEN_TURN,
};

/// Smallest number of points on a curved patch, so that small patches are sampled on all sides.
const LEAST: f32 = 32.0;

/// Steps of a sequence that fills a square evenly for any number of points (Roberts 2018): inverse powers of the plastic number.
const STEPS: [f64; 2] = [0.754_877_666_246_692_8, 0.569_840_290_998_053_3];

/// Smallest extent of a sphere beyond a tangent plane that hides a point, relative to the size of the whole.
const BEYOND: f32 = 1.0e-6;

/// A simple piece of surface.
#[derive(Clone, Debug)]
pub(super) enum Patch {
    /// A triangle.
    Triangle([Vec3; 3]),
    /// A sphere, and the spheres that share a primitive with it.
    Ball(Sphere, Vec<Sphere>),
    /// The conical part of a medial cone, and the spheres that share a slab with it.
    Mantle([Sphere; 2], Vec<Sphere>),
}

impl Patch {
    /// The patches of the envelope of clean primitives, including those hidden by other primitives.
    pub fn of(spheres: &[Sphere], primitives: &[Primitive]) -> Vec<Self> {
        let mut patches = Vec::new();
        let mut balls = BTreeMap::<u32, BTreeSet<u32>>::new();
        let mut mantles = BTreeMap::<[u32; 2], BTreeSet<u32>>::new();
        for primitive in primitives {
            let corners = primitive.indices();
            for (at, &i) in corners.iter().enumerate() {
                balls.entry(i).or_default().extend(corners.iter().filter(|&&other| other != i));
                for &j in &corners[at + 1..] {
                    let others = corners.iter().filter(|&&other| other != i && other != j);
                    mantles.entry([i.min(j), i.max(j)]).or_default().extend(others);
                }
            }
            if let Primitive::Slab(slab) = primitive {
                patches.extend(faces(slab.map(|i| spheres[i as usize])).into_iter().flatten());
            }
        }
        let sphere = |i: u32| spheres[i as usize];
        let all = |hiders: BTreeSet<u32>| hiders.into_iter().map(sphere).collect();
        patches.extend(balls.into_iter().map(|(i, hiders)| Self::Ball(sphere(i), all(hiders))));
        patches.extend(mantles.into_iter().map(|(cone, hiders)| Self::Mantle(cone.map(sphere), all(hiders))));
        patches
    }

    /// Area of the whole patch, including hidden parts.
    pub fn area(&self) -> f32 {
        match *self {
            Self::Triangle([a, b, c]) => (b - a).cross(c - a).length() * 0.5,
            Self::Ball(ref sphere, _) => 4.0 * PI * sphere.radius * sphere.radius,
            Self::Mantle([a, b], _) => {
                let growth = b.radius - a.radius;
                let length_squared = a.center.distance_squared(b.center);
                let sin_squared = (1.0 - growth * growth / length_squared).max(0.0);
                PI * (a.radius + b.radius) * sin_squared * length_squared.sqrt()
            }
        }
    }

    /// Calls `visit` with points about `spacing` apart, each with the area that it represents. Points inside the patch's own primitives are
    /// omitted.
    pub fn sample(&self, spacing: f32, mut visit: impl FnMut(Vec3, f32)) {
        let area = self.area();
        let wanted = (area / (spacing * spacing)).ceil();
        // A point is hidden by a hull of its own primitives if a sphere of the hull extends beyond the tangent plane at the point.
        let hidden = |point: Vec3, normal: Vec3, hiders: &[Sphere]| {
            hiders.iter().any(|by| normal.dot(by.center - point) + by.radius > BEYOND)
        };
        match self {
            // A triangle with zero or NaN area gets one point.
            &Self::Triangle([a, b, c]) => {
                let count = wanted.max(1.0);
                for [u, v] in square(count as u32, 1.0 / 3.0) {
                    let [u, v] = if u + v > 1.0 { [1.0 - u, 1.0 - v] } else { [u, v] };
                    visit(a + (b - a) * u + (c - a) * v, area / count);
                }
            }
            Self::Ball(sphere, hiders) => {
                let count = wanted.max(LEAST);
                for i in 0..count as u32 {
                    let height = 1.0 - (2.0 * i as f32 + 1.0) / count;
                    let turn = (f64::from(i) * GOLDEN_TURN).fract() as f32;
                    let (sin, cos) = (TAU * turn).sin_cos();
                    let direction = Vec3::new(cos, sin, 0.0) * (1.0 - height * height).sqrt() + Vec3::Z * height;
                    let point = sphere.center + direction * sphere.radius;
                    if !hidden(point, direction, hiders) {
                        visit(point, area / count);
                    }
                }
            }
            Self::Mantle([a, b], hiders) => {
                let Some(axis) = (b.center - a.center).try_normalize() else { return };
                let cos = (a.radius - b.radius) / a.center.distance(b.center);
                let sin = (1.0 - cos * cos).max(0.0).sqrt();
                let (side, up) = axis.any_orthonormal_pair();
                let count = wanted.max(LEAST);
                for [u, v] in square(count as u32, 0.5) {
                    // Position along the axis that has the fraction `u` of the area before it.
                    let radius = (a.radius * a.radius * (1.0 - u) + b.radius * b.radius * u).sqrt();
                    let sum = a.radius + radius;
                    let t = if sum > 0.0 { u * (a.radius + b.radius) / sum } else { u };
                    let (y, x) = (TAU * v).sin_cos();
                    let sphere = a.lerp(b, t);
                    let direction = axis * cos + (side * x + up * y) * sin;
                    let point = sphere.center + direction * sphere.radius;
                    if !hidden(point, direction, hiders) {
                        visit(point, area / count);
                    }
                }
            }
        }
    }
}

/// Points that fill the unit square evenly. The first one is at `start` along both sides.
fn square(count: u32, start: f64) -> impl Iterator<Item = [f32; 2]> {
    (0..count).map(move |i| STEPS.map(|step| (start + f64::from(i) * step).fract() as f32))
}

/// The two flat faces of a slab.
fn faces([a, b, c]: [Sphere; 3]) -> Option<[Patch; 2]> {
    let normals = face_normals(&[a, b, c], [0, 1, 2])?.map(|normal| normal.as_vec3());
    let face = |n: Vec3| Patch::Triangle([a, b, c].map(|s| s.center + n * s.radius));
    normals.iter().all(|n| n.is_finite()).then(|| normals.map(face))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Number of points, sum of their weights, and their weighted middle.
    fn moments(patch: &Patch, spacing: f32) -> (u32, f32, Vec3) {
        let (mut count, mut sum, mut first) = (0, 0.0, Vec3::ZERO);
        patch.sample(spacing, |point, weight| {
            count += 1;
            sum += weight;
            first += point * weight;
        });
        (count, sum, first / sum)
    }

    #[test]
    fn points_are_spread_evenly() {
        let [a, b] = [Sphere::new(Vec3::ZERO, 0.5), Sphere::new(Vec3::X * 2.0, 1.0)];
        // Slope: the sine of the mantle's angle to the axis is a quarter.
        let sin_squared = 1.0 - 1.0 / 16.0f32;
        let mantle = PI * 1.5 * 2.0 * sin_squared;
        // The ends along the axis are at -r cos. The centroid of the area lies between them.
        let [from, to] = [-0.125, 2.0 - 0.25];
        let middle = from + (to - from) * (0.5 + 2.0 * 1.0) / (3.0 * 1.5);
        let triangle = [Vec3::ZERO, Vec3::X * 3.0, Vec3::Y * 3.0];
        let cases = [
            (Patch::Triangle(triangle), 4.5, Vec3::new(1.0, 1.0, 0.0)),
            (Patch::Ball(b, vec![]), 4.0 * PI, b.center),
            (Patch::Mantle([a, b], vec![]), mantle, Vec3::X * middle),
        ];
        for (patch, area, center) in cases {
            let (count, sum, found) = moments(&patch, 0.05);
            assert!((sum / area - 1.0).abs() < 1e-4, "{patch:?}: area {sum} instead of {area}");
            assert!((count as f32 * 0.0025 / area - 1.0).abs() < 0.01, "{patch:?}: {count} points");
            assert!(found.distance(center) < 0.01, "{patch:?}: {found} instead of {center}");
            let least = moments(&patch, 1e3).0;
            assert_eq!(least, if matches!(patch, Patch::Triangle(_)) { 1 } else { LEAST as u32 });
        }
        assert_eq!(moments(&Patch::Triangle(triangle), 1e3).2, Vec3::new(1.0, 1.0, 0.0), "one point is the centroid");
    }

    #[test]
    fn hidden_samples_of_a_primitive_are_left_out() {
        let spheres = [[0.0, 0.5], [2.0, 0.5]].map(|[x, radius]| Sphere::new(Vec3::X * x, radius));
        let patches = Patch::of(&spheres, &[Primitive::Cone([0, 1])]);
        let area: f32 = patches.iter().map(|patch| moments(patch, 0.05).1).sum();
        // One half of each ball is visible.
        assert_eq!(patches.len(), 3);
        assert!((area / (PI + 2.0 * PI) - 1.0).abs() < 0.01, "{area}");
    }

    #[test]
    fn patches_without_area_are_finite() {
        let point = Sphere::new(Vec3::ONE, 0.0);
        for patch in [Patch::Triangle([Vec3::ONE; 3]), Patch::Ball(point, vec![]), Patch::Mantle([point; 2], vec![])] {
            patch.sample(0.1, |at, weight| assert!(at.is_finite() && (weight == 0.0 || !weight.is_finite())));
        }
        assert!(faces([point; 3]).is_none());
    }
}
