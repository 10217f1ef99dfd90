//! Directions along which some primitives of a pair are apart: most others are as well.

use glam::{Vec3, Vec4};

use crate::geometry::Sphere;

/// The four directions learned last, one in each lane.
#[derive(Debug, Default)]
pub(super) struct Directions {
    /// Their coordinates; zero where there is none yet.
    axes: [Vec4; 3],
    learned: usize,
}

impl Directions {
    /// Remembers a unit vector from a first side to a second, in the place of the one that was learned first. Returns its lane.
    pub fn learn(&mut self, direction: Vec3) -> usize {
        let lane = self.learned % 4;
        for (axis, coordinate) in self.axes.iter_mut().zip(direction.to_array()) {
            axis[lane] = coordinate;
        }
        self.learned += 1;
        lane
    }

    /// The greatest of `n . x` over some spheres, for each direction `n`.
    #[inline]
    pub fn high<'s>(&self, spheres: impl IntoIterator<Item = &'s Sphere>) -> Vec4 {
        let high = |s: &Sphere| self.dot(s.center) + Vec4::splat(s.radius);
        spheres.into_iter().map(high).fold(Vec4::NEG_INFINITY, Vec4::max)
    }

    /// The least.
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
