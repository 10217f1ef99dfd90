//! Poses the skinned shapes by the transforms of their joints.

use std::{
    collections::HashMap,
    sync::{Arc, Mutex, PoisonError},
};

use bevy::{
    asset::LoadState,
    ecs::{entity::EntityHashSet, system::SystemParam},
    prelude::*,
};

use super::{
    Detail,
    importance::{DetailItem, Nearness},
    is_bounded,
    screw::Screw,
    skinned::{Bound, SkinPose, SkinnedMedialMesh},
    step::MedialStep,
};
use crate::{
    constants::{MAX_JOINT_TURN, MAX_SEGMENTS, TELEPORT},
    geometry::{Aabb, Pose3, Sphere},
    medial_axis::{JointPose, MedialAxis, Skin, SkinJoint},
    pipeline::Deforming,
};

type Skinned =
    (NameOrEntity, &'static SkinnedMedialMesh, Option<&'static mut SkinPose>, Detail, Option<&'static Nearness>);

/// Events of a shape, other than moving with its joints.
enum Event {
    /// It was placed for the first time.
    Placed(SkinPose),
    /// Its joints moved by this distance in metres, for the first time too far to be swept.
    Jumped(f32),
    /// It cannot be placed, for this reason.
    Refused(String),
}

/// All skinned shapes.
#[derive(SystemParam)]
pub(crate) struct Skeletons<'w, 's> {
    commands: Commands<'w, 's>,
    skinned: Query<'w, 's, Skinned>,
    scene: Scene<'w, 's>,
    step: ResMut<'w, MedialStep>,
    /// Entities that cannot be placed. This has been logged.
    told: Local<'s, EntityHashSet>,
}

/// Assets and entities that determine the poses.
#[derive(SystemParam)]
struct Scene<'w, 's> {
    axes: Res<'w, Assets<MedialAxis>>,
    server: Option<Res<'w, AssetServer>>,
    names: Query<'w, 's, &'static Name>,
    children: Query<'w, 's, &'static Children>,
    #[cfg(feature = "bevy_mesh")]
    meshes: Query<'w, 's, &'static bevy::mesh::skinning::SkinnedMesh>,
    transforms: Query<'w, 's, &'static GlobalTransform>,
}

/// Reasons why a shape is not placed.
enum Unplaced {
    /// The asset is not loaded, or the scene is not spawned.
    Waiting,
    Refused(String),
}

impl Skeletons<'_, '_> {
    /// Places each shape in the pose of its joints. `frame_of`: the frame for the shape of an entity. `None` for a frame that the shape chooses.
    pub fn pose(
        &mut self,
        is_running: impl Fn(Entity) -> bool + Sync,
        frame_of: impl Fn(Entity) -> Option<Pose3> + Sync,
    ) {
        let Self { commands, skinned, scene, step, told } = self;
        told.retain(|entity| skinned.contains(*entity));
        let events = Mutex::new(Vec::new());
        skinned.par_iter_mut().for_each(|(name, mesh, mut pose, detail, nearness)| {
            let entity = name.entity;
            if is_running(entity)
                && let Some(event) = scene.advance(entity, mesh, &mut pose, &detail, nearness, frame_of(entity))
            {
                events.lock().unwrap_or_else(PoisonError::into_inner).push((entity, name.to_string(), event));
            }
        });
        let mut events = events.into_inner().unwrap_or_else(PoisonError::into_inner);
        events.sort_by_key(|(entity, ..)| *entity);
        for (entity, name, event) in events {
            match event {
                Event::Placed(pose) => {
                    told.remove(&entity);
                    commands.entity(entity).try_insert(pose);
                }
                Event::Jumped(metres) => warn!(
                    "{name}: its joints moved by {metres} m in one step, too far to be swept; call SkinPose::teleport where the animation jumps"
                ),
                Event::Refused(reason) => {
                    if told.insert(entity) {
                        error!("{name}: {reason}, so it collides with nothing");
                    }
                    commands.entity(entity).try_remove::<SkinPose>();
                }
            }
        }
        let bound = skinned.iter().filter_map(|(name, _, pose, ..)| Some((name.entity, pose?.bound.clone())));
        step.skins.clear();
        step.skins.extend(bound);
    }
}

/// The shape and its new joints, if they are not known, with the current poses of all joints.
type Placed<'a> = (&'a MedialAxis, Option<Vec<Entity>>, Vec<JointPose>);

