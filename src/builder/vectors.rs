//! Vectors in memory as a structure of arrays.

use fearless_simd::{Simd, f32x8, f32x16, prelude::*};
use glam::DVec3;

use crate::query::number::Vector;

/// Upper bound of the rounding error of f32 distances of about 1.
pub(super) const ROUNDING: f32 = 1e-5;

/// `N` vectors.
#[derive(Clone, Copy)]
pub(super) struct Vectors<const N: usize>([[f32; N]; 3]);

impl<const N: usize> Vectors<N> {
    pub fn new(vectors: [DVec3; N]) -> Self {
        Self(std::array::from_fn(|axis| vectors.map(|v| v[axis] as f32)))
    }
}

macro_rules! load {
    ($($n:literal, $lanes:ident;)*) => {$(
        impl Vectors<$n> {
            /// Loads all vectors, one per lane.
            #[inline(always)]
            pub fn load<S: Simd>(&self, simd: S) -> Vector<$lanes<S>> {
                let [x, y, z] = self.0;
                Vector {
                    x: $lanes::load_array(simd, x),
                    y: $lanes::load_array(simd, y),
                    z: $lanes::load_array(simd, z),
                }
            }
        }
    )*};
}
load! {
    8, f32x8;
    16, f32x16;
}

/// The same vector in each lane.
#[inline(always)]
pub(super) fn splat<S: Simd, R: SimdBase<S, Element = f32>>(simd: S, vector: DVec3) -> Vector<R> {
    let [x, y, z] = vector.as_vec3().to_array();
    Vector { x: R::splat(simd, x), y: R::splat(simd, y), z: R::splat(simd, z) }
}
