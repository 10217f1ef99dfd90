//! The asset: an immutable medial mesh that all instances of a shape share.
//!
//! ```text
//! .ma text --ma::parse--> lists --MedialAxis::new--> validate -> clean up -> derive (boxes, balls) -> MedialAxis
//! ```
//!
//! All values are in the shape's own frame, in metres, at unit scale and unit density.

mod bound;
mod chord;
mod cleanup;
pub mod ma;
mod mass;
mod mirror;
pub mod packed;
#[cfg(feature = "rapier")]
mod parts;
mod posed;
mod shapes;
mod skin;
mod surface;

#[cfg(test)]
pub(crate) mod oracle;

#[cfg(feature = "gpu")]
use std::sync::Weak;
use std::sync::{Arc, OnceLock};

use bevy::{asset::Asset, reflect::Reflect};
use thiserror::Error;

use crate::geometry::{Aabb, Bvh, Primitive, Sphere};

use bound::bounding_sphere;
pub use cleanup::CleanupReport;
pub(crate) use cleanup::numbers_of_kept;
pub use mass::MassProperties;
pub(crate) use mass::{Chord, LINES, first_line, line_position};
pub use skin::{JointPose, JointWeights, MAX_INFLUENCES, MAX_JOINTS, Skin, SkinError, SkinJoint};
pub(crate) use skin::{strongest, summed};
pub(crate) use surface::face_normals;
#[cfg(feature = "debug")]
pub(crate) use surface::mantle_directions;
pub use surface::{Surface, triangulate};

/// Largest coordinate or radius of a shape, in metres. Within this range no derived value overflows an f32.
pub const MAX_EXTENT: f32 = 1.0e6;

/// Largest number of spheres of a shape, far below the range of the packed form's indices.
pub const MAX_SPHERES: usize = 1 << 20;

/// An immutable solid shape: the union of medial primitives.
///
/// Invariants, established by every constructor:
/// * there is at least one primitive, all indices are in range and no sphere is unused;
/// * all values are finite, no radius is negative;
/// * no primitive is degenerate, listed twice or covered: a primitive is covered if each of its spheres equals, or lies
///   inside, a sphere of one other primitive. For example, the edges of a slab are not listed in addition to the slab;
/// * primitives are in ascending order (spheres, cones, slabs), as are the indices in each.
///
/// Clones share all data.
#[derive(Asset, Reflect, Clone, Debug)]
#[reflect(opaque, Clone, Debug)]
pub struct MedialAxis(Arc<Data>);

#[derive(Clone, Debug)]
struct Data {
    spheres: Box<[Sphere]>,
    primitives: Arc<[Primitive]>,
    bvh: OnceLock<Bvh>,
    /// The shape in the bind pose, if this is a pose of it.
    bind: Option<MedialAxis>,
    aabb: Aabb,
    bounding_sphere: Sphere,
    center_reach: f32,
    mass: OnceLock<MassProperties>,
    mirrored: OnceLock<MedialAxis>,
    min_radius: f32,
    coarser: Vec<(MedialAxis, f32)>,
    skin: Option<Skin>,
}

/// A weak reference to a medial axis.
#[cfg(feature = "gpu")]
#[derive(Debug)]
pub(crate) struct WeakMedialAxis(Weak<Data>);

#[cfg(feature = "gpu")]
impl WeakMedialAxis {
    /// The axis, if it still exists on its own or as a level of detail.
    pub fn upgrade(&self) -> Option<MedialAxis> {
        self.0.upgrade().map(MedialAxis)
    }
}

/// Reasons why lists or parameters do not describe a shape.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum MedialAxisError {
    /// There is no sphere.
    #[error("the shape has no spheres")]
    Empty,
    /// There are more spheres than [`MAX_SPHERES`].
    #[error("the shape has {0} spheres, more than {MAX_SPHERES}")]
    TooManySpheres(usize),
    /// A coordinate or radius is NaN, infinite or beyond [`MAX_EXTENT`].
    #[error("sphere {sphere}: {value} is not a number from -{MAX_EXTENT} to {MAX_EXTENT}")]
    NotFinite {
        /// Index of the sphere.
        sphere: usize,
        /// The invalid coordinate or radius.
        value: f32,
    },
    /// A radius is negative.
    #[error("sphere {sphere}: the radius {radius} is negative")]
    NegativeRadius {
        /// Index of the sphere.
        sphere: usize,
        /// Its radius.
        radius: f32,
    },
    /// A primitive refers to a sphere that does not exist.
    #[error("primitive {primitive}: there is no sphere {index} among {spheres}")]
    IndexOutOfRange {
        /// Index of the primitive.
        primitive: usize,
        /// The invalid index.
        index: u32,
        /// Number of spheres.
        spheres: usize,
    },
    /// A parameter of a shape constructor is out of its range.
    #[error("{name} is {value}, but must be {range}")]
    Parameter {
        /// Name of the parameter.
        name: &'static str,
        /// Its value.
        value: f32,
        /// Description of the allowed range.
        range: &'static str,
    },
}

