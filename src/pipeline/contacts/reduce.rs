//! Contact reduction: selects a few manifolds from all contacts of a body pair. The result does not depend on the order of the contacts.

use arrayvec::ArrayVec;
use glam::Vec3;

use crate::{
    constants::{CLOSE_CONTACT, DEPTH_WEIGHT, LINEAR_SLOP, MANIFOLD_NORMAL_COSINE, MAX_MANIFOLDS},
    pipeline::{Contact, Manifold},
};

/// A direction that is usually not an axis of a shape. One of two mirrored contacts is then farther out across it.
const OBLIQUE_AXIS: Vec3 = Vec3::new(0.48, 0.6, 0.64);

/// Buffers of the reduction.
#[derive(Debug, Default)]
pub(in crate::pipeline) struct Scratch {
    /// Index of the group of each contact; `None` for a contact without a group.
    groups: Vec<Option<usize>>,
    group: Vec<Contact>,
}

/// The contacts of a group that are kept.
type Kept = ArrayVec<Contact, 4>;

/// Groups contacts whose normals are close to that of the deepest contact of the group, and keeps up to four contacts of each group. `unit`: the length unit in
/// metres.
pub(in crate::pipeline) fn reduce(
    contacts: &mut [Contact],
    unit: f32,
    Scratch { groups, group }: &mut Scratch,
    mut push: impl FnMut(Manifold),
) {
    contacts.sort_unstable_by(Contact::order);
    let mut normals: ArrayVec<Vec3, MAX_MANIFOLDS> = ArrayVec::new();
    groups.clear();
    groups.extend(contacts.iter().map(|contact| {
        let alignment = |i: &usize| normals[*i].dot(contact.normal1);
        let closest = (0..normals.len()).max_by(|a, b| alignment(a).total_cmp(&alignment(b)));
        let group = closest.filter(|i| alignment(i) >= MANIFOLD_NORMAL_COSINE);
        // Contacts that would need more than MAX_MANIFOLDS groups are dropped. They are not the deepest, because contacts are sorted by depth.
        group.or_else(|| normals.try_push(contact.normal1).ok().map(|()| normals.len() - 1))
    }));
    for i in 0..normals.len() {
        group.clear();
        group.extend(contacts.iter().zip(groups.iter()).filter(|(_, of)| **of == Some(i)).map(|(contact, _)| *contact));
        push(Manifold::new(&spread(group, unit)));
    }
}

/// Selects up to four contacts of the group, the deepest first.
///
/// Contacts about as deep as the deepest one, or at least half as deep, carry the body. They come before contacts that the body may touch next: first the
/// outermost carrying contacts, then the other carrying contacts.
fn spread(group: &[Contact], unit: f32) -> Kept {
    let deepest = group[0].distance;
    let limit = deepest.max(0.5 * deepest) + 2.0 * LINEAR_SLOP * unit;
    let carrying = group.partition_point(|contact| contact.distance <= limit);
    let mut kept = Kept::new();
    outermost(&group[..carrying], unit, &mut kept);
    fill(&group[..carrying], unit, &mut kept);
    span(group, unit, &mut kept);
    keep_deepest(group[0], unit, &mut kept);
    kept.sort_unstable_by(Contact::order);
    kept
}

/// Adds the deepest contacts of the group that are not close to the kept ones, until there are four. A contact that is left out would sink until it replaces
/// another one, which sinks next, so the body would rock.
fn fill(group: &[Contact], unit: f32, kept: &mut Kept) {
    let extent = group.iter().map(|contact| contact.point1.distance(kept[0].point1)).fold(0.0, f32::max);
    let apart = CLOSE_CONTACT * extent + LINEAR_SLOP * unit;
    for contact in group {
        if !kept.is_full() && kept.iter().all(|other| other.point1.distance(contact.point1) > apart) {
            kept.push(*contact);
        }
    }
    kept.sort_unstable_by(Contact::order);
}

