//! Contact points and manifolds.

use std::cmp::Ordering;

use glam::{Quat, Vec3};

use crate::geometry::Pose3;

/// A contact point of two primitives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contact {
    /// Point on the first surface, in the frame of body 1.
    pub point1: Vec3,
    /// Point on the second surface, in the frame of body 2.
    pub point2: Vec3,
    /// Unit normal from 1 to 2, in the frame of body 1.
    pub normal1: Vec3,
    /// Distance along the normal in metres; negative for an overlap.
    pub distance: f32,
    /// Primitive of the first body.
    pub primitive1: u32,
    /// Primitive or part of the second body.
    pub primitive2: u32,
}

impl Contact {
    /// Total order with the deepest contact first. It depends only on the contacts themselves.
    pub(in crate::pipeline) fn order(&self, other: &Self) -> Ordering {
        let parts = |contact: &Self| (contact.primitive1, contact.primitive2);
        let place = |a: Vec3, b: Vec3| (0..3).map(|i| a[i].total_cmp(&b[i])).fold(Ordering::Equal, Ordering::then);
        self.distance
            .total_cmp(&other.distance)
            .then(parts(self).cmp(&parts(other)))
            .then_with(|| place(self.point1, other.point1).then(place(self.point2, other.point2)))
    }
}

/// Up to four contacts that share a normal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Manifold {
    /// Unit normal of the first and deepest contact, from 1 to 2, in the frame of body 1.
    pub normal1: Vec3,
    points: [Contact; 4],
    len: u8,
}

impl Manifold {
    /// Creates a manifold of 1 to 4 contacts, sorted by depth, the deepest first.
    pub(in crate::pipeline) fn new(contacts: &[Contact]) -> Self {
        let points = std::array::from_fn(|i| contacts[i.min(contacts.len() - 1)]);
        Self { normal1: contacts[0].normal1, points, len: contacts.len().min(4) as u8 }
    }

    /// Returns the contacts, the deepest first.
    pub fn contacts(&self) -> &[Contact] {
        &self.points[..usize::from(self.len)]
    }

    /// Returns the manifold with the same points on both bodies at another relative pose. `turn`: rotation of the normals.
    pub(in crate::pipeline) fn at(&self, pose12: &Pose3, turn: Quat) -> Self {
        let mut points = self.points;
        let points = &mut points[..usize::from(self.len)];
        for contact in points.iter_mut() {
            contact.normal1 = turn * contact.normal1;
            contact.distance = (pose12.transform_point(contact.point2) - contact.point1).dot(contact.normal1);
        }
        points.sort_unstable_by(Contact::order);
        Self::new(points)
    }
}
