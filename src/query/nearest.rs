//! Closed forms for the sphere of a primitive that is nearest to a point, or to a sphere of another primitive.
//!
//! "Nearest" refers to the distance to the sphere's surface. Every function returns a sphere of the primitive, so its distance is an
//! upper bound of the true distance however badly conditioned the input is.

use glam::Vec3;

use super::number::{Ball, Number, Vector};
use crate::{constants::ILL_CONDITIONED, geometry::Sphere};

/// Squared sine of the angle between two edges, below which they count as parallel and have no crossing.
const PARALLEL: f32 = 1.0e-12;

/// Distance of a point to a sphere's surface.
fn gap(point: Vec3, sphere: &Sphere) -> f32 {
    sphere.center.distance(point) - sphere.radius
}

/// The one of two spheres that is nearer to `point`.
fn nearer(point: Vec3, a: Sphere, b: Sphere) -> Sphere {
    if gap(point, &b) < gap(point, &a) { b } else { a }
}

/// A medial cone or an edge of a slab, with precomputed values that do not depend on the other side.
#[derive(Clone, Copy)]
pub(super) struct Edge<R: Number> {
    start: Ball<R>,
    axis: Vector<R>,
    growth: R,
    length_squared: R,
    inverse: R,
    /// Shift of the nearest sphere along the axis, in axis lengths, per metre of the point's height above the axis.
    slope: R,
    /// False if one of the spheres contains the other.
    proper: R::Mask,
}

impl<R: Number> Edge<R> {
    #[inline(always)]
    pub fn new(start: Ball<R>, end: Ball<R>) -> Self {
        let axis = end.center - start.center;
        let growth = end.radius - start.radius;
        let length_squared = axis.length_squared();
        let mantle_squared = length_squared - growth * growth;
        Self {
            start,
            axis,
            growth,
            length_squared,
            inverse: growth.like(1.0) / length_squared,
            slope: growth / (length_squared * mantle_squared).sqrt(),
            proper: growth.like(0.0).less(mantle_squared),
        }
    }

    #[inline(always)]
    pub fn at(&self, t: R) -> Ball<R> {
        Ball { center: self.start.center + self.axis * t, radius: self.start.radius + self.growth * t }
    }

    /// Parameter along the cone, from 0 to 1, of the sphere that is nearest to `point`, and whether it lies between the end spheres.
    ///
    /// It is the foot of the perpendicular on the axis, shifted towards the larger end by the slope of the mantle:
    /// by `h tan(a)`, where `h` is the distance to the axis and `sin(a) = (r_b - r_a) / length`.
    #[inline(always)]
    pub fn nearest(&self, point: Vector<R>) -> (R, R::Mask) {
        let to_point = point - self.start.center;
        let foot = to_point.dot(self.axis) * self.inverse;
        let height = (to_point - self.axis * foot).length();
        let (zero, one) = (foot.like(0.0), foot.like(1.0));
        let larger = R::select(zero.less(self.growth), one, zero);
        let t = foot + height * self.slope;
        (R::select(self.proper, t.saturate(), larger), self.proper & zero.at_most(t) & t.at_most(one))
    }

    /// Returns the gap between a point and the nearest sphere, a vector along the normal towards the point, and the sphere's parameter along the cone.
    #[inline(always)]
    pub fn gap(&self, point: Vector<R>) -> (R, Vector<R>, R) {
        let (t, inside) = self.nearest(point);
        let ball = self.at(t);
        let apart = point - ball.center;
        let length = apart.length();
        // The axial part of the normal follows from the slope of the mantle: `apart` is inaccurate for points near the axis.
        let lean = (apart.dot(self.axis) + self.growth * length) * self.inverse;
        let lean = R::select(inside, lean, lean.like(0.0));
        (length - ball.radius, apart - self.axis * lean, t)
    }

    /// The nearest spheres of two edges, if they lie inside both edges.
    ///
    /// With `u`, `v` the axes and `alpha`, `beta` the growth of the radii along them, the unit direction `n` from the second
    /// to the first satisfies `n . u = alpha`, `n . v = -beta` at an optimum inside both. Its part in the plane of `u`
    /// and `v` follows, and the distance between the axes' lines gives the rest.
    #[inline(always)]
    pub fn crossing(&self, other: &Self) -> Crossing<R> {
        let (u, v) = (self.axis, other.axis);
        let (alpha, beta) = (self.growth, other.growth);
        let (uu, uv, vv) = (self.length_squared, u.dot(v), other.length_squared);
        let offset = self.start.center - other.start.center;
        let across = u.cross(v);
        let det = across.length_squared();
        let inverse = det.like(1.0) / det;
        let x = (alpha * vv + beta * uv) * inverse;
        let y = -(beta * uu + alpha * uv) * inverse;
        let flat = det.like(1.0) - (x * alpha - y * beta);
        let height = offset.dot(across);
        let steep = det.like(1.0) / (det * flat).sqrt();
        let distance = height.abs() * steep;
        let p = distance * alpha - offset.dot(u);
        let q = -(distance * beta) - offset.dot(v);
        let s = (p * vv - q * uv) * inverse;
        let t = (p * uv - q * uu) * inverse;
        let rise = flat * steep;
        let rise = R::select(height.less(height.like(0.0)), -rise, rise);
        Crossing { s, t, normal: u * x + v * y + across * rise, det, proper: flat.like(0.0).less(flat) }
    }
}

