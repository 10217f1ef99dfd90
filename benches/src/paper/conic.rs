//! Overlap of a medial cone and a box (paper, section 4.1): a quadratic function `g` of three coordinates in the box and the parameter of the cone, on the
//! unit tesseract. Compared with the exact distance in f64 and with the kernel of `bevy_medial`, on random pairs.

use bevy_medial::{
    geometry::Sphere,
    query::{Cuboid, separation},
    random::Random,
};
use glam::{DVec3, Vec3};
use serde::Serialize;

use crate::convex::min_of_convex;

/// `g(t) = t . A t + b . t + c`: the squared distance of a point of the box and a centre on the cone, minus the squared radius (equation 5).
#[derive(Clone, Copy, Debug)]
pub struct Conic {
    a: [[f64; 4]; 4],
    b: [f64; 4],
    c: f64,
}

/// The parameters that a face of the tesseract fixes, each to 0 or 1.
type Face = [Option<f64>; 4];

/// All 81 faces: vertices, edges, squares, cubes and the tesseract itself.
fn faces() -> impl Iterator<Item = Face> {
    (0..81).map(|number| std::array::from_fn(|axis| [Some(0.0), Some(1.0), None][number / [1, 3, 9, 27][axis] % 3]))
}

impl Conic {
    /// The function of a cone and the box with half extents `half` around the origin.
    pub fn new([m1, m2]: &[Sphere; 2], half: Vec3) -> Self {
        let half = half.as_dvec3();
        let [c1, c2] = [m1.center.as_dvec3(), m2.center.as_dvec3()];
        let [r1, r2] = [f64::from(m1.radius), f64::from(m2.radius)];
        let corner = -half - c2;
        // The columns of the linear part of `v - c`.
        let columns = [DVec3::X * (2.0 * half.x), DVec3::Y * (2.0 * half.y), DVec3::Z * (2.0 * half.z), c2 - c1];
        let mut a = [[0.0; 4]; 4];
        for (i, row) in a.iter_mut().enumerate() {
            for (j, entry) in row.iter_mut().enumerate() {
                *entry = columns[i].dot(columns[j]);
            }
        }
        let mut b = columns.map(|column| 2.0 * column.dot(corner));
        a[3][3] -= (r1 - r2) * (r1 - r2);
        b[3] -= 2.0 * r2 * (r1 - r2);
        Self { a, b, c: corner.length_squared() - r2 * r2 }
    }

    /// The value at a point.
    fn at(&self, t: &[f64; 4]) -> f64 {
        let quadratic: f64 = (0..4).map(|i| (0..4).map(|j| self.a[i][j] * t[i] * t[j]).sum::<f64>()).sum();
        quadratic + (0..4).map(|i| self.b[i] * t[i]).sum::<f64>() + self.c
    }

    /// The stationary point of the function on the hull of a face, by Gaussian elimination. `None` if it is not unique.
    fn stationary(&self, face: &Face) -> Option<[f64; 4]> {
        let fixed = face.map(|value| value.unwrap_or(0.0));
        // 2 A t + b = 0 for the free parameters, t = value for the fixed ones.
        let mut rows: [[f64; 5]; 4] = std::array::from_fn(|i| match face[i] {
            Some(value) => std::array::from_fn(|j| {
                if j == i {
                    1.0
                } else if j == 4 {
                    value
                } else {
                    0.0
                }
            }),
            None => std::array::from_fn(|j| match j {
                4 => -self.b[i] - 2.0 * (0..4).map(|k| self.a[i][k] * fixed[k]).sum::<f64>(),
                _ => {
                    if face[j].is_none() {
                        2.0 * self.a[i][j]
                    } else {
                        0.0
                    }
                }
            }),
        });
        let size = (0..4).map(|i| self.a[i][i].abs()).fold(0.0, f64::max);
        for k in 0..4 {
            let pivot = (k..4).max_by(|&i, &j| rows[i][k].abs().total_cmp(&rows[j][k].abs()))?;
            rows.swap(k, pivot);
            if rows[k][k].abs() <= 1e-12 * size.min(1.0) {
                return None;
            }
            let (above, below) = rows.split_at_mut(k + 1);
            for row in below {
                let factor = row[k] / above[k][k];
                row.iter_mut().zip(&above[k]).for_each(|(entry, above)| *entry -= factor * above);
            }
        }
        let mut point = [0.0; 4];
        for k in (0..4).rev() {
            let known: f64 = (k + 1..4).map(|j| rows[k][j] * point[j]).sum();
            point[k] = (rows[k][4] - known) / rows[k][k];
        }
        Some(point)
    }

    /// True if cone and box overlap, by all faces: the min of `g` lies at the stationary point of one of them.
    pub fn overlaps(&self) -> bool {
        let inside = |point: &[f64; 4]| point.iter().all(|t| (0.0..=1.0).contains(t));
        faces().any(|face| self.stationary(&face).is_some_and(|point| inside(&point) && self.at(&point) <= 0.0))
    }

