//! Contacts at the features of two primitives: nearest points, spheres, corners of a face, and crossings of edges.

use bevy::platform::collections::HashSet;
use glam::Vec3;

use crate::{
    constants::{CROSSING_SINE, SAME_LENGTH, VERTEX_NORMAL_COSINE},
    geometry::{Aabb, Sphere},
    pipeline::Shape,
    query::{Convex, Separation, separation},
};

/// Returns the corners of the box face whose outward normal is closest to `direction`, in order around the face.
pub(super) fn face(half: Vec3, direction: Vec3) -> [Sphere; 4] {
    let axis = direction.abs().max_position();
    let [u, v] = [(axis + 1) % 3, (axis + 2) % 3];
    [(-1.0, -1.0), (-1.0, 1.0), (1.0, 1.0), (1.0, -1.0)].map(|(side_u, side_v)| {
        let mut corner = half * direction.signum();
        corner[u] = side_u * half[u];
        corner[v] = side_v * half[v];
        Sphere::new(corner, 0.0)
    })
}

/// Adds contacts at the corners of the other side's face that are near and have about the normal of the nearest points, and contacts where edges cross. A small
/// box on a large slab rests on its corners.
pub(super) fn on_face<const N: usize>(
    first: &[Sphere; N],
    face: &[Sphere],
    main: &Separation,
    prediction: f32,
    push: &mut impl FnMut(&Separation),
) {
    if N == 1 {
        return;
    }
    let around = Aabb::from_spheres(*first).inflated(prediction);
    for corner in face.iter().filter(|corner| around.overlaps(&Aabb::from_spheres([**corner]))) {
        at_feature(&separation(first, &[*corner], 0), main.normal, prediction, push);
    }
    crossings(first, face, main, prediction, push);
}

/// Adds contacts where an edge of one side crosses an edge of the other in the contact plane. A rod across a wall rests on both edges of the wall, and its ends
/// touch nothing.
pub(super) fn crossings(
    first: &[Sphere],
    second: &[Sphere],
    main: &Separation,
    prediction: f32,
    push: &mut impl FnMut(&Separation),
) {
    // Two cones touch only at their nearest points.
    if first.len() < 2 || second.len() < 2 || first.len() + second.len() < 5 {
        return;
    }
    let normal = main.normal;
    for ours in lying(first, main.point1, normal, prediction) {
        for theirs in lying(second, main.point2, -normal, prediction) {
            let Some([sphere1, sphere2]) = crossing(&ours, &theirs, normal) else { continue };
            let point1 = sphere1.center + normal * sphere1.radius;
            let point2 = sphere2.center - normal * sphere2.radius;
            let distance = (point2 - point1).dot(normal);
            if distance <= prediction {
                push(&Separation { distance, point1, point2, ..*main });
            }
        }
    }
}

/// Returns the spheres at the crossing of two edges, as seen along the normal. `None` if the edges are nearly parallel, or do not cross between their ends.
fn crossing(ours: &[Sphere; 2], theirs: &[Sphere; 2], normal: Vec3) -> Option<[Sphere; 2]> {
    let [edge1, edge2] = [ours, theirs].map(|[a, b]| b.center - a.center);
    let [length1, length2] = [edge1, edge2].map(Vec3::length);
    let (apart, area) = (theirs[0].center - ours[0].center, edge1.cross(edge2).dot(normal));
    let [along1, along2] = [edge2, edge1].map(|edge| apart.cross(edge).dot(normal) / area);
    let is_within = |along: f32| (0.0..1.0).contains(&along);
    let cross = area.abs() > CROSSING_SINE * length1 * length2;
    (cross && is_within(along1) && is_within(along2))
        .then(|| [ours[0].lerp(&ours[1], along1), theirs[0].lerp(&theirs[1], along2)])
}

/// Returns the edges between spheres, or around a face, that lie in the contact plane over their whole length. `outward`: normal of the plane, pointing away
/// from the body of the edges.
fn lying(spheres: &[Sphere], point: Vec3, outward: Vec3, prediction: f32) -> impl Iterator<Item = [Sphere; 2]> {
    let is_low = move |sphere: &Sphere| (sphere.center - point).dot(outward) + sphere.radius >= -prediction;
    let count = if spheres.len() == 2 { 1 } else { spheres.len() };
    let edges = (0..count).map(|i| [spheres[i], spheres[(i + 1) % spheres.len()]]);
    edges.filter(move |edge| edge.iter().all(is_low))
}

