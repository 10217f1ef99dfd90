//! Limits of a shape on either side of the surface.

use glam::DVec3;

use super::{
    SideLimits,
    envelope::{Envelope, Hit},
    hull::Ball,
    parallel,
    points::Points,
    solid::Solid,
    surface_samples::Samples,
};
use crate::{
    geometry::{Primitive, Sphere},
    medial_axis::MedialAxis,
};

/// Largest number of corrections.
const ROUNDS: usize = 12;

/// Part of a limit that the corrections aim at, because the verification has other samples.
const AIM: f64 = 0.9;

/// Distance between the samples of the envelope, as a part of the diagonal: for corrections and for the verification.
const SPACING: [f64; 2] = [1.0 / 150.0, 1.0 / 400.0];

/// Number of samples of the surface, for corrections and for the verification. Vertices are added.
const SAMPLES: [usize; 2] = [30_000, 200_000];

/// Weight of a sphere in a point from which its radius is corrected.
const SHARE: f64 = 0.1;

/// A place at which a shape exceeds a limit, and by how much.
struct Excess {
    primitive: u32,
    weights: [f64; 3],
    by: f64,
}

/// Protrusions of a shape from the solid, and distances of the surface outside of the shape, beyond the limits. Limits are parts of
/// the diagonal.
fn excesses(
    solid: &Solid,
    balls: &[Ball],
    primitives: &[Primitive],
    limits: [f64; 2],
    fine: usize,
) -> [Vec<Excess>; 2] {
    let envelope = Envelope::of(balls, primitives.to_vec());
    let mut out = vec![];
    if limits[0].is_finite() {
        let points = envelope.surface(SPACING[fine]);
        let distances = parallel::map(points.len(), 64, |i| protrusion(solid, envelope.point(&points[i])));
        let places = points.iter().zip(distances).filter(|(_, by)| *by > limits[0]);
        out = places.map(|(p, by)| Excess { primitive: p.primitive, weights: p.weights, by: by - limits[0] }).collect();
    }
    let mut gaps = vec![];
    if limits[1].is_finite() {
        let samples = Samples::new(solid, SAMPLES[fine], usize::MAX, fine as u64);
        let hits = envelope.hits(&Points::new(samples.points.positions)).into_iter();
        let far = hits.filter(|hit| hit.distance > limits[1]);
        let excess = |Hit { primitive, weights, distance, .. }| Excess { primitive, weights, by: distance - limits[1] };
        gaps = far.map(excess).collect();
    }
    [out, gaps]
}

/// Distance of a point from the solid, 0 inside.
fn protrusion(solid: &Solid, point: DVec3) -> f64 {
    if solid.is_inside(point) {
        return 0.0;
    }
    solid.tree.closest(point, f64::INFINITY).map_or(f64::INFINITY, |nearest| nearest.distance(point))
}

/// Reduces radii where a shape protrudes, and increases them where the surface lies outside of it, until the limits are kept.
///
/// # Errors
/// Excesses of dense samples over the limits afterwards, in percent of the diagonal.
pub(super) fn keep(solid: &Solid, axis: &MedialAxis, limits: SideLimits) -> Result<MedialAxis, [f32; 2]> {
    let limits =
        [limits.inside, limits.enclose].map(|limit| limit.map_or(f64::INFINITY, |limit| f64::from(limit) / 100.0));
    let unit = |s: &Sphere| Ball {
        center: (s.center.as_dvec3() - solid.origin) / solid.diagonal,
        radius: f64::from(s.radius) / solid.diagonal,
    };
    let mut balls: Vec<Ball> = axis.spheres().iter().map(unit).collect();
    for _ in 0..ROUNDS {
        let [out, gaps] = excesses(solid, &balls, axis.primitives(), limits.map(|limit| AIM * limit), 0);
        if out.is_empty() && gaps.is_empty() {
            break;
        }
        for (places, sign) in [(out, -1.0), (gaps, 1.0)] {
            let mut change = vec![0f64; balls.len()];
            for Excess { primitive, weights, by } in places {
                let spheres = axis.primitives()[primitive as usize].indices().iter().zip(weights);
                spheres.filter(|(_, weight)| *weight > SHARE).for_each(|(&sphere, _)| {
                    change[sphere as usize] = change[sphere as usize].max(by);
                });
            }
            balls.iter_mut().zip(change).for_each(|(ball, by)| ball.radius = (ball.radius + sign * by).max(0.0));
        }
    }
    let world = |ball: &Ball| {
        let center = (ball.center * solid.diagonal + solid.origin).as_vec3();
        Sphere::new(center, (ball.radius * solid.diagonal) as f32)
    };
    let spheres: Vec<Sphere> = balls.iter().map(world).collect();
    let kept = MedialAxis::new(spheres, axis.primitives().to_vec()).map_err(|_| [f32::INFINITY; 2])?.0;
    let balls: Vec<Ball> = kept.spheres().iter().map(unit).collect();
    let left = excesses(solid, &balls, kept.primitives(), limits, 1);
    let worst = left.map(|places| 100.0 * places.iter().map(|place| place.by as f32).fold(0.0, f32::max));
    if worst == [0.0; 2] { Ok(kept) } else { Err(worst) }
}

