//! The binding of a shape to the joints of a skeleton: linear blend skinning.
//!
//! ```text
//! joints, current --joint_poses--> JointPose: from the bind pose to now --pose--> spheres, posed
//! ```

use std::{
    collections::HashMap,
    ops::{Add, Mul, Sub},
    sync::Arc,
};

use glam::{Affine3A, Mat3A, Vec3};
use smallvec::SmallVec;
use thiserror::Error;

use crate::geometry::{Primitive, Sphere};

/// Largest number of joints that move one point.
pub const MAX_INFLUENCES: usize = 4;

/// Largest number of joints of a skin.
pub const MAX_JOINTS: usize = 1 << 16;

/// Relative difference between two squared lengths of a joint's axes, up to which its scale counts as uniform. It is above the rounding of long chains of
/// joints, and changes a radius by less than 1 %.
const UNIFORM: f32 = 0.01;

/// Difference from 1 of the sum of weights that keep their bits. It is above the rounding of four f32, and below that of weights of 8 bits.
const ROUNDING: f64 = 1.0e-6;

/// The joints that move a point, and their weights. Unused entries have weight 0.
pub type JointWeights = [(u16, f32); MAX_INFLUENCES];

/// A joint of a skeleton.
#[derive(Clone, Debug, PartialEq)]
pub struct SkinJoint {
    /// Its name, which no other joint of the skin has.
    pub name: String,
    /// Transform from the frame of the mesh to the frame of the joint in the bind pose.
    pub inverse_bind: Affine3A,
}

impl SkinJoint {
    /// Returns the motion of the joint since the bind pose. `place`: its current transform to the frame of the posed mesh.
    pub fn pose(&self, place: Affine3A) -> JointPose {
        JointPose::new(place * self.inverse_bind)
    }
}

/// Joints, and for each point of a mesh the weights of the joints that move it. The points are the spheres of a [`MedialAxis`](super::MedialAxis), or the
/// vertices of a skinned triangle mesh.
///
/// Invariants: joints have different names and invertible inverse bind poses. The weights of each point add up to 1 and are in descending order.
/// Clones share the joints.
#[derive(Clone, Debug, PartialEq)]
pub struct Skin {
    joints: Arc<[SkinJoint]>,
    weights: Box<[JointWeights]>,
}

/// Reasons why joints and weights are not a skin.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum SkinError {
    /// There is no joint.
    #[error("the skin has no joints")]
    Empty,
    /// There are more joints than [`MAX_JOINTS`].
    #[error("the skin has {0} joints, more than {MAX_JOINTS}")]
    TooManyJoints(usize),
    /// Two joints have the same name.
    #[error("joints {first} and {second} are both named `{name}`; rename one of them")]
    SameName {
        /// Index of one joint.
        first: usize,
        /// Index of the other joint.
        second: usize,
        /// Their name.
        name: String,
    },
    /// An inverse bind pose is not a finite, invertible transform.
    #[error("joint {joint} `{name}`: its inverse bind pose is not finite or not invertible; export the skin again")]
    InverseBind {
        /// Index of the joint.
        joint: usize,
        /// Its name.
        name: String,
    },
    /// A weight is negative, NaN or infinite.
    #[error("point {point}: the weight {weight} of joint {joint} is negative or not finite; normalize the weights")]
    Weight {
        /// Index of the sphere or vertex.
        point: usize,
        /// Index of the joint.
        joint: u16,
        /// The invalid weight.
        weight: f32,
    },
    /// All weights of a point are 0.
    #[error("point {point}: all of its weights are 0; assign it to a joint")]
    NoWeight {
        /// Index of the sphere or vertex.
        point: usize,
    },
    /// A weight refers to a joint that does not exist.
    #[error("point {point}: there is no joint {joint} among {joints}")]
    JointOutOfRange {
        /// Index of the sphere or vertex.
        point: usize,
        /// The invalid index.
        joint: u16,
        /// Number of joints.
        joints: usize,
    },
    /// The skin belongs to another mesh.
    #[error("the skin has weights for {weights} points, the mesh has {points}")]
    Count {
        /// Number of points with weights.
        weights: usize,
        /// Number of spheres or vertices.
        points: usize,
    },
}

