use std::{collections::HashMap, sync::Arc};

use bevy::prelude::*;

#[cfg(feature = "rapier")]
use super::screw::Screw;
use super::{MedialMesh, StaticObb};
use crate::{
    geometry::{Aabb, Pose3, Sphere},
    medial_axis::{JointPose, MedialAxis},
    pipeline::{Deforming, with_spheres},
    query::{ray_cast, separation},
};

/// Makes an entity collide with a medial mesh that follows the joints of a skeleton, such as those of an animated character.
///
/// The asset is a medial mesh with a [skin](MedialAxis::skin). The component needs no other one. It belongs on the entity with the `SkinnedMesh`, or on an
/// ancestor such as the root of a glTF scene. The joints are then found by name, as soon as the scene has been spawned.
///
/// In each step every sphere is placed by linear blend skinning, and its motion since the last step is swept. The entity is kinematic: it pushes dynamic
/// bodies and stops bullets, and nothing moves it. A `RigidBody` is not necessary; one on the entity or on an ancestor has to be kinematic or fixed.
/// It gets a [`SkinPose`] when it has been placed for the first time.
///
/// ```no_run
/// # use bevy::prelude::*;
/// # use bevy_medial::{plugin::SkinnedMedialMesh, prelude::*};
/// fn spawn(mut commands: Commands, assets: Res<AssetServer>) {
///     // In an app with Bevy's glTF loader, the entity also has a `WorldAssetRoot` with the scene of the character.
///     commands.spawn(SkinnedMedialMesh::new(assets.load("models/character.medial")));
/// }
/// ```
///
/// A [`MedialMesh`] or [`StaticObb`] on the same entity has no effect, which is logged.
///
/// An error is logged once, with the name of the entity, and the entity collides with nothing: a mesh without a skin, an unknown joint, a joint that was
/// despawned, a scale that is not uniform. A motion of more than [`TELEPORT`](crate::constants::TELEPORT) radii within a step is logged once. It is not
/// swept.
#[derive(Component, Clone, Debug, PartialEq, Reflect)]
#[reflect(Component, Default, Clone, PartialEq)]
#[require(Transform)]
pub struct SkinnedMedialMesh {
    /// The shape, with a skin.
    pub mesh: Handle<MedialAxis>,
    /// The entities of the joints, in the order of the skin. Default: none, so that they are found by name.
    #[entities]
    pub joints: Vec<Entity>,
    /// Number of steps between two updates of a shape that is far or hidden. A shape is far if it is farther than `near` metres from every
    /// [`MedialFocus`](super::MedialFocus). It is hidden if no camera sees its skinned meshes, by Bevy's `ViewVisibility`, with the feature `bevy_mesh`. The
    /// interval also applies to each shape for which neither is known, because there is no focus and no camera or mesh. Default: 1.
    ///
    /// The motion between two updates is swept in the step of the update, so nothing passes through the shape.
    pub interval: u32,
    /// Hit regions: a label for each joint, by its name. [`SkinPose::region`] returns them. Default: none.
    pub regions: HashMap<String, String>,
}

impl Default for SkinnedMedialMesh {
    fn default() -> Self {
        Self::new(Handle::default())
    }
}

impl SkinnedMedialMesh {
    /// Creates a shape that is updated in each step and finds its joints by name.
    pub fn new(mesh: Handle<MedialAxis>) -> Self {
        Self { mesh, joints: Vec::new(), interval: 1, regions: HashMap::new() }
    }
}

/// A hit of a ray on a skinned shape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SkinHit {
    /// Distance from the origin, in lengths of the direction.
    pub time: f32,
    /// Outward unit normal, in the world.
    pub normal: Vec3,
    /// Index of the primitive.
    pub primitive: u32,
    /// The joint with the largest weight at the hit.
    pub joint: Entity,
}

