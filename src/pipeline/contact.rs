//! Contacts of a pair at an instant: a pure function of shapes, relative pose and prediction distance.
//!
//! The narrow phase and rapier's dispatcher call the same function, so contacts from the step and contacts that are computed on demand have the same bits.

use arrayvec::ArrayVec;
use bevy::platform::collections::HashSet;
use glam::{Vec3, Vec4};

use super::{
    ConvexParts, Core, Culling, Hull, Part, Parts, Reach, Shape,
    directions::Directions,
    manifold::{Contact, Manifold},
    mid_phase,
    near::{self, near_part, near_shape},
    reduce::reduce,
    seams,
    thin::{self, thin},
    with_spheres,
};
use crate::{
    constants::{CROSSING_END, CROSSING_SINE, SAME_SPHERE, VERTEX_NORMAL_COSINE},
    geometry::{Aabb, Placement, Pose3, Sphere},
    query::{Convex, Cuboid, Separation, Support, separation},
};

/// The second side of a pair.
#[derive(Clone, Copy)]
pub enum Second<'a> {
    /// A medial shape.
    Shape(&'a Shape),
    /// Any other collider.
    Parts(&'a dyn ConvexParts),
}

/// Buffers that are kept from pair to pair to avoid allocations.
#[derive(Debug, Default)]
pub(super) struct Buffers {
    near: near::Room,
    /// Per side, each sphere and the primitive of the other side with which it needs no further test.
    settled: [HashSet<[u32; 2]>; 2],
    taken: thin::Taken,
    seams: seams::Room,
}

/// Returns all manifolds of a pair. `pose12`: pose of body 2 in the frame of body 1.
pub fn manifolds(shape1: &Shape, second: Second, pose12: &Pose3, reach: impl Into<Reach>) -> Vec<Manifold> {
    let (reach, mut contacts, mut manifolds) = (reach.into(), Vec::new(), Vec::new());
    find(shape1, second, pose12, reach, &mut contacts);
    reduce(&mut contacts, reach.length_unit, &mut Default::default(), |manifold| manifolds.push(manifold));
    manifolds
}

/// Replaces `contacts` with all contacts of a pair.
pub fn find(shape1: &Shape, second: Second, pose12: &Pose3, reach: impl Into<Reach>, contacts: &mut Vec<Contact>) {
    contacts.clear();
    find_with(shape1, second, pose12, reach.into(), Culling::Hybrid, contacts, &mut Buffers::default());
}

/// [`find`] with buffers. `contacts` has to be empty.
pub(super) fn find_with(
    shape1: &Shape,
    second: Second,
    pose12: &Pose3,
    reach: Reach,
    culling: Culling,
    contacts: &mut Vec<Contact>,
    buffers: &mut Buffers,
) {
    let mut find = |reach: Reach, contacts: &mut Vec<Contact>| match second {
        Second::Shape(shape2) => {
            let all = (culling == Culling::None).then(|| mid_phase::all(shape1.len(), shape2.len()));
            of_shapes(shape1, shape2, pose12, reach, all, contacts, buffers);
        }
        Second::Parts(parts) => of_parts(shape1, parts, pose12, reach, contacts, buffers),
    };
    find(reach, contacts);
    let touch = reach.touch();
    if reach.in_touch > reach.prediction && contacts.iter().any(|contact| contact.distance <= touch) {
        contacts.clear();
        find(Reach::new(reach.in_touch, reach.length_unit), contacts);
    }
}

/// Finds the contacts of a medial shape and another collider.
fn of_parts(
    shape1: &Shape,
    parts: &dyn ConvexParts,
    pose12: &Pose3,
    Reach { prediction, length_unit, .. }: Reach,
    contacts: &mut Vec<Contact>,
    buffers: &mut Buffers,
) {
    let parts = parts.within(&surroundings(shape1, pose12, prediction));
    for part in &parts {
        collect_part(shape1, part, pose12, prediction, contacts, &mut buffers.near);
    }
    contacts.sort_unstable_by(Contact::order);
    let sides: [&dyn seams::Side; 2] = [shape1, &parts];
    seams::remove(contacts, pose12.rotation, sides, length_unit, &mut buffers.seams);
}

/// Returns the box in the frame of body 2 that contains all points within a distance of the shape.
fn surroundings(shape1: &Shape, pose12: &Pose3, distance: f32) -> Aabb {
    shape1.aabb().transformed(&pose12.inverse(), 1.0).inflated(distance)
}

/// Finds the contacts of two medial shapes. `candidates`: the primitive pairs that may have contacts, if they are known.
fn of_shapes(
    shape1: &Shape,
    shape2: &Shape,
    pose12: &Pose3,
    Reach { prediction, length_unit, .. }: Reach,
    candidates: Option<impl IntoIterator<Item = [u32; 2]>>,
    contacts: &mut Vec<Contact>,
    Buffers { near, settled, taken, seams }: &mut Buffers,
) {
    let to_second = Placement::from(pose12.inverse());
    let to_first = Placement::from(*pose12);
    let mut directions = Directions::default();
    settled.iter_mut().for_each(HashSet::clear);
    let mut collect = |[primitive1, primitive2]: [u32; 2], hull: Hull| {
        let mut push = |s: &Separation| {
            contacts.push(Contact {
                point1: to_first.point(s.point1),
                point2: s.point2,
                normal1: to_first.vector(s.normal),
                distance: s.distance,
                primitive1,
                primitive2,
            });
        };
        with_spheres!(hull, |first| with_spheres!(shape2.hull(primitive2), |second| {
            let gaps = directions.low(&second) - directions.high(&first);
            if !gaps.cmpgt(Vec4::splat(prediction)).any() {
                let [settled1, settled2] = &mut *settled;
                let spheres1 = SharedSpheres::new(shape1, primitive1, primitive2, settled1);
                let spheres2 = SharedSpheres::new(shape2, primitive2, primitive1, settled2);
                let (main, is_near) = two_sided((&first, spheres1), (&second, spheres2), prediction, &mut push);
                if is_near {
                    crossings(&first, &second, &main, prediction, &mut push);
                }
                directions.learn(main.normal);
            }
        }));
    };
    match candidates {
        Some(known) => known.into_iter().for_each(|pair| collect(pair, shape1.hull(pair[0]).placed(&to_second))),
        None => near_shape(shape1, shape2, pose12, prediction, near, collect),
    }
    thin(contacts, taken);
    seams::remove(contacts, pose12.rotation, [shape1, shape2], length_unit, seams);
}

impl seams::Side for Shape {
    fn aabb(&self, primitive: u32) -> Aabb {
        self.hull(primitive).aabb()
    }

    fn separation(&self, primitive: u32, point: Vec3, normal: Vec3, height: f32, flush: f32) -> Option<Separation> {
        let hull = self.hull(primitive);
        let reaches = hull.height(point, normal) >= -flush;
        reaches.then(|| hull.separation_from(point, [Sphere::new(normal * height, 0.0)]))
    }
}

impl seams::Side for Parts<'_> {
    fn aabb(&self, id: u32) -> Aabb {
        part(self, id).map_or(Aabb::EMPTY, |part| part.aabb().transformed(&part.pose, 1.0))
    }

    fn separation(&self, id: u32, point: Vec3, normal: Vec3, height: f32, _: f32) -> Option<Separation> {
        part(self, id).map(|part| part.separation_from(point, normal * height))
    }
}

