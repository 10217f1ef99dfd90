//! Constructors of common shapes.

use std::f32::consts::TAU;

use glam::Vec3;

use super::{MedialAxis, MedialAxisError};
use crate::geometry::{Primitive, Sphere};

impl MedialAxis {
    /// A ball around the origin. Exact.
    ///
    /// # Errors
    /// If the radius, in metres, is negative or not finite.
    pub fn sphere(radius: f32) -> Result<Self, MedialAxisError> {
        Self::of(vec![Sphere::new(Vec3::ZERO, radius)], vec![])
    }

    /// A capsule between two points. Exact.
    ///
    /// # Errors
    /// If the radius is negative or a number is not finite.
    pub fn capsule(a: Vec3, b: Vec3, radius: f32) -> Result<Self, MedialAxisError> {
        Self::cone(Sphere::new(a, radius), Sphere::new(b, radius))
    }

    /// A tapered capsule: the convex hull of two spheres. Exact.
    ///
    /// # Errors
    /// If a radius is negative or a number is not finite.
    #[doc(alias = "tapered_capsule")]
    pub fn cone(a: Sphere, b: Sphere) -> Result<Self, MedialAxisError> {
        Self::of(vec![a, b], vec![Primitive::Cone([0, 1])])
    }

    /// A torus around the y axis, as a ring of capsules.
    ///
    /// `major` is the radius of the ring's centre line, `minor` that of the tube, in metres. The capsules' ends lie on
    /// the centre line. Between them the surface is too far inside by at most `major (1 - cos(pi / segments))`:
    /// 0.5 % of `major` for 32 segments.
    ///
    /// # Errors
    /// If a radius is negative or not finite, or if there are fewer than 3 segments or more than
    /// [`MAX_SPHERES`](super::MAX_SPHERES).
    pub fn torus(major: f32, minor: f32, segments: u32) -> Result<Self, MedialAxisError> {
        parameter("major", major, major >= 0.0, "a radius, zero or more")?;
        let allowed = (3..=super::MAX_SPHERES as u32).contains(&segments);
        parameter("segments", segments as f32, allowed, "from 3 to 1048576")?;
        let ring = (0..segments).map(|i| {
            let (sin, cos) = (TAU * i as f32 / segments as f32).sin_cos();
            Sphere::new(Vec3::new(major * cos, 0.0, major * sin), minor)
        });
        let cones = (0..segments).map(|i| Primitive::Cone([i, (i + 1) % segments]));
        Self::of(ring.collect(), cones.collect())
    }

    /// A box around the origin with edges and corners rounded by `radius`. All values are in metres. Exact.
    ///
    /// On each sheet of a box's medial axis the radius changes linearly, so slabs reproduce the box exactly:
    ///
    /// ```text
    ///    o---------------------o      o  corner: radius `radius`
    ///    | \                 / |
    ///    |   O-------------O   |      O  middle: radius of the smallest half extent; the middle sheet between these four
    ///    | /                 \ |         (seen along the thinnest axis), and the sheets that slope down from it
    ///    o---------------------o
    /// ```
    ///
    /// In general the shape has 12 spheres and 22 slabs. It has fewer if extents are equal. With the smallest half extent as
    /// radius it is a plate of 2 slabs.
    ///
    /// # Errors
    /// If a half extent is not positive or not finite, or if `radius` is not from 0 to the smallest half extent.
    #[doc(alias = "cuboid")]
    pub fn rounded_box(half_extents: Vec3, radius: f32) -> Result<Self, MedialAxisError> {
        for half in half_extents.to_array() {
            parameter("half_extents", half, half > 0.0, "positive")?;
        }
        let least = half_extents.min_element();
        parameter("radius", radius, (0.0..=least).contains(&radius), "from 0 to the smallest half extent")?;

        // The axis with the smallest extent. The middle sheet spans the other two axes.
        let thin = half_extents.to_array().iter().position(|&half| half == least).unwrap_or(0);
        let mut wide = Vec3::ONE;
        wide[thin] = 0.0;
        let sign = |bit: usize| if bit == 0 { -1.0 } else { 1.0 };
        // Bits 0 and 1 of a sphere's index are the signs along the wide axes, bit 2 is the sign along the thin axis.
        let signs = |number: usize| {
            let mut signs = Vec3::splat(sign(number & 4));
            signs[(thin + 1) % 3] = sign(number & 1);
            signs[(thin + 2) % 3] = sign(number & 2);
            signs
        };
        let corners = (0..8).map(|i| Sphere::new((half_extents - radius) * signs(i), radius));
        let middle = (0..4).map(|i| Sphere::new((half_extents - least) * wide * signs(i), least));

        let mut slabs = vec![[8, 9, 10], [9, 10, 11]];
        // Slabs from each side of the middle sheet to the parallel edges of the box, above and below.
        for [i, j] in [[0, 1], [1, 3], [3, 2], [2, 0]] {
            for side in [0, 4] {
                slabs.extend([[8 + i, 8 + j, side + i], [8 + j, side + i, side + j]]);
            }
        }
        // Slabs from each corner of the middle sheet to the edge across.
        slabs.extend((0..4).map(|i| [8 + i, i, 4 + i]));
        Self::of(corners.chain(middle).collect(), slabs.into_iter().map(Primitive::Slab).collect())
    }

