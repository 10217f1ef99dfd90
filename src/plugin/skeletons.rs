//! Poses the skinned shapes by the transforms of their joints.

use std::{collections::HashMap, sync::Arc};

#[cfg(feature = "bevy_mesh")]
use bevy::mesh::skinning::SkinnedMesh;
use bevy::{
    asset::LoadState,
    ecs::{entity::EntityHashMap, system::SystemParam},
    prelude::*,
    tasks::ComputeTaskPool,
};

use super::{
    Detail,
    importance::{DetailItem, Nearness},
    is_bounded,
    skin_motion::regions,
    skinned::{SkinPose, SkinnedMedialMesh},
    step::MedialStep,
};
use crate::{
    geometry::{Aabb, Pose3},
    medial_axis::{JointPose, MedialAxis, Skin, SkinJoint},
    pipeline::parallel,
};

type Skinned =
    (NameOrEntity, Ref<'static, SkinnedMedialMesh>, Option<&'static mut SkinPose>, Detail, Option<&'static Nearness>);

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
    /// Number of steps in a row in which an entity could not be placed.
    refused: Local<'s, EntityHashMap<u32>>,
}

/// Number of steps in a row in which an entity cannot be placed before the reason is logged and its pose is removed. An entity that is spawned or despawned
/// in parts needs two.
const PATIENCE: u32 = 2;

