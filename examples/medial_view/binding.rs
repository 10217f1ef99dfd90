//! The view of a skinned mesh: triangles and spheres in the colours of their joints, which the clip of the file moves.

use bevy::{math::Affine3A, prelude::*};
use bevy_medial::{
    builder::{SkinnedTriangleMesh, load::Clip},
    geometry::Sphere as Ball,
    medial_axis::JointWeights,
};

use crate::shown::{Fitted, Shown, Source};

/// The skinned mesh of the view.
#[derive(Resource)]
pub struct Binding {
    pub mesh: SkinnedTriangleMesh,
    /// `None` for a file without an animation, which stays in the bind pose.
    pub clip: Option<Clip>,
    /// Time of a picture in seconds. `None` for a clip that is played.
    pub still: Option<f32>,
}

/// Marks the ball of a sphere, by its index.
#[derive(Component)]
struct OfSphere(usize);

pub fn plugin(app: &mut App) {
    app.add_systems(Update, (color_mesh, spawn_balls, pose).chain().run_if(resource_exists::<Binding>));
}

impl Binding {
    /// Places of the joints at a time. A clip that does not move all joints is not used.
    fn places(&self, time: f32) -> Vec<Affine3A> {
        let joints = self.mesh.skin().joints();
        let places = self.clip.as_ref().and_then(|clip| clip.places(joints, self.still.unwrap_or(time)));
        places.unwrap_or_else(|| joints.iter().map(|joint| joint.inverse_bind.inverse()).collect())
    }

    /// The colour of the joint with the largest weight.
    fn color(&self, weights: &JointWeights) -> LinearRgba {
        let joint = usize::from(weights[0].0);
        // Hues of neighbours differ by the golden angle.
        Hsla::new((joint as f32 * 137.5) % 360.0, 0.65, 0.55, 1.0).into()
    }
}

/// Colours the triangles once.
fn color_mesh(binding: Res<Binding>, source: Single<&Mesh3d, With<Source>>, mut meshes: ResMut<Assets<Mesh>>) {
    if binding.is_added()
        && let Some(mut mesh) = meshes.get_mut(&source.0)
    {
        let colors = binding.mesh.skin().weights().iter().map(|weights| binding.color(weights).to_f32_array());
        mesh.insert_attribute(Mesh::ATTRIBUTE_COLOR, colors.collect::<Vec<_>>());
    }
}

/// Replaces the balls when another level is shown.
fn spawn_balls(
    mut commands: Commands,
    binding: Res<Binding>,
    shown: Res<Shown>,
    fitted: Single<Entity, With<Fitted>>,
    balls: Query<Entity, With<OfSphere>>,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
    mut last: Local<Option<usize>>,
) {
    let Some(skin) = shown.current().and_then(|level| level.axis.skin()) else { return };
    if last.replace(shown.level) == Some(shown.level) {
        return;
    }
    balls.iter().for_each(|ball| commands.entity(ball).despawn());
    let ball = meshes.add(Sphere::new(1.0));
    for (index, weights) in skin.weights().iter().enumerate() {
        let base_color = binding.color(weights).into();
        let material = materials.add(StandardMaterial { base_color, perceptual_roughness: 0.75, ..default() });
        commands.spawn((OfSphere(index), Mesh3d(ball.clone()), MeshMaterial3d(material), ChildOf(*fitted)));
    }
}

/// Moves triangles and balls.
fn pose(
    binding: Res<Binding>,
    shown: Res<Shown>,
    time: Res<Time>,
    source: Single<&Mesh3d, With<Source>>,
    mut meshes: ResMut<Assets<Mesh>>,
    mut balls: Query<(&OfSphere, &mut Transform)>,
) {
    let mut poses = vec![];
    binding.mesh.skin().joint_poses(&binding.places(time.elapsed_secs()), &mut poses);
    if let Some(mut mesh) = meshes.get_mut(&source.0) {
        let positions: Vec<[f32; 3]> = binding.mesh.posed(&poses).positions.iter().map(|p| p.to_array()).collect();
        mesh.insert_attribute(Mesh::ATTRIBUTE_POSITION, positions);
        mesh.compute_area_weighted_normals();
    }
    let Some(axis) = shown.current().map(|level| &level.axis) else { return };
    let mut spheres: Vec<Ball> = vec![];
    if let Some(skin) = axis.skin() {
        skin.pose(axis.spheres(), &poses, &mut spheres);
    }
    for (of, mut place) in &mut balls {
        if let Some(sphere) = spheres.get(of.0) {
            *place = Transform::from_translation(sphere.center).with_scale(Vec3::splat(sphere.radius));
        }
    }
}
