//! The hull of one, two or three spheres: distances from it, and points on its surface.

use std::f64::consts::{PI, TAU};

use fearless_simd::{Level, Simd, dispatch, f32x16, prelude::*, u32x16};
use glam::{DVec2, DVec3};

use super::vectors::{Vectors, splat};
use crate::{geometry::Primitive, query::number::Vector};

/// Number of points of a block.
pub(super) const BLOCK: usize = 16;

/// The points of a block.
pub(super) type Block = Vectors<BLOCK>;

/// A medial sphere in f64.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Ball {
    pub center: DVec3,
    pub radius: f64,
}

impl Ball {
    pub fn distance(&self, point: DVec3) -> f64 {
        self.center.distance(point) - self.radius
    }
}

/// A primitive with precomputed values.
pub(super) enum Hull {
    Sphere(Ball),
    Cone(Cone),
    Slab(Box<Slab>),
}

/// The hull of two spheres.
pub(super) struct Cone {
    from: Ball,
    along: DVec3,
    widening: f64,
    inverse_length_squared: f64,
    /// Shift of the nearest sphere past the foot of the perpendicular, per distance from the axis, as a fraction of the axis.
    slant: f64,
}

/// The hull of three spheres.
pub(super) struct Slab {
    from: Ball,
    u: DVec3,
    v: DVec3,
    widening: [f64; 2],
    normal: DVec3,
    /// Rows of the matrix that maps an in-plane offset to the weights of the second and third sphere.
    to_weights: [DVec3; 2],
    /// In-plane shift of the nearest sphere per distance from the plane. `None` if there is no common tangent plane.
    slant: Option<DVec3>,
    cones: [Cone; 3],
}

impl Hull {
    pub fn new(balls: &[Ball], primitive: &Primitive) -> Self {
        let ball = |i: u32| balls[i as usize];
        match *primitive {
            Primitive::Sphere([i]) => Hull::Sphere(ball(i)),
            Primitive::Cone([i, j]) => Hull::Cone(Cone::new(ball(i), ball(j))),
            Primitive::Slab([i, j, k]) => Hull::Slab(Box::new(Slab::new(ball(i), ball(j), ball(k)))),
        }
    }

    pub fn distance(&self, point: DVec3) -> f64 {
        self.closest(point).0
    }

    /// Signed distances of a block of points, up to the rounding of an f32.
    pub fn distances(&self, block: &Block) -> [f32; BLOCK] {
        let mut distances = [0.0; BLOCK];
        dispatch!(Level::new(), simd => self.distances_of(simd, block.load(simd)).store_slice(&mut distances));
        distances
    }

    #[inline(always)]
    fn distances_of<S: Simd>(&self, simd: S, points: Vector<f32x16<S>>) -> f32x16<S> {
        match self {
            Hull::Sphere(ball) => Cone::new(*ball, *ball).distances(simd, points),
            Hull::Cone(cone) => cone.distances(simd, points),
            Hull::Slab(slab) => slab.distances(simd, points),
        }
    }

    /// Signed distance, and the weights of the nearest sphere.
    pub fn closest(&self, point: DVec3) -> (f64, [f64; 3]) {
        match self {
            Hull::Sphere(ball) => (ball.distance(point), [1.0, 0.0, 0.0]),
            Hull::Cone(cone) => {
                let (distance, t) = cone.closest(point);
                (distance, [1.0 - t, t, 0.0])
            }
            Hull::Slab(slab) => slab.closest(point),
        }
    }

    /// The blend of the spheres at some weights.
    pub fn blend(&self, w: &[f64; 3]) -> Ball {
        match self {
            Hull::Sphere(ball) => *ball,
            Hull::Cone(c) => Ball { center: c.from.center + c.along * w[1], radius: c.from.radius + c.widening * w[1] },
            Hull::Slab(s) => Ball {
                center: s.from.center + s.u * w[1] + s.v * w[2],
                radius: s.from.radius + s.widening[0] * w[1] + s.widening[1] * w[2],
            },
        }
    }
}