/// Replaces the kept contact that is nearest to the deepest one, if the deepest one is deeper than all kept contacts by two slops.
/// With a smaller difference, a pile would change its supports from step to step.
fn keep_deepest(deepest: Contact, unit: f32, kept: &mut [Contact]) {
    let distance = |contact: &Contact| contact.point1.distance_squared(deepest.point1);
    let is_missing = kept.iter().all(|contact| contact.distance > deepest.distance + 2.0 * LINEAR_SLOP * unit);
    if let Some(nearest) = kept.iter_mut().min_by(|a, b| distance(a).total_cmp(&distance(b))).filter(|_| is_missing) {
        *nearest = deepest;
    }
}

/// Adds the contacts that are farthest out along four directions fixed to body 1. Depth counts more than position, up to the touch distance.
///
/// Because the directions are fixed, a body at rest keeps the same contacts from step to step, although rounding changes which one is the deepest. So the
/// solver's warm start works. Beyond the touch distance only the position counts: a small, deep body that is held only on its deeper side would rock from side
/// to side in every step and never be pushed out.
fn outermost(group: &[Contact], unit: f32, kept: &mut Kept) {
    let normal = group[0].normal1;
    let side = normal.cross(OBLIQUE_AXIS).normalize_or(Vec3::X);
    let across = normal.cross(side);
    let depth = |contact: &Contact| (-contact.distance).min(LINEAR_SLOP * unit);
    for direction in [side, across, -side, -across] {
        let reach = |contact: &Contact| contact.point1.dot(direction) + DEPTH_WEIGHT * depth(contact);
        let farthest = group.iter().max_by(|a, b| reach(a).total_cmp(&reach(b)));
        let is_new =
            |contact: &&Contact| kept.iter().all(|other| other.point1.distance(contact.point1) > LINEAR_SLOP * unit);
        kept.extend(farthest.filter(is_new).copied());
    }
    kept.sort_unstable_by(Contact::order);
}