impl MedialAxis {
    /// Creates a shape from its spheres and primitives.
    ///
    /// Each sphere without a primitive becomes a primitive. Then the lists are cleaned up, which does not change the
    /// set of points that they fill. The report lists the changes.
    ///
    /// # Errors
    /// If there are no spheres or too many, if a number is not finite or too large, if a radius is negative or if an
    /// index is out of range. A primitive that refers to a sphere twice is degenerate, which is not an error.
    pub fn new(
        spheres: Vec<Sphere>,
        primitives: Vec<Primitive>,
    ) -> Result<(MedialAxis, CleanupReport), MedialAxisError> {
        validate(&spheres, &primitives)?;
        let (spheres, primitives, report) = cleanup::clean_up(spheres, primitives);
        Ok((Self::derive(spheres, primitives), report))
    }

    /// Creates a shape from spheres, edges and faces; see [`new`](Self::new).
    ///
    /// # Errors
    /// The errors of [`new`](Self::new). Primitives are counted edges first.
    pub fn from_lists(
        spheres: Vec<Sphere>,
        edges: &[[u32; 2]],
        faces: &[[u32; 3]],
    ) -> Result<(MedialAxis, CleanupReport), MedialAxisError> {
        let cones = edges.iter().map(|&e| Primitive::Cone(e));
        let slabs = faces.iter().map(|&f| Primitive::Slab(f));
        Self::new(spheres, cones.chain(slabs).collect())
    }

    /// Computes all values derived from clean lists.
    fn derive(spheres: Vec<Sphere>, primitives: Vec<Primitive>) -> Self {
        let bound = bounding_sphere(&spheres);
        Self(Arc::new(Data {
            bvh: OnceLock::from(Bvh::new(&boxes(&spheres, &primitives))),
            bind: None,
            aabb: Aabb::from_spheres(spheres.iter().copied()),
            bounding_sphere: bound,
            center_reach: spheres.iter().map(|s| s.center.distance(bound.center)).fold(0.0, f32::max),
            mass: OnceLock::new(),
            mirrored: OnceLock::new(),
            min_radius: spheres.iter().fold(f32::INFINITY, |least, s| least.min(s.radius)),
            coarser: Vec::new(),
            skin: None,
            spheres: spheres.into(),
            primitives: primitives.into(),
        }))
    }

    /// The same shape with coarser levels of detail, finer levels first, each with its error in metres.
    ///
    /// The levels take over the mass properties of this shape, which are computed here. So a body moves alike at all levels of detail.
    #[must_use]
    pub fn with_coarser(mut self, mut coarser: Vec<(MedialAxis, f32)>) -> Self {
        let mass = *self.mass();
        coarser.iter_mut().for_each(|(level, _)| *level = level.clone().with_mass(mass));
        Arc::make_mut(&mut self.0).coarser = coarser;
        self
    }

    /// The same shape, bound to the joints of a skeleton. Its spheres are those of the bind pose. Coarser levels keep their own skins.
    ///
    /// # Errors
    /// If the skin does not have the weights of as many points as the shape has spheres.
    pub fn with_skin(self, skin: Skin) -> Result<Self, SkinError> {
        let (weights, points) = (skin.weights().len(), self.spheres().len());
        if weights != points {
            return Err(SkinError::Count { weights, points });
        }
        Ok(self.bound(skin))
    }

    /// The same shape with a skin of as many points as spheres.
    pub(crate) fn bound(mut self, skin: Skin) -> Self {
        Arc::make_mut(&mut self.0).skin = Some(skin);
        self
    }

    /// The shape in a pose of its joints, as a rigid shape; a shape without a skin does not change. The clean-up merges primitives that are degenerate in the
    /// pose, so spheres may have other indices.
    ///
    /// # Errors
    /// If a posed sphere is not finite or too far away.
    ///
    /// # Panics
    /// If there are fewer poses than joints.
    pub fn posed(&self, poses: &[JointPose]) -> Result<MedialAxis, MedialAxisError> {
        let mut spheres = self.spheres().to_vec();
        if let Some(skin) = self.skin() {
            skin.pose(self.spheres(), poses, &mut spheres);
        }
        Ok(Self::new(spheres, self.primitives().to_vec())?.0)
    }

    /// The binding to the joints of a skeleton, with the weights of each sphere. `None` for a rigid shape.
    pub fn skin(&self) -> Option<&Skin> {
        self.0.skin.as_ref()
    }

    /// The coarser levels of detail, finer levels first. Each has an error in metres: the distance between its surface and that of the original body.
    pub fn coarser(&self) -> &[(MedialAxis, f32)] {
        &self.0.coarser
    }

