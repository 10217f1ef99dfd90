//! Compares a shape with its mesh, so that no build returns a shape with wrong mass properties or a large error.

use glam::{DMat3, DVec3};

use super::{BuildError, Level, options::MOST_OFF, solid::Solid};
use crate::medial_axis::MassProperties;

/// Checks that a solid has a mass that the numbers of a shape can hold.
pub(super) fn check_solid(solid: &Solid) -> Result<(), BuildError> {
    let Solid { mass: Some(mass), diagonal, .. } = solid else { return Ok(()) };
    let least = [0, 1, 2].map(|i| mass.inertia.col(i)[i]).into_iter().fold(mass.volume, f32::min);
    if f64::from(mass.volume) <= LEAST_VOLUME * diagonal.powi(3) && *diagonal > f64::from(f32::MIN_POSITIVE).cbrt() {
        Err(BuildError::NoVolume)
    } else if least.is_normal() {
        Ok(())
    } else {
        Err(BuildError::TooSmall { diagonal: *diagonal as f32 })
    }
}

/// Added to the moments of inertia, as a part of their sum: inertia is stored as f32, whose rounding would count for rods thinner than 1:1000.
const ROUNDING: f64 = 16.0 * f32::EPSILON as f64;

/// Volumes below this part of the cube of the diagonal are those of folded sheets, up to rounding.
const LEAST_VOLUME: f64 = 1e-12;

/// Checks mass properties and error of a shape. `limit` is the largest error in percent of the diagonal. The mass of an open surface is not known.
pub(super) fn check(solid: &Solid, level: &Level, limit: f32) -> Result<(), BuildError> {
    let spheres = level.axis.spheres().len();
    // The absolute value of NaN, from a shape without mass, is the largest of all.
    let off = solid.mass.iter().flat_map(|mass| differences(level.axis.mass(), mass));
    let off = off.map(|(what, off)| (what, off.abs()));
    let (what, worst) = off.max_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or_default();
    if worst > MOST_OFF || worst.is_nan() {
        Err(BuildError::Mass { what, spheres, percent: worst as f32 })
    } else {
        within(level, limit)
    }
}

/// Checks the error of a shape.
pub(super) fn within(level: &Level, limit: f32) -> Result<(), BuildError> {
    let (spheres, percent) = (level.axis.spheres().len(), level.error.max());
    if percent > limit { Err(BuildError::Error { spheres, percent, limit }) } else { Ok(()) }
}

/// Differences in percent: of the volume, of the centre of mass relative to the radius of gyration, and of the moment of inertia about the axis for which it is
/// largest.
fn differences(found: &MassProperties, right: &MassProperties) -> [(&'static str, f64); 3] {
    let [found_volume, right_volume] = [found, right].map(|mass| f64::from(mass.volume));
    let shift = found.center_of_mass.as_dvec3().distance(right.center_of_mass.as_dvec3());
    let [found, right] = [found, right].map(|mass| mass.inertia.as_dmat3());
    let trace = |m: DMat3| m.x_axis.x + m.y_axis.y + m.z_axis.z;
    let rounding = DVec3::splat(ROUNDING * trace(right));
    let gyration = (0.5 * trace(right) / right_volume).sqrt();
    [
        ("volume", 100.0 * (found_volume / right_volume - 1.0).abs()),
        ("centre of mass", 100.0 * shift / gyration),
        ("inertia", 100.0 * largest_ratio(found - right, right + DMat3::from_diagonal(rounding))),
    ]
}

/// The largest ratio `|u change u| / (u base u)` over all directions `u`, rounded up by at most 7 %. `base` is positive definite.
fn largest_ratio(change: DMat3, base: DMat3) -> f64 {
    // base = lower lower^T (Cholesky). The ratio is the largest eigenvalue of lower^-1 change lower^-T.
    let a = base.x_axis.x.sqrt();
    let (b, c) = (base.x_axis.y / a, base.x_axis.z / a);
    let d = (base.y_axis.y - b * b).sqrt();
    let e = (base.y_axis.z - b * c) / d;
    let f = (base.z_axis.z - c * c - e * e).sqrt();
    let inverse = DMat3::from_cols(DVec3::new(a, b, c), DVec3::new(0.0, d, e), DVec3::new(0.0, 0.0, f)).inverse();
    let turned = inverse * change * inverse.transpose();
    // The trace of the 16th power is the sum of the 16th powers of the eigenvalues.
    let power = (0..4).fold(turned, |power, _| power * power);
    (power.x_axis.x + power.y_axis.y + power.z_axis.z).powf(1.0 / 16.0)
}

#[cfg(test)]
mod tests {
    use glam::{DQuat, Mat3, Vec3};

    use super::*;
    use crate::random::Random;

    #[test]
    fn the_largest_ratio_of_inertia_does_not_depend_on_the_frame() {
        let mut random = Random(5);
        for ratios in [[0.5, 0.0, 0.1], [-0.3, 0.2, 0.0], [0.1, 0.1, -0.1], [0.0, 0.0, 0.0]] {
            let turn = DMat3::from_quat(DQuat::from_scaled_axis(random.in_cube().as_dvec3() * 3.0));
            let moments = DVec3::new(1.0, 1e-6, 20.0);
            let [base, change] = [DVec3::ONE, DVec3::from_array(ratios)]
                .map(|factor| turn * DMat3::from_diagonal(moments * factor) * turn.transpose());
            let largest = ratios.iter().fold(0.0f64, |a, b| a.max(b.abs()));
            let found = largest_ratio(change, base);
            assert!(found >= largest * 0.999 - 1e-5 && found <= 1.08 * largest + 1e-5, "{found} {ratios:?}");
        }
    }

    #[test]
    fn each_property_is_compared() {
        let right = MassProperties {
            volume: 2.0,
            center_of_mass: Vec3::ONE,
            inertia: Mat3::from_diagonal(Vec3::new(1.0, 3.0, 4.0)),
        };
        let worst = |found: MassProperties| {
            let found = differences(&found, &right).into_iter().max_by(|a, b| a.1.total_cmp(&b.1)).unwrap();
            (found.0, found.1.round())
        };
        assert_eq!(worst(MassProperties { volume: 2.5, ..right }), ("volume", 25.0));
        // The radius of gyration is the root of two.
        let center_of_mass = Vec3::ONE + Vec3::Y * 2f32.sqrt();
        assert_eq!(worst(MassProperties { center_of_mass, ..right }), ("centre of mass", 100.0));
        let inertia = Mat3::from_diagonal(Vec3::new(0.5, 3.0, 4.0));
        assert_eq!(worst(MassProperties { inertia, ..right }), ("inertia", 50.0));
    }
}
