//! Lists of the primitives of two bodies that may come near each other, kept between steps.
//!
//! A list contains the primitive pairs within a margin, each with a lower bound of its distance. Bounds shrink by the displacement of the bodies. Pairs whose
//! bound is larger than a search's reach are skipped, and no new list is needed until the displacement has used up the margin.

/// A primitive pair of a list.
#[derive(Clone, Copy, Debug)]
pub(in crate::pipeline) struct NearPair {
    pub primitives: [u32; 2],
    /// Displacement until which the primitives are apart, in metres: see [`NearList`].
    pub apart_until: f32,
}

impl NearPair {
    /// Creates a pair that may be near at any displacement.
    pub fn always(primitives: [u32; 2]) -> Self {
        Self { primitives, apart_until: f32::NEG_INFINITY }
    }
}

/// Bounds of a list. A displacement is an upper bound of the path of any point of one body relative to the other since the list was made, in metres.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::pipeline) struct NearList {
    /// Displacement of the bodies, with an allowance for rounding.
    displacement: f32,
    /// Displacement until which primitives that are not in the list are apart.
    complete_until: f32,
    /// Displacement until which the bodies are apart.
    apart_until: f32,
    /// Allowance for rounding of a distance, in metres.
    rounding: f32,
}

impl NearList {
    /// Creates the bounds of a list of all primitive pairs within `reach` metres.
    pub fn new(reach: f32, rounding: f32) -> Self {
        Self { displacement: rounding, complete_until: reach, apart_until: 0.0, rounding }
    }

    /// Returns the bounds after a further displacement in metres.
    pub fn moved(self, displacement: f32) -> Self {
        Self { displacement: self.displacement + displacement + self.rounding, ..self }
    }

    /// Returns true if the list contains all primitive pairs that are within `reach` metres.
    pub fn covers(&self, reach: f32) -> bool {
        self.displacement + reach < self.complete_until
    }

    /// Returns true if a pair of the list may be within `reach` metres.
    pub fn is_near(&self, pair: &NearPair, reach: f32) -> bool {
        pair.apart_until <= self.displacement + reach
    }

    /// Returns a lower bound of the distance of the bodies in metres; 0 if none is known.
    pub fn gap(&self) -> f32 {
        (self.apart_until - self.displacement).max(0.0)
    }

    /// Updates the bound of a pair. `distance`: lower bound of its distance, in metres.
    pub fn separate(&self, pair: &mut NearPair, distance: f32) {
        pair.apart_until = pair.apart_until.max(self.displacement + distance);
    }

    /// Updates the bound of the bodies' distance from all pairs of the list.
    pub fn update_gap(&mut self, pairs: &[NearPair]) {
        self.apart_until = pairs.iter().fold(self.complete_until, |least, pair| least.min(pair.apart_until));
    }
}

#[cfg(test)]
mod tests {
    use glam::Quat;

    use super::*;
    use crate::{
        geometry::Pose3,
        medial_axis::MedialAxis,
        pipeline::{Shape, contacts::near, sweep::mid_phase, with_spheres},
        query::separation,
        random::Random,
    };

    /// Returns the distance of two primitives in metres.
    fn distance([shape1, shape2]: [&Shape; 2], pose12: &Pose3, [primitive1, primitive2]: [u32; 2]) -> f32 {
        let first = shape1.hull(primitive1).placed(&pose12.inverse().into());
        with_spheres!(first, |a| with_spheres!(shape2.hull(primitive2), |b| separation(&a, &b, 0).distance))
    }

    #[test]
    fn primitives_that_a_list_skips_are_apart() {
        let mut random = Random(5);
        let [shape1, shape2] = [(0.3, 0.05, 1.5), (0.4, 0.1, 0.7)]
            .map(|(major, minor, scale)| Shape { axis: MedialAxis::torus(major, minor, 10).unwrap(), scale });
        let shapes = [&shape1, &shape2];
        let (mut near, mut skipped, mut apart, mut used_up) = (0, 0, 0, 0);
        for _ in 0..300 {
            let mut pose12 = Pose3::from_parts(random.in_cube(), Quat::from_scaled_axis(random.in_cube() * 3.0));
            let mut pairs = Vec::new();
            let mut list = near::near_shape(&shape1, &shape2, &pose12, 0.1, &mut Default::default(), &mut pairs);
            assert!(list.covers(0.1));
            for _ in 0..12 {
                let reach = 0.02 * random.unit();
                for pair in mid_phase::all(shape1.len(), shape2.len()) {
                    let is_near = distance(shapes, &pose12, pair) <= reach;
                    let listed = pairs.iter().any(|listed| listed.primitives == pair && list.is_near(listed, reach));
                    assert!(listed || !is_near || !list.covers(reach), "{pair:?} is missing");
                    near += usize::from(is_near && list.covers(reach));
                    skipped += usize::from(!listed && list.covers(reach));
                    apart += usize::from(list.gap() > 0.0);
                    assert!(list.gap() <= distance(shapes, &pose12, pair).max(0.0));
                }
                used_up += usize::from(!list.covers(reach));
                for pair in &mut pairs {
                    if random.below(3) == 0 {
                        list.separate(pair, distance(shapes, &pose12, pair.primitives));
                    }
                }
                list.update_gap(&pairs);
                let [translation, rotation] = [random.in_cube() * 0.008, random.in_cube() * 0.008];
                let turn = Quat::from_scaled_axis(rotation);
                list = list.moved(translation.length() + rotation.length() * (pose12.translation.length() + 0.35));
                pose12 = Pose3::from_parts(turn * pose12.translation + translation, turn * pose12.rotation);
            }
        }
        assert!(near > 500 && skipped > 10_000 && apart > 1_000 && used_up > 100, "{near} {skipped} {apart} {used_up}");
        assert!(!NearList::default().covers(0.0));
    }
}
