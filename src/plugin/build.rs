//! Building medial meshes while the app runs. Entities that wait for the same build own it together: without owners it is cancelled.

use std::{
    collections::HashMap,
    ops::ControlFlow,
    panic::{AssertUnwindSafe, catch_unwind},
    path::{Path, PathBuf},
    sync::{
        Arc, LazyLock, OnceLock, Weak,
        atomic::{AtomicU32, Ordering},
    },
    thread::available_parallelism,
};

use bevy::{
    asset::LoadState,
    mesh::{Mesh, Mesh3d},
    prelude::*,
    tasks::{TaskPool, TaskPoolBuilder},
};

use super::{Changes, MedialMesh, MedialSystems, build_cache::fit_cached, init_medial_axis};
use crate::{
    builder::{FitOptions, TriangleMesh, on_this_thread},
    medial_axis::MedialAxis,
};

/// Builds the entity's [`MedialMesh`] from its `Mesh3d`, on separate threads. A change of that mesh or of the options starts a new build.
///
/// Entities with the same mesh asset and options share one build and one asset. The build is cancelled when the component or the `Mesh3d` is removed
/// or the entity is despawned, unless another entity waits for it. An existing `MedialMesh` stays. [`MedialBuildStatus`] shows the progress.
///
/// The mesh must enclose a volume. It must be in main memory when the build starts, which needs `RenderAssetUsages::MAIN_WORLD`, a part of the
/// default. The mesh should be closed: holes are [closed with flat caps](TriangleMesh::with_holes_closed).
///
/// ```no_run
/// # use bevy::prelude::*;
/// # use bevy_medial::prelude::*;
/// # use bevy_rapier3d::prelude::RigidBody;
/// fn spawn(mut commands: Commands, mut meshes: ResMut<Assets<Mesh>>) {
///     let ring = Mesh3d(meshes.add(Torus::new(0.5, 1.0)));
///     commands.spawn((RigidBody::Dynamic, ring, BuildMedialMesh(FitOptions { levels: true, ..default() })));
/// }
/// ```
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Deref, DerefMut, Reflect)]
#[cfg_attr(feature = "serialize", derive(serde::Serialize, serde::Deserialize), reflect(Serialize, Deserialize))]
#[reflect(Component, Default, Clone, PartialEq)]
#[require(MedialBuildStatus)]
pub struct BuildMedialMesh(pub FitOptions);

/// Status of the build of an entity's medial mesh. It is added with [`BuildMedialMesh`] and is written by the plugin only.
#[derive(Component, Clone, Debug, Default, PartialEq, Reflect)]
#[cfg_attr(feature = "serialize", derive(serde::Serialize, serde::Deserialize), reflect(Serialize, Deserialize))]
#[reflect(Component, Default, Clone, PartialEq)]
pub enum MedialBuildStatus {
    /// There is no `Mesh3d`, or it has not loaded yet.
    #[default]
    Waiting,
    /// The completed part of the work, from 0 to 1. With [`FitOptions::max_error`] each trial starts at 0 again.
    Building(f32),
    /// The entity has its [`MedialMesh`].
    Built,
    /// The build failed, for this reason. Another mesh or other options start a new build.
    Failed(String),
}

/// Runs the builds for [`BuildMedialMesh`], in `Update`. Add it after `DefaultPlugins`; it needs no window, no renderer and no physics.
///
/// ```no_run
/// # use bevy::prelude::*;
/// # use bevy_medial::prelude::*;
/// App::new()
///     .add_plugins((DefaultPlugins, MedialPhysicsPlugins::default()))
///     .add_plugins(MedialBuildPlugin { cache: Some("cache/medial".into()) })
///     .run();
/// ```
#[derive(Clone, Debug, Default)]
pub struct MedialBuildPlugin {
    /// A directory for built shapes, so that the next run of the app can load them. File names depend on the content of mesh and options and on the
    /// version of this crate. The directory may be deleted at any time, and several apps may share it.
    ///
    /// Default: none. A library should not write to the disk without permission, and each app has its own place for caches.
    pub cache: Option<PathBuf>,
}

