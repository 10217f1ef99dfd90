//! An animated character under fire: a runner or a spider, made by code, with a skinned triangle mesh and a medial mesh that follow the same joints.
//! Bullets of 10 to 1,000 m/s hit it. A mark on the joint shows each hit, and the program prints the joint.
//!
//! ```text
//! cargo run --release --example character [-- biped|spider] [--frames N] [--screenshot FILE] [--movie FILE] [--medial] [--ragdoll HITS]
//! ```

mod common;

use std::{error::Error, ops::ControlFlow, path::PathBuf, time::Duration};

use bevy::{
    asset::RenderAssetUsages,
    camera::RenderTarget,
    diagnostic::DiagnosticsPlugin,
    light::GlobalAmbientLight,
    log::LogPlugin,
    math::Affine3A,
    mesh::skinning::{SkinnedMesh, SkinnedMeshInverseBindposes},
    prelude::*,
    time::TimeUpdateStrategy,
};
use bevy_medial::{
    builder::{FitOptions, SkinnedTriangleMesh, fit_skinned},
    medial_axis::MedialAxis,
    prelude::*,
    random::Random,
    rapier::MedialRagdoll,
    scenes::{Bullet, characters::Character, lift_speed_limits},
};
use bevy_rapier3d::prelude::{GravityScale, RigidBody, TimestepMode, Velocity};
use clap::Parser;
use common::{display::has_display, movie, studio::Studio};

/// An animated character under fire.
#[derive(Parser)]
struct Options {
    /// biped or spider
    #[arg(default_value = "biped")]
    name: String,
    /// Number of frames, after which the program exits. Default without a display: 120
    #[arg(long)]
    frames: Option<u32>,
    /// Writes a picture of the last frame. It needs a graphics adapter, but no display
    #[arg(long)]
    screenshot: Option<PathBuf>,
    /// Writes a movie as GIF. It needs a graphics adapter, but no display
    #[arg(long)]
    movie: Option<PathBuf>,
    /// Draws the lines of the medial mesh over the character
    #[arg(long)]
    medial: bool,
    /// Number of hits after which the character becomes a ragdoll. Default: it never does
    #[arg(long)]
    ragdoll: Option<u32>,
}

/// Size of movies, in pixels.
const MOVIE: UVec2 = UVec2::new(480, 360);
/// Length of a step in seconds.
const DT: f32 = 1.0 / 60.0;
/// Speeds of bullets in metres per second, in turn.
const SPEEDS: [f32; 5] = [10.0, 30.0, 100.0, 300.0, 1000.0];
/// Radius of a bullet in metres.
const RADIUS: f32 = 0.03;

/// The character, before it is spawned.
#[derive(Resource, Clone)]
struct Cast {
    character: Character,
    mesh: SkinnedTriangleMesh,
    axis: MedialAxis,
    /// Number of hits after which it becomes a ragdoll.
    ragdoll: Option<u32>,
}

/// A joint of the character, by its index.
#[derive(Component)]
struct Joint(usize);

#[derive(Resource, Default)]
struct Score {
    shots: u32,
    hits: u32,
}

fn main() -> Result<(), Box<dyn Error>> {
    let options = Options::parse();
    let character = match &*options.name {
        "biped" => Character::biped(),
        "spider" => Character::spider(),
        other => return Err(format!("there is no character `{other}`; choose biped or spider").into()),
    };
    let mesh = character.mesh()?;
    let fit = FitOptions { spheres: Some(60), ..FitOptions::default() };
    let levels = fit_skinned(&mesh, &fit, &|_| ControlFlow::Continue(()))?;
    let axis = levels.into_medial_axis().ok_or("the builder has made no level")?;
    println!("{}: {} spheres, {} primitives", character.name, axis.spheres().len(), axis.primitives().len());
    let cast = Cast { character, mesh, axis, ragdoll: options.ragdoll };
    let is_headless = options.frames.is_some() || options.screenshot.is_some() || options.movie.is_some();
    if !is_headless && has_display() {
        let mut app = App::new();
        app.add_plugins(DefaultPlugins);
        build(&mut app, cast, options.medial, RenderTarget::default());
        app.run();
        return Ok(());
    }
    let frames = options.frames.unwrap_or(120);
    if let Some(file) = options.movie {
        let mut studio = Studio::new(MOVIE, |app, target| build(app, cast, options.medial, target));
        movie::record(&mut studio, frames, DT, &file)?;
        return report(&studio.app);
    }
    let Some(file) = options.screenshot else {
        let mut app = App::new();
        let log = LogPlugin { filter: "warn".into(), ..default() };
        app.add_plugins((MinimalPlugins, log, AssetPlugin::default(), TransformPlugin, DiagnosticsPlugin));
        simulate(&mut app, cast);
        app.finish();
        app.cleanup();
        (0..frames).for_each(|_| app.update());
        return report(&app);
    };
    let mut studio = Studio::new(UVec2::new(960, 540), |app, target| build(app, cast, options.medial, target));
    (0..frames).for_each(|_| studio.app.update());
    studio.take(&file)?;
    studio.wait_for(&file)?;
    report(&studio.app)
}

