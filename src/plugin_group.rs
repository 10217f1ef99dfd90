//! The plugins of physics, as one group.

use bevy::{
    app::PluginGroupBuilder,
    ecs::{intern::Interned, schedule::ScheduleLabel},
    prelude::*,
};

use crate::plugin::MedialCollisionPlugin;

/// Collision of medial meshes and response by rapier, in the schedule in which rapier steps.
///
/// ```no_run
/// # use bevy::prelude::*;
/// # use bevy_medial::prelude::*;
/// App::new().add_plugins((DefaultPlugins, MedialPhysicsPlugins::default())).run();
/// ```
///
/// | plugin | feature | purpose |
/// |---|---|---|
/// | [`MedialCollisionPlugin`] | | components, settings, messages, diagnostics |
/// | `MedialResponsePlugin` | `rapier` | steps around rapier's steps; adds `RapierPhysicsPlugin` if it has not been added before |
/// | [`MedialTransformPlugin`](crate::plugin::MedialTransformPlugin) | without `rapier` | steps after the propagation of transforms, without response |
///
/// If the app needs its own `RapierPhysicsPlugin`, add it *before* this group, and pass its schedule and hooks to this group. `AssetPlugin` has to be
/// added before, and so has the renderer if its GPU is to be used.
///
/// # Panics
/// When the group is added, if there is no `AssetPlugin`, or if rapier has hooks that were not passed to this group.
#[derive(Clone, Copy, Debug)]
pub struct MedialPhysicsPlugins {
    schedule: Interned<dyn ScheduleLabel>,
    /// Steps per second, if their length is fixed.
    #[cfg(feature = "rapier")]
    rate: Option<f32>,
    /// Adds the plugin that runs the step.
    add_step: fn(&Self, PluginGroupBuilder) -> PluginGroupBuilder,
}

impl Default for MedialPhysicsPlugins {
    /// Runs in `PostUpdate`, as rapier does by default.
    fn default() -> Self {
        Self {
            schedule: PostUpdate.intern(),
            #[cfg(feature = "rapier")]
            rate: None,
            #[cfg(feature = "rapier")]
            add_step: response::add::<bevy_rapier3d::prelude::NoUserData>,
            #[cfg(not(feature = "rapier"))]
            add_step: |group, builder| builder.add(crate::plugin::MedialTransformPlugin::in_schedule(group.schedule)),
        }
    }
}

impl MedialPhysicsPlugins {
    /// Runs in `FixedUpdate`.
    pub fn in_fixed_schedule(self) -> Self {
        self.in_schedule(FixedUpdate)
    }

    /// Runs in the given schedule.
    pub fn in_schedule(self, schedule: impl ScheduleLabel) -> Self {
        Self { schedule: schedule.intern(), ..self }
    }
}

impl PluginGroup for MedialPhysicsPlugins {
    fn build(self) -> PluginGroupBuilder {
        let group = PluginGroupBuilder::start::<Self>().add(MedialCollisionPlugin::in_schedule(self.schedule));
        (self.add_step)(&self, group)
    }
}

#[cfg(feature = "rapier")]
mod response {
    use bevy::{app::PluginGroupBuilder, ecs::system::SystemParamItem, utils::default};
    use bevy_rapier3d::prelude::BevyPhysicsHooks;

    use super::MedialPhysicsPlugins;
    use crate::rapier::MedialResponsePlugin;

    impl MedialPhysicsPlugins {
        /// Runs steps of a fixed length in `PostUpdate`, at any frame rate, and interpolates the transforms of all rigid bodies between the steps.
        ///
        /// `rate`: steps per second. Default without this setting: each frame is a step of variable length.
        ///
        /// ```no_run
        /// # use bevy::prelude::*;
        /// # use bevy_medial::prelude::*;
        /// App::new().add_plugins((DefaultPlugins, MedialPhysicsPlugins::fixed(60.0))).run();
        /// ```
        ///
        /// The rate is a `TimestepMode::Interpolated`, and each `RigidBody` requires a `TransformInterpolation`. A rate that is not a positive number
        /// is reported as an error, and 60 is used.
        pub fn fixed(rate: f32) -> Self {
            Self { rate: Some(rate), ..default() }
        }

        /// Uses rapier's hooks: no body stops at a collider that they filter out. They must be those of a `RapierPhysicsPlugin` that has been added
        /// before.
        ///
        /// They are also called after rapier's step, for each pair that may meet in it. They must not access
        /// [`MedialStep`](crate::plugin::MedialStep).
        #[must_use]
        pub fn with_hooks<Hooks>(self) -> Self
        where
            Hooks: 'static + BevyPhysicsHooks,
            for<'w, 's> SystemParamItem<'w, 's, Hooks>: BevyPhysicsHooks,
        {
            Self { add_step: add::<Hooks>, ..self }
        }
    }

    pub(super) fn add<Hooks>(group: &MedialPhysicsPlugins, builder: PluginGroupBuilder) -> PluginGroupBuilder
    where
        Hooks: 'static + BevyPhysicsHooks,
        for<'w, 's> SystemParamItem<'w, 's, Hooks>: BevyPhysicsHooks,
    {
        builder.add(MedialResponsePlugin::<Hooks>::new(group.schedule, group.rate))
    }
}
