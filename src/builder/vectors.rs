//! Eight vectors in memory, coordinate by coordinate.

use fearless_simd::{Simd, f32x8, prelude::*};
use glam::DVec3;

use crate::query::number::Vector;

/// How many.
pub(super) const WIDTH: usize = 8;

/// More than distances of about 1 are off in f32.
pub(super) const ROUNDING: f32 = 1e-5;

/// Eight vectors.
#[derive(Clone, Copy)]
pub(super) struct Vectors([[f32; WIDTH]; 3]);

impl Vectors {
    pub fn new(vectors: [DVec3; WIDTH]) -> Self {
        Self(std::array::from_fn(|axis| vectors.map(|v| v[axis] as f32)))
    }

    /// All eight, side by side.
    #[inline(always)]
    pub fn load<S: Simd>(&self, simd: S) -> Vector<f32x8<S>> {
        let [x, y, z] = self.0;
        Vector { x: f32x8::load_array(simd, x), y: f32x8::load_array(simd, y), z: f32x8::load_array(simd, z) }
    }
}

/// A vector eight times.
#[inline(always)]
pub(super) fn splat<S: Simd>(simd: S, vector: DVec3) -> Vector<f32x8<S>> {
    let [x, y, z] = vector.as_vec3().to_array();
    Vector { x: f32x8::splat(simd, x), y: f32x8::splat(simd, y), z: f32x8::splat(simd, z) }
}

/// The lanes whose bits are set.
#[inline(always)]
pub(super) fn lanes(mut bits: u64) -> impl Iterator<Item = usize> {
    std::iter::from_fn(
        #[inline(always)]
        move || {
            let lane = bits.trailing_zeros() as usize;
            bits &= bits.wrapping_sub(1);
            (lane < WIDTH).then_some(lane)
        },
    )
}
