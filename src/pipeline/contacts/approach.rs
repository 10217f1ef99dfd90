//! Contacts ahead of fast bodies: which of them the bodies will reach.

use crate::{
    geometry::{Placement, Pose3, Sphere, Sweep},
    pipeline::{Contact, OtherShape, Part, Shape, sweep::motion::with_core, with_spheres},
    query::{Moving, Rigid, TimeOfImpactStatus, time_of_impact},
};

/// Motion of the first body of a pair in the frame of the second, in the coming step at their current velocities. Every point moves on a line.
#[derive(Clone, Copy, Debug)]
pub(in crate::pipeline) struct Approach {
    start: Pose3,
    end: Pose3,
}

impl Approach {
    /// Creates the relative motion from the motions of both bodies in the coming step.
    pub fn new([first, second]: &[Sweep; 2]) -> Self {
        Self { start: second.start.inv_mul(&first.start), end: second.end.inv_mul(&first.end) }
    }

    /// Returns true if the primitives of a contact touch in the coming step.
    pub fn reaches(&self, contact: &Contact, shape1: &Shape, second: OtherShape) -> bool {
        let hull = shape1.hull(contact.primitive1);
        match second {
            OtherShape::Shape(shape2) => with_spheres!(hull, |first| with_spheres!(
                shape2.hull(contact.primitive2),
                |second| self.meets(&first, &second, &Pose3::IDENTITY)
            )),
            OtherShape::Parts(parts) => {
                let [start, end] = [self.start, self.end].map(|pose| hull.placed(&Placement::from(pose)).aabb());
                let parts = parts.within(&start.merge(end).inflated(contact.distance));
                let part = parts.iter().find(|part| part.id == contact.primitive2);
                part.is_some_and(|part| with_spheres!(hull, |first| self.meets_part(&first, part)))
            }
        }
    }

    fn meets_part<const N: usize>(&self, first: &[Sphere; N], part: &Part) -> bool {
        let first = first.map(|sphere| Sphere::new(sphere.center, sphere.radius + part.rounding));
        with_core!(part, |second| self.meets(&first, second, &part.pose))
    }

    /// Returns true if a primitive touches a convex shape. `frame`: pose of the shape in the frame of the second body.
    fn meets<const N: usize>(&self, first: &[Sphere; N], second: &impl Rigid, frame: &Pose3) -> bool {
        let ends = [self.start, self.end].map(|pose| Placement::from(frame.inv_mul(&pose)));
        let moving: Moving<N> = first.along([&ends[0], &ends[1]]);
        let second = second.along([&Placement::IDENTITY; 2]);
        time_of_impact(&moving, &second, 1.0).status != TimeOfImpactStatus::Separated
    }
}

#[cfg(test)]
mod tests {
    use glam::{Quat, Vec3};

    use super::*;
    use crate::{medial_axis::MedialAxis, pipeline::contacts::find, query::Cuboid};

    /// A ball ahead of a wall, and a ball that flies past its edge.
    #[test]
    fn contacts_of_bodies_that_pass_are_not_reached() {
        let ball = Shape::new(MedialAxis::sphere(0.1).unwrap());
        let plate = Shape::new(MedialAxis::rounded_box(Vec3::new(0.05, 1.0, 1.0), 0.05).unwrap());
        let cuboid = Cuboid { half: Vec3::new(0.05, 1.0, 1.0) };
        let frame = Pose3::from_parts(Vec3::new(3.0, -2.0, 1.0), Quat::from_rotation_x(0.7));
        for second in [OtherShape::Shape(&plate), OtherShape::Parts(&cuboid)] {
            let mut reached = Vec::new();
            for (place, displacement) in [
                (Vec3::new(-0.16, 0.0, 0.0), Vec3::X),
                (Vec3::new(-0.16, 0.0, 0.0), Vec3::NEG_X),
                (Vec3::new(-0.16, 0.0, 0.0), Vec3::Y),
                (Vec3::new(-0.06, 1.106, 0.0), Vec3::X),
                (Vec3::new(-0.06, 1.106, 0.0), Vec3::new(1.0, -1.0, 0.0)),
                (Vec3::new(-0.16, 0.0, 0.0), Vec3::new(0.02, 0.5, 0.0)),
            ] {
                let start = frame * Pose3::from_translation(place);
                let sweeps =
                    [Sweep::at_rates(start, Vec3::ZERO, frame.rotation * displacement, Vec3::Z), Sweep::at_rest(frame)];
                let mut contacts = Vec::new();
                find(&ball, second, &start.inv_mul(&frame), 0.02, &mut contacts);
                assert!(!contacts.is_empty() && contacts.iter().all(|c| c.distance > 5e-3), "{place}: {contacts:?}");
                let approach = Approach::new(&sweeps);
                reached.push(contacts.iter().any(|contact| approach.reaches(contact, &ball, second)));
            }
            assert_eq!(reached, [true, false, false, false, true, true]);
        }
    }
}
