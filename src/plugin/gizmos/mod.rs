//! Debug view: shapes, and input and output of the last step, as lines.
//!
//! The lines of shapes are many and do not change. They are made once for each shape and level of detail, and are retained beside each body and at
//! each stop. All other lines are drawn again in every frame, from [`MedialStep`].

mod lines;
mod outlines;
mod step;
mod stops;
mod wireframe;

use bevy::prelude::*;

use super::{MedialStep, MedialSystems};

/// Gizmos of medial bodies, a group of the `GizmoConfigStore`. Each layer has its own switch and colour.
/// [`MedialGizmo`] overrides them for single entities.
///
/// ```no_run
/// # use bevy::prelude::*;
/// # use bevy_medial::plugin::MedialGizmos;
/// fn show_candidates(mut store: ResMut<GizmoConfigStore>) {
///     let (_, layers) = store.config_mut::<MedialGizmos>();
///     layers.candidates.enabled = true;
/// }
/// ```
#[derive(GizmoConfigGroup, Reflect, Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serialize", derive(serde::Serialize, serde::Deserialize), reflect(Serialize, Deserialize))]
#[reflect(Default, Clone, PartialEq)]
pub struct MedialGizmos {
    /// The spheres of each shape, at the level of detail with which it collides. Default: on.
    pub spheres: MedialGizmoLayer,
    /// Lines along the cones of each shape. Default: on.
    pub cones: MedialGizmoLayer,
    /// The faces of the slabs of each shape. Default: on.
    pub slabs: MedialGizmoLayer,
    /// Draws shapes in the colour of their level of detail: the finest blue, coarser ones green and yellow, the coarsest red. Default: false.
    pub color_by_level: bool,
    /// The oriented boxes of statics. Default: on.
    pub boxes: MedialGizmoLayer,
    /// The boxes of the hierarchy over the statics. Default: off.
    pub hierarchy: MedialGizmoLayer,
    /// The cones that the bounding spheres of moving bodies sweep in the step. Bodies with separate cones are not tested. Default: off.
    pub swept_cones: MedialGizmoLayer,
    /// Lines between the primitives of pairs that culling has left. Default: off.
    pub candidates: MedialGizmoLayer,
    /// Contacts, drawn as their normals. Default: on.
    pub contacts: MedialGizmoLayer,
    /// Length of a normal, in metres. Default: 0.2.
    pub normal_length: f32,
    /// Bodies that stopped at an impact within the step: their shapes at the stop, boxes for bodies that are not medial, and the points of impact. Default: on.
    pub stops: MedialGizmoLayer,
}

/// A layer of [`MedialGizmos`].
#[derive(Reflect, Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serialize", derive(serde::Serialize, serde::Deserialize), reflect(Serialize, Deserialize))]
#[reflect(Clone, PartialEq)]
pub struct MedialGizmoLayer {
    /// Whether the layer is drawn.
    pub enabled: bool,
    /// Colour of its lines.
    pub color: Color,
}

impl MedialGizmoLayer {
    const fn on(color: Color) -> Self {
        Self { enabled: true, color }
    }

    const fn off(color: Color) -> Self {
        Self { enabled: false, color }
    }
}

impl Default for MedialGizmos {
    fn default() -> Self {
        Self {
            spheres: MedialGizmoLayer::on(Color::srgb(0.9, 0.8, 0.2)),
            cones: MedialGizmoLayer::on(Color::srgb(0.3, 0.6, 1.0)),
            slabs: MedialGizmoLayer::on(Color::srgb(0.4, 0.85, 0.45)),
            color_by_level: false,
            boxes: MedialGizmoLayer::on(Color::srgb(0.6, 0.6, 0.6)),
            hierarchy: MedialGizmoLayer::off(Color::srgb(0.65, 0.4, 0.85)),
            swept_cones: MedialGizmoLayer::off(Color::srgb(0.2, 0.8, 0.9)),
            candidates: MedialGizmoLayer::off(Color::srgb(0.95, 0.5, 0.9)),
            contacts: MedialGizmoLayer::on(Color::srgb(0.9, 0.2, 0.2)),
            normal_length: 0.2,
            stops: MedialGizmoLayer::on(Color::srgb(1.0, 0.55, 0.1)),
        }
    }
}

