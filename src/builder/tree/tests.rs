use super::*;
use crate::random::Random;

fn vector(random: &mut Random) -> DVec3 {
    random.in_cube().as_dvec3()
}

/// Triangles of all sizes and shapes, slivers among them.
fn soup(count: usize, random: &mut Random) -> Vec<[DVec3; 3]> {
    let triangle = |i: usize| {
        let size = [0.3, 0.01, 1e-4][i % 3];
        let (a, along) = (vector(random), vector(random) * size);
        let width = if i.is_multiple_of(5) { 1e-5 } else { 1.0 };
        [a, a + along, a + along * 0.3 + vector(random) * size * width]
    };
    (0..count).map(triangle).collect()
}

fn distance(point: DVec3, triangle: &[DVec3; 3]) -> f64 {
    let [a, b, c] = *triangle;
    let normal = (b - a).cross(c - a).normalize();
    let mut rim = f64::INFINITY;
    let mut above = true;
    for (a, b) in [(a, b), (b, c), (c, a)] {
        let t = ((point - a).dot(b - a) / (b - a).length_squared()).clamp(0.0, 1.0);
        rim = rim.min(point.distance(a.lerp(b, t)));
        above &= (b - a).cross(point - a).dot(normal) >= 0.0;
    }
    if above { (point - a).dot(normal).abs() } else { rim }
}

fn solid_angle(point: DVec3, triangle: &[DVec3; 3]) -> f64 {
    let [a, b, c] = triangle.map(|corner| corner - point);
    let (la, lb, lc) = (a.length(), b.length(), c.length());
    let denominator = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
    2.0 * a.dot(b.cross(c)).atan2(denominator)
}

#[test]
fn the_nearest_triangle_is_found() {
    let mut random = Random(3);
    let mut beyond = 0;
    // Numbers with which leaves and nodes are full, and others.
    for count in [1, 2, 7, 8, 9, 16, 17, 63, 64, 65, 500] {
        let source = soup(count, &mut random);
        let tree = TriangleTree::new(&source);
        let mut order = tree.order().to_vec();
        assert!(tree.triangles().iter().zip(&order).all(|(t, &i)| *t == source[i as usize]));
        order.sort_unstable();
        assert!(order.into_iter().eq(0..count as u32), "each triangle once");
        for _ in 0..200 {
            let point = vector(&mut random);
            let expected = source.iter().map(|t| distance(point, t)).fold(f64::INFINITY, f64::min);
            let (found, triangle) = tree.closest_with_triangle(point, None).unwrap();
            assert!((found.distance(point) - expected).abs() < 1e-6, "{found} {expected} of {count}");
            assert!((distance(point, &tree.triangles()[triangle as usize]) - expected).abs() < 1e-6);
            assert!((f64::from(tree.distance(point)) - expected).abs() < 1e-6);
            assert_eq!(tree.closest(point, expected + 1e-5), Some(found), "a limit does not change the result");
            let near = random.below(count) as u32;
            assert_eq!(tree.closest_with_triangle(point, Some(near)).unwrap().0, found, "near is only a hint");
            beyond += usize::from(tree.closest(point, expected - 1e-5).is_none());
        }
    }
    assert_eq!(beyond, 11 * 200);
    assert!(TriangleTree::new(&[]).closest(DVec3::ZERO, 1.0).is_none());
}

#[test]
fn degenerate_triangles_have_a_distance() {
    let flat = [[DVec3::X; 3], [DVec3::X, DVec3::Y, DVec3::X], [DVec3::X, DVec3::Y, DVec3::X * 2.0 - DVec3::Y]];
    let tree = TriangleTree::new(&flat);
    assert!((tree.distance(DVec3::ZERO) - 0.5f32.sqrt()).abs() < 1e-6);
    assert!((tree.distance(DVec3::new(3.0, -1.0, 0.0)) - 1.0).abs() < 1e-6);
}

#[test]
fn windings_are_sums_of_solid_angles() {
    let mut random = Random(4);
    for count in [1, 5, 64, 500] {
        let source = soup(count, &mut random);
        let tree = TriangleTree::new(&source);
        for _ in 0..100 {
            let point = vector(&mut random);
            let expected: f64 =
                source.iter().map(|t| solid_angle(point, t)).sum::<f64>() / (4.0 * std::f64::consts::PI);
            let found = tree.winding(point);
            assert!((found - expected).abs() < 0.02, "{found} instead of {expected} of {count}");
        }
    }
}

#[test]
fn the_inside_of_a_closed_surface_is_known() {
    // A cube of half size 1, with eight by eight quads per side.
    let mut triangles = vec![];
    for axis in 0..3 {
        for side in [-1.0, 1.0] {
            let [mut n, mut u, mut v] = [DVec3::ZERO; 3];
            (n[axis], u[(axis + 1) % 3], v[(axis + 2) % 3]) = (side, side, 1.0);
            let at = |i: i32, j: i32| n + u * (f64::from(i) / 4.0 - 1.0) + v * (f64::from(j) / 4.0 - 1.0);
            for (i, j) in (0..64).map(|k| (k / 8, k % 8)) {
                triangles.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
                triangles.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
            }
        }
    }
    let tree = TriangleTree::new(&triangles);
    let mut random = Random(5);
    let mut inside = 0;
    for _ in 0..2000 {
        let point = vector(&mut random) * 1.2;
        let depth = 1.0 - point.abs().max_element();
        assert!(depth.abs() < 1e-4 || tree.is_inside(point) == (depth > 0.0), "{point}");
        inside += usize::from(depth > 0.0);
    }
    assert!((500..1500).contains(&inside), "{inside}");
}
