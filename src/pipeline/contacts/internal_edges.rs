//! Seams (internal edges): where two parts of a body meet, the surface continues, and the edges and sides of the parts are not on the surface of the body.
//!
//! A ball on a plane of triangles touches the triangle below it and is near the edges of the next triangles. Contacts with these edges would push the ball
//! back, although it can slide over them. Such a contact is recognised by two properties: the surface of another part passes through the contact point, and the
//! contact normal leans over this surface. The same applies to adjacent boxes and to the primitives of a medial mesh.

use bevy::platform::collections::{HashMap, hash_map::Entry};
use glam::{Quat, Vec3};

use crate::{
    constants::{LINEAR_SLOP, SAME_NORMAL_COSINE},
    geometry::Aabb,
    pipeline::Contact,
    query::Separation,
};

/// Distance around a contact, in slops, within which the surfaces of other parts are tested. It is several times the overlap that rapier leaves.
const SEAM_REACH: f32 = 4.0;

/// Height in slops up to which an adjacent part is flush, so that there is no step between the parts.
const FLUSH: f32 = 0.1;

/// One side of a pair, in its own frame.
pub(in crate::pipeline) trait Side {
    /// Returns the bounding box of a part.
    fn aabb(&self, part: u32) -> Aabb;

    /// Returns the separation of the point `point + normal * height` and a part. `normal` is a unit vector.
    ///
    /// Returns `None` if there is no such part. May return `None` if the part stays more than `flush` below the plane through `point` with this normal.
    fn separation(&self, part: u32, point: Vec3, normal: Vec3, height: f32, flush: f32) -> Option<Separation>;
}

/// Buffers of the search.
#[derive(Debug, Default)]
pub(in crate::pipeline) struct Scratch {
    kept: Vec<(Contact, [Touch; 2])>,
    /// Covered contacts.
    removed: Vec<Contact>,
    parts: [TouchedParts; 2],
}

/// The deepest touch of each part of a side, with a box that contains the part and all points that the part may cover.
#[derive(Debug, Default)]
struct TouchedParts {
    list: Vec<(Touch, Aabb)>,
    /// Index of each part in the list.
    places: HashMap<u32, usize>,
}

impl TouchedParts {
    fn clear(&mut self) {
        self.list.clear();
        self.places.clear();
    }

    /// Adds a touch unless the list has one of the same part.
    fn insert(&mut self, touch: Touch, reach: impl FnOnce(u32) -> Aabb) {
        if let Entry::Vacant(place) = self.places.entry(touch.part) {
            place.insert(self.list.len());
            self.list.push((touch, reach(touch.part)));
        }
    }

    /// Returns the box that contains all points that a part may cover.
    fn reach(&self, part: u32) -> Option<&Aabb> {
        self.places.get(&part).map(|place| &self.list[*place].1)
    }
}

