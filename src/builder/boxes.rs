//! Medial meshes of boxes, which need no search.

use glam::{DMat3, DQuat, DVec3};

use super::solid::Solid;
use crate::{geometry::Sphere, medial_axis::MedialAxis};

/// Radius of the rounded edges, as a part of the diagonal and of the smallest half extent. A sharp edge has no core to sweep.
const ROUND: [f64; 2] = [0.004, 0.25];

/// Largest difference of a position from that in an exact box, as a part of the diagonal, of a direction, and of the volume.
const CLOSE: [f64; 3] = [3e-5, 1e-4, 3e-4];

/// Number of spheres of a box.
pub(super) const BOX_SPHERES: usize = 12;

/// Medial meshes of a solid that is a box in any direction, the finest first: with narrow edges, and with edges that are as round as possible. `None` for other
/// solids. `finest`: largest distance of a corner from the shape, as a part of the diagonal.
pub(super) fn boxes(solid: &Solid, finest: f64) -> Option<[MedialAxis; 2]> {
    let triangles = solid.tree.triangles();
    let area = |[a, b, c]: &[DVec3; 3]| (b - a).cross(c - a);
    let largest = triangles.iter().map(area).max_by(|a, b| a.length_squared().total_cmp(&b.length_squared()))?;
    let first = largest.normalize_or_zero();
    let across = triangles.iter().map(|t| area(t).normalize_or_zero()).find(|n| n.dot(first).abs() < CLOSE[1])?;
    let second = across.reject_from_normalized(first).normalize_or_zero();
    let axes = [first, second, first.cross(second)];
    let [mut min, mut max] = [DVec3::INFINITY, DVec3::NEG_INFINITY];
    for corner in triangles.iter().flatten() {
        let place = DVec3::from_array(axes.map(|axis| axis.dot(*corner)));
        (min, max) = (min.min(place), max.max(place));
    }
    let is_on_face = |triangle: &[DVec3; 3]| {
        (0..3).any(|k| {
            let on = |side: f64| triangle.iter().all(|corner| (axes[k].dot(*corner) - side).abs() < CLOSE[0]);
            on(min[k]) || on(max[k])
        })
    };
    let half = 0.5 * (max - min);
    let volume = 8.0 * half.element_product() * solid.diagonal.powi(3);
    let is_full = (f64::from(solid.mass?.volume) / volume - 1.0).abs() < CLOSE[2];
    if solid.part_count != 1 || !is_full || !triangles.iter().all(is_on_face) {
        return None;
    }
    let turn = DQuat::from_mat3(&DMat3::from_cols_array_2d(&axes.map(|axis| axis.to_array())));
    let middle = solid.origin + solid.diagonal * (turn * (0.5 * (min + max)));
    let least = half.min_element();
    let narrow = (ROUND[0].min(finest / (3f64.sqrt() - 1.0))).min(ROUND[1] * least);
    let of = |radius: f64| -> Option<MedialAxis> {
        let half = (half * solid.diagonal).as_vec3();
        let radius = ((radius * solid.diagonal) as f32).min(half.min_element());
        let straight = MedialAxis::rounded_box(half, radius).ok()?;
        let place = |s: &Sphere| Sphere::new((middle + turn * s.center.as_dvec3()).as_vec3(), s.radius);
        let spheres = straight.spheres().iter().map(place).collect();
        MedialAxis::new(spheres, straight.primitives().to_vec()).ok().map(|(axis, _)| axis)
    };
    Some([of(narrow)?, of(least)?])
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::{
        builder::{FitOptions, TriangleMesh, fit, mesh::tests::add_box},
        random::Random,
    };

    /// A box of 12 triangles, turned and moved.
    fn turned(random: &mut Random, size: DVec3) -> TriangleMesh {
        let mut mesh = TriangleMesh { positions: vec![], triangles: vec![] };
        add_box(&mut mesh, -0.5 * size, size);
        let turn = DQuat::from_axis_angle(random.in_cube().as_dvec3().normalize(), f64::from(3.0 * random.unit()));
        let shift = random.in_cube().as_dvec3() * size.length();
        mesh.positions.iter_mut().for_each(|p| *p = (turn * p.as_dvec3() + shift).as_vec3());
        mesh
    }

    fn found(mesh: &TriangleMesh) -> Option<[MedialAxis; 2]> {
        boxes(&Solid::new(mesh).unwrap(), f64::INFINITY)
    }

    #[test]
    fn boxes_of_all_proportions_are_built_without_a_search() {
        let mut random = Random(6);
        for number in 0..60 {
            let thin = 10f32.powf(-2.0 * random.unit());
            let size = match number % 3 {
                0 => Vec3::new(1.0, 0.2 + random.unit(), 0.2 + random.unit()),
                1 => Vec3::new(1.0, 1.0, thin),
                _ => Vec3::new(1.0, thin, thin),
            };
            let mesh = turned(&mut random, size.as_dvec3() * 3.0);
            let options = FitOptions { levels: true, error_limit: 50.0, ..FitOptions::default() };
            let levels = fit(&mesh, &options, &|_| std::ops::ControlFlow::Continue(())).unwrap();
            let [finest, coarse] = &levels.levels[..] else { panic!("{size}: {} levels", levels.levels.len()) };
            assert!(finest.error.max() < 0.35, "{size}: {}", finest.error);
            let [fine, few] = [finest, coarse].map(|level| level.axis.primitives().len());
            assert!(few < fine && fine <= 22, "{size}: {fine} {few}");
            let ratio = finest.axis.mass().volume / (27.0 * size.element_product());
            assert!((ratio - 1.0).abs() < 0.02, "{size}: {ratio}");
            let mass = levels.into_medial_axis().unwrap().mass().volume;
            assert!((mass / (27.0 * size.element_product()) - 1.0).abs() < 1e-3, "{size}: {mass}");
        }
    }

    #[test]
    fn other_solids_are_no_boxes() {
        let mut random = Random(7);
        let cube = turned(&mut random, DVec3::ONE);
        assert!(found(&cube).is_some());
        let mut dented = cube.clone();
        dented.positions[3] *= 0.99;
        let mut two = cube.clone();
        add_box(&mut two, DVec3::splat(5.0), DVec3::ONE);
        // Four boxes in an L: all of its faces have the directions of a box.
        let mut bent = TriangleMesh { positions: vec![], triangles: vec![] };
        add_box(&mut bent, DVec3::ZERO, DVec3::new(3.0, 1.0, 1.0));
        add_box(&mut bent, DVec3::Y, DVec3::ONE);
        for (name, mesh) in [("dented", dented), ("two", two), ("bent", bent)] {
            assert!(found(&mesh).is_none(), "{name}");
        }
        // Narrower edges for a smaller error.
        let options = FitOptions { max_error: Some(0.05), ..FitOptions::default() };
        let levels = fit(&cube, &options, &|_| std::ops::ControlFlow::Continue(())).unwrap().levels;
        assert!(levels[0].error.max() < 0.051, "{}", levels[0].error);
        let few = FitOptions { spheres: Some(8), error_limit: 20.0, ..FitOptions::default() };
        let levels = fit(&cube, &few, &|_| std::ops::ControlFlow::Continue(())).unwrap().levels;
        assert!(levels[0].axis.spheres().len() <= 8);
    }
}
