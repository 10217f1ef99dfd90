//! Seams: where the parts of a body meet, its surface goes on, and no edge or side of a part there is the body's own.
//!
//! A ball on a plain of triangles touches the one beneath it, and is near the edges of the next. Their contacts, which push it back, are not
//! those of the plain. What they touch belongs to the first triangle as well, which has another normal there; and what they would hold back
//! slides over them. The same goes for boxes side by side, and for the primitives of a medial mesh.

use glam::{Quat, Vec3};

use super::contact::Contact;
use crate::{
    constants::{SEAM, SEAM_COSINE},
    query::Separation,
};

/// One side of a pair: how a point and a part of it lie to each other, in that side's frame.
pub(super) type Side<'a> = &'a dyn Fn(u32, Vec3) -> Option<Separation>;

/// A piece of a body's surface: a part of it near a point, with the outward normal there.
#[derive(Clone, Copy)]
struct Patch {
    part: u32,
    point: Vec3,
    normal: Vec3,
}

/// Removes contacts with what other parts cover, the deepest contacts first; leaves the others sorted by depth.
///
/// `rotation12`: rotation of body 2 in the frame of body 1.
pub(super) fn remove(contacts: &mut Vec<Contact>, rotation12: Quat, sides: [Side; 2]) {
    contacts.sort_by(Contact::order);
    let rotation21 = rotation12.inverse();
    let mut known: Vec<[Patch; 2]> = Vec::with_capacity(contacts.len());
    contacts.retain(|contact| {
        let touched = [
            Patch { part: contact.primitive1, point: contact.point1, normal: contact.normal1 },
            Patch { part: contact.primitive2, point: contact.point2, normal: rotation21 * -contact.normal1 },
        ];
        for i in 0..2 {
            if let Some(patch) = known.iter().find_map(|patches| patches[i].continued(&touched[i], sides[i])) {
                let mut patches = touched;
                patches[i] = patch;
                patches[1 - i].normal = if i == 0 { rotation21 * -patch.normal } else { rotation12 * -patch.normal };
                known.push(patches);
                return false;
            }
        }
        known.push(touched);
        true
    });
}

impl Patch {
    /// The touched part as a continuation of this surface, if it is one: this part is there too, goes on to where the normal
    /// leans, and the touched part does not rise above it.
    fn continued(&self, touched: &Patch, side: Side) -> Option<Patch> {
        let height = (touched.point - self.point).dot(self.normal);
        if self.part == touched.part || height > SEAM || self.normal.dot(touched.normal) >= SEAM_COSINE {
            return None;
        }
        let along = touched.normal.reject_from_normalized(self.normal).try_normalize()?;
        let reaches = |part: u32, point: Vec3| side(part, point).filter(|s| s.distance <= SEAM);
        let level = touched.point - self.normal * height.max(0.0);
        reaches(self.part, level)?;
        reaches(self.part, level + along * (2.0 * SEAM))?;
        let above = touched.point + self.normal * (2.0 * SEAM - height);
        if reaches(touched.part, above).is_some() {
            return None;
        }
        let beyond = side(touched.part, above - along * (2.0 * SEAM))?;
        Some(Patch { normal: -beyond.normal, ..*touched })
    }
}
