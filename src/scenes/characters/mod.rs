//! Animated characters made by code: skinned triangle meshes with a walk cycle, for examples, tests and benchmarks.
//!
//! A character looks along +x and stands on the plane y = 0. Frames of joints have the axes of the model in the bind pose.

mod biped;
mod spider;
mod surface;

use std::f32::consts::TAU;

use glam::{Affine3A, Quat, Vec3};

use crate::{
    builder::SkinnedTriangleMesh,
    geometry::{Aabb, Sphere},
    medial_axis::{JointWeights, MAX_INFLUENCES, SkinJoint},
    query::separation,
};

/// Width of the zone in which the weights of two joints blend, as a part of the radius at the joint between them: the difference of the distances to the
/// parts of both joints.
const BLEND: f32 = 0.5;

/// An animated character.
#[derive(Clone, Debug)]
pub struct Character {
    /// Its name.
    pub name: &'static str,
    /// Its joints. Parents come before their children.
    pub joints: Vec<CharacterJoint>,
    /// Duration of a cycle of its gait in seconds.
    pub period: f32,
    /// Width of a cell of the grid that its surface is made on, in metres.
    cell: f32,
    /// Displacement of the root joint at a phase of the gait.
    sway: fn(f32) -> Vec3,
}

/// A joint of a character, and the part of the body that follows it.
#[derive(Clone, Debug)]
pub struct CharacterJoint {
    /// Its name, such as `left hand`.
    pub name: String,
    /// Index of its parent. `None` for the root.
    pub parent: Option<usize>,
    /// Its position in the bind pose, in the frame of the model.
    pub position: Vec3,
    /// The part: cones in the frame of the model.
    cones: Vec<[Sphere; 2]>,
    /// Bounds of the part.
    aabb: Aabb,
    gait: Gait,
}

/// The rotation of a joint over time.
#[derive(Clone, Copy, Debug)]
struct Gait {
    /// The rotation at a phase from 0 to a full turn, for a limb on the right side that points along +x.
    turn: fn(f32) -> Quat,
    /// Shift of the phase.
    phase: f32,
    /// Direction of the limb, as an angle about +y.
    heading: f32,
    /// True for the left side, z < 0, where the rotation is the mirror image.
    is_mirrored: bool,
}

impl Gait {
    const RIGHT: Self = Self { turn: |_| Quat::IDENTITY, phase: 0.0, heading: 0.0, is_mirrored: false };

    fn rotation(&self, phase: f32) -> Quat {
        let heading = Quat::from_rotation_y(self.heading);
        let [x, y, z, w] = (heading * (self.turn)((phase + self.phase).rem_euclid(TAU)) * heading.inverse()).to_array();
        if self.is_mirrored { Quat::from_xyzw(-x, -y, z, w) } else { Quat::from_xyzw(x, y, z, w) }
    }
}

impl Character {
    /// A runner, 1.8 m tall, with 17 joints.
    pub fn biped() -> Self {
        biped::biped()
    }

    /// A spider with 8 legs and 26 joints.
    pub fn spider() -> Self {
        spider::spider()
    }

    /// The transforms from the frames of the joints to the frame of the model, in the order of the joints, `time` seconds after the start.
    pub fn pose(&self, time: f32) -> Vec<Affine3A> {
        let phase = (time / self.period).fract() * TAU;
        let mut poses: Vec<Affine3A> = Vec::with_capacity(self.joints.len());
        for joint in &self.joints {
            let rotation = joint.gait.rotation(phase);
            let (parent, offset) = match joint.parent {
                Some(parent) => (poses[parent], joint.position - self.joints[parent].position),
                None => (Affine3A::IDENTITY, joint.position + (self.sway)(phase)),
            };
            poses.push(parent * Affine3A::from_rotation_translation(rotation, offset));
        }
        poses
    }

    /// The transforms of the bind pose.
    pub fn bind_pose(&self) -> Vec<Affine3A> {
        self.joints.iter().map(|joint| Affine3A::from_translation(joint.position)).collect()
    }

