//! Time of impact of a medial shape and any other collider in motion, for rapier's own continuous collision detection of its fast bodies
//! against medial shapes.

use bevy_rapier3d::parry::{
    query::{NonlinearRigidMotion, ShapeCastHit, ShapeCastStatus},
    shape::Shape as ParryShape,
};

use super::{parts::visit_parts, shape::MedialShape};
use crate::{
    constants::{CHORD_TOLERANCE, STOP_SLOP},
    geometry::{Aabb, Pose3, Sphere, Sweep},
    pipeline::{Second, with_spheres},
    query::{Chords, Cuboid, Support, TimeOfImpact, TimeOfImpactStatus, rigid_impact},
};

/// The earliest impact between two times, in seconds, the medial shape first. None if there is none, or if the shape is unknown.
///
/// An impact is where an overlap grows by more than a slop, told at the touch before that. With `stop_at_penetration` an overlap at the
/// start is one as well.
pub(super) fn first_impact(
    (first, motion1): (&MedialShape, &NonlinearRigidMotion),
    (other, motion2): (&dyn ParryShape, &NonlinearRigidMotion),
    [begin, end]: [f32; 2],
    stop_at_penetration: bool,
) -> Option<ShapeCastHit> {
    let [sweep1, sweep2] = [motion1, motion2].map(|motion| sweep(motion, begin, end));
    let bound = first.shape.bounding_sphere();
    let arm = first.shape.arm(sweep1.local_center);
    // Everything that the other collider meets, in its frame at the start.
    let other_arm = other.compute_local_bounding_sphere();
    let other_arm = other_arm.center.distance(sweep2.local_center) + other_arm.radius;
    let way = (sweep1.translation - sweep2.translation).length()
        + sweep1.rotation.length().min(2.0) * first.shape.radius_about(sweep1.local_center)
        + sweep2.rotation.length().min(2.0) * (other_arm + bound.radius);
    let seen = sweep1.seen_from(&sweep2.start);
    let start = seen.start.transform_point(bound.center);
    let reach = Aabb::from_spheres([Sphere::new(start, bound.radius + way)]);

    let mut earliest: Option<(TimeOfImpact, Pose3)> = None;
    visit_parts(other, &reach, &mut |part| {
        if matches!(part.second, Second::Shape(_)) {
            return;
        }
        let part_sweep = Sweep {
            start: sweep2.start * part.pose,
            end: sweep2.end * part.pose,
            local_center: part.pose.inverse_transform_point(sweep2.local_center),
            ..sweep2
        };
        let chords = Chords::in_frame_of_second([&sweep1, &part_sweep], arm, CHORD_TOLERANCE * bound.radius);
        let slop = STOP_SLOP * bound.radius;
        let target = part.second.aabb().inflated(part.rounding + way);
        let pose21 = part_sweep.start.inv_mul(&sweep1.start);
        let near = |aabb: &Aabb| aabb.transformed(&pose21, first.shape.scale).overlaps(&target);
        first.shape.bvh().visit(near, |primitive| {
            let limit = earliest.as_ref().map_or(1.0, |(toi, _)| toi.fraction);
            let toi = with_spheres!(first.shape.hull(primitive), |spheres| {
                let spheres = spheres.map(|s| Sphere::new(s.center, s.radius + part.rounding));
                match part.second {
                    Second::Cuboid(half) => rigid_impact(&spheres, &Cuboid { half }, &chords, limit, slop),
                    Second::Support(shape) => rigid_impact(&spheres, &Support(shape), &chords, limit, slop),
                    Second::Hull(hull) => {
                        with_spheres!(hull, |other| rigid_impact(&spheres, &other, &chords, limit, slop))
                    }
                    Second::Shape(_) => return,
                }
            });
            let counts = toi.status != TimeOfImpactStatus::Separated && (toi.fraction > 0.0 || stop_at_penetration);
            if counts && earliest.as_ref().is_none_or(|(best, _)| toi.fraction < best.fraction) {
                earliest = Some((toi, part.pose));
            }
        });
    });

    let (toi, part) = earliest?;
    let normal2 = part.rotation * -toi.contact.normal;
    let [pose1, pose2] = [&sweep1, &sweep2].map(|sweep| sweep.pose_at(toi.fraction));
    let point2 = part.transform_point(toi.contact.point2);
    Some(ShapeCastHit {
        time_of_impact: begin + toi.fraction * (end - begin),
        witness1: pose1.inverse_transform_point(pose2.transform_point(point2)),
        witness2: point2,
        normal1: pose1.rotation.inverse() * (pose2.rotation * -normal2),
        normal2,
        status: match toi.status {
            TimeOfImpactStatus::Overlapping => ShapeCastStatus::PenetratingOrWithinTargetDist,
            TimeOfImpactStatus::IterationLimit => ShapeCastStatus::OutOfIterations,
            TimeOfImpactStatus::Hit | TimeOfImpactStatus::Separated => ShapeCastStatus::Converged,
        },
    })
}

fn sweep(motion: &NonlinearRigidMotion, begin: f32, end: f32) -> Sweep {
    Sweep {
        start: motion.position_at_time(begin),
        end: motion.position_at_time(end),
        translation: motion.linvel * (end - begin),
        rotation: motion.angvel * (end - begin),
        local_center: motion.local_center,
    }
}
