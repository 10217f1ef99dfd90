//! The view: the mesh in the colours of its error on the left, the medial mesh on the right.

use std::path::PathBuf;

use bevy::prelude::*;
use bevy_medial::{
    builder::{Level, MedialLevels, TriangleMesh, vertex_errors},
    medial_axis::{MedialAxis, triangulate},
    plugin::{MedialGizmos, MedialLevel, MedialMesh},
};

use crate::{binding::Binding, job::Job};

/// Distance of the middle of each mesh from the middle of the view, in diagonals of the mesh.
const ASIDE: f32 = 0.47;
/// Number of sides of a sphere or cone.
const SIDES: u32 = 32;

/// The mesh, its levels, and the settings of the view.
#[derive(Resource)]
pub struct Shown {
    pub mesh: TriangleMesh,
    /// `None` while they are built.
    pub levels: Option<MedialLevels>,
    pub level: usize,
    /// Max error, in percent of the diagonal.
    pub budget: f32,
    /// True if the surface of the medial mesh is drawn.
    pub surface: bool,
    pub save_as: PathBuf,
    /// The result of the last action, or the error of the build. Empty before.
    pub message: String,
    /// Largest error of a vertex at the level, in percent of the diagonal.
    pub worst: f32,
}

impl Shown {
    pub fn new(mesh: TriangleMesh, budget: f32, save_as: PathBuf) -> Self {
        let message = String::new();
        Self { mesh, levels: None, level: 0, budget, surface: true, save_as, message, worst: 0.0 }
    }

    /// The level that is shown.
    pub fn current(&self) -> Option<&Level> {
        self.levels.as_ref()?.levels.get(self.level)
    }

    /// Shows the coarsest level within a budget, or the finest if all levels exceed it.
    pub fn set_budget(&mut self, percent: f32) {
        self.budget = percent;
        let levels = self.levels.iter().flat_map(|levels| &levels.levels);
        self.level =
            levels.enumerate().filter(|(_, level)| level.error.max() <= percent).map(|(i, _)| i).last().unwrap_or(0);
    }

    /// Shows a level, and sets the budget to its error.
    pub fn set_level(&mut self, level: usize) {
        self.level = level;
        self.budget = self.current().map_or(0.0, |level| level.error.max());
    }
}

/// Marks the entity of the triangle mesh.
#[derive(Component)]
pub struct Source;

/// Marks the entity of the medial mesh.
#[derive(Component)]
pub struct Fitted;

pub fn plugin(app: &mut App) {
    app.add_systems(Startup, (spawn, set_lines))
        .add_systems(Update, (take_levels, show_level.run_if(not(resource_exists::<Binding>))).chain());
}

fn spawn(
    mut commands: Commands,
    shown: Res<Shown>,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
) {
    let mut material = |base_color| {
        let material = StandardMaterial { base_color, perceptual_roughness: 0.75, ..default() };
        MeshMaterial3d(materials.add(material))
    };
    let bounds = shown.mesh.aabb();
    let scale = 1.0 / shown.mesh.diagonal();
    let place = |side: f32| {
        let translation = Vec3::X * side * ASIDE - bounds.center() * scale;
        Transform { translation, scale: Vec3::splat(scale), ..default() }
    };
    let mesh = shown.mesh.to_bevy().with_computed_area_weighted_normals();
    commands.spawn((Source, Mesh3d(meshes.add(mesh)), material(Color::WHITE), place(-1.0)));
    commands.spawn((Fitted, Mesh3d::default(), material(Color::srgb(0.72, 0.76, 0.82)), place(1.0)));
}

fn set_lines(mut store: ResMut<GizmoConfigStore>) {
    let (group, _) = store.config_mut::<MedialGizmos>();
    group.line.width = 1.2;
    // Lines are drawn in front of the surface on which they lie.
    group.depth_bias = -0.002;
}

/// Takes the levels of a finished build.
fn take_levels(
    mut commands: Commands,
    mut shown: ResMut<Shown>,
    job: Res<Job>,
    binding: Option<Res<Binding>>,
    fitted: Single<Entity, With<Fitted>>,
    mut axes: ResMut<Assets<MedialAxis>>,
) {
    match job.take() {
        Some(Ok(levels)) => {
            // The balls of a skinned mesh are not lines.
            if binding.is_none()
                && let Some(axis) = levels.clone().into_medial_axis()
            {
                commands.entity(*fitted).insert((MedialMesh(axes.add(axis)), MedialLevel(0)));
            }
            shown.levels = Some(levels);
            let budget = shown.budget;
            shown.set_budget(budget);
        }
        Some(Err(error)) => shown.message = error,
        None => {}
    }
}

/// Colours the mesh by its distance to the level, and shows the level's surface.
fn show_level(
    mut shown: ResMut<Shown>,
    source: Single<&Mesh3d, With<Source>>,
    mut fitted: Single<(&mut Mesh3d, &mut Visibility, Option<&mut MedialLevel>), (With<Fitted>, Without<Source>)>,
    mut meshes: ResMut<Assets<Mesh>>,
    mut last: Local<Option<usize>>,
) {
    let (surface, visibility, number) = &mut *fitted;
    let (Some(level), Some(number)) = (shown.current(), number) else { return };
    if last.replace(shown.level) != Some(shown.level) {
        let errors = vertex_errors(&shown.mesh, &level.axis);
        let worst = errors.iter().fold(0.0, |worst: f32, error| worst.max(error.abs()));
        let shades: Vec<[f32; 4]> = errors.iter().map(|error| shade(error.abs() / worst)).collect();
        surface.0 = meshes.add(triangulate(level.axis.spheres(), level.axis.primitives(), SIDES));
        if let Some(mut mesh) = meshes.get_mut(&source.0) {
            mesh.insert_attribute(Mesh::ATTRIBUTE_COLOR, shades);
        }
        number.0 = shown.level;
        shown.worst = worst;
    }
    // Lines are drawn whether the surface is visible or not.
    visibility.set_if_neq(if shown.surface { Visibility::Inherited } else { Visibility::Hidden });
}

/// The colour of an error. `error` is relative to the largest error, from 0 to 1.
pub fn shade(error: f32) -> [f32; 4] {
    let [r, g, b] = colorous::VIRIDIS.eval_continuous(f64::from(error)).as_array();
    Color::srgb_u8(r, g, b).to_linear().to_f32_array()
}
