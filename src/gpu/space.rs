//! The space that most bodies of a step take up. A grid in it defines their order along a space-filling curve.

use glam::Vec3;

use crate::{geometry::Aabb, random::GOLDEN_TURN};

/// Approximate number of bodies from which the box around most bodies is estimated.
const SAMPLED: usize = 512;

/// Returns a box around most of the points. A few distant points would otherwise put all others into one cell.
pub(super) fn most_of(count: usize, point: impl Fn(usize) -> Vec3) -> Aabb {
    // Regular steps could coincide with a grid on which the bodies were spawned.
    let scattered = |i: usize| (i as f64 * GOLDEN_TURN).fract() * count as f64;
    let sampled = count.min(SAMPLED);
    let sample: Vec<Vec3> =
        (0..sampled).map(|i| point(if sampled == count { i } else { scattered(i) as usize })).collect();
    let Some(last) = sampled.checked_sub(1) else { return Aabb::EMPTY };
    let [low, high] = [last / 32, last - last / 32].map(|rank| {
        Vec3::from(std::array::from_fn(|axis| {
            let mut along: Vec<f32> = sample.iter().map(|point| point[axis]).collect();
            *along.select_nth_unstable_by(rank, f32::total_cmp).1
        }))
    });
    Aabb { min: low, max: high }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_few_distant_boxes_do_not_decide_where_most_are() {
        let place = |i: u32| Vec3::new((i % 10) as f32, (i / 10 % 10) as f32, (i / 100) as f32);
        for (count, far) in [(1000, 0), (1000, 5), (10_000, 5), (3, 0), (1, 0)] {
            let point = |i: usize| if i % 997 < far { Vec3::splat(-1e6) } else { place(i as u32 % 1000) };
            let Aabb { min, max } = most_of(count, point);
            assert!(min.min_element() >= 0.0 && max.max_element() < 10.0 && (max - min).min_element() >= 0.0);
            assert!(count < 1000 || (max - min).min_element() > 6.0, "{count}, {far}: {min} to {max}");
        }
        let Aabb { min, max } = most_of(0, |_| Vec3::ZERO);
        assert!(min.cmpgt(max).all());
    }
}
