//! Numbers for formulas: one f32, or several f32 in independent SIMD lanes.

use std::ops::{Add, BitAnd, Div, Mul, Neg, Sub};

use fearless_simd::{Select, Simd, f32x8, f32x16, mask32x8, mask32x16, prelude::*};
use glam::Vec3;

use crate::geometry::Sphere;

/// A number, or several in lanes. Every operation rounds as f32 does, so the results of a lane depend neither on the machine nor on
/// the other lanes, down to the last bit.
pub(crate) trait Number:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> + Neg<Output = Self>
{
    /// Result of a comparison.
    type Mask: Copy + BitAnd<Output = Self::Mask>;

    /// A constant with the same number of lanes.
    fn like(self, value: f32) -> Self;

    fn sqrt(self) -> Self;

    fn abs(self) -> Self;

    fn less(self, other: Self) -> Self::Mask;

    fn at_most(self, other: Self) -> Self::Mask;

    fn select(mask: Self::Mask, this: Self, other: Self) -> Self;

    /// The smaller one. For NaN the result differs between machines, so the caller has to mask it out.
    #[inline(always)]
    fn lesser(self, other: Self) -> Self {
        Self::select(other.less(self), other, self)
    }

    /// The larger one. For NaN, see [`lesser`](Self::lesser).
    #[inline(always)]
    fn greater(self, other: Self) -> Self {
        Self::select(self.less(other), other, self)
    }

    /// Clamps to the range from 0 to 1.
    #[inline(always)]
    fn saturate(self) -> Self {
        self.like(0.0).greater(self).lesser(self.like(1.0))
    }
}

impl Number for f32 {
    type Mask = bool;

    #[inline(always)]
    fn like(self, value: f32) -> Self {
        value
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        self.sqrt()
    }

    #[inline(always)]
    fn abs(self) -> Self {
        self.abs()
    }

    #[inline(always)]
    fn less(self, other: Self) -> bool {
        self < other
    }

    #[inline(always)]
    fn at_most(self, other: Self) -> bool {
        self <= other
    }

    #[inline(always)]
    fn select(mask: bool, this: Self, other: Self) -> Self {
        if mask { this } else { other }
    }
}

/// Implements [`Number`] for vectors of f32.
macro_rules! vectors {
    ($($vector:ident, $mask:ident;)*) => {$(
        impl<S: Simd> Number for $vector<S> {
            type Mask = $mask<S>;

            #[inline(always)]
            fn like(self, value: f32) -> Self {
                Self::splat(self.token(), value)
            }

            #[inline(always)]
            fn sqrt(self) -> Self {
                SimdFloat::sqrt(self)
            }

            #[inline(always)]
            fn abs(self) -> Self {
                SimdBase::abs(self)
            }

            #[inline(always)]
            fn less(self, other: Self) -> $mask<S> {
                self.simd_lt(other)
            }

            #[inline(always)]
            fn at_most(self, other: Self) -> $mask<S> {
                self.simd_le(other)
            }

            #[inline(always)]
            fn select(mask: $mask<S>, this: Self, other: Self) -> Self {
                mask.select(this, other)
            }

            #[inline(always)]
            fn lesser(self, other: Self) -> Self {
                other.min(self)
            }

            #[inline(always)]
            fn greater(self, other: Self) -> Self {
                other.max(self)
            }
        }
    )*};
}
vectors! {
    f32x8, mask32x8;
    f32x16, mask32x16;
}

/// A vector of three numbers.
#[derive(Clone, Copy)]
pub(crate) struct Vector<R> {
    pub x: R,
    pub y: R,
    pub z: R,
}

impl<R: Number> Vector<R> {
    #[inline(always)]
    pub fn dot(self, other: Self) -> R {
        self.x * other.x + self.y * other.y + self.z * other.z
    }

    #[inline(always)]
    pub fn cross(self, other: Self) -> Self {
        Self {
            x: self.y * other.z - self.z * other.y,
            y: self.z * other.x - self.x * other.z,
            z: self.x * other.y - self.y * other.x,
        }
    }

    #[inline(always)]
    pub fn length_squared(self) -> R {
        self.dot(self)
    }

    #[inline(always)]
    pub fn length(self) -> R {
        self.length_squared().sqrt()
    }

    #[inline(always)]
    pub fn select(mask: R::Mask, this: Self, other: Self) -> Self {
        Self {
            x: R::select(mask, this.x, other.x),
            y: R::select(mask, this.y, other.y),
            z: R::select(mask, this.z, other.z),
        }
    }
}

impl<R: Number> Add for Vector<R> {
    type Output = Self;

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self { x: self.x + other.x, y: self.y + other.y, z: self.z + other.z }
    }
}

impl<R: Number> Sub for Vector<R> {
    type Output = Self;

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self { x: self.x - other.x, y: self.y - other.y, z: self.z - other.z }
    }
}

impl<R: Number> Neg for Vector<R> {
    type Output = Self;

    #[inline(always)]
    fn neg(self) -> Self {
        Self { x: -self.x, y: -self.y, z: -self.z }
    }
}

impl<R: Number> Mul<R> for Vector<R> {
    type Output = Self;

    #[inline(always)]
    fn mul(self, factor: R) -> Self {
        Self { x: self.x * factor, y: self.y * factor, z: self.z * factor }
    }
}

/// A sphere.
#[derive(Clone, Copy)]
pub(super) struct Ball<R> {
    pub center: Vector<R>,
    pub radius: R,
}

impl<R: Number> Ball<R> {
    #[inline(always)]
    pub fn select(mask: R::Mask, this: Self, other: Self) -> Self {
        Self {
            center: Vector::select(mask, this.center, other.center),
            radius: R::select(mask, this.radius, other.radius),
        }
    }
}

impl From<Vec3> for Vector<f32> {
    #[inline(always)]
    fn from(v: Vec3) -> Self {
        Self { x: v.x, y: v.y, z: v.z }
    }
}

impl From<Sphere> for Ball<f32> {
    #[inline(always)]
    fn from(sphere: Sphere) -> Self {
        Self { center: sphere.center.into(), radius: sphere.radius }
    }
}

impl From<Ball<f32>> for Sphere {
    #[inline(always)]
    fn from(Ball { center: Vector { x, y, z }, radius }: Ball<f32>) -> Self {
        Self::new(Vec3::new(x, y, z), radius)
    }
}
