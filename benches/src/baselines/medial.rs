//! Medial primitives: a hierarchy of the medial axis (the paper's future work). A leaf is the primitive itself, an inner node is a medial cone around the
//! primitives below it.

use bevy_medial::{
    geometry::{Aabb, Obb, Sphere},
    pipeline::Hull,
    query::{Cuboid, separation},
};
use glam::Vec3;

use super::tree::{Motion, Volume, spheres};
use crate::{convex::min_of_convex, for_primitives};

/// A primitive in the middle of the step, and how far it moves from there in each direction.
#[derive(Clone, Copy)]
pub struct MovingPrimitive {
    middle: Hull,
    /// Half of the mean displacement of its spheres over the step.
    half_motion: Vec3,
    /// Max deviation of a point from that motion.
    deviation: f32,
    aabb: Aabb,
}

impl Volume for MovingPrimitive {
    type Local = Hull;
    type Fixed = Obb;

    fn fit(hulls: &[Hull]) -> Hull {
        match hulls {
            [hull] => *hull,
            _ => Hull::Cone(cone_around(&hulls.iter().flat_map(spheres).copied().collect::<Vec<_>>())),
        }
    }

    fn refit(local: &Hull, motion: &Motion, _: Option<[&Self; 2]>) -> Self {
        let ends: Vec<[Vec3; 2]> = spheres(local).iter().map(|sphere| motion.ends(sphere.center)).collect();
        let mean = ends.iter().map(|[start, end]| *end - *start).sum::<Vec3>() / ends.len() as f32;
        let mut deviation = 0.0f32;
        let mut aabb = Aabb::EMPTY;
        for (sphere, [start, end]) in spheres(local).iter().zip(&ends) {
            let sagitta = motion.sagitta(sphere.center);
            deviation = deviation.max(0.5 * (*end - *start - mean).length() + sagitta);
            let radius = sphere.radius + sagitta;
            aabb = aabb.merge(Aabb::from_spheres([*start, *end].map(|center| Sphere::new(center, radius))));
        }
        let mut at = 0;
        let middle = map(local, |sphere| {
            at += 1;
            Sphere::new((ends[at - 1][0] + ends[at - 1][1]) * 0.5, sphere.radius)
        });
        Self { middle, half_motion: mean * 0.5, deviation, aabb }
    }

    fn fixed(obb: &Obb) -> Obb {
        *obb
    }

    fn aabb(&self) -> Aabb {
        self.aabb
    }

    fn size(&self) -> f32 {
        self.aabb.extent_squared()
    }

    fn meets(&self, other: &Self, margin: f32) -> bool {
        let origin = spheres(&self.middle)[0].center;
        let [first, second] =
            [self, other].map(|side| map(&side.middle, |sphere| Sphere::new(sphere.center - origin, sphere.radius)));
        let path = (self.half_motion - other.half_motion).length() + self.deviation + other.deviation;
        let found = for_primitives!(Hull: &first, &second, |a, b| separation(a, b, 0));
        found.distance <= margin + path
    }

    fn meets_whenever(&self, other: &Self, margin: f32) -> bool {
        self.aabb.inflated(margin).overlaps(&other.aabb)
    }

    fn meets_fixed(&self, fixed: &Obb, margin: f32) -> bool {
        let local =
            map(&self.middle, |sphere| Sphere::new(fixed.pose.inverse_transform_point(sphere.center), sphere.radius));
        let cuboid = Cuboid { half: fixed.half_extents };
        let distance = match &local {
            Hull::Sphere(spheres) => separation(spheres, &cuboid, 0).distance,
            Hull::Cone(spheres) => separation(spheres, &cuboid, 0).distance,
            Hull::Slab(spheres) => separation(spheres, &cuboid, 0).distance,
        };
        distance <= margin + self.half_motion.length() + self.deviation
    }
}

fn map(hull: &Hull, mut change: impl FnMut(Sphere) -> Sphere) -> Hull {
    match *hull {
        Hull::Sphere(spheres) => Hull::Sphere(spheres.map(&mut change)),
        Hull::Cone(spheres) => Hull::Cone(spheres.map(&mut change)),
        Hull::Slab(spheres) => Hull::Slab(spheres.map(&mut change)),
    }
}

/// A small cone around spheres. Its axis joins two spheres that are far apart. The ends move inwards in steps, radii grow until all spheres are inside,
/// and the cone with the smallest surface is used.
fn cone_around(spheres: &[Sphere]) -> [Sphere; 2] {
    let farthest = |from: Vec3| {
        spheres.iter().copied().max_by(|a, b| a.farthest(from).total_cmp(&b.farthest(from))).unwrap_or_default()
    };
    let first = farthest(Aabb::from_spheres(spheres.iter().copied()).center());
    let second = farthest(first.center);
    let cones = (0..10).map(|step| {
        let inwards = step as f32 / 20.0;
        let [a, b] = [first.lerp(&second, inwards), second.lerp(&first, inwards)];
        let growth = spheres.iter().map(|sphere| protrusion(sphere, [&a, &b])).fold(0.0, f32::max);
        [a, b].map(|end| Sphere::new(end.center, (end.radius + growth) * (1.0 + 1e-6)))
    });
    let surface = |[a, b]: &[Sphere; 2]| {
        let radius = a.radius + b.radius;
        radius * (a.center.distance(b.center) + radius)
    };
    cones.min_by(|one, other| surface(one).total_cmp(&surface(other))).unwrap_or([first, second])
}

/// How far a sphere protrudes from a cone.
fn protrusion(sphere: &Sphere, [a, b]: [&Sphere; 2]) -> f32 {
    min_of_convex(|t| {
        let inner = a.lerp(b, t as f32);
        f64::from(inner.center.distance(sphere.center) + sphere.radius - inner.radius)
    }) as f32
}

#[cfg(test)]
mod tests {
    use bevy_medial::random::Random;

    use super::*;

    #[test]
    fn a_cone_around_spheres_contains_them() {
        let mut random = Random(7);
        for _ in 0..200 {
            let spheres: Vec<Sphere> =
                (0..2 + random.below(20)).map(|_| Sphere::new(random.in_cube(), 0.3 * random.unit())).collect();
            let [a, b] = cone_around(&spheres);
            let worst = spheres.iter().map(|sphere| protrusion(sphere, [&a, &b])).fold(f32::MIN, f32::max);
            assert!(worst < 1e-5, "{worst}");
        }
    }
}
