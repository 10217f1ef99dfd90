//! Contacts of a pair at an instant: a pure function of shapes, relative pose and prediction distance.
//!
//! The narrow phase and rapier's dispatcher both call it, so a contact that the step has found and one that is computed on
//! demand are the same to the bit.

use std::fmt;

use glam::Vec3;

use super::{Hull, Shape, reduce::reduce, with_spheres};
use crate::{
    constants::VERTEX_NORMAL_COSINE,
    geometry::{Aabb, Placement, Pose3, Sphere, part_within},
    query::{Convex, Cuboid, Separation, Support, SupportShape, separation},
};

/// The second side of a pair.
#[derive(Clone, Copy)]
pub enum Second<'a> {
    /// A medial shape.
    Shape(&'a Shape),
    /// A box `[-half, half]`.
    Cuboid(Vec3),
    /// One primitive: a ball, a capsule, a triangle.
    Hull(Hull),
    /// Any other convex shape.
    Support(&'a dyn SupportShape),
}

impl fmt::Debug for Second<'_> {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Second::Shape(shape) => f.debug_tuple("Shape").field(shape).finish(),
            Second::Cuboid(half) => f.debug_tuple("Cuboid").field(half).finish(),
            Second::Hull(hull) => f.debug_tuple("Hull").field(hull).finish(),
            Second::Support(shape) => f.debug_tuple("Support").field(&shape.aabb()).finish(),
        }
    }
}

impl Second<'_> {
    /// Number of primitives.
    pub fn len(&self) -> usize {
        match self {
            Second::Shape(shape) => shape.len(),
            Second::Cuboid(_) | Second::Hull(_) | Second::Support(_) => 1,
        }
    }

    /// False: there is at least one primitive.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Box around it.
    pub fn aabb(&self) -> Aabb {
        match *self {
            Second::Shape(shape) => shape.aabb(),
            Second::Cuboid(half) => Aabb { min: -half, max: half },
            Second::Hull(hull) => with_spheres!(hull, |spheres| Aabb::from_spheres(spheres)),
            Second::Support(shape) => shape.aabb(),
        }
    }
}

/// A contact point of two primitives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contact {
    /// On the first surface, in the frame of body 1.
    pub point1: Vec3,
    /// On the second surface, in the frame of body 2.
    pub point2: Vec3,
    /// Unit normal from 1 to 2, in the frame of body 1.
    pub normal1: Vec3,
    /// Distance along the normal in metres; negative for an overlap.
    pub distance: f32,
    /// Primitive of the first body.
    pub primitive1: u32,
    /// Primitive of the second; 0 for anything but a shape.
    pub primitive2: u32,
}

/// Up to four contacts that share a normal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Manifold {
    /// Unit normal from 1 to 2, in the frame of body 1: that of the deepest contact, which is the first.
    pub normal1: Vec3,
    points: [Contact; 4],
    len: u8,
}

impl Manifold {
    /// A manifold of 1 to 4 contacts, the deepest first.
    pub(super) fn new(contacts: &[Contact]) -> Self {
        let points = std::array::from_fn(|i| contacts[i.min(contacts.len() - 1)]);
        Self { normal1: contacts[0].normal1, points, len: contacts.len().min(4) as u8 }
    }

    /// The contacts, the deepest first.
    pub fn contacts(&self) -> &[Contact] {
        &self.points[..usize::from(self.len)]
    }
}

/// All manifolds of a pair within `prediction` metres. `pose12`: pose of body 2 in the frame of body 1.
pub fn manifolds(shape1: &Shape, second: Second, pose12: &Pose3, prediction: f32) -> Vec<Manifold> {
    let mut contacts = Vec::new();
    find(shape1, second, pose12, prediction, &mut contacts);
    reduced(contacts)
}

/// All contacts of a pair within `prediction` metres.
pub fn find(shape1: &Shape, second: Second, pose12: &Pose3, prediction: f32, contacts: &mut Vec<Contact>) {
    collect(shape1, second, pose12, prediction, &near(shape1, second, pose12, prediction), contacts);
}

/// The manifolds that a pair's contacts are reduced to.
pub fn reduced(mut contacts: Vec<Contact>) -> Vec<Manifold> {
    let mut manifolds = Vec::new();
    reduce(&mut contacts, &mut manifolds);
    manifolds
}

