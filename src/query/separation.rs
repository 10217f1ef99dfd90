//! Distance of two primitives, with witness points and normal, and overlap depth.

use glam::Vec3;

use super::nearest::{between_cones, cone_to_cuboid, on_cone, on_slab};
use crate::{constants::CONTACT_ROUNDING, geometry::Sphere};

/// A box `[-half, half]` in its own frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cuboid {
    /// Half of the size along each axis, in metres.
    pub half: Vec3,
}

/// Distance and nearest points of two primitives.
#[derive(Clone, Copy, Debug)]
pub struct Separation {
    /// Distance of the surfaces in metres. For an overlap it is negative: minus the length of a translation along `normal`
    /// that separates the shapes. This is the shortest translation, unless the *centres* of the primitives cross; then it is the shortest among those
    /// across a face or a pair of edges. Up to rounding, it never exceeds the true distance.
    pub distance: f32,
    /// Unit direction from the first to the second.
    pub normal: Vec3,
    /// Point of the first surface.
    pub point1: Vec3,
    /// Point of the second surface: `point1 + normal * distance`, up to rounding.
    pub point2: Vec3,
    /// Index of the nearest pair of features: a good hint for the next query when the pair has moved a little.
    pub feature: usize,
}

impl Separation {
    /// Error of the distance in metres, because rounding has tilted the normal.
    pub(super) fn loss(&self) -> f32 {
        (self.point2 - self.point1).dot(self.normal) - self.distance
    }
}

/// The second side of a pair: a primitive or a box.
pub trait Convex: Copy {
    /// Minimum of `n . x` over the shape.
    fn low(&self, n: Vec3) -> f32;

    /// Approximate maximum distance of the shape's points from [`origin`](Self::origin).
    fn extent(&self) -> f32;

    /// A point of the shape.
    fn origin(&self) -> Vec3;

    /// Number of feature pairs against a primitive of `N` spheres.
    fn features<const N: usize>(&self) -> usize;

    /// Nearest spheres of the `k`-th pair of features. Unless the centres cross, one pair contains the nearest spheres of the whole shapes.
    fn feature<const N: usize>(&self, first: &[Sphere; N], k: usize) -> (Sphere, Sphere);

    /// Calls `visit` with unit normals of the features themselves, which stay exact if centres meet. The best one
    /// gives the depth of a deep overlap. `apart` is an approximate direction from the first to the second.
    fn normals<const N: usize>(&self, first: &[Sphere; N], apart: Vec3, visit: &mut impl FnMut(Vec3));
}

/// Distance, normal and witness points of a primitive and another convex shape, both in one frame.
///
/// `hint` is the [`Separation::feature`] of an earlier call on nearly the same pair, otherwise 0.
#[inline]
pub fn separation<const N: usize, B: Convex>(first: &[Sphere; N], second: &B, hint: usize) -> Separation {
    let rounding = CONTACT_ROUNDING * (first.extent() + second.extent());
    let mut best = Best {
        upper: f32::INFINITY,
        lower: f32::NEG_INFINITY,
        normal: Vec3::Y,
        feature: 0,
        spheres: (first[0], first[0]),
    };
    let count = second.features::<N>();
    for turn in 0..count {
        // The hinted feature first, then the others in order.
        let k = if turn == 0 {
            hint
        } else if turn <= hint {
            turn - 1
        } else {
            turn
        };
        let (sphere1, sphere2) = second.feature(first, k);
        let apart = sphere2.center - sphere1.center;
        let length = apart.length();
        let upper = length - sphere1.radius - sphere2.radius;
        if upper < best.upper {
            best.upper = upper;
            best.feature = k;
            best.spheres = (sphere1, sphere2);
            if length > 0.0 {
                // Gaps of a distant pair have this rounding error. A gap along an earlier normal may be larger by rounding alone, so it is dropped.
                let far = 2.0 * f32::EPSILON * length;
                if far > rounding {
                    best.lower = f32::NEG_INFINITY;
                }
                best.look_along(apart / length, first, second);
                if best.lower >= upper - rounding.max(far) {
                    return best.witness();
                }
            }
        }
    }
    let apart = best.spheres.1.center - best.spheres.0.center;
    let apart = if apart == Vec3::ZERO { second.origin() - first.origin() } else { apart };
    let mut look = |normal| best.look_along(normal, first, second);
    look(apart.try_normalize().unwrap_or(Vec3::Y));
    second.normals(first, apart, &mut look);
    // Centres of separated shapes do not cross. Far from the origin, coarse coordinates may suggest that they do.
    if best.lower > 0.0 || best.lower >= best.upper - 2.0 * rounding { best.witness() } else { best.crossing() }
}