/// The motion of a joint from the bind pose to the current pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointPose {
    /// Transform from the frame of the mesh to the frame of the posed mesh.
    pub transform: Affine3A,
    /// The cube root of the transform's change of volume: its scale if that is uniform.
    pub scale: f32,
}

impl JointPose {
    /// The pose with the given transform.
    pub fn new(transform: Affine3A) -> Self {
        Self { transform, scale: scale(transform.matrix3) }
    }

    /// False if the transform scales by different factors in different directions. Spheres stay spheres, so such a pose is not followed exactly.
    pub fn is_uniform(&self) -> bool {
        let (axes, square) = (self.transform.matrix3, self.scale * self.scale);
        let [x, y, z] = [axes.x_axis, axes.y_axis, axes.z_axis];
        let off =
            [x, y, z].map(|axis| axis.length_squared() - square).into_iter().chain([x.dot(y), y.dot(z), z.dot(x)]);
        off.into_iter().all(|off| off.abs() <= UNIFORM * square)
    }
}

impl Skin {
    /// Creates a skin from joints and the weights of each point. Weights of a point are divided by their sum; those of one joint are added up.
    ///
    /// # Errors
    /// If there are no joints or too many, if two have the same name, or if an inverse bind pose is not invertible. If a weight is negative or not finite, if
    /// a point has no weight, or if a weight other than 0 refers to a joint that does not exist.
    pub fn new(joints: impl Into<Arc<[SkinJoint]>>, weights: &[JointWeights]) -> Result<Self, SkinError> {
        let joints = joints.into();
        validate(&joints)?;
        let weights = weights.iter().enumerate().map(|(point, weights)| {
            if let Some(&(joint, weight)) = weights.iter().find(|(_, weight)| !(weight.is_finite() && *weight >= 0.0)) {
                return Err(SkinError::Weight { point, joint, weight });
            }
            let used = weights.iter().filter(|(_, weight)| *weight > 0.0);
            if let Some(&(joint, _)) = used.clone().find(|(joint, _)| usize::from(*joint) >= joints.len()) {
                return Err(SkinError::JointOutOfRange { point, joint, joints: joints.len() });
            }
            strongest(used.map(|&(joint, weight)| (joint, f64::from(weight)))).ok_or(SkinError::NoWeight { point })
        });
        Ok(Self { weights: weights.collect::<Result<_, _>>()?, joints })
    }

    /// The same joints, with the weights of other points.
    pub(crate) fn with_weights(&self, weights: Vec<JointWeights>) -> Self {
        Self { joints: self.joints.clone(), weights: weights.into() }
    }

    /// The joints. Skins of the levels of detail of one shape have the same ones.
    pub fn joints(&self) -> &Arc<[SkinJoint]> {
        &self.joints
    }

    /// The weights of each point, the largest first. They add up to 1.
    pub fn weights(&self) -> &[JointWeights] {
        &self.weights
    }

    /// Memory of the weights in bytes.
    pub(super) fn memory(&self) -> usize {
        size_of_val::<[JointWeights]>(&self.weights)
    }

    /// Replaces `poses` by the motion of each joint since the bind pose. `joints` are the current transforms from the frames of the joints to the frame of
    /// the posed mesh, in the order of [`joints`](Self::joints).
    pub fn joint_poses(&self, joints: &[Affine3A], poses: &mut Vec<JointPose>) {
        poses.clear();
        poses.extend(joints.iter().zip(&*self.joints).map(|(place, joint)| joint.pose(*place)));
    }

    /// Moves a point of the mesh, given its index and its position in the bind pose: the weighted mean of its positions under all joints.
    ///
    /// # Panics
    /// If there is no such point, or if there are fewer poses than joints.
    pub fn pose_point(&self, point: usize, position: Vec3, poses: &[JointPose]) -> Vec3 {
        self.blend(point, poses, |pose| pose.transform.transform_point3(position))
    }

