//! Reduction: from all contacts of a body pair to a few manifolds, in an order that depends on the contacts alone.

use super::{Contact, Impact, Manifold, Pair, StepOutput, broad_phase::BodyPair};
use crate::constants::{DUPLICATE_CONTACT, MANIFOLD_NORMAL_COSINE, MAX_MANIFOLDS};

/// Reduces each pair's contacts and keeps the pairs with something to tell.
pub(super) fn run(
    pairs: &[BodyPair],
    impacts: impl Iterator<Item = Option<Impact>>,
    contacts: Vec<Vec<Contact>>,
    output: &mut StepOutput,
) {
    for ((pair, impact), mut contacts) in pairs.iter().zip(impacts).zip(contacts) {
        let first = output.manifolds.len();
        reduce(&mut contacts, &mut output.manifolds);
        let manifolds = first..output.manifolds.len();
        if !manifolds.is_empty() || impact.is_some() {
            output.counts.contacts += output.manifolds[first..].iter().map(|m| m.contacts().len()).sum::<usize>();
            output.pairs.push(Pair { body1: pair.body1, target: pair.target, manifolds, impact });
        }
    }
}

/// Groups contacts by normal, the deepest contact of each group giving its normal, and keeps up to four of each group.
pub(super) fn reduce(contacts: &mut Vec<Contact>, manifolds: &mut Vec<Manifold>) {
    contacts.sort_by(|a, b| {
        (a.distance.total_cmp(&b.distance)).then((a.primitive1, a.primitive2).cmp(&(b.primitive1, b.primitive2)))
    });
    let mut groups: Vec<Vec<Contact>> = Vec::new();
    for contact in contacts.iter() {
        let alignment = |i: &usize| groups[*i][0].normal1.dot(contact.normal1);
        let closest = (0..groups.len()).max_by(|a, b| alignment(a).total_cmp(&alignment(b)));
        match closest {
            Some(i) if alignment(&i) >= MANIFOLD_NORMAL_COSINE => groups[i].push(*contact),
            // Beyond so many directions the deeper ones are there already.
            _ if groups.len() < MAX_MANIFOLDS => groups.push(vec![*contact]),
            _ => {}
        }
    }
    manifolds.extend(groups.iter().map(|group| Manifold::new(&spread(group))));
}

/// Up to four contacts that span the group: the deepest, the one farthest from it, the one farthest from their line, and the one
/// farthest out on the other side of it.
fn spread(group: &[Contact]) -> Vec<Contact> {
    let normal = group[0].normal1;
    let deepest = group[0].point1;
    let farthest = |measure: &dyn Fn(&Contact) -> f32| {
        let best = group.iter().max_by(|a, b| measure(a).total_cmp(&measure(b)).then(b.distance.total_cmp(&a.distance)));
        best.filter(|contact| measure(contact) > DUPLICATE_CONTACT).copied()
    };
    let mut kept = vec![group[0]];
    let Some(second) = farthest(&|c| c.point1.distance(deepest)) else { return kept };
    kept.push(second);
    let across = (second.point1 - deepest).cross(normal).normalize_or_zero();
    kept.extend(farthest(&|c| (c.point1 - deepest).dot(across)));
    kept.extend(farthest(&|c| (deepest - c.point1).dot(across)));
    kept
}
