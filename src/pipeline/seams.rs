//! Seams: where the parts of a body meet, its surface goes on, and no edge or side of a part there is the body's own.
//!
//! A ball on a plain of triangles touches the one beneath it, and is near the edges of the next. Contacts with those would push it back, yet
//! it slides over them. They show: where such a contact touches, the surface of another part passes, and the contact's normal leans over it.
//! The same goes for boxes side by side, and for the primitives of a medial mesh.

use bevy::platform::collections::{HashMap, hash_map::Entry};
use glam::{Quat, Vec3};

use super::contact::Contact;
use crate::{
    constants::{FLUSH, SAME_PLACE, SEAM_COSINE, SEAM_REACH},
    geometry::Aabb,
    query::Separation,
};

/// One side of a pair, in its own frame.
pub(super) trait Side {
    /// The box around a part.
    fn aabb(&self, part: u32) -> Aabb;

    /// How the point `point + normal * height` and a part lie to each other. None if the part stays more than `flush` beneath the plane through
    /// `point` across `normal`, a unit vector, or if there is no such part.
    fn separation(&self, part: u32, point: Vec3, normal: Vec3, height: f32, flush: f32) -> Option<Separation>;
}

/// Room to work in.
#[derive(Debug, Default)]
pub(super) struct Room {
    kept: Vec<(Contact, [Touch; 2])>,
    /// Those that are covered.
    removed: Vec<Contact>,
    parts: [TouchedParts; 2],
}

/// The deepest touch of each part of a side, with the box around the part and around all that it may cover.
#[derive(Debug, Default)]
struct TouchedParts {
    list: Vec<(Touch, Aabb)>,
    /// Where in the list a part is.
    places: HashMap<u32, usize>,
}

impl TouchedParts {
    fn clear(&mut self) {
        self.list.clear();
        self.places.clear();
    }

    /// Takes in a touch, unless there is one of that part.
    fn insert(&mut self, touch: Touch, reach: impl FnOnce(u32) -> Aabb) {
        if let Entry::Vacant(place) = self.places.entry(touch.part) {
            place.insert(self.list.len());
            self.list.push((touch, reach(touch.part)));
        }
    }

    /// The box around all that a part may cover.
    fn reach(&self, part: u32) -> Option<&Aabb> {
        self.places.get(&part).map(|place| &self.list[*place].1)
    }
}

/// Removes contacts with edges and sides of parts that other parts cover, which are in deeper contact or about as deep; leaves the others
/// sorted by depth, as they have to be.
///
/// `rotation12`: rotation of body 2 in the frame of body 1. `unit`: the length unit in metres.
pub(super) fn remove(
    contacts: &mut Vec<Contact>,
    rotation12: Quat,
    sides: [&dyn Side; 2],
    unit: f32,
    Room { kept, removed, parts }: &mut Room,
) {
    let rotation21 = rotation12.inverse();
    let [around, flush] = [SEAM_REACH, FLUSH].map(|length| length * unit);
    // What covers a place is nearer than this to a point above it.
    let reach = |side: usize, part: u32| sides[side].aabb(part).inflated(around + 2.0 * flush);
    let touches = |contact: &Contact| {
        let Contact { point1, point2, normal1, distance, primitive1, primitive2 } = *contact;
        let carries = distance <= -around;
        let normal2 = rotation21 * -normal1;
        [(primitive1, point1, normal1), (primitive2, point2, normal2)].map(|(part, point, normal)| Touch {
            part,
            point,
            normal,
            distance,
            carries,
        })
    };
    kept.clear();
    removed.clear();
    parts.iter_mut().for_each(TouchedParts::clear);
    for contact in contacts.iter() {
        let touches = touches(contact);
        for (side, (parts, touch)) in parts.iter_mut().zip(touches).enumerate() {
            parts.insert(touch, |part| reach(side, part));
        }
        let is_covered = |i: usize| {
            parts[i].list.iter().any(|(other, reach)| touches[i].is_covered(other, reach, sides[i], [around, flush]))
        };
        // Primitives that share a sphere touch at the same place.
        let is_known = || {
            let within = SAME_PLACE * unit;
            let mut as_deep = removed.iter().rev().take_while(|other| contact.distance <= other.distance + within);
            as_deep.any(|other| contact.pushes_as(other) && contact.point1.distance(other.point1) <= within)
        };
        // The deepest is there to stay, as is what has to be pushed out first, and what pushes the same way does no harm.
        let harmless =
            kept.is_empty() || contact.distance < -around || kept.iter().any(|(other, _)| contact.pushes_as(other));
        if harmless || !(is_known() || is_covered(0) || is_covered(1)) {
            kept.push((*contact, touches));
        } else {
            removed.push(*contact);
        }
    }
    // Of contacts about as deep, rounding says which comes first. What all pushes the same way does no harm.
    let one_way = kept.first().is_none_or(|(first, _)| kept.iter().all(|(contact, _)| contact.pushes_as(first)));
    let crossing = if one_way { 0 } else { kept.len() };
    for i in (0..crossing).rev() {
        let (contact, touched) = kept[i];
        if contact.distance < -around {
            break;
        }
        let is_covered = kept.iter().any(|(other, touches)| {
            !contact.pushes_as(other)
                && other.distance <= contact.distance + 0.25 * around
                && (0..2).any(|i| {
                    let reach = parts[i].reach(touches[i].part);
                    reach.is_some_and(|reach| touched[i].is_covered(&touches[i], reach, sides[i], [around, flush]))
                })
        });
        if is_covered {
            kept.remove(i);
        }
    }
    contacts.clear();
    contacts.extend(kept.iter().map(|(contact, _)| *contact));
}

impl Contact {
    fn pushes_as(&self, other: &Self) -> bool {
        self.normal1.dot(other.normal1) >= SEAM_COSINE
    }
}

/// Where a part of one side is touched, its outward normal there, and the contact's distance.
#[derive(Clone, Copy, Debug)]
struct Touch {
    part: u32,
    point: Vec3,
    normal: Vec3,
    distance: f32,
    carries: bool,
}

impl Touch {
    /// True if the surface of `other`, which may be the same part, passes here with another normal, and the touched part does not rise
    /// above it. `reach`: the box around all that `other` may cover. `around`, `flush`: [`SEAM_REACH`] and [`FLUSH`] in metres.
    fn is_covered(&self, other: &Touch, reach: &Aabb, side: &dyn Side, [around, flush]: [f32; 2]) -> bool {
        if !reach.contains_point(self.point + self.normal * around) {
            return false;
        }
        // Straight above the place: nothing of a part that ends here with this normal is nearer than the place itself.
        let Some(s) = side.separation(other.part, self.point, self.normal, around, flush) else { return false };
        // In the plane of a triangle both of its sides are as near; it is known which one is touched.
        let turned = s.distance.abs() < flush && other.normal.dot(s.normal) > 0.5;
        let (up, distance) = if turned { (s.normal, -s.distance) } else { (-s.normal, s.distance) };
        let cosine = up.dot(self.normal);
        // How high the place is over the surface, and how high the surface over the plane that is touched there.
        let height = distance - around * cosine;
        let rise = around - distance * cosine;
        let most = if self.carries { 0.5 } else { SEAM_COSINE };
        if height > flush || rise < 2.0e-4 * around || !(-0.1..most).contains(&cosine) {
            return false;
        }
        if other.part == self.part {
            return self.distance > 0.25 * around;
        }
        let above = side.separation(self.part, self.point, up, 0.5 * around - height, flush);
        above.is_none_or(|s| s.distance > 0.25 * around)
    }
}
