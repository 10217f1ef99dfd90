//! Degenerate slabs (paper, section 3.2) by the paper's rule and by that of `bevy_medial`, on random slabs.

use bevy_medial::{
    geometry::{Primitive, Sphere},
    random::Random,
};
use glam::{DVec3, Vec3};
use serde::Serialize;

use crate::convex::min_of_convex;

/// A sphere in f64: its centre and radius.
type Ball = (DVec3, f64);

/// The indices of the spheres that remain of a slab by the paper's rule: three if it is not degenerate.
///
/// Case 1: a sphere inside another one is removed. Case 2: with radii in descending order, the cones of spheres 1 and 2, and of 1 and 3, touch sphere 1
/// in two circles. If these have at most one common point, the slab becomes the cone of spheres 1 and 2.
pub fn paper_rule(spheres: &[Sphere; 3]) -> Vec<u32> {
    let mut order: Vec<u32> = vec![0, 1, 2];
    order.sort_by(|&i, &j| spheres[j as usize].radius.total_cmp(&spheres[i as usize].radius));
    let mut remaining: Vec<u32> = Vec::new();
    for i in order {
        if !remaining.iter().any(|&j| spheres[j as usize].contains(&spheres[i as usize])) {
            remaining.push(i);
        }
    }
    if let [first, second, third] = remaining[..]
        && !circles_cross([first, second, third].map(|i| ball(&spheres[i as usize])))
    {
        remaining.truncate(2);
    }
    remaining
}

/// True if the two circles on the first sphere have two common points, by the construction in figure 4 of the paper.
fn circles_cross([(c1, r1), (c2, r2), (c3, r3)]: [Ball; 3]) -> bool {
    let [edge2, edge3] = [c2 - c1, c3 - c1];
    let normal = edge2.cross(edge3).normalize_or_zero();
    // The planes of the circles cross the edges at the feet of the perpendiculars from both points.
    let foot = |edge: DVec3, radius: f64| c1 + edge * (r1 * (r1 - radius) / edge.length_squared());
    let [foot2, foot3] = [foot(edge2, r2), foot(edge3, r3)];
    let along = normal.cross(edge2);
    let projection = foot2 + along * ((foot3 - foot2).dot(edge3) / along.dot(edge3));
    projection.distance_squared(c1) < r1 * r1
}

fn ball(sphere: &Sphere) -> Ball {
    (sphere.center.as_dvec3(), f64::from(sphere.radius))
}

/// Length of the gradient of the radius in the plane of the centres, in an orthonormal frame. A slab is degenerate from 1 on.
fn gradient(spheres: &[Sphere; 3]) -> f64 {
    let [(c1, r1), (c2, r2), (c3, r3)] = spheres.each_ref().map(ball);
    let length = c1.distance(c2);
    let x = (c2 - c1) / length;
    let along = (c3 - c1).dot(x);
    let height = (c3 - c1 - x * along).length();
    let gx = (r2 - r1) / length;
    f64::hypot(gx, (r3 - r1 - gx * along) / height)
}

/// How far a ball protrudes from the union of cones, each given by one or two balls.
fn protrusion(ball: Ball, cones: &[Vec<Ball>]) -> f64 {
    let from_cone = |cone: &Vec<Ball>| {
        let [(a, ra), (b, rb)] = [cone[0], cone[cone.len() - 1]];
        min_of_convex(|t| ball.0.distance(a.lerp(b, t)) + ball.1 - (ra + (rb - ra) * t))
    };
    cones.iter().map(from_cone).fold(f64::INFINITY, f64::min)
}

/// Verdicts of both rules on random slabs. Lengths are relative to coordinates from -1 to 1.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Verdicts {
    pub slabs: usize,
    /// Slabs with a radius gradient of 1 or more.
    pub degenerate: usize,
    /// Slabs within 1e-6 of a gradient of 1 or of collinear centres. Both verdicts are right for them.
    pub undecided: usize,
    /// Wrong verdicts of `bevy_medial`.
    pub ours_wrong: usize,
    /// Degenerate slabs that protrude from their result in `bevy_medial`.
    pub ours_lossy: usize,
    /// Max protrusion of a degenerate slab from its result in `bevy_medial`.
    pub ours_max_loss: f64,
    /// Wrong verdicts of the two circles on slabs with a radius.
    pub circles_wrong: usize,
    /// Triangles: slabs whose radii are all 0.
    pub triangles: usize,
    /// Wrong verdicts of the two circles on triangles.
    pub circles_wrong_on_triangles: usize,
    /// Degenerate slabs that the paper's rule reduces to a cone which does not hold them.
    pub cone_wrong: usize,
    /// Max protrusion of a degenerate slab from the cone that remains by the paper's rule.
    pub cone_max_loss: f64,
}

