//! Converts lists from files and builders to the form that [`MedialAxis`](super::MedialAxis) guarantees.

use std::{cell::Cell, collections::HashMap, fmt};

use crate::geometry::{Aabb, Bvh, Primitive, Sphere};

/// Changes made by a clean-up.
///
/// None of them changes the shape. Covered cones are common, because most files list the edges of their faces. Other changes hint
/// at redundant data in the source.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CleanupReport {
    /// Spheres without a primitive, which became primitives.
    pub isolated_spheres: usize,
    /// Spheres equal to an earlier one, which replaced them.
    pub duplicate_spheres: usize,
    /// Cones with one sphere inside the other, which became spheres.
    pub degenerate_cones: usize,
    /// Slabs without a common tangent plane, which became one or two cones, or a sphere.
    pub degenerate_slabs: usize,
    /// Primitives that repeat another one.
    pub duplicate_primitives: usize,
    /// Sphere primitives inside another primitive.
    pub covered_spheres: usize,
    /// Cones inside another primitive.
    pub covered_cones: usize,
    /// Slabs inside another primitive.
    pub covered_slabs: usize,
    /// Spheres left without a primitive, which were removed.
    pub unused_spheres: usize,
}

impl CleanupReport {
    /// True if the lists were clean, up to order.
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }
}

impl fmt::Display for CleanupReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let counts = [
            (self.isolated_spheres, "isolated spheres made primitives"),
            (self.duplicate_spheres, "duplicate spheres merged"),
            (self.degenerate_cones, "degenerate cones simplified"),
            (self.degenerate_slabs, "degenerate slabs simplified"),
            (self.duplicate_primitives, "duplicate primitives dropped"),
            (self.covered_spheres, "covered spheres dropped"),
            (self.covered_cones, "covered cones dropped"),
            (self.covered_slabs, "covered slabs dropped"),
            (self.unused_spheres, "unused spheres dropped"),
        ];
        let mut separator = "";
        for (count, what) in counts.into_iter().filter(|(count, _)| *count > 0) {
            write!(f, "{separator}{what}: {count}")?;
            separator = ", ";
        }
        if separator.is_empty() { f.write_str("nothing to clean up") } else { Ok(()) }
    }
}

/// Returns the same set of points in canonical form. Indices must be in range, numbers finite, radii not negative.
///
/// One pass is enough: each stage preserves the results of the stages before it.
pub(super) fn clean_up(
    mut spheres: Vec<Sphere>,
    mut primitives: Vec<Primitive>,
) -> (Vec<Sphere>, Vec<Primitive>, CleanupReport) {
    let mut report = CleanupReport::default();
    add_isolated_spheres(&spheres, &mut primitives, &mut report);
    merge_duplicate_spheres(&spheres, &mut primitives, &mut report);
    simplify(&spheres, &mut primitives, &mut report);
    drop_duplicates(&mut primitives, &mut report);
    drop_covered(&spheres, &mut primitives, &mut report);
    drop_unused_spheres(&mut spheres, &mut primitives, &mut report);
    (spheres, primitives, report)
}

fn add_isolated_spheres(spheres: &[Sphere], primitives: &mut Vec<Primitive>, report: &mut CleanupReport) {
    let used = used(spheres.len(), primitives);
    let before = primitives.len();
    primitives.extend((0..spheres.len()).filter(|&i| !used[i]).map(|i| Primitive::Sphere([i as u32])));
    report.isolated_spheres = primitives.len() - before;
}

/// Replaces the indices of equal spheres by the first one's index.
fn merge_duplicate_spheres(spheres: &[Sphere], primitives: &mut [Primitive], report: &mut CleanupReport) {
    let mut first_of = HashMap::new();
    let first: Vec<u32> = (0u32..)
        .zip(spheres)
        .map(|(i, s)| {
            // Adding 0 turns -0 into 0, so both get the same key.
            let key = [s.center.x, s.center.y, s.center.z, s.radius].map(|v| (v + 0.0).to_bits());
            *first_of.entry(key).or_insert(i)
        })
        .collect();
    report.duplicate_spheres = spheres.len() - first_of.len();
    renumber(primitives, |i| first[i as usize]);
}

fn simplify(spheres: &[Sphere], primitives: &mut Vec<Primitive>, report: &mut CleanupReport) {
    *primitives = std::mem::take(primitives)
        .into_iter()
        .flat_map(|primitive| {
            let parts = primitive.simplified(spheres);
            if !parts.iter().eq([&primitive]) {
                match primitive {
                    Primitive::Slab(_) => report.degenerate_slabs += 1,
                    _ => report.degenerate_cones += 1,
                }
            }
            parts.iter().copied().collect::<Vec<_>>()
        })
        .collect();
}