    /// True if cone and box overlap, by the words of the paper: `g = 0` crosses one of the 32 edges, or `g = 0` is an ellipsoid with a negative value at
    /// its centre.
    pub fn overlaps_by_edges(&self) -> bool {
        let crosses = |face: &Face| {
            let Some(axis) = face.iter().position(Option::is_none) else { return false };
            let with = |t: f64| self.at(&std::array::from_fn(|i| if i == axis { t } else { face[i].unwrap_or(0.0) }));
            let (start, middle, end) = (with(0.0), with(0.5), with(1.0));
            let a = 2.0 * (start - 2.0 * middle + end);
            let b = end - start - a;
            let lowest = if a == 0.0 { 0.0 } else { (-b / (2.0 * a)).clamp(0.0, 1.0) };
            let values = [start, end, (a * lowest + b) * lowest + start];
            values.iter().any(|v| *v <= 0.0) && values.iter().any(|v| *v >= 0.0)
        };
        let is_edge = |face: &Face| face.iter().filter(|value| value.is_none()).count() == 1;
        faces().any(|face| is_edge(&face) && crosses(&face))
            || self.is_ellipsoid() && self.stationary(&[None; 4]).is_some_and(|center| self.at(&center) < 0.0)
    }

    /// True if the quadratic part is positive definite, so that `g = 0` is an ellipsoid or empty.
    pub fn is_ellipsoid(&self) -> bool {
        // Cholesky decomposition.
        let size = (0..4).map(|i| self.a[i][i]).fold(0.0, f64::max);
        let mut l = [[0.0; 4]; 4];
        for i in 0..4 {
            for j in 0..=i {
                let rest = self.a[i][j] - (0..j).map(|k| l[i][k] * l[j][k]).sum::<f64>();
                if i == j && rest <= 1e-12 * size {
                    return false;
                }
                l[i][j] = if i == j { rest.sqrt() } else { rest / l[j][j] };
            }
        }
        true
    }
}

/// Signed distance of a cone and a box: the min of equation 3, by plain minimisation. Where the axis of the cone meets the box, it is less negative
/// than the depth.
pub fn distance([m1, m2]: &[Sphere; 2], half: Vec3) -> f64 {
    let [c1, c2] = [m1.center.as_dvec3(), m2.center.as_dvec3()];
    let [r1, r2] = [f64::from(m1.radius), f64::from(m2.radius)];
    let half = half.as_dvec3();
    min_of_convex(|t| {
        let center = c1.lerp(c2, t);
        center.distance(center.clamp(-half, half)) - (r1 + (r2 - r1) * t)
    })
}

/// Verdicts on random pairs of a cone and a box of about the same size.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Verdicts {
    pub pairs: usize,
    pub overlapping: usize,
    /// Cones of length 0: spheres.
    pub spheres: usize,
    /// Pairs with a distance of less than 1e-5. Both verdicts are right for them.
    pub undecided: usize,
    /// Wrong verdicts of `bevy_medial`.
    pub ours_wrong: usize,
    /// Wrong verdicts by all faces of the tesseract.
    pub faces_wrong: usize,
    /// Overlaps that the words of the paper miss.
    pub edges_missed: usize,
    /// False positives of the words of the paper.
    pub edges_false: usize,
    /// Pairs for which `g = 0` is an ellipsoid.
    pub ellipsoids: usize,
}

/// Distance below which a verdict is undecided: the rounding of the f32 kernel.
const TOLERANCE: f64 = 1e-5;

impl Verdicts {
    fn judge(&mut self, cone: &[Sphere; 2], half: Vec3) {
        self.pairs += 1;
        self.spheres += usize::from(cone[0].center == cone[1].center);
        let distance = distance(cone, half);
        let conic = Conic::new(cone, half);
        self.ellipsoids += usize::from(conic.is_ellipsoid());
        if distance.abs() < TOLERANCE {
            self.undecided += 1;
            return;
        }
        let overlaps = distance < 0.0;
        self.overlapping += usize::from(overlaps);
        self.ours_wrong += usize::from((separation(cone, &Cuboid { half }, 0).distance < 0.0) != overlaps);
        self.faces_wrong += usize::from(conic.overlaps() != overlaps);
        let by_edges = conic.overlaps_by_edges();
        self.edges_missed += usize::from(overlaps && !by_edges);
        self.edges_false += usize::from(!overlaps && by_edges);
    }
}

/// Judges both rules on a number of random pairs.
pub fn compare(pairs: usize, seed: u64) -> Verdicts {
    let mut random = Random(seed);
    let mut verdicts = Verdicts::default();
    for _ in 0..pairs {
        let start = random.in_cube() * 2.0;
        let displacement = if random.chance(0.1) { Vec3::ZERO } else { random.in_cube() * 1.5 };
        let radius = random.unit();
        // The broad phase has cones of constant radius only.
        let end = if random.chance(0.5) { radius } else { random.unit() };
        let cone = [Sphere::new(start, radius), Sphere::new(start + displacement, end)];
        let half = random.in_cube().abs() * 1.2 + 0.01;
        verdicts.judge(&cone, half);
    }
    verdicts
}
