//! Closed forms: which sphere of a primitive is nearest to a point, or to a sphere of another primitive.
//!
//! "Nearest" is by the distance to the sphere's surface. Every function returns a sphere of the primitive, so that its distance is an
//! upper bound of the true one however badly conditioned the input is.

use glam::Vec3;

use crate::{constants::ILL_CONDITIONED, geometry::Sphere};

/// Distance of a point to a sphere's surface.
fn gap(point: Vec3, sphere: &Sphere) -> f32 {
    sphere.center.distance(point) - sphere.radius
}

/// Of two spheres the one nearer to `point`.
fn nearer(point: Vec3, a: Sphere, b: Sphere) -> Sphere {
    if gap(point, &b) < gap(point, &a) { b } else { a }
}

/// The sphere of the medial cone `a`-`b` that is nearest to `point`.
///
/// The foot of the perpendicular on the axis, shifted towards the larger end by the slope of the mantle:
/// with `h` the distance to the axis, by `h tan`, where `sin = (r_b - r_a) / length`.
#[inline]
pub(super) fn on_cone(point: Vec3, [a, b]: [Sphere; 2]) -> Sphere {
    let axis = b.center - a.center;
    let growth = b.radius - a.radius;
    let length_squared = axis.length_squared();
    let mantle_squared = length_squared - growth * growth;
    if mantle_squared <= 0.0 {
        return if growth > 0.0 { b } else { a };
    }
    let to_point = point - a.center;
    let foot = to_point.dot(axis) / length_squared;
    let height = (to_point - axis * foot).length();
    let t = foot + height * growth / (length_squared * mantle_squared).sqrt();
    a.lerp(&b, t.clamp(0.0, 1.0))
}

/// The sphere of the medial slab that is nearest to `point`.
///
/// With `g` the in-plane gradient of the radius, the foot of the perpendicular on the centres' plane shifted by
/// `h g / sqrt(1 - |g|^2)`, `h` being the height above the plane; where that falls outside of the triangle, the
/// nearest of the cones that face it.
#[inline]
pub(super) fn on_slab(point: Vec3, slab: [Sphere; 3]) -> Sphere {
    let [a, b, c] = slab;
    let (e2, e3) = (b.center - a.center, c.center - a.center);
    let (growth2, growth3) = (b.radius - a.radius, c.radius - a.radius);
    let normal = e2.cross(e3);
    let (d22, d23, d33) = (e2.length_squared(), e2.dot(e3), e3.length_squared());
    let det = normal.length_squared();
    if det <= 0.0 {
        return nearest_edge(point, &slab, [true; 3]);
    }
    // g = g2 e2 + g3 e3.
    let g2 = (growth2 * d33 - growth3 * d23) / det;
    let g3 = (growth3 * d22 - growth2 * d23) / det;
    let slope_squared = growth2 * g2 + growth3 * g3;
    if slope_squared >= 1.0 {
        return nearest_edge(point, &slab, [true; 3]);
    }
    let to_point = point - a.center;
    let (p2, p3) = (to_point.dot(e2), to_point.dot(e3));
    let shift = to_point.dot(normal).abs() / (det * (1.0 - slope_squared)).sqrt();
    let w2 = (p2 * d33 - p3 * d23) / det + shift * g2;
    let w3 = (p3 * d22 - p2 * d23) / det + shift * g3;
    let w1 = 1.0 - w2 - w3;
    let outside = [w1 < 0.0, w2 < 0.0, w3 < 0.0];
    let inside = Sphere::new(a.center + e2 * w2 + e3 * w3, a.radius + growth2 * w2 + growth3 * w3);
    if det < ILL_CONDITIONED * d22 * d33 {
        let edge = nearest_edge(point, &slab, [true; 3]);
        return if outside == [false; 3] { nearer(point, inside, edge) } else { edge };
    }
    if outside == [false; 3] { inside } else { nearest_edge(point, &slab, outside) }
}

/// Nearest sphere on those edges of the slab that lie opposite to the marked vertices.
fn nearest_edge(point: Vec3, slab: &[Sphere; 3], opposite: [bool; 3]) -> Sphere {
    let mut best: Option<Sphere> = None;
    for vertex in 0..3 {
        if opposite[vertex] {
            let candidate = on_cone(point, [slab[(vertex + 1) % 3], slab[(vertex + 2) % 3]]);
            best = Some(best.map_or(candidate, |best| nearer(point, best, candidate)));
        }
    }
    best.unwrap_or(slab[0])
}

