use glam::{Mat3A, Vec3, Vec3A, Vec3Swizzles};
use glamx::Pose3;

use super::Sphere;

/// Axis-aligned bounding box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aabb {
    /// Corner with the smallest coordinates.
    pub min: Vec3,
    /// Corner with the largest coordinates.
    pub max: Vec3,
}

impl Aabb {
    /// The empty box: the neutral element of [`merge`](Self::merge).
    pub const EMPTY: Aabb = Aabb { min: Vec3::INFINITY, max: Vec3::NEG_INFINITY };

    /// The box around `spheres`.
    pub fn from_spheres(spheres: impl IntoIterator<Item = Sphere>) -> Self {
        spheres
            .into_iter()
            .fold(Self::EMPTY, |aabb, s| aabb.merge(Aabb { min: s.center - s.radius, max: s.center + s.radius }))
    }

    /// The smallest box around both boxes.
    #[inline]
    #[must_use]
    pub fn merge(self, other: Aabb) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// The box with every face moved outwards by `margin` metres.
    #[must_use]
    pub fn inflated(self, margin: f32) -> Self {
        Self { min: self.min - margin, max: self.max + margin }
    }

    /// The box scaled about the origin by a positive factor.
    #[must_use]
    pub fn scaled(self, factor: f32) -> Self {
        Self { min: self.min * factor, max: self.max * factor }
    }

    /// The box in a parent frame, where this box's frame has the pose `pose` and the size `scale`. The result is axis-aligned there, so it may be larger.
    #[must_use]
    pub fn transformed(self, pose: &Pose3, scale: f32) -> Self {
        let center = pose.transform_point(self.center() * scale);
        let half = rotated_extents(&Mat3A::from_quat(pose.rotation), self.half_extents() * scale);
        Self { min: center - half, max: center + half }
    }

    /// The box around all positions of this box between two times, while it moves at `velocity`.
    #[must_use]
    pub fn swept(self, velocity: Vec3, times: [f32; 2]) -> Self {
        let [begin, end] = times.map(|time| velocity * time);
        let [low, high] = [begin.min(end), begin.max(end)];
        Self { min: self.min + low, max: self.max + high }
    }

    /// Centre of the box.
    pub fn center(&self) -> Vec3 {
        (self.min + self.max) * 0.5
    }

    /// Half of the size along each axis.
    pub fn half_extents(&self) -> Vec3 {
        (self.max - self.min) * 0.5
    }

    /// Squared length of the diagonal.
    pub fn extent_squared(&self) -> f32 {
        self.min.distance_squared(self.max)
    }

    /// Bound of the rounding error of the faces, in metres, after they are scaled or offset from spheres.
    pub(crate) fn rounding(&self) -> f32 {
        4.0 * f32::EPSILON * self.min.abs().max(self.max.abs()).max_element()
    }

    /// Surface area.
    pub fn area(&self) -> f32 {
        let size = self.max - self.min;
        2.0 * size.dot(size.yzx())
    }

    /// True if `point` is inside the box or on its faces.
    pub fn contains_point(&self, point: Vec3) -> bool {
        point.cmpge(self.min).all() && point.cmple(self.max).all()
    }

    /// True if the boxes share a point.
    pub fn overlaps(&self, other: &Aabb) -> bool {
        self.min.cmple(other.max).all() && other.min.cmple(self.max).all()
    }

    /// Distance of the boxes in metres, 0 if they share a point.
    pub fn distance_to(&self, other: &Aabb) -> f32 {
        (other.min - self.max).max(self.min - other.max).max(Vec3::ZERO).length()
    }

    /// Distance in metres from `point` to the box, 0 inside.
    pub fn distance(&self, point: Vec3) -> f32 {
        point.distance(point.clamp(self.min, self.max))
    }

    /// The times from 0 to `max_time` at which the point `origin + time * direction` enters and leaves the box. `None` if the point misses the box.
    pub fn crossing(&self, origin: Vec3, direction: Vec3, max_time: f32) -> Option<[f32; 2]> {
        let (mut enter, mut leave) = (0.0f32, max_time);
        for axis in 0..3 {
            let [low, high] = [self.min[axis] - origin[axis], self.max[axis] - origin[axis]];
            if direction[axis] != 0.0 {
                let (a, b) = (low / direction[axis], high / direction[axis]);
                enter = enter.max(a.min(b));
                leave = leave.min(a.max(b));
            } else if low > 0.0 || high < 0.0 {
                return None;
            }
        }
        (enter <= leave).then_some([enter, leave])
    }

    /// True if `other` lies inside this box.
    pub fn contains(&self, other: &Aabb) -> bool {
        self.min.cmple(other.min).all() && other.max.cmple(self.max).all()
    }
}

/// Axis-aligned half extents of a box with the half extents `half`, rotated by `rotation`.
pub(crate) fn rotated_extents(rotation: &Mat3A, half: Vec3) -> Vec3 {
    let Mat3A { x_axis, y_axis, z_axis } = rotation;
    (x_axis.abs() * half.x + y_axis.abs() * half.y + z_axis.abs() * half.z).into()
}

/// An [`Aabb`] in SIMD vectors, for fast tests.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Box3A {
    min: Vec3A,
    max: Vec3A,
}

impl From<Aabb> for Box3A {
    fn from(aabb: Aabb) -> Self {
        Self { min: aabb.min.into(), max: aabb.max.into() }
    }
}

impl Box3A {
    pub fn overlaps(&self, other: &Self) -> bool {
        (self.min.cmple(other.max) & other.min.cmple(self.max)).all()
    }

    /// Distance of the boxes in metres, 0 if they share a point.
    pub fn distance_to(&self, other: &Self) -> f32 {
        (other.min - self.max).max(self.min - other.max).max(Vec3A::ZERO).length()
    }
}