/// Improves a separation by the features' own normals, which rounding does not tilt.
pub(super) fn refined<const N: usize, B: Convex>(first: &[Sphere; N], second: &B, found: Separation) -> Separation {
    let mut best = found;
    second.normals(first, found.normal, &mut |normal| {
        let distance = second.low(normal) - high(first, normal);
        if distance > best.distance {
            best = Separation { distance, normal, ..best };
        }
    });
    best
}

/// State of the search: `lower <= distance <= upper`.
struct Best {
    upper: f32,
    lower: f32,
    normal: Vec3,
    feature: usize,
    spheres: (Sphere, Sphere),
}

impl Best {
    #[inline]
    fn look_along<const N: usize, B: Convex>(&mut self, normal: Vec3, first: &[Sphere; N], second: &B) {
        let lower = second.low(normal) - high(first, normal);
        if lower > self.lower {
            self.lower = lower;
            self.normal = normal;
        }
    }

    fn witness(&self) -> Separation {
        let (sphere1, sphere2) = self.spheres;
        Separation {
            distance: self.lower,
            normal: self.normal,
            point1: sphere1.center + self.normal * sphere1.radius,
            point2: sphere2.center - self.normal * sphere2.radius,
            feature: self.feature,
        }
    }

    /// The result for crossing centres: the points lie on both sides of the crossing.
    fn crossing(&self) -> Separation {
        let middle = (self.spheres.0.center + self.spheres.1.center) * 0.5;
        let half = self.normal * (0.5 * self.lower);
        Separation {
            distance: self.lower,
            normal: self.normal,
            point1: middle - half,
            point2: middle + half,
            feature: self.feature,
        }
    }
}

/// Maximum of `n . x` over the primitive.
#[inline]
fn high<const N: usize>(spheres: &[Sphere; N], n: Vec3) -> f32 {
    spheres.iter().map(|s| s.center.dot(n) + s.radius).fold(f32::NEG_INFINITY, f32::max)
}

/// The sphere of a primitive that is nearest to a point.
#[inline]
fn nearest<const N: usize>(point: Vec3, spheres: &[Sphere; N]) -> Sphere {
    match N {
        1 => spheres[0],
        2 => on_cone(point, [spheres[0], spheres[1]]),
        _ => on_slab(point, [spheres[0], spheres[1], spheres[2]]),
    }
}

/// Number of edges of a primitive.
pub(super) const fn edges(n: usize) -> usize {
    match n {
        1 => 0,
        2 => 1,
        _ => 3,
    }
}

/// The `k`-th edge of a primitive.
#[inline]
fn edge<const N: usize>(spheres: &[Sphere; N], k: usize) -> [Sphere; 2] {
    [spheres[k], spheres[(k + 1) % N]]
}

/// Unit outward directions in which all spheres of the primitive extend equally far: the normals of a slab's two
/// faces, or the normals of a cone's mantle nearest to `towards` and to the opposite direction. `None` for a sphere.
fn face_normals<const N: usize>(spheres: &[Sphere; N], towards: Vec3) -> Option<[Vec3; 2]> {
    if N == 1 {
        return None;
    }
    let u = spheres[1].center - spheres[0].center;
    let growth = spheres[1].radius - spheres[0].radius;
    let (across, part) = if N == 2 {
        let mut across = towards.reject_from(u);
        if across.length_squared() < 1e-2 * towards.length_squared() {
            // `towards` is nearly parallel to the axis, so the first rejection is mostly rounding error. The second one removes it.
            across = across.reject_from(u);
        }
        let across =
            if across.length_squared() > 1e-12 * towards.length_squared() { across } else { u.any_orthogonal_vector() };
        (across, u * (growth / u.length_squared()))
    } else {
        let v = spheres[2].center - spheres[0].center;
        let growth3 = spheres[2].radius - spheres[0].radius;
        let normal = u.cross(v);
        (normal, (v.cross(normal) * growth + normal.cross(u) * growth3) / normal.length_squared())
    };
    // A slope of 1 or more: one sphere extends farther than the others in every direction, and the root is NaN.
    let height = (1.0 - part.length_squared()).sqrt();
    let across = across * (height / across.length());
    if !across.is_finite() {
        return None;
    }
    // Outward: n . u = -growth, so all spheres extend equally far along n.
    Some([across - part, -across - part])
}

impl<const M: usize> Convex for [Sphere; M] {
    #[inline]
    fn low(&self, n: Vec3) -> f32 {
        self.iter().map(|s| s.center.dot(n) - s.radius).fold(f32::INFINITY, f32::min)
    }

    #[inline]
    fn extent(&self) -> f32 {
        let first = self[0].center;
        let spread = self.iter().map(|s| s.center.distance_squared(first)).fold(0.0, f32::max).sqrt();
        spread + self.iter().map(|s| s.radius).fold(0.0, f32::max)
    }

