//! Four vectors at a time, coordinate by coordinate.

use std::ops::Sub;

use glam::{DVec3, Vec4};

/// How many.
pub(super) const WIDTH: usize = 4;

/// Four vectors.
#[derive(Clone, Copy, Default)]
pub(super) struct Vectors {
    x: Vec4,
    y: Vec4,
    z: Vec4,
}

impl Vectors {
    pub fn new(vectors: [DVec3; WIDTH]) -> Self {
        let lanes = |axis: usize| Vec4::from_array(vectors.map(|v| v[axis] as f32));
        Self { x: lanes(0), y: lanes(1), z: lanes(2) }
    }

    #[inline]
    pub fn splat(vector: DVec3) -> Self {
        let [x, y, z] = vector.as_vec3().to_array().map(Vec4::splat);
        Self { x, y, z }
    }

    #[inline]
    pub fn dot(self, other: Self) -> Vec4 {
        self.x * other.x + self.y * other.y + self.z * other.z
    }

    #[inline]
    pub fn cross(self, other: Self) -> Self {
        Self {
            x: self.y * other.z - self.z * other.y,
            y: self.z * other.x - self.x * other.z,
            z: self.x * other.y - self.y * other.x,
        }
    }

    #[inline]
    pub fn times(self, factor: Vec4) -> Self {
        Self { x: self.x * factor, y: self.y * factor, z: self.z * factor }
    }

    #[inline]
    pub fn max(self, other: Self) -> Self {
        Self { x: self.x.max(other.x), y: self.y.max(other.y), z: self.z.max(other.z) }
    }

    #[inline]
    pub fn length_squared(self) -> Vec4 {
        self.dot(self)
    }

    #[inline]
    pub fn length(self) -> Vec4 {
        self.length_squared().sqrt()
    }
}

impl Sub for Vectors {
    type Output = Self;

    #[inline]
    fn sub(self, other: Self) -> Self {
        Self { x: self.x - other.x, y: self.y - other.y, z: self.z - other.z }
    }
}
