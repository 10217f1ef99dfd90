//! The ECS interface: plugin, components, messages, diagnostics.
//!
//! | item | purpose |
//! |---|---|
//! | [`MedialCollisionPlugin`] | adds components, settings, messages and diagnostics |
//! | [`MedialTransformPlugin`] | runs the step along the motion of transforms, without response |
//! | [`MedialMesh`] | component: shape with which the entity collides |
//! | [`SkinnedMedialMesh`], [`SkinPose`] | components: shape that follows the joints of a skeleton; its pose in the last step |
//! | [`StaticObb`] | component: a static box; beside a medial mesh it makes that mesh static |
//! | [`MedialCcd`] | component: whether a body stops at its first impact |
//! | [`MedialBudget`], [`MedialLevel`] | components: the error that a shape may have; the level of detail in use |
//! | [`MedialImportance`], [`MedialFocus`] | components: relative accuracy of a body; a point at a distance from which bodies may be coarser |
//! | [`MedialSettings`], [`MedialBackend`] | resource: settings for all bodies; back end that culls pairs |
//! | [`MedialContactStarted`], [`MedialContactEnded`] | messages, and events for observers of the entities |
//! | [`MedialContacts`] | system parameter: the contacts of the last step, by entity |
//! | `MedialBuildPlugin` | with the feature `bevy_mesh`: builds the medial meshes of entities with a `BuildMedialMesh` from their `Mesh3d` |
//! | `MedialDebugPlugin` | with the feature `debug`: draws shapes and the last step, as configured by `MedialGizmos` and the component `MedialGizmo` |
//! | `MedialProcessPlugin` | with the feature `asset_processor`: builds medial meshes when Bevy processes the app's assets |
//! | `MedialScene` | with the feature `gltf_scenes`: component: the meshes of a spawned glTF scene get shapes |
//! | `MedialPickingPlugin` | with the feature `picking`: pointers pick medial bodies |
//! | [`MedialSystems`] | system sets, for ordering |
//! | [`MedialStep`] | internal resource: input and output of the last step |

#[cfg(feature = "bevy_mesh")]
mod build;
#[cfg(feature = "bevy_mesh")]
mod build_cache;
#[cfg(any(feature = "bevy_mesh", feature = "debug"))]
mod changes;
#[cfg(feature = "gpu")]
mod choice;
mod components;
mod contacts;
mod diagnostics;
#[cfg(feature = "debug")]
mod gizmos;
#[cfg(feature = "gpu")]
mod gpu;
mod importance;
mod levels;
mod loader;
#[cfg(feature = "gpu")]
mod look_ahead;
mod messages;
#[cfg(feature = "picking")]
mod picking;
#[cfg(feature = "gpu")]
mod pipelined;
#[cfg(feature = "asset_processor")]
mod process;
mod report;
#[cfg(feature = "gltf_scenes")]
mod scene;
mod screw;
mod settings;
mod skeletons;
mod skin_motion;
mod skinned;
mod step;
mod transforms;

use bevy::{
    ecs::{intern::Interned, schedule::ScheduleLabel},
    prelude::*,
};

use crate::{
    constants::{MAX_MAGNITUDE, SAME_LENGTH},
    geometry::Pose3,
    medial_axis::MedialAxis,
};

#[cfg(feature = "bevy_mesh")]
pub use build::{BuildMedialMesh, MedialBuildPlugin, MedialBuildStatus};
#[cfg(any(feature = "bevy_mesh", feature = "debug"))]
pub(crate) use changes::Changes;
pub use components::{MedialCcd, MedialMesh, StaticObb};
pub use contacts::{MedialContactPair, MedialContacts};
pub use diagnostics::paths as diagnostic_paths;
#[cfg(feature = "debug")]
pub use gizmos::{MedialDebugPlugin, MedialGizmo, MedialGizmoLayer, MedialGizmos};
pub(crate) use importance::Detail;
use importance::DetailItem;
pub use importance::{MedialFocus, MedialImportance};
pub use levels::{MedialBudget, MedialLevel};
pub use loader::{MaLoader, MaLoaderError, MedialLoader, MedialLoaderError};
pub use messages::{MedialContactEnded, MedialContactStarted, TouchPoint};
#[cfg(feature = "picking")]
pub use picking::{MedialPickingCamera, MedialPickingPlugin, MedialPickingSettings};
#[cfg(feature = "asset_processor")]
pub use process::{MedialProcess, MedialProcessPlugin};
#[cfg(feature = "gltf_scenes")]
pub use scene::MedialScene;
#[cfg(all(feature = "gltf_scenes", feature = "rapier"))]
pub(crate) use scene::SceneBody;
pub use settings::{MedialBackend, MedialSettings};
pub(crate) use skeletons::Skeletons;
pub use skinned::{SkinHit, SkinPose, SkinnedMedialMesh};
pub use step::{BodyInfo, MedialStep};
pub use transforms::MedialTransformPlugin;