impl Scene<'_, '_> {
    /// Moves a shape with its joints, or places it for the first time.
    fn advance(
        &self,
        entity: Entity,
        mesh: &SkinnedMedialMesh,
        pose: &mut Option<Mut<SkinPose>>,
        detail: &DetailItem,
        nearness: Option<&Nearness>,
        frame: Option<Pose3>,
    ) -> Option<Event> {
        match (self.place(entity, mesh, detail, pose.as_deref()), pose) {
            (Ok((axis, None, poses)), Some(pose)) => {
                let is_far = nearness.is_none_or(Nearness::is_far);
                pose.advance(axis, poses, frame, if is_far { mesh.interval } else { 1 }).map(Event::Jumped)
            }
            (Ok((axis, joints, poses)), _) => {
                Some(Event::Placed(SkinPose::new(axis, joints.unwrap_or_default(), poses, mesh, frame)))
            }
            // The shape rests until its asset or its joints are back.
            (Err(Unplaced::Waiting), Some(pose)) => {
                let (axis, poses) = (pose.bound.axis.clone(), pose.poses.clone());
                pose.advance(&axis, poses, frame, 1).map(Event::Jumped)
            }
            (Err(Unplaced::Waiting), None) => None,
            (Err(Unplaced::Refused(reason)), _) => Some(Event::Refused(reason)),
        }
    }

