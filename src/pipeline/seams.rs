//! Seams: where the parts of a body meet, its surface goes on, and no edge or side of a part there is the body's own.
//!
//! A ball on a plain of triangles touches the one beneath it, and is near the edges of the next. Contacts with those would push it back, yet
//! it slides over them. They show: where such a contact touches, the surface of another part passes, and the contact's normal leans over it.
//! The same goes for boxes side by side, and for the primitives of a medial mesh.

use glam::{Quat, Vec3};

use super::contact::Contact;
use crate::{
    constants::{SEAM, SEAM_COSINE},
    query::Separation,
};

/// One side of a pair: how the point `point + offset` and a part of it lie to each other, in that side's frame.
pub(super) type Side<'a> = &'a dyn Fn(u32, Vec3, Vec3) -> Option<Separation>;

/// Removes contacts with edges and sides that parts with deeper contacts cover; leaves the others sorted by depth.
///
/// `rotation12`: rotation of body 2 in the frame of body 1.
pub(super) fn remove(contacts: &mut Vec<Contact>, rotation12: Quat, sides: [Side; 2]) {
    contacts.sort_by(Contact::order);
    let rotation21 = rotation12.inverse();
    let touched = |contact: &Contact| {
        [
            Touch { part: contact.primitive1, point: contact.point1, normal: contact.normal1, distance: contact.distance },
            Touch { part: contact.primitive2, point: contact.point2, normal: rotation21 * -contact.normal1, distance: contact.distance },
        ]
    };
    let mut kept: Vec<Contact> = Vec::with_capacity(contacts.len());
    let mut parts: [Vec<u32>; 2] = Default::default();
    for contact in contacts.iter() {
        let touches = touched(contact);
        for (parts, touch) in parts.iter_mut().zip(&touches) {
            if !parts.contains(&touch.part) {
                parts.push(touch.part);
            }
        }
        let known = kept.iter().any(|other| other.normal1.dot(contact.normal1) >= SEAM_COSINE);
        let is_covered = |i: usize| parts[i].iter().any(|part| touches[i].is_covered(*part, sides[i]));
        if known || kept.is_empty() || !(is_covered(0) || is_covered(1)) {
            kept.push(*contact);
        }
    }
    // Of contacts about as deep, any may come first.
    for i in (0..kept.len()).rev() {
        let touches = touched(&kept[i]);
        let is_covered = kept.iter().any(|other| {
            other.normal1.dot(kept[i].normal1) < SEAM_COSINE
                && other.distance <= kept[i].distance + SEAM
                && (0..2).any(|side| touches[side].is_covered(touched(other)[side].part, sides[side]))
        });
        if is_covered {
            kept.remove(i);
        }
    }
    *contacts = kept;
}

/// Where a part of one side is touched, and its outward normal there.
struct Touch {
    part: u32,
    point: Vec3,
    normal: Vec3,
    distance: f32,
}

impl Touch {
    /// True if the surface of `other` passes here with another normal, and the touched part does not rise above it.
    fn is_covered(&self, other: u32, side: Side) -> bool {
        let reach = 4.0 * SEAM;
        let Some(s) = side(other, self.point, self.normal * reach) else { return false };
        let up = -s.normal;
        let cosine = up.dot(self.normal);
        let height = s.distance - reach * cosine;
        if height > SEAM || !(-0.01..SEAM_COSINE).contains(&cosine) {
            return false;
        }
        if other == self.part {
            return self.distance > 0.0 || s.distance > 0.5 * reach;
        }
        side(self.part, self.point, up * (2.0 * SEAM - height)).is_none_or(|s| s.distance > SEAM)
    }
}
