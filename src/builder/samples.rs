//! Points spread evenly over the surfaces of triangles, spheres and medial cones.

use std::collections::BTreeSet;
use std::f32::consts::{PI, TAU};

use glam::Vec3;

use crate::geometry::{Primitive, Sphere};

/// Least number of points on a patch with curvature, so that small ones are seen from all sides.
const LEAST: f32 = 32.0;

/// Steps of the sequence that fills a square evenly however long it gets (Roberts 2018): powers of the plastic number.
const STEPS: [f64; 2] = [0.754_877_666_246_692_8, 0.569_840_290_998_053_3];

/// Turn from one point of a spiral over a sphere to the next.
const GOLDEN_TURN: f64 = 0.381_966_011_250_105_1;

/// A simple piece of surface.
#[derive(Clone, Copy, Debug)]
pub(super) enum Patch {
    /// A triangle.
    Triangle([Vec3; 3]),
    /// A sphere.
    Ball(Sphere),
    /// The conical part of a medial cone.
    Mantle([Sphere; 2]),
}

impl Patch {
    /// The patches of which the envelope of clean primitives is made, together with what is hidden inside.
    pub fn of(spheres: &[Sphere], primitives: &[Primitive]) -> Vec<Self> {
        let (mut balls, mut mantles) = (BTreeSet::new(), BTreeSet::new());
        let mut patches = Vec::new();
        for primitive in primitives {
            let corners = primitive.indices();
            balls.extend(corners.iter().copied());
            for (at, &i) in corners.iter().enumerate() {
                mantles.extend(corners[at + 1..].iter().map(|&j| [i.min(j), i.max(j)]));
            }
            if let Primitive::Slab(slab) = primitive {
                patches.extend(faces(slab.map(|i| spheres[i as usize])).into_iter().flatten());
            }
        }
        patches.extend(balls.into_iter().map(|i| Self::Ball(spheres[i as usize])));
        patches.extend(mantles.into_iter().map(|cone| Self::Mantle(cone.map(|i| spheres[i as usize]))));
        patches
    }

    /// Area.
    pub fn area(&self) -> f32 {
        match *self {
            Self::Triangle([a, b, c]) => (b - a).cross(c - a).length() * 0.5,
            Self::Ball(sphere) => 4.0 * PI * sphere.radius * sphere.radius,
            Self::Mantle([a, b]) => {
                let growth = b.radius - a.radius;
                let length_squared = a.center.distance_squared(b.center);
                let sin_squared = (1.0 - growth * growth / length_squared).max(0.0);
                PI * (a.radius + b.radius) * sin_squared * length_squared.sqrt()
            }
        }
    }

    /// Calls `visit` with points about `spacing` apart, each with the area it stands for.
    pub fn sample(&self, spacing: f32, mut visit: impl FnMut(Vec3, f32)) {
        let area = self.area();
        let wanted = (area / (spacing * spacing)).round();
        match *self {
            // A triangle without area, or an area that is no number, is one point.
            Self::Triangle([a, b, c]) => {
                let count = wanted.max(1.0);
                for [u, v] in square(count as u32, 1.0 / 3.0) {
                    let [u, v] = if u + v > 1.0 { [1.0 - u, 1.0 - v] } else { [u, v] };
                    visit(a + (b - a) * u + (c - a) * v, area / count);
                }
            }
            Self::Ball(sphere) => {
                let count = wanted.max(LEAST);
                for i in 0..count as u32 {
                    let height = 1.0 - (2.0 * i as f32 + 1.0) / count;
                    let turn = (f64::from(i) * GOLDEN_TURN).fract() as f32;
                    let (sin, cos) = (TAU * turn).sin_cos();
                    let direction = Vec3::new(cos, sin, 0.0) * (1.0 - height * height).sqrt() + Vec3::Z * height;
                    visit(sphere.center + direction * sphere.radius, area / count);
                }
            }
            Self::Mantle([a, b]) => {
                let Some(axis) = (b.center - a.center).try_normalize() else { return };
                let cos = (a.radius - b.radius) / a.center.distance(b.center);
                let sin = (1.0 - cos * cos).max(0.0).sqrt();
                let (side, up) = axis.any_orthonormal_pair();
                let count = wanted.max(LEAST);
                for [u, v] in square(count as u32, 0.5) {
                    // Where the part `u` of the area lies before.
                    let radius = (a.radius * a.radius * (1.0 - u) + b.radius * b.radius * u).sqrt();
                    let sum = a.radius + radius;
                    let t = if sum > 0.0 { u * (a.radius + b.radius) / sum } else { u };
                    let (y, x) = (TAU * v).sin_cos();
                    let sphere = a.lerp(&b, t);
                    let direction = axis * cos + (side * x + up * y) * sin;
                    visit(sphere.center + direction * sphere.radius, area / count);
                }
            }
        }
    }
}

