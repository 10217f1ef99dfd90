//! Lower bounds of the distance of bodies that are apart. A pair is not searched until its bodies have moved by that distance.

use crate::{
    geometry::{Aabb, Placement, Pose3, Sphere},
    pipeline::{ConvexParts, Part, Shape, contacts::near::near_parts, sweep::motion::with_core, with_spheres},
    query::separation,
};

/// Returns the distance of a shape and another collider in metres, or `max` if it is larger. `pose12`: pose of the collider in the frame of the shape.
pub(in crate::pipeline) fn gap(shape1: &Shape, parts: &dyn ConvexParts, pose12: &Pose3, max: f32) -> f32 {
    let parts = near_parts(shape1, parts, pose12, max);
    parts.into_iter().fold(max, |least, part| of_part(shape1, part, pose12, least))
}

fn of_part(shape1: &Shape, part: Part, pose12: &Pose3, max: f32) -> f32 {
    let to_part = Placement::from((*pose12 * part.pose).inverse());
    let target = part.aabb();
    let bound = |aabb: &Aabb| to_part.aabb(&aabb.scaled(shape1.scale)).distance_to(&target);
    let distance = |primitive| {
        let hull = shape1.hull(primitive).placed(&to_part);
        with_spheres!(hull, |first| {
            let first = first.map(|s| Sphere::new(s.center, s.radius + part.rounding));
            with_core!(part, |second| separation(&first, second, 0).distance)
        })
    };
    if bound(&shape1.bvh().aabb()) >= max {
        return max;
    }
    shape1.bvh().least(bound, distance).map_or(max, |(_, distance)| distance.min(max))
}

#[cfg(test)]
mod tests {
    use glam::{Quat, Vec3};

    use super::*;
    use crate::{medial_axis::MedialAxis, query::Cuboid, random::Random};

    #[test]
    fn gaps_are_those_of_the_nearest_primitives() {
        let mut random = Random(3);
        let shape1 = Shape { axis: MedialAxis::torus(0.3, 0.05, 12).unwrap(), scale: 1.5 };
        let cuboid = Cuboid { half: Vec3::new(0.4, 0.1, 0.2) };
        let (mut apart, mut beyond) = (0, 0);
        for _ in 0..600 {
            let rotation = Quat::from_scaled_axis(random.in_cube() * 3.0);
            let pose12 = Pose3::from_parts(random.in_cube(), rotation);
            let to_second = Placement::from(pose12.inverse());
            let firsts = || (0..shape1.len() as u32).map(|i| shape1.hull(i).placed(&to_second));
            let to_cuboid = firsts().map(|first| with_spheres!(first, |a| separation(&a, &cuboid, 0).distance));
            let expected = to_cuboid.fold(f32::INFINITY, f32::min);
            let found = gap(&shape1, &cuboid, &pose12, 0.5);
            // A part of a box that is far away is left out, so the distance of an overlap may differ.
            assert!((found.max(0.0) - expected.clamp(0.0, 0.5)).abs() < 1e-5, "{found} instead of {expected}");
            apart += usize::from((1e-3..0.5).contains(&expected));
            beyond += usize::from(expected >= 0.5);
        }
        assert!(apart > 70 && beyond > 50, "{apart} apart, {beyond} beyond the limit");
    }
}
