//! Thinning of contacts where fine medial shapes touch along long lines or over wide areas. Later stages need only a few contacts that are spread out.
//!
//! Contacts with other colliders are not thinned. Parts of these colliders may have any size, and the removal of internal edges needs every contact.

use bevy::platform::collections::HashSet;
use glam::IVec3;

use crate::{constants::MANY_CONTACTS, geometry::Aabb, pipeline::Contact};

/// Cells of position and normal that have a contact.
pub(in crate::pipeline) type Taken = HashSet<[IVec3; 2]>;

/// Sorts contacts by depth and keeps at most [`MANY_CONTACTS`]: only the deepest of contacts in a cell of position and normal. The cells are enlarged until few
/// enough contacts are left. Shorter lists are only sorted.
///
/// `taken`: a buffer.
pub(in crate::pipeline) fn cluster(contacts: &mut Vec<Contact>, taken: &mut Taken) {
    contacts.sort_unstable_by(Contact::order);
    let around = contacts.iter().fold(Aabb::EMPTY, |aabb, c| aabb.merge(Aabb { min: c.point1, max: c.point1 }));
    let extent = 2.0 * around.half_extents().max_element();
    // Number of cells over the extent of the contacts, and over a unit of the normal. A power of two, so that one cell is left at the end.
    let mut cells = MANY_CONTACTS.next_power_of_two() as f32;
    while contacts.len() > MANY_CONTACTS && cells >= 1.0 {
        taken.clear();
        contacts.retain(|contact| {
            // If all contacts are at one point, they share a cell.
            let place = ((contact.point1 - around.min) * (cells / extent.max(f32::MIN_POSITIVE))).as_ivec3();
            taken.insert([place, (contact.normal1 * cells).round().as_ivec3()])
        });
        cells *= 0.5;
    }
    // One cell is left, and contacts with different normals remain.
    contacts.truncate(MANY_CONTACTS);
}