/// The components, settings, messages and diagnostics of collision, and the back ends of its step.
///
/// Another plugin of [`MedialPhysicsPlugins`](crate::MedialPhysicsPlugins) runs the step: `MedialResponsePlugin` around rapier's, or
/// [`MedialTransformPlugin`] after Bevy's transform propagation. Both need the same schedule.
///
/// # Panics
/// When the plugin is added, if there is no `AssetPlugin`.
#[derive(Clone, Copy, Debug)]
pub struct MedialCollisionPlugin {
    schedule: Interned<dyn ScheduleLabel>,
}

impl MedialCollisionPlugin {
    /// Runs in the given schedule.
    pub fn in_schedule(schedule: impl ScheduleLabel) -> Self {
        Self { schedule: schedule.intern() }
    }
}

impl Default for MedialCollisionPlugin {
    /// Runs in `PostUpdate`.
    fn default() -> Self {
        Self::in_schedule(PostUpdate)
    }
}

/// System sets of the plugin within a step, in this order. Without the feature `rapier` there are only the last two, after Bevy's transform propagation.
#[derive(SystemSet, Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum MedialSystems {
    /// Builds shapes from meshes for [`BuildMedialMesh`], in `Update`.
    #[cfg(feature = "bevy_mesh")]
    Build,
    /// Creates the colliders of loaded shapes, before rapier takes over changes.
    Attach,
    /// Records the poses at the start of the step, right before rapier's step.
    Snapshot,
    /// Runs the pipeline and stops fast bodies at impacts, right after rapier's step.
    Detect,
    /// Writes messages and diagnostics and triggers observers, right after rapier has written back poses.
    Report,
}

/// Registers medial meshes as assets, only once: a second registration would drop the existing assets.
fn init_medial_axis(app: &mut App) {
    if !app.world().contains_resource::<Assets<MedialAxis>>() {
        app.init_asset::<MedialAxis>()
            .register_asset_reflect::<MedialAxis>()
            .init_asset_loader::<MaLoader>()
            .init_asset_loader::<MedialLoader>();
    }
}

/// Returns true if no coordinate exceeds [`MAX_MAGNITUDE`]; false for NaN.
pub(crate) fn is_bounded(v: Vec3) -> bool {
    v.abs().cmple(Vec3::splat(MAX_MAGNITUDE)).all()
}

/// Returns true for a bounded position with a unit quaternion. An uneven scale of a turned parent causes shear, and the extracted rotation is then invalid.
pub(crate) fn is_sound_pose(pose: &Pose3) -> bool {
    is_bounded(pose.translation) && (pose.rotation.length_squared() - 1.0).abs() < 1e-2
}

/// Returns the scale of a medial mesh, for [`Shape::scaled`](crate::pipeline::Shape::scaled). It must be the same along all axes up to the rounding of a
/// rotation, and may be negative along x, as in Bevy's decomposition of a mirrored transform.
pub(crate) fn uniform_scale(scale: Vec3) -> Option<f32> {
    let (sizes, least) = (scale.abs(), scale.abs().min_element());
    let is_uniform = scale.is_finite() && least > 0.0 && sizes.max_element() <= least * (1.0 + SAME_LENGTH);
    (is_uniform && scale.y > 0.0 && scale.z > 0.0).then_some(scale.x)
}

impl Plugin for MedialCollisionPlugin {
    fn build(&self, app: &mut App) {
        init_medial_axis(app);
        app.register_type::<MedialMesh>()
            .register_type::<SkinnedMedialMesh>()
            .register_type::<StaticObb>()
            .register_type::<MedialCcd>()
            .register_type::<MedialBudget>()
            .register_type::<MedialLevel>()
            .register_type::<MedialImportance>()
            .register_type::<MedialFocus>()
            .register_type::<MedialSettings>()
            .register_type::<MedialBackend>()
            .register_type::<MedialStep>()
            .register_type::<MedialContactStarted>()
            .register_type::<MedialContactEnded>()
            .init_resource::<MedialSettings>()
            .add_observer(skinned::forget_pose)
            .init_resource::<MedialStep>()
            .add_message::<MedialContactStarted>()
            .add_message::<MedialContactEnded>()
            .add_systems(
                self.schedule,
                (
                    (levels::check_budgets, levels::check_levels, skinned::check_shapes)
                        .run_if(any_with_component::<MedialMesh>.or_else(any_with_component::<SkinnedMedialMesh>)),
                    importance::look_from_focuses
                        .run_if(any_with_component::<MedialFocus>.or_else(any_with_component::<importance::Nearness>)),
                )
                    .before(MedialSystems::Attach)
                    .before(MedialSystems::Detect),
            )
            .add_systems(self.schedule, (report::report_contacts, diagnostics::measure).in_set(MedialSystems::Report));
        diagnostics::register(app);
        #[cfg(feature = "gltf_scenes")]
        scene::add(app);
        #[cfg(feature = "gpu")]
        {
            app.init_resource::<crate::gpu::GpuCapacity>()
                .register_type::<crate::gpu::GpuCapacity>()
                .add_systems(Startup, pipelined::adopt_renderer);
            pipelined::add(app);
        }
    }
}