    /// The same as [`new`](Self::new), without the report.
    fn of(spheres: Vec<Sphere>, primitives: Vec<Primitive>) -> Result<Self, MedialAxisError> {
        Self::new(spheres, primitives).map(|(axis, _)| axis)
    }
}

fn parameter(name: &'static str, value: f32, allowed: bool, range: &'static str) -> Result<(), MedialAxisError> {
    if allowed { Ok(()) } else { Err(MedialAxisError::Parameter { name, value, range }) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        medial_axis::oracle::{self, Envelope},
        random::Random,
    };

    fn counts(axis: &MedialAxis) -> (usize, usize) {
        assert!(!axis.primitives().iter().any(|p| oracle::is_degenerate(axis.spheres(), p)), "{axis:?}");
        (axis.spheres().len(), axis.primitives().len())
    }

    #[test]
    fn simple_shapes_are_as_small_as_can_be() {
        assert_eq!(counts(&MedialAxis::sphere(1.0).unwrap()), (1, 1));
        assert_eq!(counts(&MedialAxis::capsule(Vec3::ZERO, Vec3::X, 0.1).unwrap()), (2, 1));
        let swallowed = MedialAxis::cone(Sphere::new(Vec3::ZERO, 2.0), Sphere::new(Vec3::X, 1.0)).unwrap();
        assert_eq!(swallowed.primitives(), [Primitive::Sphere([0])]);
        let torus = MedialAxis::torus(1.0, 0.25, 32).unwrap();
        assert_eq!(counts(&torus), (32, 32));
        assert!((torus.aabb().half_extents() - Vec3::new(1.25, 0.25, 1.25)).abs().max_element() < 1e-6);
    }

    #[test]
    fn torus_error_is_as_stated() {
        let (major, minor, segments) = (2.0, 0.3, 24);
        let torus = MedialAxis::torus(major, minor, segments).unwrap();
        let envelope = Envelope::new(torus.spheres(), torus.primitives());
        let bound = f64::from(major) * (1.0 - (std::f64::consts::PI / f64::from(segments)).cos());
        let mut random = Random(11);
        let mut worst = 0f64;
        for _ in 0..20_000 {
            let [angle, around] = [(); 2].map(|()| f64::from(TAU * random.unit()));
            let ring = 2.0 + 0.3 * around.cos();
            let point = glam::DVec3::new(ring * angle.cos(), 0.3 * around.sin(), ring * angle.sin());
            worst = worst.max(envelope.distance(point).abs());
        }
        assert!(worst < bound * 1.001 && worst > bound * 0.9, "{worst} {bound}");
    }

    #[test]
    fn boxes_are_exact() {
        let mut random = Random(12);
        // Half extents, radius, number of spheres and number of primitives.
        let cases = [
            (Vec3::new(3.0, 2.0, 1.0), 0.0, (12, 22)),
            (Vec3::new(1.0, 3.0, 2.0), 0.25, (12, 22)),
            (Vec3::new(2.0, 1.0, 3.0), 0.9, (12, 22)),
            (Vec3::new(3.0, 2.0, 1.0), 1.0, (4, 2)),
            (Vec3::new(1.0, 1.0, 3.0), 0.25, (10, 16)),
            (Vec3::new(1.0, 3.0, 1.0), 1.0, (2, 1)),
            (Vec3::splat(1.0), 0.0, (9, 12)),
            (Vec3::splat(1.0), 1.0, (1, 1)),
        ];
        for (half, radius, expected) in cases {
            let axis = MedialAxis::rounded_box(half, radius).unwrap();
            assert_eq!(counts(&axis), expected, "{half} {radius}");
            let envelope = Envelope::new(axis.spheres(), axis.primitives());
            for _ in 0..5_000 {
                let point = half * 1.5 * random.in_cube();
                // Signed distance to the core box minus the radius.
                let out = point.abs() - (half - radius);
                let truth = out.max(Vec3::ZERO).length() + out.max_element().min(0.0) - radius;
                let found = envelope.distance(point.as_dvec3()) as f32;
                if truth > 0.0 || found > 0.0 {
                    assert!((truth - found).abs() < 1e-5, "{half} {radius}: {truth} {found} at {point}");
                }
            }
        }
    }

    #[test]
    fn wrong_parameters_are_refused() {
        let message = |result: Result<MedialAxis, MedialAxisError>| result.unwrap_err().to_string();
        assert_eq!(message(MedialAxis::sphere(-1.0)), "sphere 0: the radius -1 is negative");
        assert_eq!(message(MedialAxis::torus(1.0, 0.1, 2)), "segments is 2, but must be from 3 to 1048576");
        assert_eq!(message(MedialAxis::torus(f32::NAN, 0.1, 8)), "major is NaN, but must be a radius, zero or more");
        assert!(MedialAxis::torus(f32::INFINITY, 0.1, 8).is_err());
        assert!(MedialAxis::capsule(Vec3::NAN, Vec3::ZERO, 1.0).is_err());
        assert_eq!(
            message(MedialAxis::rounded_box(Vec3::ONE, 1.5)),
            "radius is 1.5, but must be from 0 to the smallest half extent"
        );
        assert_eq!(message(MedialAxis::rounded_box(Vec3::X, 0.0)), "half_extents is 0, but must be positive");
        assert!(MedialAxis::rounded_box(Vec3::ONE, f32::NAN).is_err());
        assert!(MedialAxis::rounded_box(Vec3::INFINITY, 0.0).is_err());
    }
}
