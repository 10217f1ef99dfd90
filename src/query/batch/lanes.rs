//! Vectors with one number per pair, and their transfer from and to memory.

use fearless_simd::{Simd, f32x4, f32x8, f32x16, prelude::*};

use super::movers::Mover;
use crate::query::{
    branchless::each,
    moving::Moving,
    number::{Ball, Number, Vector},
};

/// A SIMD vector with one number per pair.
pub(super) trait Lanes<S: Simd>:
    Number<Mask: SimdMask<S>> + SimdBase<S, Element = f32> + SimdWiden<S, Widened: SimdBase<S, Element = f64>>
{
    /// Joins vectors of four numbers.
    fn of_fours(four: impl Fn(usize) -> f32x4<S>) -> Self;
}

impl<S: Simd> Lanes<S> for f32x8<S> {
    #[inline(always)]
    fn of_fours(four: impl Fn(usize) -> f32x4<S>) -> Self {
        four(0).combine(four(1))
    }
}

impl<S: Simd> Lanes<S> for f32x16<S> {
    #[inline(always)]
    fn of_fours(four: impl Fn(usize) -> f32x4<S>) -> Self {
        four(0).combine(four(1)).combine(four(2).combine(four(3)))
    }
}

#[inline(always)]
pub(super) fn halves<S: Simd, R: Lanes<S>, const L: usize>(simd: S, numbers: &[f64; L]) -> [R::Widened; 2] {
    let (a, b) = numbers.split_at(L / 2);
    [R::Widened::from_slice(simd, a), R::Widened::from_slice(simd, b)]
}

/// The spheres of the primitives and their displacements, one pair per lane.
#[inline(always)]
pub(super) fn columns<'p, S: Simd, R: Lanes<S>, const N: usize>(
    simd: S,
    moving: impl Fn(usize) -> &'p Moving<N>,
) -> [Mover<R>; N] {
    each(
        #[inline(always)]
        |i| {
            let [x, y, z, radius] = transposed(
                simd,
                #[inline(always)]
                |lane| bytemuck::cast(moving(lane).start[i]),
            );
            let ball = Ball { center: Vector { x, y, z }, radius };
            let [x, y, z, _] = transposed(
                simd,
                #[inline(always)]
                |lane| moving(lane).motion[i].extend(0.0).to_array(),
            );
            (ball, Vector { x, y, z })
        },
    )
}

/// The columns of a matrix with one row per lane.
#[inline(always)]
fn transposed<S: Simd, R: Lanes<S>>(simd: S, row: impl Fn(usize) -> [f32; 4]) -> [R; 4] {
    // An eight-lane vector has two groups of four: the other groups are zero and unused.
    let fours: [_; 4] = each(
        #[inline(always)]
        |four| if 4 * four < R::LEN { transposed_from(simd, &row, 4 * four) } else { [f32x4::splat(simd, 0.0); 4] },
    );
    each(
        #[inline(always)]
        |i| {
            R::of_fours(
                #[inline(always)]
                |four| fours[four][i],
            )
        },
    )
}

/// The same for the four lanes that start at `from`.
#[inline(always)]
fn transposed_from<S: Simd>(simd: S, row: &impl Fn(usize) -> [f32; 4], from: usize) -> [f32x4<S>; 4] {
    let [a, b, c, d] = each(
        #[inline(always)]
        |i| f32x4::load_array(simd, row(from + i)),
    );
    let (ac, bd) = ((a.zip_low(c), a.zip_high(c)), (b.zip_low(d), b.zip_high(d)));
    [ac.0.zip_low(bd.0), ac.0.zip_high(bd.0), ac.1.zip_low(bd.1), ac.1.zip_high(bd.1)]
}

/// Stores the differences `a - b` in f64, where they are nearly exact.
#[inline(always)]
pub(super) fn differences<S: Simd, R: Lanes<S>, const L: usize>(into: &mut [[f64; L]; 3], a: Vector<R>, b: Vector<R>) {
    for (into, (a, b)) in into.iter_mut().zip([(a.x, b.x), (a.y, b.y), (a.z, b.z)]) {
        let (a, b) = (a.widen(), b.widen());
        let (early, late) = into.split_at_mut(L / 2);
        (a.0 - b.0).store_slice(early);
        (a.1 - b.1).store_slice(late);
    }
}
