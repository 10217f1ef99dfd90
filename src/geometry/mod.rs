//! Shapes and motions as plain data, without ECS.
//!
//! A medial primitive is the convex hull of one to three [`Sphere`]s:
//!
//! ```text
//!   sphere        medial cone           medial slab
//!    ( )         ( )-------( )      ( )----------( )
//!                (           )       \            /     two tangent planes, three cones,
//!                ( )-------( )        \___ ( ) __/      three spheres
//! ```
//!
//! Its surface is `{ c(w) + r(w) n }` for barycentric weights `w` and the linear interpolation of centres and radii.
//! Units are metres and radians; [`Pose3`] maps a local point to its parent frame.

mod aabb;
mod bvh;
mod obb;
mod placement;
mod primitive;
mod sweep;

pub use aabb::Aabb;
pub(crate) use aabb::Box3A;
pub(crate) use bvh::Item;
pub use bvh::{Bvh, Leaf, Values};
pub use glamx::Pose3;
pub use obb::Obb;
pub(crate) use obb::part_within;
pub use placement::Placement;
pub use primitive::{Parts, Primitive, Sphere};
pub use sweep::Sweep;