/// The pose of a [`SkinnedMedialMesh`] at the end of the last step, and its motion in that step. Written by the plugin only.
#[derive(Component, Debug)]
pub struct SkinPose {
    pub(super) bound: Bound,
    /// The hit region of each joint.
    pub(super) regions: Vec<Option<String>>,
    /// Motion of the joints from the bind pose to their place in the world, at the last update but one.
    pub(super) before: Vec<JointPose>,
    /// The same at the last update.
    pub(super) poses: Vec<JointPose>,
    /// The spheres at the last update, in the world.
    pub(super) spheres: Vec<Sphere>,
    /// Number of steps between these two updates.
    pub(super) span: u32,
    pub(super) shape: Arc<Deforming>,
    pub(super) frame: Pose3,
    /// Number of steps since the last update.
    pub(super) age: u32,
    pub(super) teleports: bool,
    /// True if a motion was too long to be swept. This has been logged.
    pub(super) has_jumped: bool,
}

/// A shape and the joints that move it.
#[derive(Clone, Debug)]
pub(crate) struct Bound {
    /// The level of detail in the bind pose.
    pub axis: MedialAxis,
    /// In the order of the skin.
    pub joints: Arc<[Entity]>,
}

impl Bound {
    /// Returns the joint with the largest weight at a point of a primitive, in the frame of the shape. `shape`: the shape in motion.
    pub fn joint_at(&self, shape: &Deforming, primitive: u32, point: Vec3, fraction: f32) -> Option<Entity> {
        // The level of detail may have changed since the primitive was found.
        shape.axis().primitives().get(primitive as usize)?;
        let shares = shape.hull_at(primitive, fraction).shares(point);
        let joint = self.axis.skin()?.joint_within(self.axis.primitives().get(primitive as usize)?, &shares);
        self.joints.get(usize::from(joint)).copied()
    }
}

impl SkinPose {
    /// Returns the entities of the joints, in the order of the skin.
    pub fn joints(&self) -> &[Entity] {
        &self.bound.joints
    }

    /// Returns the shape and its motion in the last step, in the frame [`frame`](Self::frame).
    pub fn shape(&self) -> &Arc<Deforming> {
        &self.shape
    }

    /// Returns the pose of the shape's frame in the world.
    pub fn frame(&self) -> Pose3 {
        self.frame
    }

    /// Places the shape in the next step without sweeping its motion. Use it when the entity or its animation jumps.
    pub fn teleport(&mut self) {
        self.teleports = true;
    }

    /// Returns the joint with the largest weight at a point of a primitive. `point`: a point near the surface of the primitive, in the world. `fraction`: time
    /// of the point as a fraction of the last step.
    pub fn joint_at(&self, primitive: u32, point: Vec3, fraction: f32) -> Option<Entity> {
        self.bound.joint_at(&self.shape, primitive, self.frame.inverse_transform_point(point), fraction)
    }

    /// Returns the level of detail in the bind pose.
    #[cfg(feature = "rapier")]
    pub(crate) fn axis(&self) -> &MedialAxis {
        &self.bound.axis
    }

    /// Returns the joint with the largest weight at the point of the surface that is nearest to a point in the world, in the current pose. Use it for results
    /// without a primitive, such as those of shape casts.
    pub fn joint_near(&self, point: Vec3) -> Option<Entity> {
        let local = self.frame.inverse_transform_point(point);
        let to_point = |primitive| {
            let hull = self.shape.hull_at(primitive, 1.0);
            with_spheres!(&hull, |spheres| separation(spheres, &[Sphere::new(local, 0.0)], 0).distance)
        };
        // A box around the point may hold a primitive that contains the point more deeply than any other.
        let bound = |aabb: &Aabb| match aabb.distance(local) {
            0.0 => f32::NEG_INFINITY,
            distance => distance,
        };
        let (primitive, _) = self.shape.axis().bvh().least(bound, to_point)?;
        self.joint_at(primitive, point, 1.0)
    }

