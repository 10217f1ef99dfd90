use glam::Vec3;

use super::{MedialAxis, MedialAxisError, SkinJoint};
use crate::geometry::Primitive;

/// The part of a shape that follows one joint, as a rigid shape.
#[derive(Clone, Debug)]
pub struct SkinPart {
    /// Index of the joint.
    pub joint: u16,
    /// The primitives that follow the joint, in the frame of the whole shape and in the bind pose. Its mass properties are those of the part.
    pub axis: MedialAxis,
    /// Position of the joint in the bind pose, in the frame of the shape: the anchor of the part.
    pub anchor: Vec3,
}

impl MedialAxis {
    /// Splits a shape into a part for each joint, in the order of the joints, for ragdolls. A primitive belongs to the joint with the largest sum of weights at
    /// its spheres; joints without a primitive have no part. Neighbouring parts overlap at the spheres that they share. A shape without a skin has no parts.
    ///
    /// # Errors
    /// None for the shapes of this crate: a part of a valid shape is valid.
    pub fn parts(&self) -> Result<Vec<SkinPart>, MedialAxisError> {
        let Some(skin) = self.skin() else { return Ok(vec![]) };
        let mut of_joint: Vec<Vec<Primitive>> = vec![vec![]; skin.joints().len()];
        for primitive in self.primitives() {
            of_joint[usize::from(skin.joint_within(primitive, &[1.0; 3]))].push(*primitive);
        }
        let numbered = (0..).zip(of_joint).zip(skin.joints().iter());
        let part = |((joint, primitives), of): ((u16, Vec<Primitive>), &SkinJoint)| {
            Ok(SkinPart { joint, axis: self.only(&primitives)?, anchor: of.inverse_bind.inverse().translation.into() })
        };
        numbered.filter(|((_, primitives), _)| !primitives.is_empty()).map(part).collect()
    }

    /// The shape of some of the primitives, without a skin.
    fn only(&self, primitives: &[Primitive]) -> Result<MedialAxis, MedialAxisError> {
        let mut used: Vec<u32> = primitives.iter().flat_map(Primitive::indices).copied().collect();
        used.sort_unstable();
        used.dedup();
        let number = |i: u32| used.partition_point(|&other| other < i) as u32;
        let renumbered = primitives.iter().map(|primitive| match *primitive {
            Primitive::Sphere(indices) => Primitive::Sphere(indices.map(number)),
            Primitive::Cone(indices) => Primitive::Cone(indices.map(number)),
            Primitive::Slab(indices) => Primitive::Slab(indices.map(number)),
        });
        let spheres = used.iter().map(|&i| self.spheres()[i as usize]).collect();
        Ok(MedialAxis::new(spheres, renumbered.collect())?.0)
    }
}

#[cfg(test)]
mod tests {
    use glam::Affine3A;

    use super::*;
    use crate::{geometry::Sphere, medial_axis::Skin};

    #[test]
    fn each_primitive_belongs_to_one_part() {
        let spheres = [0.0, 2.0, 4.0, 6.0].map(|x| Sphere::new(Vec3::X * x, 0.5)).to_vec();
        let (axis, _) = MedialAxis::from_lists(spheres, &[[0, 1], [1, 2], [2, 3]], &[]).unwrap();
        assert!(axis.parts().unwrap().is_empty(), "a rigid shape has no joints");
        let joints = [0.0, 9.0, 3.0].map(|x| SkinJoint {
            name: format!("joint at {x}"),
            inverse_bind: Affine3A::from_translation(Vec3::NEG_X * x),
        });
        // The last sphere follows the third joint, the third one half of it, and no sphere follows the second joint.
        let weights = [0.0, 0.0, 0.5, 1.0].map(|last| [(0, 1.0 - last), (2, last), (0, 0.0), (0, 0.0)]);
        let axis = axis.with_skin(Skin::new(joints, &weights).unwrap()).unwrap();
        let [first, last] = &axis.parts().unwrap()[..] else { panic!("not two parts") };
        assert_eq!((first.joint, first.anchor, first.axis.primitives().len()), (0, Vec3::ZERO, 2));
        assert_eq!((last.joint, last.anchor, last.axis.spheres()), (2, Vec3::X * 3.0, &axis.spheres()[2..]));
        // The two parts overlap in half a ball on either side of the sphere that they share.
        let ball = 4.0 / 3.0 * std::f32::consts::PI * 0.125;
        let (sum, whole) = (first.axis.mass().volume + last.axis.mass().volume, axis.mass().volume);
        assert!((sum - whole - ball).abs() < 0.01 * whole, "{sum} {whole}");
    }
}