/// Primitive pairs whose boxes come within `margin`, in ascending order.
pub(super) fn near(shape1: &Shape, second: Second, pose12: &Pose3, margin: f32) -> Vec<[u32; 2]> {
    let pose21 = pose12.inverse();
    let mut pairs = Vec::new();
    match second {
        Second::Shape(shape2) => shape1.bvh().visit_pairs(
            shape2.bvh(),
            |aabb1, aabb2| {
                let aabb2 = Aabb { min: aabb2.min * shape2.scale, max: aabb2.max * shape2.scale };
                aabb1.transformed(&pose21, shape1.scale).inflated(margin).overlaps(&aabb2)
            },
            |i, j| pairs.push([i, j]),
        ),
        Second::Cuboid(_) | Second::Hull(_) | Second::Support(_) => {
            let target = second.aabb().inflated(margin);
            let reaches = |aabb: &Aabb| aabb.transformed(&pose21, shape1.scale).overlaps(&target);
            shape1.bvh().visit(reaches, |i| pairs.push([i, 0]));
        }
    }
    pairs.sort_unstable();
    pairs
}

/// Contacts within `prediction` of the candidate primitive pairs.
pub(super) fn collect(
    shape1: &Shape,
    second: Second,
    pose12: &Pose3,
    prediction: f32,
    candidates: &[[u32; 2]],
    contacts: &mut Vec<Contact>,
) {
    // Of a box only the part in reach, in whose frame the kernel works.
    let pose21 = pose12.inverse();
    let (second, center) = match second {
        Second::Cuboid(half) => {
            let (center, part) = part_within(half, &shape1.aabb().transformed(&pose21, 1.0).inflated(prediction));
            (Second::Cuboid(part), center)
        }
        other => (other, Vec3::ZERO),
    };
    let to_second = Placement::from(Pose3::from_translation(-center) * pose21);
    let to_first = Placement::from(*pose12 * Pose3::from_translation(center));
    for &[primitive1, primitive2] in candidates {
        let hull1 = shape1.hull(primitive1).placed(&to_second);
        let mut push = |s: &Separation| {
            contacts.push(Contact {
                point1: to_first.point(s.point1),
                point2: s.point2 + center,
                normal1: to_first.rotation * s.normal,
                distance: s.distance,
                primitive1,
                primitive2,
            });
        };
        with_spheres!(hull1, |first| match second {
            Second::Cuboid(half) => {
                one_sided(&first, &Cuboid { half }, prediction, &mut push);
            }
            Second::Support(shape) => {
                one_sided(&first, &Support(shape), prediction, &mut push);
            }
            Second::Hull(hull2) => with_spheres!(hull2, |other| two_sided(&first, &other, prediction, &mut push)),
            Second::Shape(shape2) => {
                with_spheres!(shape2.hull(primitive2), |other| two_sided(&first, &other, prediction, &mut push))
            }
        });
    }
}

/// The nearest points of two primitives, and the nearest points of the other spheres on either side that face the same way:
/// a cone on a floor, or beside another cone, touches along a line, and rests on both its ends.
fn two_sided<const N: usize, const M: usize>(
    first: &[Sphere; N],
    second: &[Sphere; M],
    prediction: f32,
    push: &mut impl FnMut(&Separation),
) {
    let Some(main) = one_sided(first, second, prediction, push) else { return };
    if N > 1 && M > 1 {
        for sphere in second {
            let ours = separation(first, &[*sphere], 0);
            if ours.distance <= prediction && ours.normal.dot(main) >= VERTEX_NORMAL_COSINE {
                push(&ours);
            }
        }
    }
}

/// The same for the spheres of the first side alone. Returns the normal of the nearest points.
fn one_sided<const N: usize, B: Convex>(
    first: &[Sphere; N],
    second: &B,
    prediction: f32,
    push: &mut impl FnMut(&Separation),
) -> Option<Vec3> {
    let main = separation(first, second, 0);
    if main.distance > prediction {
        return None;
    }
    push(&main);
    if N > 1 {
        for sphere in first {
            let ours = separation(&[*sphere], second, 0);
            if ours.distance <= prediction && ours.normal.dot(main.normal) >= VERTEX_NORMAL_COSINE {
                push(&ours);
            }
        }
    }
    Some(main.normal)
}