    /// Finds the shape of an entity and its joints. `pose`: the pose of the last step.
    fn place<'a>(
        &'a self,
        entity: Entity,
        mesh: &SkinnedMedialMesh,
        detail: &DetailItem,
        pose: Option<&SkinPose>,
    ) -> Result<Placed<'a>, Unplaced> {
        let scale =
            pose.map_or(1.0, |pose| pose.poses.iter().map(|joint| joint.scale).fold(f32::MIN_POSITIVE, f32::max));
        let axis = self.axis(mesh, detail, scale)?;
        let missing = "its medial mesh has no skin; build the mesh with `medial build --skin`";
        let skin = axis.skin().ok_or_else(|| Unplaced::Refused(missing.into()))?;
        let known = pose.map(|pose| &pose.bound).filter(|known| {
            let is_same = known
                .axis
                .skin()
                .is_some_and(|known| Arc::ptr_eq(known.joints(), skin.joints()) || known.joints() == skin.joints());
            is_same && (mesh.joints.is_empty() || *mesh.joints == *known.joints)
        });
        let new = if known.is_none() { Some(self.bind(entity, mesh, skin)?) } else { None };
        let joints = new.as_deref().or(known.map(|known| &*known.joints)).unwrap_or_default();
        let poses = self.poses(skin, joints)?;
        Ok((axis, new, poses))
    }

    /// Returns the loaded shape at its level of detail. `scale`: the largest scale of its joints.
    fn axis(&self, mesh: &SkinnedMedialMesh, detail: &DetailItem, scale: f32) -> Result<&MedialAxis, Unplaced> {
        if let Some(finest) = self.axes.get(&mesh.mesh) {
            return Ok(finest.level(detail.level(finest, scale)));
        }
        Err(match self.server.as_ref().and_then(|server| server.get_load_state(&mesh.mesh)) {
            Some(LoadState::Failed(error)) => Unplaced::Refused(format!("its medial mesh did not load: {error}")),
            _ => Unplaced::Waiting,
        })
    }

    /// Returns the entities of the joints: those that the component lists, or those with the names of the joints among the joints of the entity's skinned meshes
    /// and its descendants.
    fn bind(&self, entity: Entity, mesh: &SkinnedMedialMesh, skin: &Skin) -> Result<Vec<Entity>, Unplaced> {
        let count = skin.joints().len();
        if !mesh.joints.is_empty() {
            let listed = mesh.joints.len();
            let wrong = || {
                Unplaced::Refused(format!(
                    "it lists {listed} joints, its skin has {count}; list the joints of the skin"
                ))
            };
            return if listed == count { Ok(mesh.joints.clone()) } else { Err(wrong()) };
        }
        let mut named: HashMap<&str, Entity> = HashMap::new();
        for joint in self.candidates(entity) {
            if let Ok(name) = self.names.get(joint) {
                named.entry(name.as_str()).or_insert(joint);
            }
        }
        let found: Vec<Option<Entity>> = skin.joints().iter().map(|joint| named.get(&*joint.name).copied()).collect();
        if found.iter().all(Option::is_none) && !self.has_skinned_mesh(entity) {
            return Err(Unplaced::Waiting);
        }
        let unknown = std::iter::zip(skin.joints().iter(), &found).find(|(_, found)| found.is_none());
        match unknown {
            Some((joint, _)) => Err(Unplaced::Refused(format!(
                "no entity has the name `{}` of a joint of its skin; use the scene from which the medial mesh was built, or list its joints",
                joint.name
            ))),
            None => Ok(found.into_iter().flatten().collect()),
        }
    }

    /// Returns true if the scene of an entity has been spawned: it has a skinned triangle mesh.
    fn has_skinned_mesh(&self, entity: Entity) -> bool {
        #[cfg(feature = "bevy_mesh")]
        return std::iter::once(entity)
            .chain(self.children.iter_descendants(entity))
            .any(|entity| self.meshes.contains(entity));
        #[cfg(not(feature = "bevy_mesh"))]
        return {
            let _ = entity;
            false
        };
    }

    /// Returns the entities that may be joints.
    fn candidates(&self, entity: Entity) -> impl Iterator<Item = Entity> {
        let all = || std::iter::once(entity).chain(self.children.iter_descendants(entity));
        #[cfg(feature = "bevy_mesh")]
        let listed =
            all().filter_map(|entity| self.meshes.get(entity).ok()).flat_map(|mesh| mesh.joints.iter().copied());
        #[cfg(not(feature = "bevy_mesh"))]
        let listed = std::iter::empty();
        listed.chain(all())
    }

    /// Returns the motion of each joint since the bind pose, in the world.
    fn poses(&self, skin: &Skin, joints: &[Entity]) -> Result<Vec<JointPose>, Unplaced> {
        let place = |(joint, &entity): (&SkinJoint, &Entity)| {
            self.transforms.get(entity).map(GlobalTransform::affine).map_err(|_| {
                Unplaced::Refused(format!(
                    "its joint `{}` ({entity}) does not exist or has no GlobalTransform; keep the joints as long as the shape",
                    joint.name
                ))
            })
        };
        let places = std::iter::zip(skin.joints().iter(), joints).map(place).collect::<Result<Vec<_>, _>>()?;
        let mut poses = Vec::with_capacity(joints.len());
        skin.joint_poses(&places, &mut poses);
        let is_sound = |pose: &JointPose| {
            is_bounded(pose.transform.translation.into()) && pose.transform.matrix3.is_finite() && pose.is_uniform()
        };
        match std::iter::zip(skin.joints().iter(), &poses).find(|(_, pose)| !is_sound(pose)) {
            Some((joint, pose)) => Err(Unplaced::Refused(format!(
                "its joint `{}` has the transform {:?}; give it and its ancestors finite values and a uniform scale",
                joint.name, pose.transform
            ))),
            None => Ok(poses),
        }
    }
}

