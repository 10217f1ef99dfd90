//! Thinning of contacts where fine medial shapes touch along long lines or over wide areas. Later stages need only a few contacts that are spread out.
//!
//! Contacts with other colliders are not thinned. Parts of these colliders may have any size, and the removal of internal edges needs every contact.

use bevy::platform::collections::HashSet;
use glam::IVec3;

use crate::{
    constants::{CLUSTER_CELLS, CLUSTER_NORMALS, MANY_CONTACTS},
    geometry::Aabb,
    pipeline::Contact,
};

/// Cells of position and normal that have a contact.
pub(in crate::pipeline) type Taken = HashSet<[IVec3; 2]>;

/// Sorts contacts by depth and keeps at most [`MANY_CONTACTS`]: only the deepest of contacts that are near each other and have similar normals. Shorter lists
/// are only sorted.
///
/// `taken`: a buffer.
pub(in crate::pipeline) fn cluster(contacts: &mut Vec<Contact>, taken: &mut Taken) {
    contacts.sort_unstable_by(Contact::order);
    let around = contacts.iter().fold(Aabb::EMPTY, |aabb, c| aabb.merge(Aabb { min: c.point1, max: c.point1 }));
    let extent = 2.0 * around.half_extents().max_element();
    let mut cells = CLUSTER_CELLS;
    while contacts.len() > MANY_CONTACTS && cells >= 1.0 {
        taken.clear();
        contacts.retain(|contact| {
            // If all contacts are at one point, they share a cell.
            let place = ((contact.point1 - around.min) * (cells / extent.max(f32::MIN_POSITIVE))).as_ivec3();
            taken.insert([place, (contact.normal1 * CLUSTER_NORMALS).round().as_ivec3()])
        });
        cells *= 0.5;
    }
    // One cell is left, and contacts with different normals remain.
    contacts.truncate(MANY_CONTACTS);
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    #[test]
    fn both_walls_of_a_groove_keep_contacts() {
        // Two rows along x with normals 58 degrees apart. The second is deeper at every place.
        let contact = |number: u32| {
            let (side, along) = (number % 2, (number / 2) as f32 / 100.0);
            let lean = 29f32.to_radians() * if side == 0 { 1.0 } else { -1.0 };
            let point = Vec3::new(along, 0.0, 0.0);
            let normal1 = Vec3::new(0.0, lean.cos(), lean.sin());
            let distance = -1e-3 * side as f32;
            Contact { primitive1: number, primitive2: 0, point1: point, point2: point, normal1, distance }
        };
        let mut contacts: Vec<Contact> = (0..200).map(contact).collect();
        cluster(&mut contacts, &mut Taken::default());
        let walls = [0, 1].map(|side| contacts.iter().filter(|contact| contact.primitive1 % 2 == side).count());
        assert!(contacts.len() <= MANY_CONTACTS && walls.iter().all(|count| *count > 20), "{walls:?}");
    }
}