/// Returns the part with an id, by binary search.
fn part<'p, 'a>(parts: &'p Parts<'a>, id: u32) -> Option<&'p Part<'a>> {
    parts.binary_search_by_key(&id, |part| part.id).ok().map(|at| &parts[at])
}

/// Collects the contacts within `prediction` metres of a convex part of another collider.
fn collect_part(
    shape1: &Shape,
    part: &Part,
    pose12: &Pose3,
    prediction: f32,
    contacts: &mut Vec<Contact>,
    near: &mut near::Room,
) {
    let pose12 = *pose12 * part.pose;
    let to_first = Placement::from(pose12);
    let within = prediction + part.rounding;
    near_part(shape1, part, &pose12, prediction, near, |primitive1, hull| {
        let mut push = |s: &Separation| {
            contacts.push(Contact {
                point1: to_first.point(s.point1),
                point2: part.pose.transform_point(s.point2 - s.normal * part.rounding),
                normal1: to_first.vector(s.normal),
                distance: s.distance - part.rounding,
                primitive1,
                primitive2: part.id,
            });
        };
        with_spheres!(hull, |first| match &part.core {
            Core::Cuboid(half) => {
                if let (main, true) = one_sided((&first, NONE_SHARED), &Cuboid { half: *half }, within, &mut push) {
                    on_face(&first, &face(*half, -main.normal), &main, within, &mut push);
                }
            }
            Core::Support(shape) => {
                if let (main, true) = one_sided((&first, NONE_SHARED), &Support(&**shape), within, &mut push) {
                    let mut corners = ArrayVec::<Sphere, 4>::new();
                    shape.face(-main.normal, main.point2, &mut |corner| {
                        // Four corners are enough.
                        let _ = corners.try_push(Sphere::new(corner, 0.0));
                    });
                    on_face(&first, &corners, &main, within, &mut push);
                }
            }
            Core::Hull(hull) => with_spheres!(*hull, |second| {
                two_sided((&first, NONE_SHARED), (&second, NONE_SHARED), within, &mut push);
            }),
        });
    });
}