    /// The skinned triangle mesh in the bind pose: a closed surface around the parts of all joints. It takes some tenths of a second.
    ///
    /// # Errors
    /// None for the characters of this module.
    pub fn mesh(&self) -> Result<SkinnedTriangleMesh, Box<dyn std::error::Error>> {
        let bounds = self.joints.iter().map(|joint| joint.aabb).fold(Aabb::EMPTY, Aabb::merge);
        let mesh = surface::surface(&bounds, self.cell, |point| self.distance(point))?;
        let weights: Vec<JointWeights> = mesh.positions.iter().map(|&position| self.weights(position)).collect();
        let inverse_bind = |joint: &CharacterJoint| Affine3A::from_translation(-joint.position);
        let joints =
            self.joints.iter().map(|joint| SkinJoint { name: joint.name.clone(), inverse_bind: inverse_bind(joint) });
        Ok(SkinnedTriangleMesh::new(mesh, joints.collect(), &weights)?)
    }

    /// Signed distance of a point from the body. Far from its surface only the sign is exact.
    fn distance(&self, point: Vec3) -> f32 {
        self.joints.iter().fold(f32::INFINITY, |rest, joint| {
            let blend = 0.5 * joint.radius();
            let is_far = joint.aabb.distance(point) > rest + blend;
            if is_far { rest } else { smooth_min(rest, joint.distance(point), blend) }
        })
    }

    /// The weights of a vertex: those of the nearest part, and of its parent and children where their parts are nearly as near.
    fn weights(&self, position: Vec3) -> JointWeights {
        let distances: Vec<f32> = self.joints.iter().map(|joint| joint.distance(position)).collect();
        let nearest = (0..distances.len()).min_by(|&a, &b| distances[a].total_cmp(&distances[b])).unwrap_or(0);
        let mut weights: Vec<(u16, f32)> = (0..self.joints.len())
            .map(|joint| {
                let between = match (self.joints[joint].parent, self.joints[nearest].parent) {
                    _ if joint == nearest => joint,
                    (Some(parent), _) if parent == nearest => joint,
                    (_, Some(parent)) if parent == joint => nearest,
                    _ => return (0, 0.0),
                };
                let width = BLEND * self.joints[between].radius();
                let near = (1.0 - (distances[joint] - distances[nearest]) / width).max(0.0);
                // The cast is lossless: characters have few joints.
                (joint as u16, near * near)
            })
            .collect();
        weights.sort_by(|a, b| b.1.total_cmp(&a.1));
        std::array::from_fn::<_, MAX_INFLUENCES, _>(|at| weights.get(at).copied().unwrap_or_default())
    }
}

impl CharacterJoint {
    /// A joint at the start of the first cone. The balls are x, y, z and radius, relative to `base` and along the heading.
    fn new(name: String, parent: Option<usize>, base: Vec3, balls: &[[[f32; 4]; 2]], gait: Gait) -> Self {
        let sphere = |[x, y, z, radius]: [f32; 4]| {
            let side = if gait.is_mirrored { -1.0 } else { 1.0 };
            let along = base + Quat::from_rotation_y(gait.heading) * Vec3::new(x, y, z);
            Sphere::new(along * Vec3::new(1.0, 1.0, side), radius)
        };
        let cones: Vec<[Sphere; 2]> = balls.iter().map(|cone| cone.map(sphere)).collect();
        let aabb = Aabb::from_spheres(cones.iter().flatten().copied());
        let position = cones.first().map_or(Vec3::ZERO, |[start, _]| start.center);
        Self { name, parent, position, cones, aabb, gait }
    }

    /// Radius of the part at the joint.
    fn radius(&self) -> f32 {
        self.cones.first().map_or(0.0, |[start, _]| start.radius)
    }

    /// Signed distance of a point from the part.
    fn distance(&self, point: Vec3) -> f32 {
        let point = [Sphere::new(point, 0.0)];
        self.cones.iter().map(|cone| separation(&point, cone, 0).distance).fold(f32::INFINITY, f32::min)
    }
}

/// The smaller of two distances, with a fillet where they differ by less than `blend`.
fn smooth_min(a: f32, b: f32, blend: f32) -> f32 {
    let near = (1.0 - (a - b).abs() / blend).max(0.0);
    a.min(b) - 0.25 * blend * near * near
}

#[cfg(test)]
mod tests;