/// Points that fill the unit square evenly, the first at `start` along both sides.
fn square(count: u32, start: f64) -> impl Iterator<Item = [f32; 2]> {
    (0..count).map(move |i| STEPS.map(|step| (start + f64::from(i) * step).fract() as f32))
}

/// The two flat faces of a slab.
fn faces([a, b, c]: [Sphere; 3]) -> Option<[Patch; 2]> {
    let (e2, e3) = (b.center - a.center, c.center - a.center);
    let area = e2.cross(e3);
    let normal = area.try_normalize()?;
    // In-plane gradient of the radius.
    let g = (e3.cross(area) * (b.radius - a.radius) - e2.cross(area) * (c.radius - a.radius)) / area.length_squared();
    let out = normal * (1.0 - g.length_squared()).max(0.0).sqrt();
    let face = |n: Vec3| Patch::Triangle([a, b, c].map(|s| s.center + n * s.radius));
    g.is_finite().then(|| [face(out - g), face(-out - g)])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Number of points, sum of their weights, and their weighted middle.
    fn moments(patch: Patch, spacing: f32) -> (u32, f32, Vec3) {
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
        // Slope: sin of the mantle's angle to the axis is a quarter.
        let sin_squared = 1.0 - 1.0 / 16.0f32;
        let mantle = PI * 1.5 * 2.0 * sin_squared;
        // Ends along the axis at -r cos, and the middle of area between them.
        let [from, to] = [-0.125, 2.0 - 0.25];
        let middle = from + (to - from) * (0.5 + 2.0 * 1.0) / (3.0 * 1.5);
        let triangle = [Vec3::ZERO, Vec3::X * 3.0, Vec3::Y * 3.0];
        let cases = [
            (Patch::Triangle(triangle), 4.5, Vec3::new(1.0, 1.0, 0.0)),
            (Patch::Ball(b), 4.0 * PI, b.center),
            (Patch::Mantle([a, b]), mantle, Vec3::X * middle),
        ];
        for (patch, area, center) in cases {
            let (count, sum, found) = moments(patch, 0.05);
            assert!((sum / area - 1.0).abs() < 1e-4, "{patch:?}: area {sum} instead of {area}");
            assert!((count as f32 * 0.0025 / area - 1.0).abs() < 0.01, "{patch:?}: {count} points");
            assert!(found.distance(center) < 0.01, "{patch:?}: {found} instead of {center}");
            let least = moments(patch, 1e3).0;
            assert_eq!(least, if matches!(patch, Patch::Triangle(_)) { 1 } else { LEAST as u32 });
        }
        assert_eq!(moments(Patch::Triangle(triangle), 1e3).2, Vec3::new(1.0, 1.0, 0.0), "one point is the middle");
    }

    #[test]
    fn patches_of_nothing_are_finite() {
        let point = Sphere::new(Vec3::ONE, 0.0);
        for patch in [Patch::Triangle([Vec3::ONE; 3]), Patch::Ball(point), Patch::Mantle([point; 2])] {
            patch.sample(0.1, |at, weight| assert!(at.is_finite() && (weight == 0.0 || !weight.is_finite())));
        }
        assert!(faces([point; 3]).is_none());
    }
}