/// Assets and entities that determine the poses.
#[derive(SystemParam)]
struct Scene<'w, 's> {
    axes: Res<'w, Assets<MedialAxis>>,
    server: Option<Res<'w, AssetServer>>,
    names: Query<'w, 's, &'static Name>,
    children: Query<'w, 's, &'static Children>,
    #[cfg(feature = "bevy_mesh")]
    meshes: Query<'w, 's, (&'static SkinnedMesh, Option<&'static ViewVisibility>)>,
    #[cfg(feature = "bevy_mesh")]
    cameras: Query<'w, 's, (), With<Camera>>,
    shapes: Query<'w, 's, (), With<SkinnedMedialMesh>>,
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
        let Self { commands, skinned, scene, step, refused } = self;
        // Bevy's parallel queries do not use the thread that waits.
        let mut items: Vec<_> = skinned.iter_mut().collect();
        items.sort_unstable_by_key(|(name, ..)| name.entity);
        let pool = ComputeTaskPool::get_or_init(Default::default);
        let events = parallel::change(pool, &mut items, 4, |(name, mesh, pose, detail, nearness)| {
            let entity = name.entity;
            let runs = is_running(entity);
            let event = runs.then(|| scene.advance(entity, mesh, pose, detail, *nearness, frame_of(entity))).flatten();
            event.map(|event| (entity, name.to_string(), event))
        });
        let is_refused = |entity: &Entity| {
            events.iter().any(|(known, _, event)| known == entity && matches!(event, Event::Refused(_)))
        };
        refused.retain(|entity, _| is_refused(entity));
        for (entity, name, event) in events {
            match event {
                Event::Placed(pose) => _ = commands.entity(entity).try_insert(pose),
                Event::Jumped(metres) => warn!(
                    "{name}: its joints moved by {metres} m in one step, too far to be swept; call SkinPose::teleport where the animation jumps"
                ),
                Event::Refused(reason) => {
                    let steps = refused.entry(entity).or_default();
                    *steps = steps.saturating_add(1);
                    if *steps == PATIENCE {
                        error!("{name}: {reason}, so it collides with nothing");
                    }
                    if *steps >= PATIENCE {
                        commands.entity(entity).try_remove::<SkinPose>();
                    }
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
        mesh: &Ref<SkinnedMedialMesh>,
        pose: &mut Option<Mut<SkinPose>>,
        detail: &DetailItem,
        nearness: Option<&Nearness>,
        frame: Option<Pose3>,
    ) -> Option<Event> {
        match (self.place(entity, mesh, detail, pose.as_deref()), pose) {
            (Ok((axis, None, poses)), Some(pose)) => {
                if mesh.is_changed() {
                    pose.regions = regions(axis, mesh);
                }
                let is_slow = mesh.interval > 1 && self.is_remote(entity, nearness);
                pose.advance(axis, poses, frame, if is_slow { mesh.interval } else { 1 }).map(Event::Jumped)
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
        let poses = self.poses(axis, skin, joints)?;
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
        return self.members(entity).into_iter().any(|entity| self.meshes.contains(entity));
        #[cfg(not(feature = "bevy_mesh"))]
        return {
            let _ = entity;
            false
        };
    }

    /// Returns the entities that may be joints.
    fn candidates(&self, entity: Entity) -> Vec<Entity> {
        let members = self.members(entity);
        #[cfg(feature = "bevy_mesh")]
        let listed =
            members.iter().filter_map(|entity| self.meshes.get(*entity).ok()).flat_map(|(mesh, _)| &mesh.joints);
        #[cfg(not(feature = "bevy_mesh"))]
        let listed = std::iter::empty();
        listed.chain(&members).copied().collect()
    }

    /// Returns an entity and its descendants, nearer ones first, without those of another skinned shape below it, such as a rider.
    fn members(&self, entity: Entity) -> Vec<Entity> {
        let mut members = vec![entity];
        let mut next = 0;
        while let Some(&member) = members.get(next) {
            let children = self.children.get(member).into_iter().flatten();
            members.extend(children.filter(|child| !self.shapes.contains(**child)));
            next += 1;
        }
        members
    }

    /// Returns true for a shape that is far from every point of interest, or that no camera sees, and for one about which neither is known.
    fn is_remote(&self, entity: Entity, nearness: Option<&Nearness>) -> bool {
        match (nearness.map(Nearness::is_far), self.is_hidden(entity)) {
            (None, None) => true,
            (is_far, is_hidden) => is_far == Some(true) || is_hidden == Some(true),
        }
    }

    /// Returns true if no camera sees a skinned mesh of an entity; `None` without cameras or without such meshes.
    fn is_hidden(&self, entity: Entity) -> Option<bool> {
        #[cfg(feature = "bevy_mesh")]
        if !self.cameras.is_empty() {
            let seen = |member: &Entity| self.meshes.get(*member).ok()?.1;
            // While Bevy updates it, the visibility of the last frame counts.
            let is_hidden = |visibility: &ViewVisibility| *visibility == ViewVisibility::HIDDEN;
            let members = self.members(entity);
            let mut known = members.iter().filter_map(seen).peekable();
            known.peek()?;
            return Some(known.all(is_hidden));
        }
        let _ = entity;
        None
    }

    /// Returns the motion of each joint since the bind pose, in the world.
    fn poses(&self, axis: &MedialAxis, skin: &Skin, joints: &[Entity]) -> Result<Vec<JointPose>, Unplaced> {
        let Aabb { min, max } = axis.aabb();
        let reach = min.abs().max(max.abs()).length();
        let is_sound = |pose: &JointPose| {
            is_bounded(pose.transform.translation.into())
                && is_bounded(Vec3::splat(reach * pose.scale))
                && pose.is_uniform()
        };
        let mut poses = Vec::with_capacity(joints.len());
        for (joint, &entity) in skin.joints().iter().zip(joints) {
            let SkinJoint { name, .. } = joint;
            let place = self.transforms.get(entity).map_err(|_| {
                Unplaced::Refused(format!(
                    "its joint `{name}` ({entity}) does not exist or has no GlobalTransform; keep the joints as long as the shape"
                ))
            })?;
            let pose = joint.pose(place.affine());
            if !is_sound(&pose) {
                return Err(Unplaced::Refused(format!(
                    "its joint `{name}` has the transform {:?}; give it and its ancestors finite values of a moderate size and a uniform scale",
                    pose.transform
                )));
            }
            poses.push(pose);
        }
        Ok(poses)
    }
}