/// See [`Edge::crossing`].
pub(super) struct Crossing<R: Number> {
    /// Parameters along the two edges, from 0 to 1 if inside.
    pub s: R,
    pub t: R,
    /// Unit direction from the second to the first.
    normal: Vector<R>,
    /// Product of both squared lengths and the squared sine of the angle between the edges.
    det: R,
    /// False if there is no such optimum, because one sphere extends farther than the others in every direction.
    proper: R::Mask,
}

impl<R: Number> Crossing<R> {
    /// Returns the gap, the normal, and whether the spheres lie inside both edges.
    #[inline(always)]
    pub fn gap(&self, edge1: &Edge<R>, edge2: &Edge<R>) -> (R, Vector<R>, R::Mask) {
        let (ball1, ball2) = (edge1.at(self.s), edge2.at(self.t));
        let (zero, one) = (self.s.like(0.0), self.s.like(1.0));
        let inside = zero.at_most(self.s) & self.s.at_most(one) & zero.at_most(self.t) & self.t.at_most(one);
        ((ball2.center - ball1.center).length() - ball1.radius - ball2.radius, self.normal, inside & self.proper)
    }

    /// For each edge, true if its second end faces the other edge. The gap is convex: unless the nearest spheres lie inside both edges, one of them is
    /// a facing end and the other is the sphere nearest to it. For nearly parallel edges, the facing end is the one towards which the gap decreases from the
    /// middles of the edges.
    #[inline(always)]
    pub fn facing(&self, edge1: &Edge<R>, edge2: &Edge<R>) -> [R::Mask; 2] {
        let (zero, half) = (self.s.like(0.0), self.s.like(0.5));
        let parallel = edge1.length_squared * edge2.length_squared * zero.like(ILL_CONDITIONED);
        let trusted = self.proper & parallel.less(self.det);
        let apart = edge2.at(half).center - edge1.at(half).center;
        let length = apart.length();
        let s = R::select(trusted, self.s - half, apart.dot(edge1.axis) + edge1.growth * length);
        let t = R::select(trusted, self.t - half, edge2.growth * length - apart.dot(edge2.axis));
        [zero.less(s), zero.less(t)]
    }
}

/// The face of a medial slab, with precomputed values that do not depend on the other side.
#[derive(Clone, Copy)]
pub(super) struct Face<R: Number> {
    start: Ball<R>,
    sides: [Vector<R>; 2],
    growth: [R; 2],
    /// Dot products of the two sides: the first squared, first times second, the second squared.
    products: [R; 3],
    across: Vector<R>,
    det: R,
    inverse: R,
    /// In-plane gradient of the radius, in coordinates along the sides.
    gradient: [R; 2],
    /// Shift of the nearest sphere, in gradients, per unit of the dot product of `across` and the point's offset from `start`.
    steep: R,
    /// False if there is no face, because one sphere extends farther than the others in every direction.
    proper: R::Mask,
    flat: R,
}

impl<R: Number> Face<R> {
    #[inline(always)]
    pub fn new(a: Ball<R>, b: Ball<R>, c: Ball<R>) -> Self {
        let sides = [b.center - a.center, c.center - a.center];
        let growth = [b.radius - a.radius, c.radius - a.radius];
        let across = sides[0].cross(sides[1]);
        let products = [sides[0].length_squared(), sides[0].dot(sides[1]), sides[1].length_squared()];
        let det = across.length_squared();
        let inverse = det.like(1.0) / det;
        let gradient = [
            (growth[0] * products[2] - growth[1] * products[1]) * inverse,
            (growth[1] * products[0] - growth[0] * products[1]) * inverse,
        ];
        let flat = det.like(1.0) - (growth[0] * gradient[0] + growth[1] * gradient[1]);
        let steep = det.like(1.0) / (det * flat).sqrt();
        let proper = det.like(0.0).less(det) & det.like(0.0).less(flat);
        Self { start: a, sides, growth, products, across, det, inverse, gradient, steep, proper, flat }
    }