#[cfg(test)]
mod tests {
    use std::ops::ControlFlow;

    use glam::Vec3;

    use super::*;
    use crate::{
        builder::{BuildError, FitOptions, TriangleMesh, fit, vertex_errors},
        random::Random,
    };

    fn torus() -> TriangleMesh {
        let (rings, sides) = (96, 48);
        let angle = |number: u32, count: u32| std::f32::consts::TAU * number as f32 / count as f32;
        let (mut positions, mut triangles) = (vec![], vec![]);
        for (i, j) in (0..rings).flat_map(|i| (0..sides).map(move |j| (i, j))) {
            let (reach, u) = (1.0 + 0.25 * angle(j, sides).cos(), angle(i, rings));
            positions.push(Vec3::new(reach * u.cos(), 0.25 * angle(j, sides).sin(), reach * u.sin()));
            let at = |i: u32, j: u32| (i % rings) * sides + j % sides;
            triangles.extend([[at(i, j), at(i + 1, j + 1), at(i + 1, j)], [at(i, j), at(i, j + 1), at(i + 1, j + 1)]]);
        }
        TriangleMesh { positions, triangles }
    }

    /// Distance of a point from the surface of a torus around the y axis; negative inside.
    fn from_torus(point: Vec3) -> f32 {
        (Vec3::new(point.x, 0.0, point.z).length() - 1.0).hypot(point.y) - 0.25
    }

    #[test]
    fn limits_hold_at_other_samples() {
        let mesh = torus();
        let percent = mesh.diagonal() / 100.0;
        // Largest protrusion of the shape, and largest distance of the surface outside of it.
        let worst = |sides: SideLimits| {
            let options = FitOptions { spheres: Some(14), sides, searches: Some(1), ..FitOptions::default() };
            let levels = fit(&mesh, &options, &|_| ControlFlow::Continue(())).unwrap();
            assert_eq!(levels.sides, sides);
            let mut random = Random(2);
            let mut out = [0f32; 2];
            for level in &levels.levels {
                for _ in 0..20_000 {
                    let hull = &level.axis.primitives()[random.below(level.axis.primitives().len())];
                    let weights = [(); 3].map(|()| random.unit() + 1e-6);
                    let sum: f32 = hull.indices().iter().zip(weights).map(|(_, weight)| weight).sum();
                    let spheres = hull
                        .indices()
                        .iter()
                        .zip(weights)
                        .map(|(&i, weight)| (level.axis.spheres()[i as usize], weight / sum));
                    let (center, radius) = spheres.fold((Vec3::ZERO, 0.0), |(center, radius), (s, w)| {
                        (center + w * s.center, radius + w * s.radius)
                    });
                    out[0] = out[0].max((from_torus(center + radius * random.in_cube().normalize())) / percent);
                }
                out[1] = vertex_errors(&mesh, &level.axis).into_iter().fold(out[1], f32::max);
            }
            out
        };
        let free = worst(SideLimits::default());
        assert!(free[0] > 0.3 && free[1] > 0.3, "{free:?}");
        let inside = worst(SideLimits { inside: Some(0.2), enclose: None });
        assert!(inside[0] < 0.25 && inside[1] > 0.3, "{inside:?}");
        let enclosing = worst(SideLimits { inside: None, enclose: Some(0.2) });
        assert!(enclosing[1] <= 0.201 && enclosing[0] > 0.3, "{enclosing:?}");
    }

    #[test]
    fn limits_out_of_reach_are_an_error() {
        let mesh = torus();
        let sides = SideLimits { inside: Some(0.01), enclose: Some(0.01) };
        let options = FitOptions { spheres: Some(10), sides, searches: Some(1), ..FitOptions::default() };
        let error = fit(&mesh, &options, &|_| ControlFlow::Continue(())).unwrap_err();
        assert!(matches!(error, BuildError::Sides { spheres: ..=10, .. }), "{error}");
    }
}
