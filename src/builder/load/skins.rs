//! Skins of a glTF document.

use std::collections::HashMap;

use glam::{Affine3A, DMat4, Mat4};
use gltf::{Node, Primitive, Semantic};

use super::{
    FormatError,
    accessors::{Values, values},
    nodes::name,
};
use crate::medial_axis::{JointPose, JointWeights, SkinJoint, strongest};

/// Largest difference of two inverse bind poses of one joint, relative to their largest entry.
const SAME: f32 = 1.0e-4;

/// The joints of all skins that have been read, and the weights of their vertices.
#[derive(Default)]
pub(super) struct Skins {
    pub joints: Vec<SkinJoint>,
    pub weights: Vec<JointWeights>,
    /// For each node that is a joint, its index among the joints.
    of_node: HashMap<usize, u16>,
}

impl Skins {
    /// Adds the joints of a skin. Returns the index of each among all joints.
    pub fn add(&mut self, skin: &gltf::Skin, buffers: &[Vec<u8>]) -> Result<Vec<u16>, FormatError> {
        let place = format!("skin {}", skin.index());
        let nodes: Vec<Node> = skin.joints().collect();
        let binds = match skin.inverse_bind_matrices() {
            Some(accessor) => values(&accessor, buffers, &place, Values::InverseBinds)?,
            None => Mat4::IDENTITY.to_cols_array().repeat(nodes.len()),
        };
        let binds = binds.as_chunks::<16>().0;
        if binds.len() < nodes.len() {
            let problem = format!("it has {} inverse bind poses for {} joints", binds.len(), nodes.len());
            return Err(FormatError::damaged(place, problem));
        }
        nodes.iter().zip(binds).map(|(node, bind)| self.joint(node, &Mat4::from_cols_array(bind), &place)).collect()
    }

    fn joint(&mut self, node: &Node, bind: &Mat4, place: &str) -> Result<u16, FormatError> {
        let inverse_bind = Affine3A::from_mat4(*bind);
        if let Some(&known) = self.of_node.get(&node.index()) {
            let joint = &self.joints[usize::from(known)];
            let size = bind.to_cols_array().iter().fold(0.0, |size: f32, entry| size.max(entry.abs()));
            if !inverse_bind.abs_diff_eq(joint.inverse_bind, SAME * size) {
                let problem = format!("another skin has another bind pose of joint `{}`", joint.name);
                return Err(FormatError::new(place, problem, "join the meshes, so that they have one skin"));
            }
            return Ok(known);
        }
        let name = name(node);
        let number = u16::try_from(self.joints.len());
        let number =
            number.map_err(|_| FormatError::new(place, "the file has more than 65536 joints", "remove some"))?;
        self.joints.push(SkinJoint { name, inverse_bind });
        self.of_node.insert(node.index(), number);
        Ok(number)
    }

    /// Adds the weights of the vertices of a primitive, given the joints of its skin.
    pub fn add_weights(
        &mut self,
        primitive: &Primitive,
        joints: &[u16],
        vertices: usize,
        buffers: &[Vec<u8>],
        place: &str,
    ) -> Result<(), FormatError> {
        // Sets of four joints and weights per vertex.
        let mut sets: Vec<(Vec<f32>, Vec<f32>)> = vec![];
        for set in 0.. {
            let get = |semantic: Semantic| primitive.get(&semantic);
            let (Some(numbers), Some(weights)) = (get(Semantic::Joints(set)), get(Semantic::Weights(set))) else {
                break;
            };
            let numbers = values(&numbers, buffers, place, Values::Joints)?;
            let weights = values(&weights, buffers, place, Values::Weights)?;
            if [numbers.len(), weights.len()].iter().any(|length| *length < 4 * vertices) {
                return Err(FormatError::damaged(place, "it has fewer weights than vertices"));
            }
            sets.push((numbers, weights));
        }
        if sets.is_empty() {
            let remedy = "assign its vertices to joints, or remove it";
            return Err(FormatError::new(place, "it has a skin and no weights (JOINTS_0, WEIGHTS_0)", remedy));
        }
        for vertex in 0..vertices {
            let refused =
                |problem: String, remedy| Err(FormatError::new(format!("{place}, vertex {vertex}"), problem, remedy));
            let mut entries: Vec<(u16, f64)> = vec![];
            for (numbers, weights) in &sets {
                let four = 4 * vertex..4 * vertex + 4;
                for (&number, &weight) in numbers[four.clone()].iter().zip(&weights[four]) {
                    if !(weight.is_finite() && weight >= 0.0) {
                        return refused(
                            format!("its weight {weight} is negative or not finite"),
                            "normalize its weights",
                        );
                    }
                    // The cast is lossless: indices have at most 16 bits.
                    match joints.get(number as usize) {
                        Some(&joint) => entries.push((joint, weight.into())),
                        None if weight == 0.0 => {}
                        None => {
                            let problem = format!("there is no joint {number} among the {} of its skin", joints.len());
                            return refused(problem, super::EXPORT_AGAIN);
                        }
                    }
                }
            }
            match strongest(entries.into_iter()) {
                Some(weights) => self.weights.push(weights),
                None => return refused("all of its weights are 0".into(), "assign it to a joint"),
            }
        }
        Ok(())
    }

    /// Checks the scale of each joint in the pose of the file, given the poses of the nodes.
    pub fn check_scales(&self, poses: &HashMap<usize, DMat4>) -> Result<(), FormatError> {
        let mut numbers: Vec<(&usize, &u16)> = self.of_node.iter().collect();
        numbers.sort_unstable();
        for (node, &number) in numbers {
            let SkinJoint { name, inverse_bind } = &self.joints[usize::from(number)];
            let Some(pose) = poses.get(node) else { continue };
            let pose = JointPose::new(Affine3A::from_mat4(pose.as_mat4()) * *inverse_bind);
            if !pose.is_uniform() {
                let (scale, _, _) = pose.transform.to_scale_rotation_translation();
                let problem = format!("joint `{name}` scales by {scale}, different in different directions");
                return Err(FormatError::new(format!("node {node}"), problem, "apply its scale, or make it uniform"));
            }
        }
        Ok(())
    }
}