    /// Barycentric weights of the sphere in the face's plane that is nearest to `point`.
    ///
    /// With `g` the in-plane gradient of the radius and `h` the height above the plane, the sphere's centre is the foot of the
    /// perpendicular on the centres' plane, shifted by `h g / sqrt(1 - |g|^2)`.
    #[inline(always)]
    pub fn nearest(&self, point: Vector<R>) -> [R; 3] {
        let to_point = point - self.start.center;
        let [d22, d23, d33] = self.products;
        let (p2, p3) = (to_point.dot(self.sides[0]), to_point.dot(self.sides[1]));
        let shift = to_point.dot(self.across).abs() * self.steep;
        let w2 = (p2 * d33 - p3 * d23) * self.inverse + shift * self.gradient[0];
        let w3 = (p3 * d22 - p2 * d23) * self.inverse + shift * self.gradient[1];
        [w2.like(1.0) - w2 - w3, w2, w3]
    }

    #[inline(always)]
    pub fn at(&self, [_, w2, w3]: [R; 3]) -> Ball<R> {
        Ball {
            center: self.start.center + self.sides[0] * w2 + self.sides[1] * w3,
            radius: self.start.radius + self.growth[0] * w2 + self.growth[1] * w3,
        }
    }

    /// Returns the gap between a point and the nearest sphere, the unit normal towards the point, whether this sphere lies inside the face, and its
    /// barycentric weights.
    #[inline(always)]
    pub fn gap(&self, point: Vector<R>) -> (R, Vector<R>, R::Mask, [R; 3]) {
        let weights = self.nearest(point);
        let ball = self.at(weights);
        let apart = point - ball.center;
        let rise = self.flat * self.steep;
        let rise = R::select(apart.dot(self.across).less(rise.like(0.0)), -rise, rise);
        let normal = self.across * rise - (self.sides[0] * self.gradient[0] + self.sides[1] * self.gradient[1]);
        let zero = rise.like(0.0);
        let [w1, w2, w3] = weights.map(|w| zero.at_most(w));
        (apart.length() - ball.radius, normal, self.proper & w1 & w2 & w3, weights)
    }
}

/// The sphere of the medial cone that is nearest to `point`.
#[inline(always)]
pub(super) fn on_cone(point: Vec3, [a, b]: [Sphere; 2]) -> Sphere {
    let edge = Edge::new(a.into(), b.into());
    let (t, _) = edge.nearest(point.into());
    edge.at(t).into()
}

/// The sphere of the medial slab that is nearest to `point`: inside the face, or otherwise on the nearest of the
/// cones that face the point.
#[inline]
pub(super) fn on_slab(point: Vec3, slab: [Sphere; 3]) -> Sphere {
    let [a, b, c] = slab.map(Ball::from);
    let face = Face::new(a, b, c);
    if !face.proper {
        return nearest_edge(point, &slab, [true; 3]);
    }
    let weights = face.nearest(point.into());
    let outside = weights.map(|w| w < 0.0);
    let [d22, _, d33] = face.products;
    if face.det < ILL_CONDITIONED * d22 * d33 {
        let edge = nearest_edge(point, &slab, [true; 3]);
        return if outside == [false; 3] { nearer(point, face.at(weights).into(), edge) } else { edge };
    }
    if outside == [false; 3] { face.at(weights).into() } else { nearest_edge(point, &slab, outside) }
}

/// Nearest sphere on the slab's edges opposite to the marked vertices.
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

/// The nearest spheres of two medial cones, one of each.
///
/// If the edges' [`Crossing`] lies outside the unit square, the optimum lies on an edge of the square that faces the unconstrained optimum, because
/// the gap is convex. Such an optimum is an end sphere against a cone.
#[inline]
pub(super) fn between_cones(cone1: [Sphere; 2], cone2: [Sphere; 2]) -> (Sphere, Sphere) {
    let [a0, a1] = cone1;
    let [b0, b1] = cone2;
    let edges = [Edge::new(a0.into(), a1.into()), Edge::new(b0.into(), b1.into())];
    let lengths_squared = edges[0].length_squared * edges[1].length_squared;
    let crossing = edges[0].crossing(&edges[1]);
    let mut facing = [true; 4];
    let mut best = None;
    if crossing.det > PARALLEL * lengths_squared && crossing.proper {
        let Crossing { s, t, .. } = crossing;
        let outside = [s < 0.0, s > 1.0, t < 0.0, t > 1.0];
        if outside == [false; 4] {
            best = Some((edges[0].at(s).into(), edges[1].at(t).into()));
        }
        if crossing.det > ILL_CONDITIONED * lengths_squared {
            if let Some(pair) = best {
                return pair;
            }
            facing = outside;
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
/// Along the axis the distance to the box is convex and consists of up to seven pieces. They are bounded by the points where a coordinate
/// enters or leaves the box's range. Each piece is the distance to a point, a line or a plane, with a closed form.
#[inline]
pub(super) fn cone_to_cuboid([a, b]: [Sphere; 2], half: Vec3) -> (Sphere, Vec3) {
    let axis = b.center - a.center;
    let growth = b.radius - a.radius;
    // The derivative of `distance(t) - radius(t)`, which increases with t.
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
    // On [low, high] the same coordinates lie outside the box: the distance is that to a point in the subspace of these coordinates.
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