impl Hull {
    /// The point in a direction on the sphere at some weights.
    pub fn point(&self, weights: &[f64; 3], normal: DVec3) -> DVec3 {
        let ball = self.blend(weights);
        ball.center + normal * ball.radius
    }

    /// Calls `push` with points about `spacing` apart, at least five around a cone, on the sides without the spheres. Its arguments are the weights, the
    /// outward normal and the area represented by the point.
    pub fn sample(&self, spacing: f64, mut push: impl FnMut([f64; 3], DVec3, f64)) {
        match self {
            Hull::Sphere(_) => {}
            Hull::Cone(cone) => cone.sample(spacing, |t, n, area| push([1.0 - t, t, 0.0], n, area)),
            Hull::Slab(slab) => {
                slab.sample(spacing, &mut push);
                for (edge, cone) in slab.cones.iter().enumerate() {
                    cone.sample(spacing, |t, n, area| push(edge_weights(edge, t), n, area));
                }
            }
        }
    }
}

/// For each point of a block, the index of the nearest of some hulls and its distance, or 0 and `limit` if no hull is nearer than `limit`. `among` lists
/// hulls with their distances from the middle of the block. All points are within `radius` of the middle. The search ends when no distance exceeds `enough`.
pub(super) fn nearest_to_block(
    hulls: &[Hull],
    among: &[(u32, f32)],
    block: &Block,
    radius: f32,
    [enough, limit]: [f32; 2],
) -> ([u32; BLOCK], [f32; BLOCK]) {
    let (mut nearest, mut least) = ([0; BLOCK], [limit; BLOCK]);
    // The hull nearest to the middle comes first: it is the nearest to most points, so most other hulls can be skipped.
    let first = among.iter().min_by(|a, b| a.1.total_cmp(&b.1));
    let others = among.iter().filter(|other| Some(*other) != first);
    dispatch!(Level::new(), simd => {
        let points = block.load(simd);
        let (mut numbers, mut distances) = (u32x16::splat(simd, 0), f32x16::splat(simd, limit));
        let mut farthest = limit;
        for &(number, gap) in first.into_iter().chain(others) {
            if gap > farthest + radius {
                continue;
            }
            let found = hulls[number as usize].distances_of(simd, points);
            let nearer = found.simd_lt(distances);
            distances = nearer.select(found, distances);
            numbers = nearer.select(u32x16::splat(simd, number), numbers);
            farthest = largest(distances);
            if farthest <= enough {
                break;
            }
        }
        numbers.store_slice(&mut nearest);
        distances.store_slice(&mut least);
    });
    (nearest, least)
}

/// The largest of all lanes.
#[inline(always)]
fn largest<S: Simd>(lanes: f32x16<S>) -> f32 {
    let (low, high) = lanes.split();
    let (low, high) = low.max(high).split();
    low.max(high).as_slice().iter().copied().fold(f32::NEG_INFINITY, f32::max)
}

/// Fractional part of the golden ratio: its multiples are evenly spread, for any number of them.
const GOLDEN: f64 = 0.618_033_988_749_894_9;

pub(super) fn sample_sphere(radius: f64, spacing: f64, mut push: impl FnMut(DVec3, f64)) {
    const LEAST: f64 = 16.0;
    let area = 4.0 * PI * radius * radius;
    let count = (area / (spacing * spacing)).max(LEAST) as usize;
    let turn = DVec2::from_angle(TAU * GOLDEN);
    let mut spoke = DVec2::X;
    for i in 0..count {
        let z = 1.0 - (2 * i + 1) as f64 / count as f64;
        push((spoke * (1.0 - z * z).sqrt()).extend(z), area / count as f64);
        spoke = turn.rotate(spoke);
    }
}

/// Weights in a slab at `t` along its edge ab (0), bc (1) or ac (2).
fn edge_weights(edge: usize, t: f64) -> [f64; 3] {
    match edge {
        0 => [1.0 - t, t, 0.0],
        1 => [0.0, 1.0 - t, t],
        _ => [1.0 - t, 0.0, t],
    }
}

