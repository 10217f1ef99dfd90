//! Fewer contacts, where fine medial shapes touch along long ways or over wide areas: the rest of the step takes a few of them, spread out.
//!
//! Not where a body lies on another collider: its parts may be of any size, and each edge between them has to be told from a true one.

use bevy::platform::collections::HashSet;
use glam::IVec3;

use super::contact::Contact;
use crate::{
    constants::{MANY_CONTACTS, THIN_CELLS, THIN_NORMALS},
    geometry::Aabb,
};

/// Places and directions that have a contact.
pub(super) type Taken = HashSet<[IVec3; 2]>;

/// Leaves at most [`MANY_CONTACTS`], sorted by depth: of those near each other that push about the same way only the deepest. Where there are no more,
/// nothing changes.
/// `taken`: room to work in.
pub(super) fn thin(contacts: &mut Vec<Contact>, taken: &mut Taken) {
    contacts.sort_unstable_by(Contact::order);
    let around = contacts.iter().fold(Aabb::EMPTY, |aabb, c| aabb.merge(Aabb { min: c.point1, max: c.point1 }));
    let extent = 2.0 * around.half_extents().max_element();
    let mut cells = THIN_CELLS;
    while contacts.len() > MANY_CONTACTS && cells >= 1.0 {
        taken.clear();
        contacts.retain(|contact| {
            // All in one cell, where they are all at one place.
            let place = ((contact.point1 - around.min) * (cells / extent.max(f32::MIN_POSITIVE))).as_ivec3();
            taken.insert([place, (contact.normal1 * THIN_NORMALS).round().as_ivec3()])
        });
        cells *= 0.5;
    }
    // So many that each pushes another way.
    contacts.truncate(MANY_CONTACTS);
}
