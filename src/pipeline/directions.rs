//! Directions that separate some primitives of a pair. Most other primitives of the pair are separated along them too.

use glam::{Vec3, Vec4};

use crate::geometry::Sphere;

/// The last four learned directions, one in each lane.
#[derive(Debug, Default)]
pub(super) struct Directions {
    /// Coordinates of the directions; zero in unused lanes.
    axes: [Vec4; 3],
    learned: usize,
}

impl Directions {
    /// Stores a unit vector from the first side to the second in place of the oldest one. Returns its lane.
    pub fn push_axis(&mut self, direction: Vec3) -> usize {
        let lane = self.learned % 4;
        for (axis, coordinate) in self.axes.iter_mut().zip(direction.to_array()) {
            axis[lane] = coordinate;
        }
        self.learned += 1;
        lane
    }

    /// Returns the maximum of `n . x` over the spheres, for each direction `n`.
    #[inline]
    pub fn high<'s>(&self, spheres: impl IntoIterator<Item = &'s Sphere>) -> Vec4 {
        let high = |s: &Sphere| self.dot(s.center) + Vec4::splat(s.radius);
        spheres.into_iter().map(high).fold(Vec4::NEG_INFINITY, Vec4::max)
    }

    /// Returns the minimum of `n . x` over the spheres, for each direction `n`.
    #[inline]
    pub fn low<'s>(&self, spheres: impl IntoIterator<Item = &'s Sphere>) -> Vec4 {
        let low = |s: &Sphere| self.dot(s.center) - Vec4::splat(s.radius);
        spheres.into_iter().map(low).fold(Vec4::INFINITY, Vec4::min)
    }

    #[inline]
    fn dot(&self, point: Vec3) -> Vec4 {
        let [x, y, z] = &self.axes;
        x * point.x + y * point.y + z * point.z
    }
}