impl Plugin for MedialBuildPlugin {
    fn build(&self, app: &mut App) {
        init_medial_axis(app);
        if !app.world().contains_resource::<Assets<Mesh>>() {
            app.init_asset::<Mesh>();
        }
        app.register_type::<BuildMedialMesh>()
            .register_type::<MedialBuildStatus>()
            .register_type::<MedialMesh>()
            .insert_resource(Cache(self.cache.clone()))
            .add_systems(
                Update,
                (leave_builds, join_builds, take_results)
                    .chain()
                    .run_if(any_with_component::<MedialBuildStatus>)
                    .in_set(MedialSystems::Build),
            );
    }
}

#[derive(Resource)]
struct Cache(Option<PathBuf>);

/// Identity of a build. Entities with equal keys share the build.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
struct Key {
    mesh: AssetId<Mesh>,
    spheres: Option<usize>,
    /// Bits of the values, so that NaN equals itself.
    max_error: Option<u32>,
    error_limit: u32,
    sides: [Option<u32>; 2],
    levels: bool,
    searches: Option<usize>,
    seed: u64,
}

impl Key {
    fn new(mesh: AssetId<Mesh>, options: &FitOptions) -> Self {
        let &FitOptions { spheres, max_error, error_limit, sides, levels, searches, seed } = options;
        let (max_error, error_limit) = (max_error.map(f32::to_bits), error_limit.to_bits());
        let sides = [sides.inside, sides.enclose].map(|limit| limit.map(f32::to_bits));
        Self { mesh, spheres, max_error, error_limit, sides, levels, searches, seed }
    }
}

/// A build that is in progress or finished.
#[derive(Default)]
struct Build {
    /// The completed part, as the bits of an f32.
    progress: AtomicU32,
    result: OnceLock<Result<MedialAxis, String>>,
    asset: OnceLock<Handle<MedialAxis>>,
}

impl Build {
    /// Runs a build until it is finished or has no owner. `name` is the name of an owner.
    fn start(self: &Arc<Self>, name: String, mesh: Mesh, options: FitOptions, cache: Option<PathBuf>) {
        let build = Arc::downgrade(self);
        let task = async move {
            let progress = |fraction: f32| {
                let Some(build) = build.upgrade() else { return ControlFlow::Break(()) };
                build.progress.store(fraction.to_bits(), Ordering::Relaxed);
                ControlFlow::Continue(())
            };
            if progress(0.0).is_break() {
                return;
            }
            // Parallel loops on the pool of the frame's systems would delay frames.
            let work = || on_this_thread(|| medial_axis_of(&mesh, &options, cache.as_deref(), &progress));
            // A panic becomes an error, so that waiting entities get a result in any case.
            let result =
                catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|_| Err("the builder has panicked".into()));
            let Some(build) = build.upgrade() else { return };
            if let Err(error) = &result {
                error!("{name}: no medial mesh can be built from its Mesh3d: {error}");
            }
            // Only this task sets the result.
            let _ = build.result.set(result);
        };
        BUILDERS.spawn(task).detach();
    }
}

/// Threads for builds. Builds take seconds, and Bevy makes pipelines and loads assets on the few threads of its own pools.
static BUILDERS: LazyLock<TaskPool> = LazyLock::new(|| {
    let threads = available_parallelism().map_or(1, usize::from).div_ceil(4);
    TaskPoolBuilder::new().num_threads(threads).thread_name("medial mesh builder".into()).build()
});

fn medial_axis_of(
    mesh: &Mesh,
    options: &FitOptions,
    cache: Option<&Path>,
    progress: &(dyn Fn(f32) -> ControlFlow<()> + Sync),
) -> Result<MedialAxis, String> {
    let mesh = TriangleMesh::from_bevy(mesh).map_err(|error| error.to_string())?;
    let levels = fit_cached(cache, &mesh, options, progress).map_err(|error| error.to_string())?;
    levels.into_medial_axis().ok_or_else(|| "the builder returned no levels".into())
}