/// Adds contacts of the group until there are four, or until the others lie within the kept ones. Adds the contact farthest from the deepest one, the one
/// farthest from the line through both, and the farthest one on the other side of that line.
fn span(group: &[Contact], unit: f32, kept: &mut Kept) {
    let normal = group[0].normal1;
    let add = |kept: &mut Kept, measure: &dyn Fn(&Contact) -> f32| {
        let best =
            group.iter().max_by(|a, b| measure(a).total_cmp(&measure(b)).then(b.distance.total_cmp(&a.distance)));
        if kept.len() < 4 {
            kept.extend(best.filter(|contact| measure(contact) > LINEAR_SLOP * unit).copied());
        }
    };
    let deepest = kept[0].point1;
    if kept.len() == 1 {
        add(kept, &|c| c.point1.distance(deepest));
    }
    let Some(second) = kept.get(1).map(|c| c.point1) else { return };
    let across = (second - deepest).cross(normal).normalize_or_zero();
    let reach =
        |kept: &[Contact], side: f32| kept.iter().map(|c| side * (c.point1 - deepest).dot(across)).fold(0.0, f32::max);
    for side in [1.0, -1.0] {
        let reached = reach(kept, side);
        add(kept, &|c| side * (c.point1 - deepest).dot(across) - reached);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    /// Returns a contact of a body with a floor.
    fn contact(primitive1: usize, point1: Vec3, distance: f32) -> Contact {
        let primitive1 = primitive1 as u32;
        Contact { point1, point2: Vec3::ZERO, normal1: Vec3::NEG_Y, distance, primitive1, primitive2: 0 }
    }

    /// Returns the primitives of the kept contacts.
    fn kept_of(contacts: impl Iterator<Item = Contact>) -> Vec<u32> {
        let mut manifolds = Vec::new();
        let mut contacts: Vec<Contact> = contacts.collect();
        reduce(&mut contacts, 1.0, &mut Scratch::default(), |manifold| manifolds.push(manifold));
        assert_eq!(manifolds.len(), 1);
        let contacts = manifolds[0].contacts();
        assert!(contacts.windows(2).all(|pair| pair[0].distance <= pair[1].distance), "contacts are not sorted");
        contacts.iter().map(|contact| contact.primitive1).collect()
    }

    /// Returns a point on a ring with a radius of 0.2 m.
    fn on_ring(i: usize) -> Vec3 {
        let angle = i as f32 / 24.0 * std::f32::consts::TAU;
        Vec3::new(0.2 * angle.cos(), -0.05, 0.2 * angle.sin())
    }

    /// Returns the kept contacts of a ring on a floor. The contact `deeper` is 2 mm deeper than the others.
    fn kept_of_ring(random: &mut Random, deeper: usize) -> Vec<u32> {
        let sinks = |i| if i == deeper { 2.0e-3 } else { 0.0 };
        let mut kept = kept_of((0..24).map(|i| contact(i, on_ring(i), 1.0e-6 * random.in_cube().x - sinks(i))));
        assert!(deeper >= 24 || kept[0] == deeper as u32, "{kept:?} lacks the deepest contact {deeper}");
        kept.sort_unstable();
        kept
    }

    #[test]
    fn a_ring_at_rest_keeps_its_contacts() {
        let mut random = Random(1);
        let expected = kept_of_ring(&mut random, 24);
        assert_eq!(expected.len(), 4);
        // Contacts on every side, so that the ring does not tip.
        assert!(expected.windows(2).all(|pair| pair[1] - pair[0] >= 4), "{expected:?}");
        for _ in 0..50 {
            assert_eq!(kept_of_ring(&mut random, 24), expected);
        }
        for deeper in 0..24 {
            assert_eq!(kept_of_ring(&mut random, deeper).len(), 4);
        }
    }

    #[test]
    fn a_small_ring_that_is_deep_and_tilted_is_held_on_every_side() {
        // The ring has a radius of 10 mm and an overlap of 20 mm. One side is 10 % deeper than the middle.
        let on_coin = |i: usize| on_ring(i) * 0.05;
        let kept = kept_of((0..24).map(|i| contact(i, on_coin(i), -0.02 - 0.2 * on_coin(i).x)));
        assert_eq!(kept.len(), 4);
        let [left, right] =
            [-1.0, 1.0].map(|side| kept.iter().filter(|&&i| side * on_coin(i as usize).x > 3.0e-3).count());
        assert!(left > 0 && right > 0, "{kept:?}");
    }

    #[test]
    fn a_contact_in_the_middle_that_is_deeper_is_kept() {
        // The weight of depth, limited to the touch distance, does not make up for the distance to the ring.
        let middle = contact(24, Vec3::NEG_Y * 0.05, -3.0e-3);
        let kept = kept_of((0..24).map(|i| contact(i, on_ring(i), 0.0)).chain([middle]));
        assert_eq!(kept.len(), 4);
        assert_eq!(kept[0], 24);
        // A difference in depth of the order of rounding does not count.
        let middle = Contact { distance: -1.0e-5, ..middle };
        let kept = kept_of((0..24).map(|i| contact(i, on_ring(i), 0.0)).chain([middle]));
        assert!(!kept.contains(&24));
    }

    #[test]
    fn feet_that_carry_are_kept_before_what_is_far_off() {
        // One foot lies between two others and is about as deep. A leg in the air is the farthest contact on its side.
        let feet = [(0.24, -0.12, -0.6e-3), (-0.28, 0.0, -0.1e-3), (0.3, 0.15, 0.0), (0.31, -0.16, 0.6e-3)];
        let leg = [(0.15, 0.25, 12.0e-3)];
        let contacts = feet.into_iter().chain(leg).enumerate();
        let mut kept = kept_of(contacts.map(|(i, (x, z, distance))| contact(i, Vec3::new(x, -0.1, z), distance)));
        kept.sort_unstable();
        assert_eq!(kept, [0, 1, 2, 3]);
    }
}