/// Removes contacts with edges and sides of parts that are covered by other parts, if these parts have deeper contacts or contacts of about the same depth.
///
/// `contacts` have to be sorted by depth and stay sorted. `rotation12`: rotation of body 2 in the frame of body 1. `unit`: the length unit in metres.
pub(in crate::pipeline) fn remove(
    contacts: &mut Vec<Contact>,
    rotation12: Quat,
    sides: [&dyn Side; 2],
    unit: f32,
    Scratch { kept, removed, parts }: &mut Scratch,
) {
    let rotation21 = rotation12.inverse();
    let slop = LINEAR_SLOP * unit;
    let [around, flush] = [SEAM_REACH, FLUSH].map(|slops| slops * slop);
    let touches = |contact: &Contact| {
        let Contact { point1, point2, normal1, distance, primitive1, primitive2 } = *contact;
        let normal2 = rotation21 * -normal1;
        [(primitive1, point1, normal1), (primitive2, point2, normal2)].map(|(part, point, normal)| Touch {
            part,
            point,
            normal,
            distance,
        })
    };
    kept.clear();
    removed.clear();
    parts.iter_mut().for_each(TouchedParts::clear);
    for contact in contacts.iter() {
        let touches = touches(contact);
        for (side, (parts, touch)) in parts.iter_mut().zip(touches).enumerate() {
            // A part that covers a contact point is nearer than this to a point above it.
            parts.insert(touch, |part| sides[side].aabb(part).inflated(around + 2.0 * flush));
        }
        let is_covered = |i: usize| {
            parts[i].list.iter().any(|(other, reach)| touches[i].is_covered(other, reach, sides[i], [around, flush]))
        };
        // Primitives that share a sphere touch at the same place.
        let is_known = || {
            // A distance up to which places differ by rounding.
            let within = 0.01 * slop;
            let mut as_deep = removed.iter().rev().take_while(|other| contact.distance <= other.distance + within);
            as_deep.any(|other| contact.pushes_as(other) && contact.point1.distance(other.point1) <= within)
        };
        // The deepest contact is kept, and so are deep overlaps, because they have to be pushed out first. A contact along the normal of a kept one does no
        // harm.
        let harmless =
            kept.is_empty() || contact.distance < -around || kept.iter().any(|(other, _)| contact.pushes_as(other));
        if harmless || !(is_known() || is_covered(0) || is_covered(1)) {
            kept.push((*contact, touches));
        } else {
            removed.push(*contact);
        }
    }
    remove_covered_by_later(kept, parts, sides, [around, flush]);
    contacts.clear();
    contacts.extend(kept.iter().map(|(contact, _)| *contact));
}

/// Tests contacts against later ones too, because rounding decides the order of contacts of about the same depth. `around`, `flush`: [`SEAM_REACH`] and
/// [`FLUSH`] in metres.
fn remove_covered_by_later(
    kept: &mut Vec<(Contact, [Touch; 2])>,
    parts: &[TouchedParts; 2],
    sides: [&dyn Side; 2],
    [around, flush]: [f32; 2],
) {
    // If all normals agree, no contact does harm.
    let normals_agree = kept.first().is_none_or(|(first, _)| kept.iter().all(|(contact, _)| contact.pushes_as(first)));
    let crossing = if normals_agree { 0 } else { kept.len() };
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
}

impl Contact {
    /// Returns true if the normals of two contacts are nearly equal.
    fn pushes_as(&self, other: &Self) -> bool {
        self.normal1.dot(other.normal1) >= SAME_NORMAL_COSINE
    }
}

/// A contact as seen from one side: the touched part, the point and outward normal in the side's frame, and the distance of the contact.
#[derive(Clone, Copy, Debug)]
struct Touch {
    part: u32,
    point: Vec3,
    normal: Vec3,
    distance: f32,
}

impl Touch {
    /// Returns true if the surface of the part of `other` passes through this point with another normal, and the touched part does not rise above this surface.
    /// Both parts may be the same.
    ///
    /// `reach`: the box that contains all points that the part of `other` may cover. `around`, `flush`: [`SEAM_REACH`] and [`FLUSH`] in metres.
    fn is_covered(&self, other: &Touch, reach: &Aabb, side: &dyn Side, [around, flush]: [f32; 2]) -> bool {
        if !reach.contains_point(self.point + self.normal * around) {
            return false;
        }
        // The query point is straight above the contact point. A part whose surface ends here with this normal has no point nearer to it than the contact
        // point.
        let Some(s) = side.separation(other.part, self.point, self.normal, around, flush) else { return false };
        // In the plane of a triangle the normal of the separation may point to either side. The normal of `other` shows which side is touched.
        let turned = s.distance.abs() < flush && other.normal.dot(s.normal) > 0.5;
        let (up, distance) = if turned { (s.normal, -s.distance) } else { (-s.normal, s.distance) };
        let cosine = up.dot(self.normal);
        // Height of the contact point above the surface, and height of the surface above the contact plane.
        let height = distance - around * cosine;
        let rise = around - distance * cosine;
        let most = if self.distance <= -around { 0.5 } else { SAME_NORMAL_COSINE };
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