    /// Replaces `posed` by the posed spheres, given all spheres in the bind pose.
    ///
    /// A centre moves to the weighted mean of its positions under all joints, as the vertices of a skinned mesh do. A radius scales with the cube root of
    /// the change of volume under the blended transform. So spheres at a bent joint shrink, like the skin there: the mean of two rotations is not a rotation.
    ///
    /// A sphere may swallow another one in a pose, so primitives of posed spheres may be degenerate. They still bound the same hulls.
    ///
    /// # Panics
    /// If there are more spheres than weights, or fewer poses than joints.
    pub fn pose(&self, spheres: &[Sphere], poses: &[JointPose], posed: &mut Vec<Sphere>) {
        posed.clear();
        posed.extend(spheres.iter().enumerate().map(|(point, sphere)| {
            let axes = self.blend(point, poses, |pose| pose.transform.matrix3);
            Sphere::new(self.pose_point(point, sphere.center, poses), sphere.radius * scale(axes))
        }));
    }

    /// The weighted mean of a value of the joints, as a sum of differences from the value of the first joint. So the mean of equal values is exact.
    fn blend<T>(&self, point: usize, poses: &[JointPose], value: impl Fn(&JointPose) -> T) -> T
    where
        T: Copy + Add<Output = T> + Sub<Output = T> + Mul<f32, Output = T>,
    {
        let [(first, _), others @ ..] = &self.weights[point];
        let start = value(&poses[usize::from(*first)]);
        let used = others.iter().take_while(|(_, weight)| *weight > 0.0);
        used.fold(start, |sum, &(joint, weight)| sum + (value(&poses[usize::from(joint)]) - start) * weight)
    }

    /// The joint with the largest weight at a sphere within a primitive, given the barycentric weights of the primitive's spheres.
    ///
    /// # Panics
    /// If the primitive has an index beyond the points.
    pub fn joint_within(&self, primitive: &Primitive, shares: &[f32]) -> u16 {
        let weights = primitive.indices().iter().zip(shares).flat_map(|(&sphere, &share)| {
            let of_sphere = self.weights[sphere as usize].iter();
            of_sphere.map(move |&(joint, weight)| (joint, f64::from(share) * f64::from(weight)))
        });
        summed(weights).first().map_or(0, |&(joint, _)| joint)
    }
}

/// The cube root of the change of volume under a linear transform.
fn scale(axes: Mat3A) -> f32 {
    axes.determinant().abs().cbrt()
}

fn validate(joints: &[SkinJoint]) -> Result<(), SkinError> {
    if joints.is_empty() {
        return Err(SkinError::Empty);
    }
    if joints.len() > MAX_JOINTS {
        return Err(SkinError::TooManyJoints(joints.len()));
    }
    let mut named = HashMap::new();
    for (joint, SkinJoint { name, inverse_bind }) in joints.iter().enumerate() {
        if let Some(first) = named.insert(name, joint) {
            return Err(SkinError::SameName { first, second: joint, name: name.clone() });
        }
        if !inverse_bind.is_finite() || !inverse_bind.inverse().is_finite() {
            return Err(SkinError::InverseBind { joint, name: name.clone() });
        }
    }
    Ok(())
}

/// The largest weights, divided by their sum if that is not 1 up to rounding. `None` if there are no weights above 0.
pub(crate) fn strongest(weights: impl Iterator<Item = (u16, f64)>) -> Option<JointWeights> {
    let mut sums = summed(weights.filter(|(_, weight)| *weight > 0.0));
    sums.truncate(MAX_INFLUENCES);
    let sum: f64 = sums.iter().map(|(_, weight)| weight).sum();
    let &(first, _) = sums.first()?;
    let divisor = if (sum - 1.0).abs() <= ROUNDING { 1.0 } else { sum };
    let entry = |&(joint, weight): &(u16, f64)| (joint, (weight / divisor) as f32);
    Some(std::array::from_fn(|at| sums.get(at).map_or((first, 0.0), entry)))
}

/// The sum of the weights of each joint, the largest first. Equal ones are in the order of the joints.
pub(crate) fn summed(weights: impl Iterator<Item = (u16, f64)>) -> SmallVec<[(u16, f64); 3 * MAX_INFLUENCES]> {
    let mut sums = SmallVec::<[(u16, f64); 3 * MAX_INFLUENCES]>::new();
    for (joint, weight) in weights {
        match sums.iter_mut().find(|sum| sum.0 == joint) {
            Some(sum) => sum.1 += weight,
            None => sums.push((joint, weight)),
        }
    }
    sums.sort_unstable_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    sums
}

#[cfg(test)]
mod tests;