/// The build that an entity waits for, or has the result of.
#[derive(Component, Clone)]
struct Joined {
    key: Key,
    build: Arc<Build>,
}

/// Removes entities from their build if they have lost a component that it needs.
fn leave_builds(
    mut commands: Commands,
    mut left: Query<
        (Entity, &mut MedialBuildStatus, Has<BuildMedialMesh>),
        Or<(Without<BuildMedialMesh>, Without<Mesh3d>)>,
    >,
) {
    for (entity, mut status, wants) in &mut left {
        status.set_if_neq(MedialBuildStatus::Waiting);
        let mut entity = commands.entity(entity);
        entity.try_remove::<Joined>();
        if !wants {
            // The component may have been inserted again by then.
            entity.queue_silenced(|mut entity: EntityWorldMut| {
                if !entity.contains::<BuildMedialMesh>() {
                    entity.remove::<MedialBuildStatus>();
                }
            });
        }
    }
}

/// Gives each entity with a loaded mesh its build, and starts builds that do not exist yet.
fn join_builds(
    mut commands: Commands,
    cache: Res<Cache>,
    meshes: Res<Assets<Mesh>>,
    server: Option<Res<AssetServer>>,
    mut changes: Changes<Mesh>,
    mut builds: Local<HashMap<Key, Weak<Build>>>,
    mut entities: Query<(NameOrEntity, &BuildMedialMesh, &Mesh3d, &mut MedialBuildStatus, Option<&Joined>)>,
) {
    let changed = changes.read();
    builds.retain(|key, build| !changed.contains(&key.mesh) && build.strong_count() > 0);
    for (name, wanted, mesh, mut status, joined) in &mut entities {
        let key = Key::new(mesh.0.id(), wanted);
        if joined.is_some_and(|joined| joined.key == key) && !changed.contains(&key.mesh) {
            continue;
        }
        let Some(source) = meshes.get(&mesh.0) else {
            commands.entity(name.entity).try_remove::<Joined>();
            let loading = server.as_ref().and_then(|server| server.get_load_state(&mesh.0));
            let Some(LoadState::Failed(error)) = loading else {
                status.set_if_neq(MedialBuildStatus::Waiting);
                continue;
            };
            if status.set_if_neq(MedialBuildStatus::Failed(error.to_string())) {
                error!("{name}: its Mesh3d did not load, so it gets no medial mesh: {error}");
            }
            continue;
        };
        let build = builds.get(&key).and_then(Weak::upgrade).unwrap_or_else(|| {
            let build = Arc::<Build>::default();
            build.start(name.to_string(), source.clone(), wanted.0, cache.0.clone());
            builds.insert(key, Arc::downgrade(&build));
            build
        });
        *status = MedialBuildStatus::Building(0.0);
        commands.entity(name.entity).try_insert(Joined { key, build });
    }
}

/// Updates the status of entities, and inserts the built shapes.
fn take_results(
    mut commands: Commands,
    mut axes: ResMut<Assets<MedialAxis>>,
    mut entities: Query<(Entity, &Joined, &mut MedialBuildStatus)>,
) {
    for (entity, Joined { build, .. }, mut status) in &mut entities {
        if *status == MedialBuildStatus::Built {
            continue;
        }
        let now = match build.result.get() {
            None => MedialBuildStatus::Building(f32::from_bits(build.progress.load(Ordering::Relaxed))),
            Some(Err(error)) => MedialBuildStatus::Failed(error.clone()),
            Some(Ok(axis)) => {
                let asset = build.asset.get_or_init(|| axes.add(axis.clone()));
                commands.entity(entity).try_insert(MedialMesh(asset.clone()));
                MedialBuildStatus::Built
            }
        };
        status.set_if_neq(now);
    }
}