impl Cone {
    fn sample(&self, spacing: f64, mut push: impl FnMut(f64, DVec3, f64)) {
        if self.slant.is_infinite() {
            return;
        }
        let length = self.along.length();
        let axis = self.along / length;
        let (e1, e2) = axis.any_orthonormal_pair();
        let sine = self.widening / length;
        let cosine = (1.0 - sine * sine).sqrt();
        let rings = (length * cosine / spacing).ceil().max(2.0);
        for ring in 0..rings as usize {
            let t = (ring as f64 + 0.5) / rings;
            let around = TAU * (self.from.radius + t * self.widening) * cosine;
            let count = (around / spacing).ceil().max(5.0);
            let turn = DVec2::from_angle(TAU / count);
            let mut spoke = DVec2::from_angle(TAU * GOLDEN * ring as f64);
            for _ in 0..count as usize {
                let normal = (e1 * spoke.x + e2 * spoke.y) * cosine - axis * sine;
                push(t, normal, around * length * cosine / (rings * count));
                spoke = turn.rotate(spoke);
            }
        }
    }

    pub fn new(from: Ball, to: Ball) -> Self {
        let along = to.center - from.center;
        let widening = to.radius - from.radius;
        let length_squared = along.length_squared();
        let rest = length_squared - widening * widening;
        let (inverse_length_squared, slant) = if rest > 1e-12 * length_squared && length_squared > 1e-24 {
            (1.0 / length_squared, widening / (length_squared * rest).sqrt())
        } else {
            // One sphere contains the other and is nearest to all points.
            (0.0, if widening > 0.0 { f64::INFINITY } else { f64::NEG_INFINITY })
        };
        Self { from, along, widening, inverse_length_squared, slant }
    }

    #[inline(always)]
    fn distances<S: Simd>(&self, simd: S, points: Vector<f32x16<S>>) -> f32x16<S> {
        // A degenerate cone is the sphere that contains the other.
        let (ball, along, widening, slant) = if self.slant.is_finite() {
            (self.from, self.along, self.widening, self.slant.clamp(-1e6, 1e6))
        } else {
            let t = if self.slant > 0.0 { 1.0 } else { 0.0 };
            let (center, radius) = (self.from.center + self.along * t, self.from.radius + self.widening * t);
            (Ball { center, radius }, DVec3::ZERO, 0.0, 0.0)
        };
        let all = |x: f64| f32x16::splat(simd, x as f32);
        let (radius, widening, length_squared) = (all(ball.radius), all(widening), all(along.length_squared()));
        let (slant, inverse) = (all(slant), all(self.inverse_length_squared));
        let (offset, along) = (points - splat(simd, ball.center), splat(simd, along));
        let foot = offset.dot(along) * inverse;
        let square = (offset - along * foot).length_squared();
        let t = (foot + square.sqrt() * slant).max(0.0).min(1.0);
        let past = t - foot;
        (square + past * past * length_squared).sqrt() - (radius + t * widening)
    }

    #[inline]
    fn closest(&self, point: DVec3) -> (f64, f64) {
        let offset = point - self.from.center;
        let t = if self.slant.is_finite() {
            let foot = offset.dot(self.along) * self.inverse_length_squared;
            let height = (offset - self.along * foot).length();
            (foot + self.slant * height).clamp(0.0, 1.0)
        } else if self.slant > 0.0 {
            1.0
        } else {
            0.0
        };
        ((offset - self.along * t).length() - (self.from.radius + self.widening * t), t)
    }
}

impl Slab {
    fn new(a: Ball, b: Ball, c: Ball) -> Self {
        let (u, v) = (b.center - a.center, c.center - a.center);
        let widening = [b.radius - a.radius, c.radius - a.radius];
        let cross = u.cross(v);
        let area_squared = cross.length_squared();
        let (uu, vv, uv) = (u.length_squared(), v.length_squared(), u.dot(v));
        let proper = area_squared > 1e-12 * uu * vv;
        let to_weights = if proper {
            [(u * vv - v * uv) / area_squared, (v * uu - u * uv) / area_squared]
        } else {
            [DVec3::ZERO; 2]
        };
        let gradient = to_weights[0] * widening[0] + to_weights[1] * widening[1];
        let rest = 1.0 - gradient.length_squared();
        Self {
            from: a,
            u,
            v,
            widening,
            normal: cross.normalize_or_zero(),
            to_weights,
            slant: (proper && rest > 1e-12).then(|| gradient / rest.sqrt()),
            cones: [Cone::new(a, b), Cone::new(b, c), Cone::new(a, c)],
        }
    }

