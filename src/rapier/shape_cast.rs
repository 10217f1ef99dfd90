//! Linear shape casts of a medial shape and any other collider, without rotation.

use bevy_rapier3d::parry::{
    query::{ShapeCastHit, ShapeCastStatus, details::ShapeCastOptions},
    shape::Shape as ParryShape,
};
use glam::Vec3;

use super::{parts::parts_within, shape::MedialShape};
use crate::{
    geometry::{Aabb, Placement, Pose3, Sphere},
    pipeline::{Core, Part, Parts, Shape, with_spheres},
    query::{Cuboid, Moving, Support, TimeOfImpact, TimeOfImpactStatus, time_of_impact},
};

/// The first touch found so far.
struct Touch {
    time: f32,
    toi: TimeOfImpact,
    /// Displacement of the medial shape until the touch, in the other collider's frame.
    displacement: Vec3,
    /// Pose of the contact's frame in the other collider's frame.
    frame: Pose3,
    /// Lengths that were added to the radii of the medial shape, in metres: the part's rounding, and the target distance.
    grown: [f32; 2],
}

/// Finds the first time at which a medial shape and another collider come within the target distance. `pose12` and `velocity12`: pose and velocity of the
/// other collider in the frame of the medial shape.
///
/// Each pair of convex parts is tested separately, including the test whether an overlap at the start counts. Of several overlaps at the start, the deepest one
/// is returned.
pub(super) fn first_touch(
    shape: &Shape,
    other: &dyn ParryShape,
    pose12: &Pose3,
    velocity12: Vec3,
    options: &ShapeCastOptions,
) -> Option<ShapeCastHit> {
    // All coordinates are in the frame of the other collider, which is at rest there.
    let pose21 = pose12.inverse();
    let velocity = pose21.rotation * -velocity12;
    let max_time = if velocity == Vec3::ZERO { 0.0 } else { options.max_time_of_impact };
    let around = shape.aabb().transformed(&pose21, 1.0).inflated(options.target_distance);
    let [begin, end] = times_near(other, &around, velocity, max_time)?;
    let mut earliest: Option<Touch> = None;
    for part in convex_parts(other, &around.swept(velocity, [begin, end])) {
        let pose = part.pose.inv_mul(&pose21);
        let velocity = part.pose.rotation.inverse() * velocity;
        let margin = part.rounding + options.target_distance;
        let around = shape.aabb().transformed(&pose, 1.0).inflated(options.target_distance);
        let target = part.aabb();
        let end = earliest.as_ref().map_or(end, |touch| touch.time);
        let Some([begin, end]) = times_within(&target, &around, velocity, end) else { continue };
        let translation = pose.translation.as_dvec3() + velocity.as_dvec3() * f64::from(begin);
        let start = Pose3::from_parts(translation.as_vec3(), pose.rotation);
        let placement = Placement::from(start);
        let displacement = velocity * (end - begin);
        let near = |aabb: &Aabb| {
            let around = aabb.transformed(&start, shape.scale).inflated(options.target_distance);
            times_within(&target, &around, displacement, 1.0).is_some()
        };
        shape.bvh().visit(near, |primitive| {
            let limit = earliest.as_ref().map_or(1.0, |touch| ((touch.time - begin) / (end - begin)).clamp(0.0, 1.0));
            let toi = with_spheres!(shape.hull(primitive).placed(&placement), |spheres| {
                let start = spheres.map(|sphere| Sphere::new(sphere.center, sphere.radius + margin));
                time_to(&Moving { start, motion: spheres.map(|_| displacement) }, &part.core, limit)
            });
            let overlaps = toi.status == TimeOfImpactStatus::Overlapping && begin == 0.0;
            let parts_again = overlaps && toi.contact.normal.dot(velocity) <= 0.0;
            if toi.status == TimeOfImpactStatus::Separated || (parts_again && !options.stop_at_penetration) {
                return;
            }
            let time = begin + toi.fraction * (end - begin);
            let is_first = earliest.as_ref().is_none_or(|best| {
                time < best.time || (time == best.time && toi.contact.distance < best.toi.contact.distance)
            });
            if is_first {
                let grown = [part.rounding, options.target_distance];
                earliest = Some(Touch {
                    time,
                    toi,
                    displacement: part.pose.rotation * velocity * time,
                    frame: part.pose,
                    grown,
                });
            }
        });
    }
    earliest.map(|touch| touch.hit(&pose21))
}