/// The spheres of two medial cones, one of each, that are nearest to each other.
///
/// With `u`, `v` the axes and `alpha`, `beta` the growth of the radii along them, the unit direction `n` from the second
/// to the first satisfies `n . u = alpha`, `n . v = -beta` at an optimum inside both; its part in the plane of `u`
/// and `v` follows, and the distance of the axes' lines gives the rest. Outside of the unit square the function is
/// convex, so the optimum lies on an edge that faces the unconstrained one: an end sphere against a cone.
#[inline]
pub(super) fn between_cones(cone1: [Sphere; 2], cone2: [Sphere; 2]) -> (Sphere, Sphere) {
    let [a0, a1] = cone1;
    let [b0, b1] = cone2;
    let (u, v) = (a1.center - a0.center, b1.center - b0.center);
    let (alpha, beta) = (a1.radius - a0.radius, b1.radius - b0.radius);
    let offset = a0.center - b0.center;
    let normal = u.cross(v);
    let (uu, uv, vv) = (u.length_squared(), u.dot(v), v.length_squared());
    let det = normal.length_squared();
    let mut facing = [true; 4];
    let mut best = None;
    if det > 1.0e-12 * uu * vv {
        let x = (alpha * vv + beta * uv) / det;
        let y = -(beta * uu + alpha * uv) / det;
        let slope_squared = x * alpha - y * beta;
        if slope_squared < 1.0 {
            let distance = offset.dot(normal).abs() / (det * (1.0 - slope_squared)).sqrt();
            let p = distance * alpha - offset.dot(u);
            let q = -distance * beta - offset.dot(v);
            let s = (p * vv - q * uv) / det;
            let t = (p * uv - q * uu) / det;
            let outside = [s < 0.0, s > 1.0, t < 0.0, t > 1.0];
            let inside = outside == [false; 4];
            if inside {
                best = Some((a0.lerp(&a1, s), b0.lerp(&b1, t)));
            }
            if det > ILL_CONDITIONED * uu * vv {
                if let Some(pair) = best {
                    return pair;
                }
                facing = outside;
            }
        }
    }
    let mut least = best.map_or(f32::INFINITY, |(a, b)| gap(a.center, &b) - a.radius);
    let mut take = |a: Sphere, b: Sphere| {
        let distance = gap(a.center, &b) - a.radius;
        if distance < least {
            least = distance;
            best = Some((a, b));
        }
    };
    if facing[0] {
        take(a0, on_cone(a0.center, cone2));
    }
    if facing[1] {
        take(a1, on_cone(a1.center, cone2));
    }
    if facing[2] {
        take(on_cone(b0.center, cone1), b0);
    }
    if facing[3] {
        take(on_cone(b1.center, cone1), b1);
    }
    best.unwrap_or((a0, b0))
}

/// The sphere of the medial cone that is nearest to the box `[-half, half]`, and the box's point nearest to its centre.
///
/// Along the axis the distance to the box is convex and made of up to seven pieces, between the places where a coordinate
/// enters or leaves the box's range. A piece is the distance to a point, a line or a plane: a closed form.
#[inline]
pub(super) fn cone_to_cuboid([a, b]: [Sphere; 2], half: Vec3) -> (Sphere, Vec3) {
    let axis = b.center - a.center;
    let growth = b.radius - a.radius;
    // The derivative of `distance(t) - radius(t)`, increasing in t.
    let derivative = |t: f32| {
        let point = a.center + axis * t;
        let outside = point - point.clamp(-half, half);
        let length = outside.length();
        if length > 0.0 { outside.dot(axis) / length - growth } else { -growth }
    };
    let (mut low, mut high) = (0.0f32, 1.0f32);
    for k in 0..3 {
        for bound in [-half[k], half[k]] {
            let t = (bound - a.center[k]) / axis[k];
            if t > low && t < high {
                if derivative(t) < 0.0 {
                    low = t;
                } else {
                    high = t;
                }
            }
        }
    }
    // On [low, high] the same coordinates lie outside: their part of the distance is that to a point in a subspace.
    let middle = a.center + axis * ((low + high) * 0.5);
    let clamped = middle.clamp(-half, half);
    let active = (middle - clamped).map(|x| if x != 0.0 { 1.0 } else { 0.0 });
    let direction = axis * active;
    let start = (a.center - clamped) * active;
    let length_squared = direction.length_squared();
    let mantle_squared = length_squared - growth * growth;
    let t = if mantle_squared > 0.0 {
        let foot = -start.dot(direction) / length_squared;
        let height = (start + direction * foot).length();
        (foot + height * growth / (length_squared * mantle_squared).sqrt()).clamp(low, high)
    } else if growth > 0.0 {
        high
    } else {
        low
    };
    let sphere = a.lerp(&b, t);
    (sphere, sphere.center.clamp(-half, half))
}
