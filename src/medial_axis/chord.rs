//! Intersections of a primitive with lines parallel to the x axis, in closed form and in f64.

use glam::DVec3;

#[derive(Clone, Copy)]
pub(super) struct Ball {
    pub center: DVec3,
    pub radius: f64,
}

/// The convex hull of one to three balls.
pub(super) struct Hull {
    balls: Vec<Ball>,
    /// The two flat triangles of a slab. NaN for a degenerate slab, whose triangles then intersect no line.
    faces: Vec<[DVec3; 3]>,
}

impl Hull {
    pub fn new(balls: Vec<Ball>) -> Self {
        let mut faces = Vec::new();
        if let [a, b, c] = balls[..] {
            // A tangent plane's unit normal n has n . (b - a) = -(rb - ra) and n . (c - a) = -(rc - ra): in the plane
            // of the centres it is the negative gradient of the radius.
            let (u, v) = (b.center - a.center, c.center - a.center);
            let normal = u.cross(v);
            let gradient = (v.cross(normal) * (b.radius - a.radius) - u.cross(normal) * (c.radius - a.radius))
                / normal.length_squared();
            let height = (1.0 - gradient.length_squared()).sqrt();
            for up in [height, -height] {
                let n = normal.normalize() * up - gradient;
                faces.push([a, b, c].map(|ball| ball.center + n * ball.radius));
            }
        }
        Self { balls, faces }
    }

    /// Extent along an axis.
    pub fn range(&self, axis: usize) -> (f64, f64) {
        let least = self.balls.iter().map(|b| b.center[axis] - b.radius).fold(f64::INFINITY, f64::min);
        let greatest = self.balls.iter().map(|b| b.center[axis] + b.radius).fold(f64::NEG_INFINITY, f64::max);
        (least, greatest)
    }

    /// Area of the bounding rectangle of the projection along x.
    pub fn shadow(&self) -> f64 {
        let [(y0, y1), (z0, z1)] = [1, 2].map(|axis| self.range(axis));
        (y1 - y0) * (z1 - z0)
    }

    /// The x coordinates at which the line along x through `y` and `z` enters and leaves the hull.
    ///
    /// Every candidate below is a point of the hull, and both ends of the chord are among the candidates: on a ball, on the mantle
    /// between two balls, or on a face.
    pub fn chord(&self, at: [f64; 2]) -> Option<(f64, f64)> {
        let (mut from, mut to) = (f64::INFINITY, f64::NEG_INFINITY);
        let mut point = |x: f64| {
            from = from.min(x);
            to = to.max(x);
        };
        for (i, a) in self.balls.iter().enumerate() {
            let square = a.radius * a.radius - offset_squared(a.center, at);
            if square >= 0.0 {
                point(a.center.x - square.sqrt());
                point(a.center.x + square.sqrt());
            }
            for b in &self.balls[..i] {
                mantle(a, b, at).into_iter().flatten().for_each(&mut point);
            }
        }
        self.faces.iter().filter_map(|face| in_triangle(face, at)).for_each(&mut point);
        (from < to).then_some((from, to))
    }
}

fn offset_squared(center: DVec3, [y, z]: [f64; 2]) -> f64 {
    (center.y - y).powi(2) + (center.z - z).powi(2)
}

/// The smallest x at which the line enters a ball between `a` and `b`, and the largest x at which it leaves one. `None` if that ball is `a` or `b`.
///
/// The line leaves the ball at `s` at `k s + sqrt(Q(s))`, where `Q = A s^2 + 2 B s + C` is its squared radius minus the squared
/// distance of its centre from the line. This function is concave; with `y = A s + B` and `D = B^2 - A C` its maximum is at
/// `y^2 = k^2 D / (k^2 - A)`, where `y` has the opposite sign of `k`. For the entry, `k` changes its sign.
fn mantle(a: &Ball, b: &Ball, at: [f64; 2]) -> [Option<f64>; 2] {
    let (step, growth) = (b.center - a.center, b.radius - a.radius);
    let across = (a.center.y - at[0]) * step.y + (a.center.z - at[1]) * step.z;
    let qa = growth * growth - step.y * step.y - step.z * step.z;
    let qb = a.radius * growth - across;
    let qc = a.radius * a.radius - offset_squared(a.center, at);
    let slack = step.x * step.x - qa;
    let root = step.x.abs() * ((qb * qb - qa * qc) / slack).sqrt();
    [-1.0, 1.0].map(|sense: f64| {
        let k = sense * step.x;
        let y = -root.copysign(k);
        // Two forms of the same number: each avoids cancellation in its case.
        let s = if y * qb > 0.0 { (qb * qb - k * k * qc) / (slack * (y + qb)) } else { (y - qb) / qa };
        let square = (qa * s + 2.0 * qb) * s + qc;
        (s > 0.0 && s < 1.0 && square >= 0.0).then(|| a.center.x + step.x * s + sense * square.sqrt())
    })
}

