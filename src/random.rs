//! Seeded random numbers.
//!
//! The demo scenes and the builder use this generator, as do the tests and benchmarks of the repository. It is not part of the stable API.

use std::f64::consts::TAU;

use glam::{DQuat, DVec3, Quat, Vec3};

/// The golden section. Steps of this fraction of a turn, or of a list, are evenly distributed for any number of steps.
pub const GOLDEN_TURN: f64 = 0.381_966_011_250_105_1;

/// SplitMix64: a small generator whose numbers depend on the seed alone, on every machine.
#[derive(Clone, Debug)]
pub struct Random(pub u64);

impl Random {
    /// 64 random bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// An index from 0 to below `count`.
    pub fn below(&mut self, count: usize) -> usize {
        (self.bits() % count as u64) as usize
    }

    /// A number from 0 to below 1.
    pub fn unit(&mut self) -> f32 {
        (self.bits() >> 40) as f32 / (1u64 << 24) as f32
    }

    /// A number from -1 to below 1.
    pub fn signed(&mut self) -> f32 {
        2.0 * self.unit() - 1.0
    }

    /// A number from 0 to below 1, with all bits of an f64.
    pub fn unit_f64(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// A number from `low` to below `high`.
    pub fn range(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit_f64()
    }

    /// Ten to a power from `low` to below `high`.
    pub fn magnitude(&mut self, low: f64, high: f64) -> f64 {
        10f64.powf(self.range(low, high))
    }

    /// True with a probability from 0 to 1.
    pub fn chance(&mut self, probability: f64) -> bool {
        self.range(0.0, 1.0) < probability
    }

    /// A point of the cube from -1 to 1.
    pub fn in_cube(&mut self) -> Vec3 {
        Vec3::new(self.signed(), self.signed(), self.signed())
    }

    /// A point of the unit ball.
    pub fn in_ball(&mut self) -> Vec3 {
        loop {
            let point = self.in_cube();
            if point.length_squared() <= 1.0 {
                return point;
            }
        }
    }

    /// A unit vector.
    pub fn direction(&mut self) -> DVec3 {
        loop {
            let point = DVec3::new(self.range(-1.0, 1.0), self.range(-1.0, 1.0), self.range(-1.0, 1.0));
            let length = point.length();
            if length > 1e-2 && length <= 1.0 {
                return point / length;
            }
        }
    }

    /// A rotation about a random direction by up to a full turn.
    pub fn direction_rotation(&mut self) -> DQuat {
        DQuat::from_axis_angle(self.direction(), self.range(0.0, TAU))
    }

    /// A rotation by up to half a turn.
    pub fn rotation(&mut self) -> Quat {
        Quat::from_scaled_axis(self.in_ball().normalize_or(Vec3::X) * self.unit() * std::f32::consts::PI)
    }
}
