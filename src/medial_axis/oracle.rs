//! Independent reference results in f64, and hard cases, for the tests of this module.

use std::path::PathBuf;

use glam::DVec3;

use crate::{
    geometry::{Primitive, Sphere},
    random::Random,
};

/// Files of models: the project's own, and those of a folder of research models if it exists beside the repository.
pub fn model_files(own: &[&str], research: &[&str]) -> Vec<PathBuf> {
    let root = PathBuf::from(env!("CARGO_MANIFEST_DIR"));
    let (assets, shared) = (root.join("assets/models"), root.join("../shared/models"));
    let research = if shared.is_dir() { research } else { &[] };
    let own = own.iter().map(|name| assets.join(name));
    own.chain(research.iter().map(|name| shared.join(name))).collect()
}

/// Number of kinds of [`hard_slab`].
pub const HARD_KINDS: usize = 8;

/// Three spheres of random size and position that are a degenerate slab, or nearly so.
pub fn hard_slab(random: &mut Random, kind: usize) -> [Sphere; 3] {
    let [a, b, c] = [(); 3].map(|()| random.in_cube());
    let [ra, rb] = [(); 2].map(|()| 0.3 * random.unit());
    let t = random.unit();
    let nearly = [0.0, 1e-6, -1e-6, 1e-3, -1e-3][random.below(5)];
    let (c, rc) = match kind {
        // Three random spheres.
        0 => (c, random.unit()),
        // The third inside the first, or nearly so, possibly touching it from inside.
        1 => (a + c.normalize_or_zero() * ra * t, ra * (1.0 - t) + nearly),
        // The third inside the hull of the others, or nearly so.
        2 => (a.lerp(b, t), (ra + (rb - ra) * t) * random.unit().sqrt() + nearly),
        // A middle sphere that bulges out of the hull of the others.
        3 => (a.lerp(b, t) + 0.05 * c, ra + (rb - ra) * t + 0.2),
        // Collinear centres.
        4 => (a + (b - a) * (3.0 * t - 1.0), random.unit()),
        // Coincident centres.
        5 => (if t < 0.5 { a } else { b }, random.unit()),
        // A sliver with nearly linear radii.
        6 => (a.lerp(b, t) + c * nearly, ra + (rb - ra) * t + nearly),
        // A radius gradient of about 1.
        _ => (c, ra + a.distance(c) * (1.0 + nearly)),
    };
    let mut slab = [Sphere::new(a, ra), Sphere::new(b, rb), Sphere::new(c, rc.max(0.0))];
    slab.rotate_left(random.below(3));
    let (scale, offset) = (10f32.powf(4.0 * random.signed()), random.in_cube());
    slab.map(|s| Sphere::new((s.center + offset) * scale, s.radius * scale))
}

/// True if a primitive is degenerate, according to its radius gradient in an orthonormal frame.
pub fn is_degenerate(spheres: &[Sphere], primitive: &Primitive) -> bool {
    let at = |i: u32| (spheres[i as usize].center.as_dvec3(), f64::from(spheres[i as usize].radius));
    let edge = |i: u32, j: u32| (at(j).0 - at(i).0, at(j).1 - at(i).1);
    match *primitive {
        Primitive::Sphere(_) => false,
        Primitive::Cone([i, j]) => edge(i, j).0.length() <= edge(i, j).1.abs(),
        Primitive::Slab([i, j, k]) => {
            let ((u, p), (v, q)) = (edge(i, j), edge(i, k));
            let x = u.normalize_or_zero();
            // The second projection removes the rounding error of the first.
            let across = v - x * v.dot(x);
            let across = across - x * across.dot(x);
            let height = across.length();
            let (gx, gy) = (p / u.length(), (q - p / u.length() * v.dot(x)) / height);
            u == DVec3::ZERO || height == 0.0 || gx * gx + gy * gy >= 1.0
        }
    }
}

/// A union of primitives, in f64.
pub struct Envelope(Vec<(Hull, DVec3, f64)>);

type Hull = Vec<(DVec3, f64)>;

impl Envelope {
    pub fn new(spheres: &[Sphere], primitives: &[Primitive]) -> Self {
        let hulls = primitives.iter().map(|primitive| {
            let hull: Hull = primitive
                .indices()
                .iter()
                .map(|&i| (spheres[i as usize].center.as_dvec3(), f64::from(spheres[i as usize].radius)))
                .collect();
            let middle = hull.iter().map(|s| s.0).sum::<DVec3>() / hull.len() as f64;
            let reach = hull.iter().map(|s| s.0.distance(middle) + s.1).fold(0.0, f64::max);
            (hull, middle, reach)
        });
        Self(hulls.collect())
    }

    /// Diameter of a ball around the union, not the smallest one.
    pub fn size(&self) -> f64 {
        let middle = self.0.iter().map(|h| h.1).sum::<DVec3>() / self.0.len() as f64;
        2.0 * self.0.iter().map(|h| h.1.distance(middle) + h.2).fold(0.0, f64::max)
    }

    /// Smallest signed distance of `point` to a primitive.
    pub fn distance(&self, point: DVec3) -> f64 {
        self.0.iter().fold(f64::INFINITY, |least, (hull, middle, reach)| {
            if middle.distance(point) - reach > least { least } else { least.min(hull_distance(hull, point)) }
        })
    }

