//! Ray casts against medial shapes and their primitives: the entry point, or the exit point for a ray that starts inside.

use std::cell::Cell;

use bevy_rapier3d::parry::{
    math::Real,
    query::{Ray, RayCast, RayIntersection},
    shape::FeatureId,
};

use super::{primitive::PrimitiveShape, shape::MedialShape};
use crate::{
    constants::CONTACT_ROUNDING,
    geometry::Aabb,
    pipeline::{Hull, with_spheres},
    query::{RayHit, ray_cast},
};

/// The part of a ray inside a primitive.
#[derive(Clone, Copy)]
struct Span {
    enter: RayHit,
    /// Time of the exit, and outward normal there.
    leave: RayHit,
    primitive: u32,
}

impl RayCast for MedialShape {
    /// Without `solid`, a ray that starts inside hits where it leaves the union of the overlapping primitives. The normal points inwards there, as for parry's
    /// own shapes.
    fn cast_local_ray_and_get_normal(&self, ray: &Ray, max_time: Real, solid: bool) -> Option<RayIntersection> {
        let hit = self.enter(ray, max_time)?;
        if solid || hit.time_of_impact > 0.0 { Some(hit) } else { self.leave(ray, max_time) }
    }
}

impl RayCast for PrimitiveShape {
    fn cast_local_ray_and_get_normal(&self, ray: &Ray, max_time: Real, solid: bool) -> Option<RayIntersection> {
        let hit = enter(&self.hull, ray, max_time)?;
        if solid || hit.time > 0.0 {
            return Some(RayIntersection::new(hit.time, hit.normal, FeatureId::Face(0)));
        }
        let leave = leave(&self.hull, ray, hit);
        (leave.time <= max_time).then(|| RayIntersection::new(leave.time, -leave.normal, FeatureId::Face(0)))
    }
}

impl MedialShape {
    /// Returns the first entry of the ray, at time 0 if it starts inside.
    fn enter(&self, ray: &Ray, max_time: f32) -> Option<RayIntersection> {
        let (hit, primitive) = self.shape.ray_cast(ray.origin, ray.dir, max_time)?;
        Some(RayIntersection::new(hit.time, hit.normal, FeatureId::Face(primitive)))
    }

    /// Returns the exit of a ray that starts inside. Follows the ray through overlapping primitives.
    pub(super) fn leave(&self, ray: &Ray, max_time: f32) -> Option<RayIntersection> {
        let mut spans = Vec::new();
        self.shape.visit_crossed(ray.origin, ray.dir, &Cell::new(f32::MAX), |primitive, hull| {
            if let Some(enter) = enter(&hull, ray, f32::MAX) {
                spans.push(Span { enter, leave: leave(&hull, ray, enter), primitive });
            }
        });
        spans.sort_by(|a, b| a.enter.time.total_cmp(&b.enter.time));
        let gap = CONTACT_ROUNDING * self.shape.bounding_sphere().radius / ray.dir.length();
        let mut last: Option<Span> = None;
        for span in spans {
            let reached = last.map_or(0.0, |last| last.leave.time + gap);
            if span.enter.time <= reached && last.is_none_or(|last| span.leave.time > last.leave.time) {
                last = Some(span);
            }
        }
        let Span { leave, primitive, .. } = last?;
        let feature = FeatureId::Face(primitive);
        (leave.time <= max_time).then(|| RayIntersection::new(leave.time, -leave.normal, feature))
    }
}

fn enter(hull: &Hull, ray: &Ray, max_time: f32) -> Option<RayHit> {
    with_spheres!(hull, |spheres| ray_cast(spheres, ray.origin, ray.dir, max_time))
}

/// Returns the exit of a ray from a primitive, as the entry of the reversed ray that starts beyond the primitive.
fn leave(hull: &Hull, ray: &Ray, enter: RayHit) -> RayHit {
    let speed = ray.dir.length();
    if speed == 0.0 {
        return enter;
    }
    let around = with_spheres!(hull, |spheres| Aabb::from_spheres(*spheres));
    let beyond = ray.point_at(enter.time) + ray.dir * (1.1 * around.extent_squared().sqrt() / speed);
    let back = with_spheres!(hull, |spheres| ray_cast(spheres, beyond, -ray.dir, f32::MAX));
    match back {
        Some(back) => RayHit { time: enter.time + 1.1 * around.extent_squared().sqrt() / speed - back.time, ..back },
        // The ray only grazes the primitive.
        None => enter,
    }
}