    /// The index of the coarsest level of detail with an error of at most `error` metres. It is 0, this shape, if no coarser level is accurate enough.
    pub fn level_within(&self, error: f32) -> usize {
        self.0.coarser.iter().rposition(|level| level.1 <= error).map_or(0, |at| at + 1)
    }

    /// A level of detail: 0 is this shape, 1 the first of the [coarser](Self::coarser) ones. A larger number than the last one's gives the coarsest level.
    pub fn level(&self, number: usize) -> &MedialAxis {
        let coarser = &self.0.coarser[..number.min(self.0.coarser.len())];
        coarser.last().map_or(self, |(level, _)| level)
    }

    /// Memory of the shape, its mirror image if it is used, and its coarser levels of detail, in bytes. Clones share it.
    pub fn memory(&self) -> usize {
        let Data { spheres, primitives, bvh, coarser, skin, mirrored, .. } = &*self.0;
        let own = size_of::<Data>() + size_of_val::<[Sphere]>(spheres) + size_of_val::<[Primitive]>(primitives);
        own + bvh.get().map_or(0, Bvh::memory)
            + skin.as_ref().map_or(0, Skin::memory)
            + mirrored.get().map_or(0, MedialAxis::memory)
            + coarser.iter().map(|(level, _)| level.memory()).sum::<usize>()
    }

    /// The medial spheres.
    pub fn spheres(&self) -> &[Sphere] {
        &self.0.spheres
    }

    /// The primitives, whose union is the shape.
    pub fn primitives(&self) -> &[Primitive] {
        &self.0.primitives
    }

    /// A number that is unique among all axes as long as this axis or a weak reference to it exists.
    pub(crate) fn address(&self) -> usize {
        Arc::as_ptr(&self.0).addr()
    }

    /// A weak reference, which shows whether the axis still exists.
    #[cfg(feature = "gpu")]
    pub(crate) fn downgrade(&self) -> WeakMedialAxis {
        WeakMedialAxis(Arc::downgrade(&self.0))
    }

    /// Hierarchy over the boxes of the primitives. That of a pose is computed on the first call.
    pub fn bvh(&self) -> &Bvh {
        let Data { bvh, bind, spheres, primitives, .. } = &*self.0;
        bvh.get_or_init(|| {
            let boxes = boxes(spheres, primitives);
            bind.as_ref().map_or_else(|| Bvh::new(&boxes), |bind| bind.bvh().refitted(&boxes))
        })
    }

    /// The smallest axis-aligned box around the shape, up to rounding.
    pub fn aabb(&self) -> Aabb {
        self.0.aabb
    }

    /// A sphere around the shape, at most about 1 % larger than the smallest one.
    pub fn bounding_sphere(&self) -> Sphere {
        self.0.bounding_sphere
    }

    /// Distance from the centre of the [bounding sphere](Self::bounding_sphere) to the farthest sphere centre, in metres.
    pub fn center_reach(&self) -> f32 {
        self.0.center_reach
    }

    /// Volume, centre of mass and inertia of the shape at unit density. Computed on the first call, in some milliseconds; loaded assets have them already.
    pub fn mass(&self) -> &MassProperties {
        self.0.mass.get_or_init(|| MassProperties::of_union(&self.0.spheres, &self.0.primitives))
    }

    /// Smallest radius of all spheres, in metres. No part of the shape is thinner than twice this value.
    pub fn min_radius(&self) -> f32 {
        self.0.min_radius
    }
}

fn boxes(spheres: &[Sphere], primitives: &[Primitive]) -> Vec<Aabb> {
    let of = |primitive: &Primitive| Aabb::from_spheres(primitive.indices().iter().map(|&i| spheres[i as usize]));
    primitives.iter().map(of).collect()
}

fn validate(spheres: &[Sphere], primitives: &[Primitive]) -> Result<(), MedialAxisError> {
    if spheres.is_empty() {
        return Err(MedialAxisError::Empty);
    }
    if spheres.len() > MAX_SPHERES {
        return Err(MedialAxisError::TooManySpheres(spheres.len()));
    }
    for (sphere, s) in spheres.iter().enumerate() {
        let values = [s.center.x, s.center.y, s.center.z, s.radius];
        // NaN is not contained in any range.
        if let Some(&value) = values.iter().find(|v| !(-MAX_EXTENT..=MAX_EXTENT).contains(*v)) {
            return Err(MedialAxisError::NotFinite { sphere, value });
        }
        if s.radius < 0.0 {
            return Err(MedialAxisError::NegativeRadius { sphere, radius: s.radius });
        }
    }
    for (primitive, p) in primitives.iter().enumerate() {
        if let Some(&index) = p.indices().iter().find(|&&i| i as usize >= spheres.len()) {
            return Err(MedialAxisError::IndexOutOfRange { primitive, index, spheres: spheres.len() });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests;