impl Touch {
    fn hit(&self, pose21: &Pose3) -> ShapeCastHit {
        let [rounding, target_distance] = self.grown;
        let contact = &self.toi.contact;
        let normal = self.frame.rotation * contact.normal;
        let point1 = self.frame.transform_point(contact.point1) - normal * (rounding + target_distance);
        let point2 = self.frame.transform_point(contact.point2) - normal * rounding;
        ShapeCastHit {
            time_of_impact: self.time,
            witness1: pose21.inverse_transform_point(point1 - self.displacement),
            witness2: point2,
            normal1: pose21.rotation.inverse() * normal,
            normal2: -normal,
            status: match self.toi.status {
                TimeOfImpactStatus::IterationLimit => ShapeCastStatus::OutOfIterations,
                TimeOfImpactStatus::Overlapping if self.time == 0.0 && contact.distance < 0.0 => {
                    ShapeCastStatus::PenetratingOrWithinTargetDist
                }
                _ => ShapeCastStatus::Converged,
            },
        }
    }
}

/// Finds the time of impact of a moving primitive and a convex shape at rest.
fn time_to<const N: usize>(moving: &Moving<N>, core: &Core, limit: f32) -> TimeOfImpact {
    match core {
        Core::Cuboid(half) => time_of_impact(moving, &Cuboid { half: *half }, limit),
        Core::Support(shape) => time_of_impact(moving, &Support(&**shape), limit),
        Core::Hull(hull) => with_spheres!(*hull, |spheres| {
            let still = Moving { start: spheres, motion: spheres.map(|_| Vec3::ZERO) };
            time_of_impact(moving, &still, limit)
        }),
    }
}

/// Returns the convex parts of a collider within `reach`, a box in its frame. The parts of a medial shape are its primitives.
fn convex_parts<'a>(other: &'a dyn ParryShape, reach: &Aabb) -> Parts<'a> {
    let Some(medial) = other.as_shape::<MedialShape>() else { return parts_within(other, reach) };
    let shape = &medial.shape;
    let reach = reach.transformed(&Pose3::IDENTITY, 1.0 / shape.scale);
    let mut parts = Parts::new();
    shape.bvh().overlapping(&reach, |id| {
        parts.push(Part { id, pose: Pose3::IDENTITY, core: Core::Hull(shape.hull(id)), rounding: 0.0 });
    });
    parts
}

/// Returns the first and last time at which a moving box may touch a collider. `None` if it cannot touch until `max_time`.
fn times_near(other: &dyn ParryShape, moving: &Aabb, velocity: Vec3, max_time: f32) -> Option<[f32; 2]> {
    let Some(half_space) = other.as_halfspace() else {
        let aabb = other.compute_local_aabb();
        return times_within(&Aabb { min: aabb.mins, max: aabb.maxs }, moving, velocity, max_time);
    };
    // For a half-space, from the first touch until the whole box is below the plane.
    let height = half_space.normal.dot(moving.center());
    let half = half_space.normal.abs().dot(moving.half_extents());
    let sinking = -half_space.normal.dot(velocity);
    let [enter, leave] = match sinking > 0.0 {
        true => [height - half, height + half].map(|height| (height / sinking).max(0.0)),
        false => [if height <= half { 0.0 } else { f32::INFINITY }, 0.0],
    };
    (enter <= leave.min(max_time)).then_some([enter, leave.min(max_time)])
}

/// Returns the first and last time at which a moving box overlaps with a box at rest. `None` if they do not overlap until `max_time`.
fn times_within(target: &Aabb, moving: &Aabb, velocity: Vec3, max_time: f32) -> Option<[f32; 2]> {
    let half = moving.half_extents();
    let around = Aabb { min: target.min - half, max: target.max + half };
    // Rounding error of the coordinates.
    let rounding = f32::EPSILON * moving.center().abs().max_element();
    around.inflated(rounding).crossing(moving.center(), velocity, max_time)
}