/// Tolerance of gradients and lengths.
const TOLERANCE: f64 = 1e-6;

impl Verdicts {
    fn judge(&mut self, spheres: &[Sphere; 3], random: &mut Random) {
        self.slabs += 1;
        let gradient = gradient(spheres);
        let is_degenerate = gradient >= 1.0;
        self.degenerate += usize::from(is_degenerate);
        // A gradient that is not a number belongs to collinear centres.
        if !((gradient - 1.0).abs() > TOLERANCE && gradient < 1.0 / TOLERANCE) {
            self.undecided += 1;
            return;
        }
        let balls = spheres.each_ref().map(ball);
        let simplified = Primitive::Slab([0, 1, 2]).simplified(spheres);
        let parts: Vec<Vec<u32>> = simplified.iter().map(|part| part.indices().to_vec()).collect();
        self.ours_wrong += usize::from((parts[0].len() < 3) != is_degenerate);
        let paper = paper_rule(spheres);
        let is_triangle = spheres.iter().all(|sphere| sphere.radius == 0.0);
        self.triangles += usize::from(is_triangle);
        let wrong = usize::from((paper.len() < 3) != is_degenerate);
        *(if is_triangle { &mut self.circles_wrong_on_triangles } else { &mut self.circles_wrong }) += wrong;
        if !is_degenerate {
            return;
        }
        let cones = |parts: &[Vec<u32>]| -> Vec<Vec<Ball>> {
            parts.iter().map(|part| part.iter().map(|&i| balls[i as usize]).collect()).collect()
        };
        // Balls of the slab: the three given ones and two random ones.
        let mix = |w: [f64; 3]| {
            let sum: f64 = w.iter().sum();
            let at = |i: usize| (balls[i].0 * (w[i] / sum), balls[i].1 * (w[i] / sum));
            [at(0), at(1), at(2)].into_iter().fold((DVec3::ZERO, 0.0), |(c, r), (dc, dr)| (c + dc, r + dr))
        };
        let random_balls = [(); 2].map(|()| mix([(); 3].map(|()| random.range(0.0, 1.0) + 1e-9)));
        let loss = |cones: &[Vec<Ball>]| {
            balls.iter().chain(&random_balls).map(|&ball| protrusion(ball, cones)).fold(0.0, f64::max)
        };
        let ours = loss(&cones(&parts));
        self.ours_lossy += usize::from(ours > TOLERANCE);
        self.ours_max_loss = self.ours_max_loss.max(ours);
        if paper.len() < 3 {
            let loss = loss(&cones(&[paper]));
            self.cone_wrong += usize::from(loss > TOLERANCE);
            self.cone_max_loss = self.cone_max_loss.max(loss);
        }
    }
}

/// Three spheres: random ones, ones near a gradient of 1, a bulge between two others, a small sphere in the hull of two others, a triangle.
fn random_slab(random: &mut Random) -> [Sphere; 3] {
    let [a, b, c] = [(); 3].map(|()| random.in_cube());
    let [ra, rb, rc] = [(); 3].map(|()| 0.7 * random.unit());
    let t = random.unit();
    let (c, rc) = match random.below(16) {
        0..6 => (c, rc),
        6..9 => (c, ra + a.distance(c) * (1.0 + (random.signed() * 10f32.powf(-5.0 * random.unit())))),
        9..12 => (a.lerp(b, t) + 0.1 * c, ra + (rb - ra) * t + 0.2 * random.unit()),
        12..15 => (a.lerp(b, t) + 0.1 * c, (ra + (rb - ra) * t) * random.unit()),
        _ => return [a, b, c].map(|center| Sphere::new(center, 0.0)),
    };
    let mut slab = [Sphere::new(a, ra), Sphere::new(b, rb), Sphere::new(c, rc.max(0.0))];
    slab.rotate_left(random.below(3));
    slab
}

/// Judges both rules on a number of random slabs.
pub fn compare(slabs: usize, seed: u64) -> Verdicts {
    let mut random = Random(seed);
    let mut verdicts = Verdicts::default();
    for _ in 0..slabs {
        let slab = random_slab(&mut random);
        verdicts.judge(&slab, &mut random);
    }
    verdicts
}

/// A slab whose middle sphere bulges out of the cone of the two larger ones, so that the paper's rule loses volume.
pub const BULGING: [Sphere; 3] = [
    Sphere::new(Vec3::new(-1.0, 0.0, 0.0), 0.60),
    Sphere::new(Vec3::new(-0.4, 0.05, 0.0), 0.62),
    Sphere::new(Vec3::new(1.0, 0.0, 0.0), 0.10),
];
