use glam::{DVec3, Vec3};

/// Relative to the polygon's area, an inverted area up to this counts as rounding error. Corners are rounded, so they are rarely exactly planar or collinear.
const ROUNDING: f64 = 1e-6;

/// Number of corners that are tried as the apex of a fan.
const TRIED: usize = 16;

/// Largest number of corners of a polygon for ear clipping, which takes quadratic time.
const CLIPPED: usize = 4096;

/// Splits a polygon into triangles: into the fan from one of its first corners whose triangles face the polygon's normal best. If every such fan has an
/// inverted triangle, ears are clipped instead. Indices must be in range; fewer than three corners give no triangle.
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
    if count <= 3 {
        triangles.extend(fan(0));
        return;
    }
    let whole = fan(0).map(area).sum::<DVec3>();
    let normal = whole.normalize_or_zero();
    let facing = |triangle: [u32; 3]| area(triangle).dot(normal);
    let worst = |apex: usize| fan(apex).map(facing).fold(f64::INFINITY, f64::min);
    let apexes = (0..count.min(TRIED)).map(|apex| (apex, worst(apex)));
    // The first of equal candidates.
    let (best, worst) = apexes.reduce(|best, next| if next.1 > best.1 { next } else { best }).unwrap_or_default();
    if worst < -ROUNDING * whole.length() && count <= CLIPPED {
        clip_ears(corners, facing, triangles);
    } else {
        triangles.extend(fan(best));
    }
}

/// Cuts off corners whose triangle contains no other corner, one by one, as long as there are any. The rest is split into a fan.
fn clip_ears(corners: &[u32], facing: impl Fn([u32; 3]) -> f64, triangles: &mut Vec<[u32; 3]>) {
    let mut left = corners.to_vec();
    let mut at = 0;
    let mut tried = 0;
    while left.len() > 3 && tried < left.len() {
        let count = left.len();
        let ear @ [a, b, c] = [0, 1, 2].map(|k| left[(at + k) % count]);
        let is_within = |&point: &u32| {
            !ear.contains(&point) && [[a, b, point], [b, c, point], [c, a, point]].into_iter().all(|t| facing(t) >= 0.0)
        };
        if facing(ear) > 0.0 && !left.iter().any(is_within) {
            triangles.push(ear);
            left.remove((at + 1) % count);
            tried = 0;
            // The corner before may have become an ear.
            at = (at.min(left.len() - 1) + left.len() - 1) % left.len();
        } else {
            tried += 1;
            at = (at + 1) % count;
        }
    }
    triangles.extend(left[1..].windows(2).map(|pair| [left[0], pair[0], pair[1]]));
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Areas of triangles seen from above, negative for clockwise winding.
    fn areas(triangles: &[[u32; 3]], positions: &[Vec3]) -> impl Iterator<Item = f32> {
        triangles.iter().map(|t| {
            let [a, b, c] = t.map(|i| positions[i as usize]);
            (b - a).cross(c - a).z * 0.5
        })
    }

    #[test]
    fn a_polygon_that_cannot_be_fanned_is_cut_within() {
        // A letter U, in which no corner sees all others, and a comb with more corners than are tried as apex.
        let u = [[0, 0], [3, 0], [3, 3], [2, 3], [2, 1], [1, 1], [1, 3], [0, 3]];
        let teeth = (0..20).flat_map(|i| [[40 - 2 * i, 5], [39 - 2 * i, 1]]);
        let comb: Vec<[i32; 2]> = [[0, 0], [40, 0]].into_iter().chain(teeth).chain([[0, 5]]).collect();
        for (outline, expected) in [(&u[..], 7.0), (&comb[..], 40.0 + 80.0)] {
            let positions: Vec<Vec3> = outline.iter().map(|&[x, y]| Vec3::new(x as f32, y as f32, 0.0)).collect();
            for turn in 0..outline.len() {
                let mut corners: Vec<u32> = (0..outline.len() as u32).collect();
                corners.rotate_left(turn);
                let mut triangles = Vec::new();
                triangulate(&corners, &positions, &mut triangles);
                let areas = areas(&triangles, &positions);
                // Inverted triangles count negative, and doubly covered areas balance them: the sum alone does not detect them.
                let (sum, least) = areas.fold((0.0, f32::INFINITY), |(sum, least), a| (sum + a, least.min(a)));
                assert_eq!((triangles.len(), sum), (outline.len() - 2, expected), "from corner {turn}: {triangles:?}");
                assert!(least >= 0.0, "from corner {turn}: {triangles:?}");
            }
        }
    }

    #[test]
    fn a_long_strip_takes_time_with_the_square_of_its_corners() {
        let asked = |count: u32| {
            let half = count / 2;
            let there = (0..half).map(|i| [i as f64, if i % 2 == 0 { 0.0 } else { 20.0 }]);
            let back = (0..half).rev().map(|i| [i as f64, if i % 2 == 0 { 1.0 } else { 21.0 }]);
            let places: Vec<[f64; 2]> = there.chain(back).collect();
            let calls = std::cell::Cell::new(0u32);
            let facing = |triangle: [u32; 3]| {
                calls.set(calls.get() + 1);
                let [[ax, ay], [bx, by], [cx, cy]] = triangle.map(|i| places[i as usize]);
                (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
            };
            let mut triangles = Vec::new();
            clip_ears(&(0..count).collect::<Vec<_>>(), facing, &mut triangles);
            assert_eq!(triangles.len() as u32, count - 2);
            calls.get()
        };
        let [few, many] = [asked(100), asked(400)];
        assert!(many < 20 * few, "{few} for 100 corners, {many} for 400");
    }

    #[test]
    fn a_dent_is_not_covered() {
        // An arrow head: only the fans from the tip and from the dent stay inside.
        let positions = [[0.0, 0.0, 0.0], [2.0, -1.0, 0.0], [0.5, 0.0, 0.0], [2.0, 1.0, 0.0]].map(Vec3::from);
        for turn in 0..4 {
            let mut corners = [0, 1, 2, 3];
            corners.rotate_left(turn);
            let mut triangles = Vec::new();
            triangulate(&corners, &positions, &mut triangles);
            let areas = areas(&triangles, &positions);
            // Absolute values, because the winding of the arrow head does not matter.
            let (sum, least) = areas.fold((0.0, f32::INFINITY), |(sum, least), a| (sum + a, least.min(a.abs())));
            assert!((sum.abs() - 0.5).abs() < 1e-6 && (least - 0.25).abs() < 1e-6, "{triangles:?}");
        }
        let mut none = Vec::new();
        triangulate(&[0, 1], &positions, &mut none);
        triangulate(&[], &positions, &mut none);
        assert!(none.is_empty());
    }
}