    /// Returns the displacement per step of a point that moves with a joint, and the rotation of the joint per step in radians: the mean between the last two
    /// updates. `point`: in the world.
    #[cfg(feature = "rapier")]
    pub(crate) fn moved_with(&self, joint: usize, point: Vec3) -> [Vec3; 2] {
        let [before, now] = [self.before[joint], self.poses[joint]];
        let start = (before.transform * now.transform.inverse()).transform_point3(point);
        let moved = if start.is_finite() { point - start } else { Vec3::ZERO };
        [moved, Screw::new([before, now]).turn()].map(|motion| motion / self.span.max(1) as f32)
    }

    /// Returns the place of a joint at the last update, in the world. It may have a scale.
    #[cfg(feature = "rapier")]
    pub(crate) fn place_of(&self, joint: usize) -> Option<bevy::math::Affine3A> {
        let bind = self.bound.axis.skin()?.joints().get(joint)?.inverse_bind.inverse();
        Some(self.poses[joint].transform * bind)
    }

    /// Returns the radius of a sphere that has the scale of a joint, in the world. In the pose it is smaller where a limb bends.
    #[cfg(feature = "rapier")]
    pub(crate) fn unbent_radius(&self, joint: usize, sphere: usize) -> f32 {
        self.bound.axis.spheres()[sphere].radius * self.poses[joint].scale
    }

    /// Returns the hit region of a joint.
    pub fn region(&self, joint: Entity) -> Option<&str> {
        let joint = self.bound.joints.iter().position(|known| *known == joint)?;
        self.regions[joint].as_deref()
    }

    /// Returns the first hit of the ray `origin + time * direction`, in the world, for times from 0 to `max_time`. A ray that starts inside hits at time 0.
    ///
    /// `fraction`: the pose that the ray hits, as a fraction of the last step: 1 for the current pose, 0 for the one before. The queries of
    /// [`MedialQueries`](crate::rapier::MedialQueries) use the current pose.
    pub fn cast_ray(&self, origin: Vec3, direction: Vec3, max_time: f32, fraction: f32) -> Option<SkinHit> {
        let (from, along) = (self.frame.inverse_transform_point(origin), self.frame.rotation.inverse() * direction);
        let mut first: Option<(f32, Vec3, u32)> = None;
        self.shape.visit_crossed(from, along, max_time, |primitive| {
            let limit = first.map_or(max_time, |(time, ..)| time);
            let hull = self.shape.hull_at(primitive, fraction);
            if let Some(hit) = with_spheres!(&hull, |spheres| ray_cast(spheres, from, along, limit))
                && first.is_none_or(|(time, ..)| hit.time < time)
            {
                first = Some((hit.time, hit.normal, primitive));
            }
        });
        let (time, normal, primitive) = first?;
        let joint = self.joint_at(primitive, origin + direction * time, fraction)?;
        Some(SkinHit { time, normal: self.frame.rotation * normal, primitive, joint })
    }
}

/// Logs that an entity has another shape as well, which does not count.
pub(super) fn check_shapes(
    twice: Query<
        (NameOrEntity, Has<MedialMesh>),
        (
            With<SkinnedMedialMesh>,
            Or<(With<MedialMesh>, With<StaticObb>)>,
            Or<(Added<SkinnedMedialMesh>, Added<MedialMesh>, Added<StaticObb>)>,
        ),
    >,
) {
    for (name, has_mesh) in &twice {
        let other = if has_mesh { "MedialMesh" } else { "StaticObb" };
        warn!(
            "{name}: its {other} has no effect beside its SkinnedMedialMesh; remove one of them, or move it to a child"
        );
    }
}

/// Removes the pose together with the component, and the collider with the pose.
pub(super) fn forget_pose(removed: On<Remove, SkinnedMedialMesh>, mut commands: Commands) {
    commands.entity(removed.entity).try_remove::<SkinPose>();
}