impl SkinPose {
    /// Creates the pose of a shape that is placed for the first time.
    fn new(
        axis: &MedialAxis,
        joints: Vec<Entity>,
        poses: Vec<JointPose>,
        mesh: &SkinnedMedialMesh,
        frame: Option<Pose3>,
    ) -> Self {
        let bound = Bound { axis: axis.clone(), joints: joints.into() };
        let names = axis.skin().map_or(&[][..], |skin| skin.joints());
        let regions = names.iter().map(|joint| mesh.regions.get(&joint.name).cloned()).collect();
        let spheres = posed(axis, &poses);
        let frame = frame.unwrap_or_else(|| frame_around(&spheres));
        let shape = Arc::new(Deforming::new(axis, vec![seen_from(&frame, spheres)]));
        Self { bound, regions, before: poses.clone(), poses, shape, frame, age: 0, teleports: false, has_jumped: false }
    }

    /// Moves the shape to the pose of its joints. Returns the displacement in metres if it is too long to be swept, for the first time.
    ///
    /// `interval`: number of steps between two updates.
    fn advance(
        &mut self,
        axis: &MedialAxis,
        poses: Vec<JointPose>,
        frame: Option<Pose3>,
        interval: u32,
    ) -> Option<f32> {
        self.age += 1;
        let teleports = std::mem::take(&mut self.teleports);
        self.before.clone_from(&self.poses);
        if self.age >= interval || teleports {
            (self.age, self.poses) = (0, poses);
        }
        let rests = self.poses == self.before
            && axis.address() == self.bound.axis.address()
            && frame.is_none_or(|frame| frame == self.frame);
        if rests && self.shape.path() == 0.0 {
            return None;
        }
        let [start, end] = [&self.before, &self.poses].map(|poses| posed(axis, poses));
        let displacement = std::iter::zip(&start, &end).map(|(a, b)| a.center.distance(b.center)).fold(0.0, f32::max);
        let jumps = displacement > TELEPORT * self.shape.axis().bounding_sphere().radius;
        let mut knots = if jumps || teleports { Vec::new() } else { between(axis, &self.before, &self.poses) };
        if jumps || teleports {
            self.before.clone_from(&self.poses);
        }
        self.frame = frame.unwrap_or_else(|| if rests { self.frame } else { frame_around(&end) });
        if !jumps && !teleports {
            knots.insert(0, start);
        }
        knots.push(end);
        let knots = knots.into_iter().map(|knot| seen_from(&self.frame, knot)).collect();
        self.shape = Arc::new(Deforming::new(axis, knots));
        self.bound.axis = axis.clone();
        let is_new = jumps && !teleports && !self.has_jumped;
        self.has_jumped |= is_new;
        is_new.then_some(displacement)
    }
}

fn posed(axis: &MedialAxis, poses: &[JointPose]) -> Vec<Sphere> {
    let mut spheres = Vec::new();
    if let Some(skin) = axis.skin() {
        skin.pose(axis.spheres(), poses, &mut spheres);
    }
    spheres
}

/// Returns the spheres at equal fractions between two poses, so that no joint turns by more than [`MAX_JOINT_TURN`] from one to the next.
fn between(axis: &MedialAxis, before: &[JointPose], now: &[JointPose]) -> Vec<Vec<Sphere>> {
    let screws: Vec<Screw> = std::iter::zip(before, now).map(|(before, now)| Screw::new([*before, *now])).collect();
    let turn = screws.iter().map(Screw::angle).fold(0.0, f32::max);
    let segments = ((turn / MAX_JOINT_TURN).ceil() as usize).clamp(1, MAX_SEGMENTS);
    let at = |fraction: f32| screws.iter().map(|screw| screw.at(fraction)).collect::<Vec<_>>();
    (1..segments).map(|i| posed(axis, &at(i as f32 / segments as f32))).collect()
}

/// Returns a frame with the axes of the world in the middle of the spheres.
fn frame_around(spheres: &[Sphere]) -> Pose3 {
    Pose3::from_translation(Aabb::from_spheres(spheres.iter().copied()).center())
}

fn seen_from(frame: &Pose3, spheres: Vec<Sphere>) -> Vec<Sphere> {
    let turn = frame.rotation.inverse();
    let place = |s: Sphere| Sphere::new(turn * (s.center - frame.translation), s.radius);
    spheres.into_iter().map(place).collect()
}