fn report(app: &App) -> Result<(), Box<dyn Error>> {
    let Score { shots, hits } = *app.world().resource::<Score>();
    println!("{hits} hits of {shots} bullets");
    if hits == 0 { Err("no bullet has hit".into()) } else { Ok(()) }
}

/// Adds everything that does not draw.
fn simulate(app: &mut App, cast: Cast) {
    app.add_plugins(MedialPhysicsPlugins::default())
        .insert_resource(cast)
        .insert_resource(TimestepMode::Fixed { dt: DT, substeps: 1 })
        .insert_resource(TimeUpdateStrategy::ManualDuration(Duration::from_secs_f32(DT)))
        .init_resource::<Score>()
        .add_systems(Startup, spawn_character)
        .add_systems(Update, (animate, shoot))
        .add_systems(Last, report_hits);
    lift_speed_limits(app);
}

/// The same with a camera, light and meshes.
fn build(app: &mut App, cast: Cast, medial: bool, target: RenderTarget) {
    simulate(app, cast);
    app.add_plugins(MedialDebugPlugin { enabled: medial })
        .insert_resource(GlobalAmbientLight { brightness: 450.0, ..default() })
        .add_systems(Startup, dress.after(spawn_character))
        .add_systems(Update, dress_bullets);
    let looking = |x: f32, y: f32, z: f32| Transform::from_xyz(x, y, z).looking_at(Vec3::Y * 0.8, Vec3::Y);
    app.world_mut().spawn((Camera3d::default(), target, looking(2.2, 1.6, 3.2)));
    app.world_mut().spawn((DirectionalLight::default(), looking(3.0, 6.0, 4.0)));
}

fn spawn_character(mut commands: Commands, cast: Res<Cast>, mut axes: ResMut<Assets<MedialAxis>>) {
    let shape = SkinnedMedialMesh::new(axes.add(cast.axis.clone()));
    let root = commands.spawn((Name::new(cast.character.name), shape, Visibility::default())).id();
    let mut joints: Vec<Entity> = Vec::new();
    for (index, joint) in cast.character.joints.iter().enumerate() {
        let parent = joint.parent.map_or(root, |parent| joints[parent]);
        let name = Name::new(joint.name.clone());
        let place = (Transform::default(), Visibility::default(), ChildOf(parent));
        joints.push(commands.spawn((name, Joint(index), place)).id());
    }
    commands.spawn((StaticObb::new(6.0, 0.5, 6.0), Transform::from_xyz(0.0, -0.55, 0.0)));
}

fn dress(
    mut commands: Commands,
    cast: Res<Cast>,
    character: Single<Entity, With<SkinnedMedialMesh>>,
    joints: Query<(Entity, &Joint)>,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
    mut bind_poses: ResMut<Assets<SkinnedMeshInverseBindposes>>,
) {
    let mut mesh = cast.mesh.to_bevy().with_computed_area_weighted_normals();
    mesh.asset_usage = RenderAssetUsages::default();
    let inverse: Vec<Mat4> = cast.mesh.skin().joints().iter().map(|joint| Mat4::from(joint.inverse_bind)).collect();
    let mut sorted: Vec<(Entity, usize)> = joints.iter().map(|(entity, joint)| (entity, joint.0)).collect();
    sorted.sort_by_key(|(_, index)| *index);
    let skin = SkinnedMesh {
        inverse_bindposes: bind_poses.add(SkinnedMeshInverseBindposes::from(inverse)),
        joints: sorted.into_iter().map(|(entity, _)| entity).collect(),
    };
    let material = materials.add(StandardMaterial {
        base_color: Color::srgb(0.45, 0.6, 0.75),
        perceptual_roughness: 0.7,
        ..default()
    });
    commands.spawn((Mesh3d(meshes.add(mesh)), MeshMaterial3d(material), skin, ChildOf(*character)));
    let floor = materials.add(StandardMaterial { base_color: Color::srgb(0.3, 0.32, 0.35), ..default() });
    commands.spawn((Mesh3d(meshes.add(Plane3d::default().mesh().size(12.0, 12.0))), MeshMaterial3d(floor)));
}

