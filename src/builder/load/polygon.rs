use glam::DVec3;
use glam::Vec3;

/// Corners that are tried as the one from which a polygon is fanned.
const TRIED: usize = 16;

/// Cuts a polygon into the fan of triangles that face its way best: a convex polygon always, one with a dent if all of it can be
/// seen from one of its first corners. Indices must be in range; fewer than three corners are no triangle.
pub(super) fn triangulate(corners: &[u32], positions: &[Vec3], triangles: &mut Vec<[u32; 3]>) {
    let count = corners.len();
    let fan = |apex: usize| {
        let corner = move |k: usize| corners[(apex + k) % count];
        (1..count.saturating_sub(1)).map(move |k| [corner(0), corner(k), corner(k + 1)])
    };
    let area = |triangle: [u32; 3]| {
        let [a, b, c] = triangle.map(|i| positions[i as usize].as_dvec3());
        (b - a).cross(c - a)
    };
    let best = if count > 3 {
        let normal = fan(0).map(area).sum::<DVec3>().normalize_or_zero();
        let worst = |apex: usize| fan(apex).map(|t| area(t).dot(normal)).fold(f64::INFINITY, f64::min);
        let apexes = (0..count.min(TRIED)).map(|apex| (apex, worst(apex)));
        // The first of equals.
        apexes.reduce(|best, next| if next.1 > best.1 { next } else { best }).map_or(0, |best| best.0)
    } else {
        0
    };
    triangles.extend(fan(best));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_dent_is_not_covered() {
        // An arrow head: only the fans from the tip and from the dent stay inside.
        let positions = [[0.0, 0.0, 0.0], [2.0, -1.0, 0.0], [0.5, 0.0, 0.0], [2.0, 1.0, 0.0]].map(Vec3::from);
        for turn in 0..4 {
            let mut corners = [0, 1, 2, 3];
            corners.rotate_left(turn);
            let mut triangles = Vec::new();
            triangulate(&corners, &positions, &mut triangles);
            let areas = triangles.iter().map(|t| {
                let [a, b, c] = t.map(|i| positions[i as usize]);
                (b - a).cross(c - a).z * 0.5
            });
            // Facing the other way, this arrow head winds clockwise.
            let (sum, least) = areas.fold((0.0, f32::INFINITY), |(sum, least), a| (sum + a, least.min(a.abs())));
            assert!((sum.abs() - 0.5).abs() < 1e-6 && (least - 0.25).abs() < 1e-6, "{triangles:?}");
        }
        let mut none = Vec::new();
        triangulate(&[0, 1], &positions, &mut none);
        triangulate(&[], &positions, &mut none);
        assert!(none.is_empty());
    }
}
