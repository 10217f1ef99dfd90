//! The paper's own rules and method, to compare with those of `bevy_medial`.
//!
//! | module | section of the paper | content |
//! |---|---|---|
//! | [`chains`] | 4, figure 5 | chains of swept bounding spheres |
//! | [`slabs`] | 3.2 | degenerate slabs by two circles on the largest sphere |
//! | [`conic`] | 4.1 | overlap of a cone and a box by a quadratic function on the unit tesseract |
//! | [`flat`] | 4, 4.2 | swept bounding spheres, then all primitive pairs of the remaining body pairs, without trees |

pub mod chains;
pub mod conic;
pub mod flat;
pub mod slabs;

use bevy_medial::{
    geometry::{Obb, Sphere},
    query::{Cuboid, separation},
};

/// Distance of a swept sphere and a box, in metres; negative for an overlap.
fn distance_to_box(cone: &[Sphere; 2], obb: &Obb) -> f32 {
    let local = cone.map(|sphere| Sphere::new(obb.pose.inverse_transform_point(sphere.center), sphere.radius));
    separation(&local, &Cuboid { half: obb.half_extents }, 0).distance
}