/// Returns the corners of the box face whose outward normal is closest to `direction`, in order around the face.
fn face(half: Vec3, direction: Vec3) -> [Sphere; 4] {
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
fn on_face<const N: usize>(
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
fn crossings(
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

/// Returns the spheres at the crossing of two edges, as seen along the normal. `None` near an end of an edge, because the end is a contact of its own: the two
/// contacts would replace each other from step to step.
fn crossing(ours: &[Sphere; 2], theirs: &[Sphere; 2], normal: Vec3) -> Option<[Sphere; 2]> {
    let [way1, way2] = [ours, theirs].map(|[a, b]| b.center - a.center);
    let [length1, length2] = [way1, way2].map(Vec3::length);
    let (apart, area) = (theirs[0].center - ours[0].center, way1.cross(way2).dot(normal));
    let [along1, along2] = [way2, way1].map(|way| apart.cross(way).dot(normal) / area);
    let end = CROSSING_END * length1.min(length2);
    let is_within = |along: f32, length: f32| (end..length - end).contains(&(along * length));
    let cross = area.abs() > CROSSING_SINE * length1 * length2;
    (cross && is_within(along1, length1) && is_within(along2, length2))
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
fn two_sided<const N: usize, const M: usize>(
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
    rise.cross(normal).length_squared() <= (SAME_SPHERE * sphere.radius).powi(2)
        && (rise.length_squared() - sphere.radius.powi(2)).abs() <= SAME_SPHERE * sphere.radius.powi(2)
}

/// [`two_sided`] without the spheres of the second side.
fn one_sided<const N: usize, B: Convex>(
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
struct SharedSpheres<'a> {
    indices: &'a [u32],
    other: u32,
    /// Pairs of a sphere and a primitive of the other side that need no further test.
    settled: Option<&'a mut HashSet<[u32; 2]>>,
}

const NONE_SHARED: SharedSpheres = SharedSpheres { indices: &[], other: 0, settled: None };

impl<'a> SharedSpheres<'a> {
    fn new(shape: &'a Shape, primitive: u32, other: u32, settled: &'a mut HashSet<[u32; 2]>) -> Self {
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
