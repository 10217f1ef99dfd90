//! Contacts of a pair at an instant: a pure function of shapes, relative pose and prediction distance.
//!
//! The narrow phase and rapier's dispatcher call the same function, so contacts from the step and contacts that are computed on demand have the same bits. Only the
//! step knows which contacts a fast pair that is apart will reach.

use arrayvec::ArrayVec;
use bevy::platform::collections::HashSet;
use glam::{Vec3, Vec4};

use crate::{
    constants::CONTACT_ROUNDING,
    geometry::{Aabb, Placement, Pose3, Sphere},
    pipeline::{
        ContactMargin, ConvexParts, Core, Hull, OtherShape, Part, Parts, Shape,
        contacts::{
            cluster::{self, cluster},
            features::{NONE_SHARED, SharedSpheres, crossings, face, on_face, one_sided, two_sided},
            internal_edges,
            manifold::{Contact, Manifold},
            near::{self, near_part, near_parts, near_shape},
            near_list::{NearList, NearPair},
            reduce::reduce,
        },
        directions::Directions,
        with_spheres,
    },
    query::{Cuboid, Separation, Support},
};

/// Buffers that are kept from pair to pair to avoid allocations.
#[derive(Debug, Default)]
pub(in crate::pipeline) struct Scratch {
    pub near: near::Scratch,
    /// Per side, each sphere and the primitive of the other side with which it needs no further test.
    settled: [HashSet<[u32; 2]>; 2],
    taken: cluster::Taken,
    edges: internal_edges::Scratch,
}

/// Returns all manifolds of a pair. `pose12`: pose of body 2 in the frame of body 1. A fast pair that is apart has no manifolds, because its motion is not known.
pub fn manifolds(shape1: &Shape, second: OtherShape, pose12: &Pose3, reach: impl Into<ContactMargin>) -> Vec<Manifold> {
    let (reach, mut contacts, mut manifolds) = (reach.into(), Vec::new(), Vec::new());
    find(shape1, second, pose12, reach, &mut contacts);
    reach.keep_reached(&mut contacts, |_| false);
    reduce(&mut contacts, reach.length_unit, &mut Default::default(), |manifold| manifolds.push(manifold));
    manifolds
}

/// Replaces `contacts` with all contacts of a pair.
pub fn find(
    shape1: &Shape,
    second: OtherShape,
    pose12: &Pose3,
    reach: impl Into<ContactMargin>,
    contacts: &mut Vec<Contact>,
) {
    contacts.clear();
    let (reach, buffers) = (reach.into(), &mut Scratch::default());
    match second {
        OtherShape::Shape(shape2) => {
            let mut pairs = Vec::new();
            let list = near_shape(shape1, shape2, pose12, reach.prediction, &mut buffers.near, &mut pairs);
            of_shapes(shape1, shape2, pose12, reach, &list, &mut pairs, contacts, buffers);
        }
        OtherShape::Parts(parts) => of_parts(shape1, parts, pose12, reach, None, contacts, buffers),
    }
}

/// Finds the contacts of a medial shape and another collider. `contacts` has to be empty. `listed`: the pairs of primitive and part that may have contacts;
/// `None` if they are not known.
pub(in crate::pipeline) fn of_parts(
    shape1: &Shape,
    parts: &dyn ConvexParts,
    pose12: &Pose3,
    ContactMargin { prediction, length_unit, .. }: ContactMargin,
    listed: Option<&[NearPair]>,
    contacts: &mut Vec<Contact>,
    buffers: &mut Scratch,
) {
    let parts = near_parts(shape1, parts, pose12, prediction);
    for part in &parts {
        collect_part(shape1, part, pose12, prediction, listed, contacts, &mut buffers.near);
    }
    contacts.sort_unstable_by(Contact::order);
    let sides: [&dyn internal_edges::Side; 2] = [shape1, &parts];
    internal_edges::remove(contacts, pose12.rotation, sides, length_unit, &mut buffers.edges);
}

/// Finds the contacts of two medial shapes. `contacts` has to be empty. `list`: bounds of `pairs`, which are the primitive pairs that may have contacts, in
/// ascending order. Their own bounds are updated.
pub(in crate::pipeline) fn of_shapes(
    shape1: &Shape,
    shape2: &Shape,
    pose12: &Pose3,
    ContactMargin { prediction, length_unit, .. }: ContactMargin,
    list: &NearList,
    pairs: &mut [NearPair],
    contacts: &mut Vec<Contact>,
    Scratch { settled, taken, edges, .. }: &mut Scratch,
) {
    let to_second = Placement::from(pose12.inverse());
    let to_first = Placement::from(*pose12);
    let mut directions = Directions::default();
    // Allowance for rounding: otherwise the contacts would depend on the order of the pairs.
    let [size1, size2] = [shape1, shape2].map(|shape| shape.bounding_sphere().radius);
    let apart = Vec4::splat(prediction + CONTACT_ROUNDING * (size1 + size2));
    settled.iter_mut().for_each(HashSet::clear);
    for of_first in pairs.chunk_by_mut(|pair, next| pair.primitives[0] == next.primitives[0]) {
        let mut near = of_first.iter_mut().filter(|pair| list.is_near(pair, prediction)).peekable();
        let Some(primitive1) = near.peek().map(|pair| pair.primitives[0]) else { continue };
        let hull = shape1.hull(primitive1).placed(&to_second);
        for pair in near {
            let primitive2 = pair.primitives[1];
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
            let distance = with_spheres!(hull, |first| with_spheres!(shape2.hull(primitive2), |second| {
                let gaps = directions.low(&second) - directions.high(&first);
                if gaps.cmpgt(apart).any() {
                    gaps.max_element()
                } else {
                    let [settled1, settled2] = &mut *settled;
                    let spheres1 = SharedSpheres::new(shape1, primitive1, primitive2, settled1);
                    let spheres2 = SharedSpheres::new(shape2, primitive2, primitive1, settled2);
                    let (main, is_near) = two_sided((&first, spheres1), (&second, spheres2), prediction, &mut push);
                    if is_near {
                        crossings(&first, &second, &main, prediction, &mut push);
                    }
                    directions.push_axis(main.normal);
                    main.distance
                }
            }));
            list.separate(pair, distance);
        }
    }
    cluster(contacts, taken);
    internal_edges::remove(contacts, pose12.rotation, [shape1, shape2], length_unit, edges);
}

impl internal_edges::Side for Shape {
    fn aabb(&self, primitive: u32) -> Aabb {
        self.hull(primitive).aabb()
    }

    fn separation(&self, primitive: u32, point: Vec3, normal: Vec3, height: f32, flush: f32) -> Option<Separation> {
        let hull = self.hull(primitive);
        let reaches = hull.height(point, normal) >= -flush;
        reaches.then(|| hull.separation_from(point, [Sphere::new(normal * height, 0.0)]))
    }
}

impl internal_edges::Side for Parts<'_> {
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
    listed: Option<&[NearPair]>,
    contacts: &mut Vec<Contact>,
    near: &mut near::Scratch,
) {
    let pose12 = *pose12 * part.pose;
    let to_first = Placement::from(pose12);
    let within = prediction + part.rounding;
    let mut collect = |primitive1: u32, hull: Hull| {
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
    };
    match listed {
        Some(pairs) => {
            let to_part = Placement::from(pose12.inverse());
            for [primitive1, _] in pairs.iter().map(|pair| pair.primitives).filter(|[_, id]| *id == part.id) {
                collect(primitive1, shape1.hull(primitive1).placed(&to_part));
            }
        }
        None => near_part(shape1, part, &pose12, prediction, near, collect),
    }
}