/// Sorts the primitives and the indices in each, and removes duplicates.
fn drop_duplicates(primitives: &mut Vec<Primitive>, report: &mut CleanupReport) {
    let before = primitives.len();
    for primitive in primitives.iter_mut() {
        indices_mut(primitive).sort_unstable();
    }
    primitives.sort_unstable();
    primitives.dedup();
    report.duplicate_primitives = before - primitives.len();
}

/// Removes each primitive whose spheres all equal, or lie inside, spheres of one other primitive. The other primitive is
/// convex, so it contains the hull as well.
///
/// No volume is lost, because no two primitives cover each other: no sphere of a proper primitive contains another sphere of it, and equal spheres
/// are merged.
fn drop_covered(spheres: &[Sphere], primitives: &mut Vec<Primitive>, report: &mut CleanupReport) {
    let boxes: Vec<Aabb> = spheres.iter().map(|&sphere| Aabb::from_spheres([sphere])).collect();
    let bvh = Bvh::new(&boxes);
    let mut users = vec![Vec::new(); spheres.len()];
    for (number, primitive) in primitives.iter().enumerate() {
        primitive.indices().iter().for_each(|&i| users[i as usize].push(number));
    }
    let holds = |outer: u32, inner: u32| outer == inner || spheres[outer as usize].contains(&spheres[inner as usize]);
    let is_covered = |number: usize, indices: &[u32]| {
        let covered = Cell::new(false);
        let covers = |other: &usize| {
            let by = primitives[*other].indices();
            *other != number && indices.iter().all(|&i| by.iter().any(|&j| holds(j, i)))
        };
        // A covering primitive covers each sphere of this one. The box of a covered sphere lies in the box of the sphere that contains it, up to rounding.
        // The search starts from the sphere with the fewest primitives, which gives the fewest candidates.
        let Some(sphere) = indices.iter().copied().min_by_key(|&i| users[i as usize].len()) else { return false };
        let own = boxes[sphere as usize];
        let core = own.inflated(-own.rounding());
        bvh.visit(
            |aabb| !covered.get() && aabb.contains(&core),
            |holder| {
                if !covered.get() && holds(holder, sphere) && users[holder as usize].iter().any(covers) {
                    covered.set(true);
                }
            },
        );
        covered.get()
    };
    let covered: Vec<bool> =
        primitives.iter().enumerate().map(|(number, primitive)| is_covered(number, primitive.indices())).collect();
    let mut covered = covered.into_iter();
    primitives.retain(|primitive| {
        let drop = covered.next() == Some(true);
        let count = match primitive {
            Primitive::Sphere(_) => &mut report.covered_spheres,
            Primitive::Cone(_) => &mut report.covered_cones,
            Primitive::Slab(_) => &mut report.covered_slabs,
        };
        *count += usize::from(drop);
        !drop
    });
}

fn drop_unused_spheres(spheres: &mut Vec<Sphere>, primitives: &mut [Primitive], report: &mut CleanupReport) {
    let used = used(spheres.len(), primitives);
    let before = spheres.len();
    let mut flags = used.iter();
    spheres.retain(|_| flags.next() == Some(&true));
    report.unused_spheres = before - spheres.len() - report.duplicate_spheres;
    let number = numbers_of_kept(used.iter().copied());
    renumber(primitives, |i| number[i as usize]);
}

/// The new index of each kept item after the others are removed. The entries of removed items are meaningless.
pub(crate) fn numbers_of_kept(kept: impl Iterator<Item = bool>) -> Vec<u32> {
    let mut next = 0;
    kept.map(|kept| {
        next += u32::from(kept);
        next - u32::from(kept)
    })
    .collect()
}

/// For each of `count` spheres, true if a primitive refers to it.
fn used(count: usize, primitives: &[Primitive]) -> Vec<bool> {
    let mut used = vec![false; count];
    primitives.iter().flat_map(Primitive::indices).for_each(|&i| used[i as usize] = true);
    used
}

fn renumber(primitives: &mut [Primitive], number: impl Fn(u32) -> u32) {
    primitives.iter_mut().flat_map(indices_mut).for_each(|i| *i = number(*i));
}

fn indices_mut(primitive: &mut Primitive) -> &mut [u32] {
    match primitive {
        Primitive::Sphere(i) => i,
        Primitive::Cone(i) => i,
        Primitive::Slab(i) => i,
    }
}

#[cfg(test)]
mod tests;