/// Moves the joints, until the character is a ragdoll.
fn animate(
    cast: Res<Cast>,
    time: Res<Time>,
    alive: Query<(), With<SkinnedMedialMesh>>,
    mut joints: Query<(&Joint, &mut Transform)>,
) {
    if alive.is_empty() {
        return;
    }
    let pose = cast.character.pose(time.elapsed_secs());
    for (joint, mut transform) in &mut joints {
        let above = cast.character.joints[joint.0].parent.map_or(Affine3A::IDENTITY, |parent| pose[parent].inverse());
        *transform = Transform::from_matrix(Mat4::from(above * pose[joint.0]));
    }
}

/// Shoots at a joint every eighth frame.
fn shoot(
    mut commands: Commands,
    mut frame: Local<u32>,
    mut score: ResMut<Score>,
    poses: Query<&SkinPose>,
    transforms: Query<&GlobalTransform>,
    mut axes: ResMut<Assets<MedialAxis>>,
) -> Result {
    *frame += 1;
    let Some(pose) = poses.iter().next().filter(|_| (*frame).is_multiple_of(8)) else { return Ok(()) };
    let mut random = Random(u64::from(*frame));
    let target = transforms.get(pose.joints()[random.below(pose.joints().len())])?.translation();
    let direction = Vec3::new(random.signed(), 0.3 * random.unit(), 1.0).normalize();
    let speed = SPEEDS[score.shots as usize % SPEEDS.len()];
    commands.spawn((
        RigidBody::Dynamic,
        Bullet,
        MedialMesh(axes.add(MedialAxis::sphere(RADIUS)?)),
        Transform::from_translation(target + direction * speed.min(100.0) * 4.0 * DT),
        Velocity::linear(-direction * speed),
        GravityScale(0.0),
    ));
    score.shots += 1;
    Ok(())
}

fn dress_bullets(
    mut commands: Commands,
    bullets: Query<Entity, Added<Bullet>>,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
) {
    for bullet in &bullets {
        let material = materials.add(StandardMaterial { base_color: Color::srgb(0.9, 0.75, 0.2), ..default() });
        commands.entity(bullet).insert((Mesh3d(meshes.add(Sphere::new(RADIUS))), MeshMaterial3d(material)));
    }
}

/// Prints each hit, and marks it on its joint.
fn report_hits(
    mut commands: Commands,
    mut started: MessageReader<MedialContactStarted>,
    mut score: ResMut<Score>,
    cast: Res<Cast>,
    characters: Query<Entity, With<SkinnedMedialMesh>>,
    joints: Query<(&Name, &GlobalTransform), With<Joint>>,
    assets: (Option<ResMut<Assets<Mesh>>>, Option<ResMut<Assets<StandardMaterial>>>),
) {
    let (mut meshes, mut materials) = assets;
    for message in started.read() {
        let Some(joint) = message.touch.joint1.or(message.touch.joint2) else { continue };
        let Ok((name, place)) = joints.get(joint) else { continue };
        score.hits += 1;
        println!("hit: {name} at {:.0} m/s", message.touch.approach_speed);
        if cast.ragdoll == Some(score.hits) {
            characters.iter().for_each(|character| _ = commands.entity(character).queue(MedialRagdoll::default()));
        }
        let local = place.affine().inverse().transform_point3(message.touch.point);
        if let (Some(meshes), Some(materials)) = (&mut meshes, &mut materials) {
            let red = materials.add(StandardMaterial { base_color: Color::srgb(0.9, 0.15, 0.1), ..default() });
            let mark = (Mesh3d(meshes.add(Sphere::new(1.2 * RADIUS))), MeshMaterial3d(red));
            commands.spawn((mark, Transform::from_translation(local), ChildOf(joint)));
        }
    }
}
