use super::{MedialAxis, MedialAxisError};
use crate::geometry::{Primitive, Sphere};

impl MedialAxis {
    /// Returns the primitives of each joint, in the order of the joints: those that it moves most. A shape without a skin has no joints.
    pub(crate) fn primitives_of_joints(&self) -> Vec<Vec<Primitive>> {
        let Some(skin) = self.skin() else { return vec![] };
        let mut of_joint = vec![vec![]; skin.joints().len()];
        for primitive in self.primitives() {
            of_joint[usize::from(skin.joint_within(primitive, &[1.0; 3]))].push(*primitive);
        }
        of_joint
    }

    /// Creates a shape of some primitives, whose indices refer to `spheres`, without a skin.
    ///
    /// # Errors
    /// If a sphere or an index is not valid.
    pub(crate) fn part_of(spheres: &[Sphere], primitives: &[Primitive]) -> Result<MedialAxis, MedialAxisError> {
        let mut used: Vec<u32> = primitives.iter().flat_map(Primitive::indices).copied().collect();
        used.sort_unstable();
        used.dedup();
        let number = |i: u32| used.partition_point(|&other| other < i) as u32;
        let renumbered = primitives.iter().map(|primitive| primitive.renumbered(number));
        let own = used.iter().map(|&i| spheres[i as usize]).collect();
        Ok(MedialAxis::new(own, renumbered.collect())?.0)
    }
}

#[cfg(test)]
mod tests {
    use glam::{Affine3A, Vec3};

    use super::*;
    use crate::medial_axis::{Skin, SkinJoint};

    #[test]
    fn each_primitive_belongs_to_one_part() {
        let spheres = [0.0, 2.0, 4.0, 6.0].map(|x| Sphere::new(Vec3::X * x, 0.5)).to_vec();
        let (axis, _) = MedialAxis::from_lists(spheres, &[[0, 1], [1, 2], [2, 3]], &[]).unwrap();
        assert!(axis.primitives_of_joints().is_empty(), "a rigid shape has no joints");
        let joints = [0.0, 9.0, 3.0].map(|x| SkinJoint {
            name: format!("joint at {x}"),
            inverse_bind: Affine3A::from_translation(Vec3::NEG_X * x),
        });
        // The last sphere follows the third joint, the third one half of it, and no sphere follows the second joint.
        let weights = [0.0, 0.0, 0.5, 1.0].map(|last| [(0, 1.0 - last), (2, last), (0, 0.0), (0, 0.0)]);
        let axis = axis.with_skin(Skin::new(joints, &weights).unwrap()).unwrap();
        let [first, none, last] = &axis.primitives_of_joints()[..] else { panic!("not three joints") };
        assert_eq!([first.len(), none.len(), last.len()], [2, 0, 1]);
        let [first, last] = [first, last].map(|own| MedialAxis::part_of(axis.spheres(), own).unwrap());
        assert_eq!(last.spheres(), &axis.spheres()[2..]);
        // The two parts overlap in half a ball on either side of the sphere that they share.
        let ball = 4.0 / 3.0 * std::f32::consts::PI * 0.125;
        let (sum, whole) = (first.mass().volume + last.mass().volume, axis.mass().volume);
        assert!((sum - whole - ball).abs() < 0.01 * whole, "{sum} {whole}");
    }
}
