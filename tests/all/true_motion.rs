//! Reference distances along the true rigid motion, in f64: no chords, no culling, no closed forms.

use bevy_medial::{
    geometry::{Obb, Pose3, Sweep},
    pipeline::{Hull, Shape},
};
use glam::{DQuat, DVec3};

use crate::reference::{Ball, Difference};

/// The spheres of a convex body, or the corners of a box, in its frame.
pub type Corners = Vec<(DVec3, f64)>;

/// Spheres of a shape's primitive.
pub fn corners_of(shape: &Shape, primitive: u32) -> Corners {
    let spheres = match shape.hull(primitive) {
        Hull::Sphere(s) => s.to_vec(),
        Hull::Cone(s) => s.to_vec(),
        Hull::Slab(s) => s.to_vec(),
    };
    spheres.into_iter().map(|s| (s.center.as_dvec3(), f64::from(s.radius))).collect()
}

/// Corners of a box.
pub fn corners_of_box(obb: &Obb) -> Corners {
    let half = obb.half_extents.as_dvec3();
    let sign = |i: usize, bit: usize| if i & bit == 0 { -1.0 } else { 1.0 };
    (0..8).map(|i| (half * DVec3::new(sign(i, 1), sign(i, 2), sign(i, 4)), 0.0)).collect()
}

/// The exact motion of a sweep: the centre of mass moves on a line, and the body turns about it at a constant rate.
#[derive(Clone, Copy)]
pub struct Motion {
    center: DVec3,
    rotation: DQuat,
    local_center: DVec3,
    pub translation: DVec3,
    pub spin: DVec3,
}

impl Motion {
    /// The motion in a frame with the world's axes and the given origin.
    pub fn new(sweep: &Sweep, origin: DVec3) -> Self {
        let rotation = sweep.start.rotation.as_dquat().normalize();
        let local_center = sweep.local_center.as_dvec3();
        Self {
            center: sweep.start.translation.as_dvec3() - origin + rotation * local_center,
            rotation,
            local_center,
            translation: sweep.translation.as_dvec3(),
            spin: sweep.rotation.as_dvec3(),
        }
    }

    fn place(&self, corners: &Corners, fraction: f64) -> Vec<Ball> {
        let rotation = DQuat::from_scaled_axis(self.spin * fraction) * self.rotation;
        let center = self.center + self.translation * fraction;
        let place = |&(corner, radius): &(DVec3, f64)| Ball {
            center: center + rotation * (corner - self.local_center),
            radius,
            motion: DVec3::ZERO,
        };
        corners.iter().map(place).collect()
    }

    /// Position of a point of the body.
    pub fn point(&self, point: DVec3, fraction: f64) -> DVec3 {
        let rotation = DQuat::from_scaled_axis(self.spin * fraction) * self.rotation;
        self.center + self.translation * fraction + rotation * (point - self.local_center)
    }

    /// Position and rotation of the body.
    pub fn pose(&self, fraction: f64) -> Pose3 {
        let rotation = DQuat::from_scaled_axis(self.spin * fraction) * self.rotation;
        Pose3::from_parts(self.point(DVec3::ZERO, fraction).as_vec3(), rotation.as_quat())
    }

    /// Length of the longest arc of a corner's centre about the centre of mass.
    fn swing(&self, corners: &Corners) -> f64 {
        let arm = corners.iter().map(|(corner, _)| corner.distance(self.local_center)).fold(0.0, f64::max);
        self.spin.length() * arm
    }

    /// Upper bound of the path length of a corner's centre.
    pub fn reach(&self, corners: &Corners) -> f64 {
        self.translation.length() + self.swing(corners)
    }
}

/// A moving pair of convex bodies.
pub struct MovingPair {
    pub sides: [(Corners, Motion); 2],
}

impl MovingPair {
    /// Lower bound of the signed distance at a fraction, exact to 1e-9.
    pub fn distance(&self, fraction: f64) -> f64 {
        let [first, second] = [0, 1].map(|i| self.sides[i].1.place(&self.sides[i].0, fraction));
        Difference::new(&first, &second).distance().lower
    }

    /// Upper bound of the distance's change over the step.
    fn reach(&self) -> f64 {
        let [(corners1, motion1), (corners2, motion2)] = &self.sides;
        (motion1.translation - motion2.translation).length() + motion1.swing(corners1) + motion2.swing(corners2)
    }

    /// First fraction at which the distance is down to `level`. The search can only miss distances less than `accuracy` below `level`.
    pub fn first_below(&self, level: f64, accuracy: f64) -> Option<f64> {
        let reach = self.reach();
        let mut fraction = 0.0;
        loop {
            let above = self.distance(fraction) - level;
            if above <= 0.0 {
                return Some(fraction);
            }
            if fraction >= 1.0 {
                return None;
            }
            fraction = (fraction + above.max(accuracy) / reach).min(1.0);
        }
    }
}

/// All convex parts of a body, or one box, each with a bounding sphere.
pub struct Solid {
    pub parts: Vec<(Corners, DVec3, f64)>,
    pub motion: Motion,
}

impl Solid {
    pub fn new(parts: impl Iterator<Item = Corners>, motion: Motion) -> Self {
        let bound = |corners: Corners| {
            let middle = corners.iter().map(|(center, _)| *center).sum::<DVec3>() / corners.len() as f64;
            let radius = corners.iter().map(|(center, r)| center.distance(middle) + r).fold(0.0, f64::max);
            (corners, middle, radius)
        };
        Self { parts: parts.map(bound).collect(), motion }
    }

    pub fn of_shape(shape: &Shape, motion: Motion) -> Self {
        Self::new((0..shape.len() as u32).map(|i| corners_of(shape, i)), motion)
    }

    /// Upper bound of the path length of a sphere's centre.
    pub fn reach(&self) -> f64 {
        self.parts.iter().map(|(corners, _, _)| self.motion.reach(corners)).fold(0.0, f64::max)
    }
}

/// Smallest distance of two solids at a fraction, or `limit` if that is smaller.
pub fn distance(first: &Solid, second: &Solid, fraction: f64, limit: f64) -> f64 {
    let placed = |solid: &Solid| {
        let place = |(_, middle, radius): &(Corners, DVec3, f64)| (solid.motion.point(*middle, fraction), *radius);
        solid.parts.iter().map(place).collect::<Vec<_>>()
    };
    let (bounds1, bounds2) = (placed(first), placed(second));
    let mut order = Vec::new();
    for (i, (center1, radius1)) in bounds1.iter().enumerate() {
        for (j, (center2, radius2)) in bounds2.iter().enumerate() {
            let bound = center1.distance(*center2) - radius1 - radius2;
            if bound < limit {
                order.push((bound, i, j));
            }
        }
    }
    order.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut least = limit;
    for (bound, i, j) in order {
        if bound >= least {
            break;
        }
        let sides = [(first.parts[i].0.clone(), first.motion), (second.parts[j].0.clone(), second.motion)];
        least = least.min(MovingPair { sides }.distance(fraction));
    }
    least
}
