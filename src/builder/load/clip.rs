//! The first animation of a glTF document.

use std::collections::HashMap;

use glam::{Affine3A, Quat, Vec3, Vec4};
use gltf::{
    Animation, Node,
    animation::{Interpolation, Property},
};

use super::{
    FormatError,
    accessors::{Values, values},
    nodes::name,
};
use crate::medial_axis::SkinJoint;

/// The first animation of a glTF file: the motion of its nodes.
#[derive(Clone, Debug, PartialEq)]
pub struct Clip {
    /// Time of the last key in seconds.
    pub duration: f32,
    /// Parents come before their children.
    nodes: Vec<ClipNode>,
}

/// A node. Values without keys do not change.
#[derive(Clone, Debug, PartialEq)]
struct ClipNode {
    name: String,
    parent: Option<usize>,
    translation: Track,
    rotation: Track,
    scale: Track,
}

/// A value over time.
#[derive(Clone, Debug, PartialEq)]
struct Track {
    /// The value without keys.
    rest: Vec4,
    /// Times in seconds, in ascending order.
    times: Vec<f32>,
    /// One value per time; for a spline three: tangent before, value, tangent after.
    keys: Vec<Vec4>,
    interpolation: Interpolation,
    /// True for rotations, which turn at a constant rate along the shorter way.
    turns: bool,
}

impl Clip {
    /// Reads an animation. `nodes`: all nodes of the scene, each with the index of its parent, parents first.
    pub(super) fn read(
        animation: &Animation,
        nodes: Vec<(Node, Option<usize>)>,
        buffers: &[Vec<u8>],
    ) -> Result<Self, FormatError> {
        let (mut clip, numbers) = Self::at_rest(nodes);
        for channel in animation.channels() {
            let (target, sampler) = (channel.target(), channel.sampler());
            let place = format!("animation {}, channel {}", animation.index(), channel.index());
            let node = numbers.get(&target.node().index()).map(|number| &mut clip.nodes[*number]);
            let (Some(node), kind) = (node, kind(target.property())) else { continue };
            let Some((kind, width)) = kind else { continue };
            let times = values(&sampler.input(), buffers, &place, Values::Times)?;
            let numbers = values(&sampler.output(), buffers, &place, kind)?;
            let vector =
                |numbers: &[f32]| Vec4::from_array(std::array::from_fn(|at| numbers.get(at).copied().unwrap_or(0.0)));
            let keys: Vec<Vec4> = numbers.chunks_exact(width).map(vector).collect();
            let interpolation = sampler.interpolation();
            let per_time = if interpolation == Interpolation::CubicSpline { 3 } else { 1 };
            let is_sorted = times.is_sorted() && times.iter().all(|time| time.is_finite());
            if keys.len() != per_time * times.len() || !is_sorted || keys.iter().any(|key| !key.is_finite()) {
                let problem =
                    format!("its {} times and {} values do not fit, or are not finite", times.len(), keys.len());
                return Err(FormatError::damaged(place, problem));
            }
            clip.duration = times.last().copied().unwrap_or(0.0).max(clip.duration);
            let track = match target.property() {
                Property::Translation => &mut node.translation,
                Property::Rotation => &mut node.rotation,
                _ => &mut node.scale,
            };
            (track.times, track.keys, track.interpolation) = (times, keys, interpolation);
        }
        Ok(clip)
    }

    /// The nodes of the scene without keys, and the number of each node by its index.
    fn at_rest(nodes: Vec<(Node, Option<usize>)>) -> (Self, HashMap<usize, usize>) {
        let mut numbers = HashMap::new();
        let mut clip = Self { duration: 0.0, nodes: vec![] };
        for (node, parent) in nodes {
            let parent = parent.and_then(|parent| numbers.get(&parent).copied());
            let (translation, rotation, scale) = node.transform().decomposed();
            let still =
                |rest, turns| Track { rest, times: vec![], keys: vec![], interpolation: Interpolation::Step, turns };
            numbers.insert(node.index(), clip.nodes.len());
            clip.nodes.push(ClipNode {
                name: name(&node),
                parent,
                translation: still(Vec3::from(translation).extend(0.0), false),
                rotation: still(Vec4::from(rotation), true),
                scale: still(Vec3::from(scale).extend(0.0), false),
            });
        }
        (clip, numbers)
    }

    /// The transforms from the frames of joints to the scene, `time` seconds after the start; `None` if a joint is not a node of the file. The clip is
    /// repeated.
    pub fn places(&self, joints: &[SkinJoint], time: f32) -> Option<Vec<Affine3A>> {
        let time = if self.duration > 0.0 { time.rem_euclid(self.duration) } else { 0.0 };
        let mut places: Vec<Affine3A> = Vec::with_capacity(self.nodes.len());
        for node in &self.nodes {
            let rotation = Quat::from_vec4(node.rotation.at(time)).normalize();
            let [scale, translation] = [&node.scale, &node.translation].map(|track| track.at(time).truncate());
            let local = Affine3A::from_scale_rotation_translation(scale, rotation, translation);
            places.push(node.parent.map_or(local, |parent| places[parent] * local));
        }
        let place = |joint: &SkinJoint| Some(places[self.nodes.iter().position(|node| node.name == joint.name)?]);
        joints.iter().map(place).collect()
    }
}

impl Track {
    fn at(&self, time: f32) -> Vec4 {
        let Some(next) = self.times.iter().position(|key| *key > time) else { return self.key(self.times.len()) };
        if next == 0 {
            return self.key(1);
        }
        let (start, length) = (self.times[next - 1], self.times[next] - self.times[next - 1]);
        let part = (time - start) / length;
        let [before, after] = [self.key(next), self.key(next + 1)];
        match self.interpolation {
            Interpolation::Step => before,
            Interpolation::Linear if self.turns => {
                let [before, after] = [before, after].map(|key| Quat::from_vec4(key).normalize());
                before.slerp(after, part).into()
            }
            Interpolation::Linear => before.lerp(after, part),
            Interpolation::CubicSpline => {
                let [out, into] = [self.keys[3 * next - 1], self.keys[3 * next]].map(|tangent| tangent * length);
                let [square, cube] = [part * part, part * part * part];
                before * (2.0 * cube - 3.0 * square + 1.0)
                    + out * (cube - 2.0 * square + part)
                    + after * (3.0 * square - 2.0 * cube)
                    + into * (cube - square)
            }
        }
    }

    /// The value of a key, counted from 1; 0 is the value without keys.
    fn key(&self, number: usize) -> Vec4 {
        match (number.checked_sub(1), self.interpolation) {
            (None, _) => self.rest,
            (Some(at), Interpolation::CubicSpline) => self.keys[3 * at + 1],
            (Some(at), _) => self.keys[at],
        }
    }
}

/// The kind of the values of a property, and the number of coordinates. Morph targets are not read.
fn kind(property: Property) -> Option<(Values, usize)> {
    match property {
        Property::Translation | Property::Scale => Some((Values::Vectors, 3)),
        Property::Rotation => Some((Values::Rotations, 4)),
        Property::MorphTargetWeights => None,
    }
}
