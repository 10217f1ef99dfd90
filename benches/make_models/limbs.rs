//! The signed distance to limbs that are joined by fillets.

use bevy_medial::{
    geometry::{Aabb, Sphere},
    query::separation,
};
use glam::{Vec3, Vec4, Vec4Swizzles};

/// A sphere: x, y, z, radius.
pub type Ball = [f32; 4];

/// A union of cones and slabs, with its mirror image if it lies on the right side of an animal.
pub struct Limb {
    cones: Vec<[Sphere; 2]>,
    slabs: Vec<[Sphere; 3]>,
    is_pair: bool,
    /// Bounds of the limb and of its mirror image.
    aabb: Aabb,
    /// Width of the fillet to other limbs.
    blend: f32,
}

/// Width of a limb's fillets, relative to its mean radius.
const BLEND: f32 = 0.7;

/// Number of cones of a tube between two balls.
const STEPS: usize = 4;

/// Cones along the smooth curve through `balls`.
pub fn tube<const N: usize>(balls: [Ball; N]) -> Limb {
    let balls = balls.map(Vec4::from);
    let curve: Vec<Sphere> = (0..=(N - 1) * STEPS).map(|i| sphere(curve(&balls, i as f32 / STEPS as f32))).collect();
    Limb::new(curve.array_windows().copied().collect(), vec![])
}

/// A fan of slabs from `root` to a rim: ears, fins, feet.
pub fn leaf<const N: usize>(root: Ball, rim: [Ball; N]) -> Limb {
    let slab = |pair: &[Ball; 2]| [root, pair[0], pair[1]].map(|ball| sphere(ball.into()));
    Limb::new(vec![], rim.array_windows().map(slab).collect())
}

impl Limb {
    fn new(cones: Vec<[Sphere; 2]>, slabs: Vec<[Sphere; 3]>) -> Self {
        let spheres: Vec<Sphere> = cones.iter().flatten().chain(slabs.iter().flatten()).copied().collect();
        let radius = spheres.iter().map(|s| s.radius).sum::<f32>() / spheres.len() as f32;
        let sides = spheres.iter().flat_map(|s| [*s, Sphere::new(mirrored(s.center), s.radius)]);
        Self {
            aabb: Aabb::from_spheres(sides),
            is_pair: spheres.iter().all(|s| s.center.z >= 0.0) && spheres.iter().any(|s| s.center.z > 0.0),
            blend: BLEND * radius,
            cones,
            slabs,
        }
    }

    /// Signed distance to the limb and its mirror image.
    fn distance(&self, point: Vec3) -> f32 {
        let one = self.distance_to_one(point);
        if self.is_pair { smooth_min(one, self.distance_to_one(mirrored(point)), self.blend) } else { one }
    }

    fn distance_to_one(&self, point: Vec3) -> f32 {
        let point = [Sphere::new(point, 0.0)];
        let cones = self.cones.iter().map(|cone| separation(&point, cone, 0).distance);
        let slabs = self.slabs.iter().map(|slab| separation(&point, slab, 0).distance);
        cones.chain(slabs).fold(f32::INFINITY, f32::min)
    }
}

/// Limbs that are joined by fillets.
pub struct Solid(pub Vec<Limb>);

impl Solid {
    /// The box around all limbs.
    pub fn aabb(&self) -> Aabb {
        self.0.iter().map(|limb| limb.aabb).fold(Aabb::EMPTY, Aabb::merge)
    }

    /// The signed distance near the surface. Elsewhere only its sign is exact.
    pub fn distance(&self, point: Vec3) -> f32 {
        self.0.iter().fold(f32::INFINITY, |rest, limb| {
            let is_far = limb.aabb.distance(point) > rest + limb.blend;
            if is_far { rest } else { smooth_min(rest, limb.distance(point), limb.blend) }
        })
    }

    /// The gradient of the distance, by central differences over two `step`s.
    pub fn gradient(&self, point: Vec3, step: f32) -> Vec3 {
        let along = |axis: Vec3| self.distance(point + axis * step) - self.distance(point - axis * step);
        Vec3::new(along(Vec3::X), along(Vec3::Y), along(Vec3::Z)) / (2.0 * step)
    }
}

/// The smaller of two distances, with a fillet where they differ by less than `blend`.
fn smooth_min(a: f32, b: f32, blend: f32) -> f32 {
    let near = (1.0 - (a - b).abs() / blend).max(0.0);
    a.min(b) - 0.25 * blend * near * near
}

fn mirrored(point: Vec3) -> Vec3 {
    point.with_z(-point.z)
}

fn sphere(ball: Vec4) -> Sphere {
    Sphere::new(ball.xyz(), ball.w)
}

/// The Catmull-Rom curve through `points`. The parameter `t` is 0 at the first point, and grows by 1 from point to point.
fn curve(points: &[Vec4], t: f32) -> Vec4 {
    let last = points.len() - 1;
    let from = (t as usize).min(last - 1);
    let t = t - from as f32;
    let (p1, p2) = (points[from], points[from + 1]);
    // Beyond its ends, the curve is continued by a straight line.
    let p0 = if from > 0 { points[from - 1] } else { p1 * 2.0 - p2 };
    let p3 = if from + 2 <= last { points[from + 2] } else { p2 * 2.0 - p1 };
    let (a, b, c) = (p2 - p0, p0 * 2.0 - p1 * 5.0 + p2 * 4.0 - p3, p1 * 3.0 - p0 - p2 * 3.0 + p3);
    p1 + (a + (b + c * t) * t) * t * 0.5
}