impl MedialGizmos {
    /// Returns all layers with their names.
    pub fn layers_mut(&mut self) -> [(&'static str, &mut MedialGizmoLayer); 9] {
        [
            ("spheres", &mut self.spheres),
            ("cones", &mut self.cones),
            ("slabs", &mut self.slabs),
            ("boxes", &mut self.boxes),
            ("hierarchy", &mut self.hierarchy),
            ("swept cones", &mut self.swept_cones),
            ("candidates", &mut self.candidates),
            ("contacts", &mut self.contacts),
            ("stops", &mut self.stops),
        ]
    }
}

/// Overrides [`MedialGizmos`] for one entity.
///
/// ```no_run
/// # use bevy::prelude::*;
/// # use bevy_medial::{plugin::MedialGizmo, prelude::*};
/// fn spawn(mut commands: Commands, assets: Res<AssetServer>) {
///     let gizmo = MedialGizmo { color: Some(Color::WHITE), ..default() };
///     commands.spawn((MedialMesh(assets.load("models/bear.medial")), gizmo));
/// }
/// ```
#[derive(Component, Clone, Copy, Debug, PartialEq, Reflect)]
#[cfg_attr(feature = "serialize", derive(serde::Serialize, serde::Deserialize), reflect(Serialize, Deserialize))]
#[reflect(Component, Default, Clone, PartialEq)]
pub struct MedialGizmo {
    /// True: its shape is drawn even if the layers of shapes or all gizmos are off. False: neither the entity nor its pairs are drawn. Default: true.
    pub enabled: bool,
    /// Colour of its lines, in place of the layers' colours. Default: none.
    pub color: Option<Color>,
}

impl Default for MedialGizmo {
    fn default() -> Self {
        Self { enabled: true, color: None }
    }
}

/// The debug view: draws the shapes of medial meshes, and the last step if the app has physics. [`MedialGizmos`] selects the layers.
///
/// ```no_run
/// # use bevy::prelude::*;
/// # use bevy_medial::{plugin::MedialDebugPlugin, prelude::*};
/// App::new().add_plugins((DefaultPlugins, MedialPhysicsPlugins::default(), MedialDebugPlugin::default())).run();
/// ```
#[derive(Clone, Copy, Debug)]
pub struct MedialDebugPlugin {
    /// Whether the view is shown from the start. Default: true.
    pub enabled: bool,
}

impl Default for MedialDebugPlugin {
    fn default() -> Self {
        Self { enabled: true }
    }
}

impl Plugin for MedialDebugPlugin {
    fn build(&self, app: &mut App) {
        super::init_medial_axis(app);
        if !app.world().contains_resource::<Assets<GizmoAsset>>() {
            app.init_asset::<GizmoAsset>();
        }
        app.insert_gizmo_config(MedialGizmos::default(), GizmoConfig { enabled: self.enabled, ..default() })
            .init_resource::<lines::Lines>()
            .register_type::<MedialGizmo>()
            .register_type::<MedialGizmoLayer>()
            .add_systems(
                PostUpdate,
                (
                    (outlines::outline, outlines::follow_config.run_if(resource_changed::<GizmoConfigStore>))
                        .chain()
                        .before(TransformSystems::Propagate),
                    (stops::outline, step::ask_for_candidates, step::draw.run_if(is_enabled))
                        .run_if(resource_exists::<MedialStep>)
                        .after(TransformSystems::Propagate)
                        .after(MedialSystems::Report),
                ),
            );
    }
}

fn is_enabled(store: Res<GizmoConfigStore>) -> bool {
    store.config::<MedialGizmos>().0.enabled
}
