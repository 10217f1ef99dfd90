//! Primitives with linearly moving spheres, and shapes at rest in their own frame, as sides of a time of impact query.

use glam::{DVec3, Vec3};

use super::{
    separation::{Convex, Cuboid},
    support::Support,
};
use crate::geometry::Sphere;

/// A primitive whose spheres move linearly over the step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moving<const N: usize> {
    /// The spheres at fraction 0.
    pub start: [Sphere; N],
    /// Displacement of their centres over the step, in metres.
    pub motion: [Vec3; N],
}

/// The second side of a time of impact query.
pub trait MovingConvex {
    /// The shape at an instant.
    type Shape: Convex;

    /// The best origin for the pair's coordinates at `fraction`. `first` is a point of the first side.
    fn origin(&self, fraction: f64, first: DVec3) -> DVec3;

    /// The shape at `fraction`, relative to `origin`.
    fn at(&self, fraction: f64, origin: DVec3) -> Self::Shape;

    /// Calls `visit` with support and speed, `(c . n - r, c' . n)`, of each part of the shape that can be lowest along `n` at an instant.
    /// Speeds are relative to `frame`, in metres per step.
    fn supports(&self, now: &Self::Shape, n: Vec3, frame: Vec3, visit: impl FnMut(f32, f32));

    /// Calls `visit` with a lower bound of the support of each part that can be lowest, while direction and shape are interpolated from the first
    /// to the second.
    fn lows(shapes: [&Self::Shape; 2], normals: [Vec3; 2], visit: impl FnMut(Quadratic));

    /// Extent of the shape at the start of the step.
    fn extent_at_start(&self) -> f32;

    /// Largest displacement over the step relative to `motion`, in metres.
    fn fastest(&self, motion: Vec3) -> f32;
}

/// A quadratic function of a parameter from 0 to 1.
#[derive(Clone, Copy, Debug)]
pub struct Quadratic([f32; 3]);

impl Quadratic {
    /// The dot product of a point and a direction, both interpolated from their first to their second value.
    pub(super) fn dot([p, q]: [Vec3; 2], [m, n]: [Vec3; 2]) -> Self {
        let (dp, dn) = (q - p, n - m);
        Self([p.dot(m), p.dot(dn) + dp.dot(m), dp.dot(dn)])
    }

    pub(super) fn plus(self, constant: f32) -> Self {
        Self([self.0[0] + constant, self.0[1], self.0[2]])
    }

    pub(super) fn minus(&self, other: &Self) -> Self {
        Self(std::array::from_fn(|i| self.0[i] - other.0[i]))
    }

    /// True if the function is positive on all of `[0, 1]`.
    pub(super) fn is_positive(&self) -> bool {
        let Self([c, b, a]) = *self;
        let lowest = if a > 0.0 { (-b / (2.0 * a)).clamp(0.0, 1.0) } else { 0.0 };
        c > 0.0 && a + b + c > 0.0 && (a * lowest + b) * lowest + c > 0.0
    }
}

impl<const N: usize> Moving<N> {
    /// Centre of sphere `i` at `fraction`.
    pub(super) fn center(&self, i: usize, fraction: f64) -> DVec3 {
        self.start[i].center.as_dvec3() + self.motion[i].as_dvec3() * fraction
    }
}

impl<const M: usize> MovingConvex for Moving<M> {
    type Shape = [Sphere; M];

    #[inline]
    fn origin(&self, _: f64, first: DVec3) -> DVec3 {
        first
    }

    #[inline]
    fn at(&self, fraction: f64, origin: DVec3) -> [Sphere; M] {
        std::array::from_fn(|i| Sphere::new((self.center(i, fraction) - origin).as_vec3(), self.start[i].radius))
    }

    #[inline]
    fn supports(&self, now: &[Sphere; M], n: Vec3, frame: Vec3, mut visit: impl FnMut(f32, f32)) {
        for (sphere, motion) in now.iter().zip(&self.motion) {
            visit(sphere.center.dot(n) - sphere.radius, (*motion - frame).dot(n));
        }
    }

    fn lows([a, b]: [&Self::Shape; 2], normals: [Vec3; 2], mut visit: impl FnMut(Quadratic)) {
        for (a, b) in a.iter().zip(b) {
            visit(Quadratic::dot([a.center, b.center], normals).plus(-a.radius));
        }
    }

    #[inline]
    fn extent_at_start(&self) -> f32 {
        self.start.extent()
    }

    #[inline]
    fn fastest(&self, motion: Vec3) -> f32 {
        self.motion.iter().map(|m| m.distance_squared(motion)).fold(0.0, f32::max).sqrt()
    }
}

/// Implements [`MovingConvex`] for shapes at rest in their own frame.
macro_rules! at_rest {
    ($shape:ty) => {
        impl MovingConvex for $shape {
            type Shape = Self;

            #[inline]
            fn origin(&self, _: f64, _: DVec3) -> DVec3 {
                DVec3::ZERO
            }

            #[inline]
            fn at(&self, _: f64, _: DVec3) -> Self {
                *self
            }

            #[inline]
            fn supports(&self, _: &Self, n: Vec3, frame: Vec3, mut visit: impl FnMut(f32, f32)) {
                visit(self.low(n), -frame.dot(n));
            }

            /// The minimum of linear functions of the direction is concave, so the chord is a lower bound.
            fn lows([shape, _]: [&Self; 2], normals: [Vec3; 2], mut visit: impl FnMut(Quadratic)) {
                let [first, last] = normals.map(|n| shape.low(n));
                visit(Quadratic([first, last - first, 0.0]));
            }

            #[inline]
            fn extent_at_start(&self) -> f32 {
                self.extent()
            }

            #[inline]
            fn fastest(&self, motion: Vec3) -> f32 {
                motion.length()
            }
        }
    };
}
at_rest!(Cuboid);
at_rest!(Support<'_>);
