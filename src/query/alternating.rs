//! The published scheme of medial continuous collision detection, as a baseline for comparison. The pipeline does not use it.

use glam::{DVec3, Vec3};

use super::{
    moving::{Moving, MovingConvex},
    separation::{Convex, separation},
    time_of_impact::{TimeOfImpact, TimeOfImpactStatus},
};
use crate::geometry::Sphere;

/// Time of impact by alternation (Song et al., the continuous test that the paper builds on).
///
/// The search starts at the end of the step. Each iteration finds the nearest pair of spheres at the current time, then the first contact of
/// these two moving spheres, or their time of closest approach if they never touch. It stops after 8 iterations, or when
/// the time changes by less than 1e-5. There is no contact if the last pair of spheres never touches, or if the time is 0.
///
/// The scheme misses hits, reports late hits and false positives, and ignores overlaps at the start.
pub fn alternating<const N: usize, const M: usize>(first: &Moving<N>, second: &Moving<M>) -> TimeOfImpact {
    let mut fraction = 1.0;
    let mut rounds = 0;
    loop {
        rounds += 1;
        let (shape1, shape2) = (first.at(fraction.into(), DVec3::ZERO), second.at(fraction.into(), DVec3::ZERO));
        let contact = separation(&shape1, &shape2, 0);
        let (sphere1, sphere2) = shape2.feature(&shape1, contact.feature);
        let (start1, motion1) = trace(first, &shape1, &sphere1);
        let (start2, motion2) = trace(second, &shape2, &sphere2);
        let (next, touches) = approach(start2 - start1, motion2 - motion1, sphere1.radius + sphere2.radius);
        let settled = (next - fraction).abs() < 1e-5;
        fraction = next;
        if settled || rounds == 8 {
            let status =
                if touches && fraction > 0.0 { TimeOfImpactStatus::Hit } else { TimeOfImpactStatus::Separated };
            return TimeOfImpact { status, fraction, contact, rounds };
        }
    }
}

/// Start and displacement of a sphere of the primitive, given its state at some instant. Both are interpolated by its barycentric weights.
fn trace<const N: usize>(moving: &Moving<N>, now: &[Sphere; N], sphere: &Sphere) -> (Vec3, Vec3) {
    let weights = weights(now, sphere.center);
    let mix = |value: &dyn Fn(usize) -> Vec3| (0..N).map(|i| value(i) * weights[i]).sum();
    (mix(&|i| moving.start[i].center), mix(&|i| moving.motion[i]))
}

/// Barycentric weights of a point in the hull of the centres.
fn weights<const N: usize>(spheres: &[Sphere; N], point: Vec3) -> [f32; N] {
    let mut weights = [0.0; N];
    weights[0] = 1.0;
    let to_point = point - spheres[0].center;
    if N == 2 {
        let e = spheres[1].center - spheres[0].center;
        let t = if e == Vec3::ZERO { 0.0 } else { to_point.dot(e) / e.length_squared() };
        (weights[0], weights[1]) = (1.0 - t, t);
    } else if N == 3 {
        let (e2, e3) = (spheres[1].center - spheres[0].center, spheres[2].center - spheres[0].center);
        let normal = e2.cross(e3);
        let det = normal.length_squared();
        if det > 0.0 {
            weights[1] = to_point.cross(e3).dot(normal) / det;
            weights[2] = e2.cross(to_point).dot(normal) / det;
            weights[0] = 1.0 - weights[1] - weights[2];
        }
    }
    weights
}

/// First contact of two spheres during the step, or else their closest approach, and whether they touch. `offset` is their distance vector at the
/// start, `motion` its change over the step.
fn approach(offset: Vec3, motion: Vec3, radii: f32) -> (f32, bool) {
    let speed_squared = motion.length_squared();
    if speed_squared == 0.0 {
        return (0.0, offset.length_squared() <= radii * radii);
    }
    let half_slope = offset.dot(motion);
    let discriminant = half_slope * half_slope - speed_squared * (offset.length_squared() - radii * radii);
    let closest = (-half_slope / speed_squared).clamp(0.0, 1.0);
    if discriminant >= 0.0 {
        let (enter, leave) =
            ((-half_slope - discriminant.sqrt()) / speed_squared, (-half_slope + discriminant.sqrt()) / speed_squared);
        if enter <= 1.0 && leave >= 0.0 {
            return (enter.max(0.0), true);
        }
    }
    (closest, false)
}