/// The x coordinate at which the line intersects a triangle.
fn in_triangle(&[a, b, c]: &[DVec3; 3], at: [f64; 2]) -> Option<f64> {
    let area = |p: DVec3, q: DVec3| (p.y - at[0]) * (q.z - at[1]) - (q.y - at[0]) * (p.z - at[1]);
    let weights = DVec3::new(area(b, c), area(c, a), area(a, b));
    let sum = weights.element_sum();
    let inside = sum != 0.0 && (weights / sum).cmpge(DVec3::ZERO).all();
    inside.then(|| (a.x * weights.x + b.x * weights.y + c.x * weights.z) / sum)
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::{
        geometry::{Primitive, Sphere},
        medial_axis::oracle::{self, Envelope},
        random::Random,
    };

    #[test]
    fn chords_end_on_the_surface() {
        let mut random = Random(9);
        let (mut hits, mut misses) = (0, 0);
        for case in 0..4_000 {
            let slab = oracle::hard_slab(&mut random, case % oracle::HARD_KINDS);
            let count = 1 + random.below(3);
            let balls = slab[..count].iter().map(|s| Ball { center: s.center.as_dvec3(), radius: f64::from(s.radius) });
            let hull = Hull::new(balls.collect());
            let primitive = [Primitive::Sphere([0]), Primitive::Cone([0, 1]), Primitive::Slab([0, 1, 2])][count - 1];
            let envelope = Envelope::new(&slab, &[primitive]);
            let near = envelope.point_near_surface(&mut random);
            let distance = |x: f64| envelope.distance(DVec3::new(x, near.y, near.z)) / envelope.size();
            match hull.chord([near.y, near.z]) {
                Some((from, to)) => {
                    hits += 1;
                    assert!(distance(from).abs() < 1e-7 && distance(to).abs() < 1e-7, "{slab:?} {near}");
                }
                None => {
                    misses += 1;
                    let (least, greatest) = hull.range(0);
                    let outside = (0..=200).map(|i| least + (greatest - least) * f64::from(i) / 200.0).map(distance);
                    assert!(outside.fold(f64::INFINITY, f64::min) > -1e-9, "{slab:?} {near}");
                }
            }
        }
        assert!(hits > 1000 && misses > 100, "{hits} {misses}");
    }

    #[test]
    fn a_line_along_the_mantle_is_met() {
        // The upper rim of this cone is parallel to the line: the radius shrinks as fast as the centre approaches the line.
        let hull = Hull::new(vec![
            Ball { center: DVec3::ZERO, radius: 1.0 },
            Ball { center: DVec3::new(3.0, 0.5, 0.0), radius: 0.5 },
        ]);
        let spheres = [Sphere::new(Vec3::ZERO, 1.0), Sphere::new(Vec3::new(3.0, 0.5, 0.0), 0.5)];
        let envelope = Envelope::new(&spheres, &[Primitive::Cone([0, 1])]);
        for z in [-0.7, -0.4, 0.2, 0.45, 0.6] {
            let (from, to) = hull.chord([-0.3, z]).unwrap();
            for x in [from, to] {
                assert!(envelope.distance(DVec3::new(x, -0.3, z)).abs() < 1e-12, "{z}: {from} {to}");
            }
        }
    }
}