    #[inline]
    fn origin(&self) -> Vec3 {
        self.iter().map(|s| s.center).sum::<Vec3>() / M as f32
    }

    #[inline]
    fn features<const N: usize>(&self) -> usize {
        let (vertices1, vertices2) = vertex_features(N, M);
        vertices1 + vertices2 + edges(N) * edges(M)
    }

    #[inline]
    fn feature<const N: usize>(&self, first: &[Sphere; N], k: usize) -> (Sphere, Sphere) {
        let (vertices1, vertices2) = vertex_features(N, M);
        if k < vertices1 {
            (first[k], nearest(first[k].center, self))
        } else if k < vertices1 + vertices2 {
            let sphere2 = self[k - vertices1];
            (nearest(sphere2.center, first), sphere2)
        } else {
            let k = k - vertices1 - vertices2;
            between_cones(edge(first, k / edges(M)), edge(self, k % edges(M)))
        }
    }

    fn normals<const N: usize>(&self, first: &[Sphere; N], apart: Vec3, visit: &mut impl FnMut(Vec3)) {
        edge_directions(first, apart, visit);
        edge_directions(self, apart, &mut |normal: Vec3| visit(-normal));
        for i in 0..edges(N) {
            let [a0, a1] = edge(first, i);
            for j in 0..edges(M) {
                let [b0, b1] = edge(self, j);
                edge_normals(
                    (a1.center - a0.center, a1.radius - a0.radius),
                    (b1.center - b0.center, b1.radius - b0.radius),
                    visit,
                );
            }
        }
    }
}

/// Calls `visit` with the normals of a primitive's faces, and of its edges' mantles towards `apart` and the opposite direction.
pub(super) fn edge_directions<const N: usize>(first: &[Sphere; N], apart: Vec3, visit: &mut impl FnMut(Vec3)) {
    face_normals(first, apart).into_iter().flatten().for_each(&mut *visit);
    if N == 3 {
        for i in 0..edges(N) {
            face_normals(&edge(first, i), apart).into_iter().flatten().for_each(&mut *visit);
        }
    }
}

/// Number of spheres of each side that have to be tested against the whole other side. The ends of an edge are covered by its cones.
const fn vertex_features(n: usize, m: usize) -> (usize, usize) {
    if n == 1 { (1, 0) } else { (if m == 3 { n } else { 0 }, if m == 1 || n == 3 { m } else { 0 }) }
}

/// The two unit directions, from first to second, that are normals of both cones' mantles: `n . u = -alpha`, `n . v = beta`.
fn edge_normals((u, alpha): (Vec3, f32), (v, beta): (Vec3, f32), visit: &mut impl FnMut(Vec3)) {
    let normal = u.cross(v);
    let det = normal.length_squared();
    let part = (v.cross(normal) * -alpha + normal.cross(u) * beta) / det;
    let across = normal * ((1.0 - part.length_squared()) / det).sqrt();
    if across.is_finite() {
        visit(part + across);
        visit(part - across);
    }
}

impl Convex for Cuboid {
    #[inline]
    fn low(&self, n: Vec3) -> f32 {
        -self.half.dot(n.abs())
    }

    #[inline]
    fn extent(&self) -> f32 {
        self.half.max_element()
    }

    fn origin(&self) -> Vec3 {
        Vec3::ZERO
    }

    #[inline]
    fn features<const N: usize>(&self) -> usize {
        match N {
            1 | 2 => 1,
            _ => 5,
        }
    }

    #[inline]
    fn feature<const N: usize>(&self, first: &[Sphere; N], k: usize) -> (Sphere, Sphere) {
        let (sphere1, point) = match N {
            1 => (first[0], first[0].center.clamp(-self.half, self.half)),
            2 => cone_to_cuboid([first[0], first[1]], self.half),
            _ if k < 3 => cone_to_cuboid(edge(first, k), self.half),
            _ => {
                // A face of the slab against a corner of the box.
                let corner =
                    face_normals(first, Vec3::Y).map_or(Vec3::ZERO, |normals| -self.half * normals[k - 3].signum());
                (nearest(corner, first), corner)
            }
        };
        (sphere1, Sphere::new(point, 0.0))
    }

    fn normals<const N: usize>(&self, first: &[Sphere; N], apart: Vec3, visit: &mut impl FnMut(Vec3)) {
        for axis in Vec3::AXES {
            visit(axis);
            visit(-axis);
        }
        edge_directions(first, apart, visit);
        for i in 0..edges(N) {
            let [a0, a1] = edge(first, i);
            for axis in Vec3::AXES {
                edge_normals((a1.center - a0.center, a1.radius - a0.radius), (axis, 0.0), visit);
            }
        }
    }
}

#[cfg(test)]
mod tests;