    fn sample(&self, spacing: f64, mut push: impl FnMut([f64; 3], DVec3, f64)) {
        let Some(slant) = self.slant else { return };
        // The slant is g / sqrt(1 - g^2), where g is the gradient of the radius.
        let cosine = 1.0 / (1.0 + slant.length_squared()).sqrt();
        let area = 0.5 * self.u.cross(self.v).length() * cosine;
        let count = (area / (spacing * spacing)).ceil().max(2.0);
        for i in 0..count as usize {
            // Roberts' sequence (2018), folded into the triangle.
            let (s, t) = ((0.5 + 0.754_877_666 * i as f64).fract(), (0.5 + 0.569_840_291 * i as f64).fract());
            let (s, t) = if s + t > 1.0 { (1.0 - s, 1.0 - t) } else { (s, t) };
            for side in [self.normal, -self.normal] {
                push([1.0 - s - t, s, t], (side - slant) * cosine, area / count);
            }
        }
    }

    #[inline(always)]
    fn distances<S: Simd>(&self, simd: S, points: Vector<f32x16<S>>) -> f32x16<S> {
        let Some(slant) = self.slant else {
            let [ab, bc, ac] = self.cones.each_ref().map(|cone| cone.distances(simd, points));
            return ab.min(bc).min(ac);
        };
        let (offset, normal) = (points - splat(simd, self.from.center), splat(simd, self.normal));
        let rows = (splat(simd, self.to_weights[0]), splat(simd, self.to_weights[1]));
        // Per distance from the plane: the shift of the weights, and the distance from the centre of the shifted sphere.
        let [s, t] = self.to_weights.map(|row| row.dot(slant));
        let stretch = (1.0 + slant.length_squared()).sqrt();
        let all = |x: f64| f32x16::splat(simd, x as f32);
        let (shift, stretch) = ((all(s), all(t)), all(stretch));
        let (radius, widening) = (all(self.from.radius), (all(self.widening[0]), all(self.widening[1])));
        let height = offset.dot(normal).abs();
        let (s, t) = (offset.dot(rows.0) + height * shift.0, offset.dot(rows.1) + height * shift.1);
        let inside = [t, 1.0 - s - t, s];
        let within = inside[0].min(inside[1]).min(inside[2]).simd_ge(0.0);
        let mut beside = f32x16::splat(simd, f32::INFINITY);
        for (cone, inside) in self.cones.iter().zip(inside) {
            // Only edges that face a point can be nearest to it.
            let faces = inside.simd_lt(0.0);
            if faces.any_true() {
                beside = faces.select(beside.min(cone.distances(simd, points)), beside);
            }
        }
        within.select(height * stretch - (radius + s * widening.0 + t * widening.1), beside)
    }

    fn closest(&self, point: DVec3) -> (f64, [f64; 3]) {
        let offset = point - self.from.center;
        let mut open = [true; 3];
        if let Some(slant) = self.slant {
            let height = offset.dot(self.normal);
            let shifted = offset + slant * height.abs();
            let (s, t) = (shifted.dot(self.to_weights[0]), shifted.dot(self.to_weights[1]));
            // The edges that face the point: ab, bc, ac.
            open = [t < 0.0, s + t > 1.0, s < 0.0];
            if open == [false; 3] {
                let radius = self.from.radius + s * self.widening[0] + t * self.widening[1];
                let center = self.u * s + self.v * t;
                return ((offset - center).length() - radius, [1.0 - s - t, s, t]);
            }
        }
        let mut best = (f64::INFINITY, [0.0; 3]);
        for (edge, cone) in self.cones.iter().enumerate().filter(|(edge, _)| open[*edge]) {
            let (distance, t) = cone.closest(point);
            if distance < best.0 {
                best = (distance, edge_weights(edge, t));
            }
        }
        best
    }
}