    /// A point near the surface of a random primitive, within a tenth of the primitive's size.
    pub fn point_near_surface(&self, random: &mut Random) -> DVec3 {
        let (hull, _, reach) = &self.0[random.below(self.0.len())];
        let mut weights: Vec<f64> = hull.iter().map(|_| f64::from(random.unit()).powi(2) + 1e-9).collect();
        let sum: f64 = weights.iter().sum();
        weights.iter_mut().for_each(|w| *w /= sum);
        let center: DVec3 = hull.iter().zip(&weights).map(|(s, w)| s.0 * *w).sum();
        let radius: f64 = hull.iter().zip(&weights).map(|(s, w)| s.1 * w).sum();
        let offset = f64::from(random.signed()).powi(3) * 0.1 * reach;
        center + random.in_cube().as_dvec3().normalize_or(DVec3::X) * (radius + offset)
    }
}

/// Signed distance to the hull of one to three spheres: the minimum over its corners, the stationary points of its edges
/// and, if it exists, the stationary point of its triangle.
fn hull_distance(hull: &[(DVec3, f64)], point: DVec3) -> f64 {
    let mut least = hull.iter().map(|(c, r)| c.distance(point) - r).fold(f64::INFINITY, f64::min);
    for i in 0..hull.len() {
        for j in 0..i {
            let ((a, ra), (b, rb)) = (hull[i], hull[j]);
            let (along, growth) = ((b - a).normalize_or_zero(), (rb - ra) / a.distance(b));
            let foot = (point - a).dot(along);
            let height = (point - a - along * foot).length();
            let t = (foot + height * growth / (1.0 - growth * growth).sqrt()) / a.distance(b);
            if t > 0.0 && t < 1.0 {
                least = least.min(a.lerp(b, t).distance(point) - (ra + t * (rb - ra)));
            }
        }
    }
    if let [(a, ra), (b, rb), (c, rc)] = *hull {
        let (u, v) = (b - a, c - a);
        let (uu, uv, vv) = (u.dot(u), u.dot(v), v.dot(v));
        let det = uu * vv - uv * uv;
        let solve = |p: f64, q: f64| ((p * vv - q * uv) / det, (q * uu - p * uv) / det);
        let (gu, gv) = solve(rb - ra, rc - ra);
        let gradient = u * gu + v * gv;
        let height = (point - a).dot(u.cross(v).normalize_or_zero()).abs();
        let (fu, fv) = solve((point - a).dot(u), (point - a).dot(v));
        let shift = height / (1.0 - gradient.length_squared()).sqrt();
        let (s, t) = (fu + gu * shift, fv + gv * shift);
        if s > 0.0 && t > 0.0 && s + t < 1.0 {
            least = least.min((a + u * s + v * t).distance(point) - (ra + (rb - ra) * s + (rc - ra) * t));
        }
    }
    least
}

/// Signed distance to a slab by nested search: slow, but based on convexity alone.
pub fn searched_distance(slab: &[Sphere; 3], point: DVec3) -> f64 {
    let [(a, ra), (b, rb), (c, rc)] = slab.map(|s| (s.center.as_dvec3(), f64::from(s.radius)));
    // Chords parallel to a-b, from that edge (t = 0) to c (t = 1): the minimum along each chord is convex in t.
    least_of_convex(|t| {
        let (from, to) = (a.lerp(c, t), b.lerp(c, t));
        let (r_from, r_to) = (ra + (rc - ra) * t, rb + (rc - rb) * t);
        least_of_convex(|s| from.lerp(to, s).distance(point) - (r_from + (r_to - r_from) * s))
    })
}

/// Minimum of a convex function on [0, 1], by golden section.
fn least_of_convex(f: impl Fn(f64) -> f64) -> f64 {
    const GOLDEN: f64 = 0.618_033_988_749_894_9;
    let (mut from, mut to) = (0.0, 1.0);
    let (mut x, mut y) = (1.0 - GOLDEN, GOLDEN);
    let (mut fx, mut fy) = (f(x), f(y));
    let mut least = f(0.0).min(f(1.0));
    for _ in 0..60 {
        least = least.min(fx).min(fy);
        if fx < fy {
            (to, y, fy) = (y, x, fx);
            x = to - GOLDEN * (to - from);
            fx = f(x);
        } else {
            (from, x, fx) = (x, y, fy);
            y = from + GOLDEN * (to - from);
            fy = f(y);
        }
    }
    least
}

#[test]
fn closed_distance_equals_searched_distance() {
    let mut random = Random(6);
    for case in 0..400 {
        let slab = hard_slab(&mut random, case % HARD_KINDS);
        let envelope = Envelope::new(&slab, &[Primitive::Slab([0, 1, 2])]);
        for _ in 0..4 {
            let point = envelope.point_near_surface(&mut random);
            let (closed, searched) = (envelope.distance(point), searched_distance(&slab, point));
            assert!((closed - searched).abs() < 1e-8 * envelope.size(), "{closed} {searched} {slab:?} {point}");
        }
    }
}