/// Adds the nearest points of two primitives, and those of the other spheres of both sides if they have about the same normal. A cone on a floor or beside
/// another cone touches along a line and rests on both its ends.
///
/// Returns the nearest points, and true if they are within `prediction`.
pub(super) fn two_sided<const N: usize, const M: usize>(
    (first, spheres1): (&[Sphere; N], SharedSpheres),
    (second, spheres2): (&[Sphere; M], SharedSpheres),
    prediction: f32,
    push: &mut impl FnMut(&Separation),
) -> (Separation, bool) {
    let (main, is_near) = one_sided((first, spheres1), second, prediction, push);
    if is_near && N > 1 && M > 1 {
        spheres2.each(second, |sphere| {
            is_on(sphere, main.point2, main.normal) || {
                let theirs = separation(first, &[*sphere], 0);
                at_feature(&theirs, main.normal, prediction, push)
            }
        });
    }
    (main, is_near)
}

/// Returns true if `point`, the nearest point of a primitive, lies on this sphere. `normal`: the outward normal at the point, with either sign.
fn is_on(sphere: &Sphere, point: Vec3, normal: Vec3) -> bool {
    let rise = point - sphere.center;
    rise.cross(normal).length_squared() <= (SAME_LENGTH * sphere.radius).powi(2)
        && (rise.length_squared() - sphere.radius.powi(2)).abs() <= SAME_LENGTH * sphere.radius.powi(2)
}

/// [`two_sided`] without the spheres of the second side.
pub(super) fn one_sided<const N: usize, B: Convex>(
    (first, spheres): (&[Sphere; N], SharedSpheres),
    second: &B,
    prediction: f32,
    push: &mut impl FnMut(&Separation),
) -> (Separation, bool) {
    let main = separation(first, second, 0);
    if main.distance > prediction {
        return (main, false);
    }
    push(&main);
    if N > 1 {
        spheres.each(first, |sphere| {
            is_on(sphere, main.point1, main.normal) || {
                let ours = separation(&[*sphere], second, 0);
                at_feature(&ours, main.normal, prediction, push)
            }
        });
    }
    (main, true)
}

/// Adds the contact of a sphere or a corner if it is near and its normal is close to `main`. Returns true if the sphere needs no test with another `main`: its
/// contact has been added, or it is not near.
fn at_feature(contact: &Separation, main: Vec3, prediction: f32, push: &mut impl FnMut(&Separation)) -> bool {
    let is_near = contact.distance <= prediction;
    let is_contact = is_near && contact.normal.dot(main) >= VERTEX_NORMAL_COSINE;
    if is_contact {
        push(contact);
    }
    is_contact || !is_near
}

/// The spheres of a primitive in a pair of primitives. Primitives share spheres, and each sphere makes one contact with a primitive of the other side.
pub(super) struct SharedSpheres<'a> {
    indices: &'a [u32],
    other: u32,
    /// Pairs of a sphere and a primitive of the other side that need no further test.
    settled: Option<&'a mut HashSet<[u32; 2]>>,
}

pub(super) const NONE_SHARED: SharedSpheres = SharedSpheres { indices: &[], other: 0, settled: None };

impl<'a> SharedSpheres<'a> {
    pub(super) fn new(shape: &'a Shape, primitive: u32, other: u32, settled: &'a mut HashSet<[u32; 2]>) -> Self {
        Self { indices: shape.axis.primitives()[primitive as usize].indices(), other, settled: Some(settled) }
    }

    /// Calls `look` for each sphere that is not settled. A sphere is settled when `look` returns true.
    fn each<const N: usize>(mut self, spheres: &[Sphere; N], mut look: impl FnMut(&Sphere) -> bool) {
        for (i, sphere) in spheres.iter().enumerate() {
            match &mut self.settled {
                None => {
                    look(sphere);
                }
                Some(settled) => {
                    let key = [self.indices[i], self.other];
                    if !settled.contains(&key) && look(sphere) {
                        settled.insert(key);
                    }
                }
            }
        }
    }
}
