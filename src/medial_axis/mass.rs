use std::f64::consts::PI;

use glam::{DMat3, DQuat, DVec3, Mat3, Vec3};

use super::chord::{Ball, Hull};
use crate::geometry::{Aabb, Primitive, Sphere};

/// Approximate number of intersections of the grid's lines with the primitives of a shape, in total.
///
/// The cost grows linearly with it. The error falls with its power of -3/4 or faster.
const CHORDS: f64 = 150_000.0;

/// Direction of the lines, as the rotation that maps them to the x axis. It is oblique, so that the faces of boxes and the
/// sides of rods along an axis do not fall between two rows of lines.
pub(crate) const LINES: DQuat = DQuat::from_xyzw(1.0 / 11.0, 5.0 / 11.0, 4.0 / 11.0, 8.888_194_417_315_589 / 11.0);

/// Mass properties of a solid at unit density.
///
/// # Method
/// A square grid of parallel lines runs through the shape. On each line the exact intervals inside the primitives are
/// merged, so that overlaps count once. The moments are integrated exactly along the lines, and by the midpoint rule across them.
/// All computations use f64, relative to the middle of the shape. Equal lists give bitwise equal results.
///
/// # Error
/// One ball is exact. For boxes, capsules, cones and rings, the error of the volume is within 0.1 %. The centre of mass is within 0.1 % of the size,
/// and moments of inertia are within 0.2 %.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MassProperties {
    /// Volume in cubic metres: the mass, at unit density. Zero for a shape whose radii are all zero.
    pub volume: f32,
    /// Centre of mass in metres, in the shape's frame. The centre of the bounding box if the volume is zero.
    pub center_of_mass: Vec3,
    /// Inertia tensor at unit density about the centre of mass, along the shape's axes, in m^5.
    pub inertia: Mat3,
}

impl MassProperties {
    /// Mass properties of the union of `primitives`, whose indices must be in range. The type describes method and error.
    pub(super) fn of_union(spheres: &[Sphere], primitives: &[Primitive]) -> Self {
        if let ([sphere], [Primitive::Sphere(_)]) = (spheres, primitives) {
            return Self::of_ball(sphere);
        }
        let aabb = Aabb::from_spheres(spheres.iter().copied());
        let middle = aabb.center().as_dvec3();
        let hulls: Vec<Hull> = primitives
            .iter()
            .map(|primitive| {
                let balls = primitive.indices().iter().map(|&i| {
                    let sphere = spheres[i as usize];
                    Ball { center: LINES * (sphere.center.as_dvec3() - middle), radius: f64::from(sphere.radius) }
                });
                Hull::new(balls.collect())
            })
            .collect();
        let area: f64 = hulls.iter().map(Hull::shadow).sum();
        let spacing = (area / CHORDS).sqrt();
        let chords = if spacing > 0.0 { chords(&hulls, spacing) } else { vec![] };
        Self::of_chords(&chords, spacing, middle)
    }

    /// Mass properties of the solid that a grid of lines intersects along `chords`. Coordinates of chords are relative to `middle` and rotated by [`LINES`].
    pub(crate) fn of_chords(chords: &[Chord], spacing: f64, middle: DVec3) -> Self {
        let mut moments = Moments { volume: 0.0, first: DVec3::ZERO, second: DMat3::ZERO };
        chords.iter().for_each(|chord| moments.add(chord, spacing));
        moments.finish(middle)
    }

    fn of_ball(&Sphere { center, radius }: &Sphere) -> Self {
        let square = f64::from(radius).powi(2);
        let volume = 4.0 / 3.0 * PI * square * f64::from(radius);
        let inertia = Mat3::from_diagonal(Vec3::splat((0.4 * volume * square) as f32));
        Self { volume: volume as f32, center_of_mass: center, inertia }
    }
}

/// An interval of a line inside the shape.
#[derive(Clone, Copy)]
pub(crate) struct Chord {
    /// Number of the line along y and z.
    pub line: [i64; 2],
    /// The x coordinates at which the line enters and leaves.
    pub from: f64,
    pub to: f64,
}

/// The y or z coordinate of a line. Lines run through the middles of the cells, so the samples of a symmetric shape are symmetric.
pub(crate) fn line_position(number: i64, spacing: f64) -> f64 {
    (number as f64 + 0.5) * spacing
}

/// The number of the first line at or above a y or z coordinate.
pub(crate) fn first_line(from: f64, spacing: f64) -> i64 {
    (from / spacing - 0.5).ceil() as i64
}

/// The chords of all lines of a grid around the origin with the union of `hulls`.
fn chords(hulls: &[Hull], spacing: f64) -> Vec<Chord> {
    let mut chords = Vec::new();
    for hull in hulls {
        let [ys, zs] = [1, 2].map(|axis| {
            let (least, greatest) = hull.range(axis);
            first_line(least, spacing)..first_line(greatest, spacing)
        });
        for y in ys {
            for z in zs.clone() {
                if let Some((from, to)) = hull.chord([y, z].map(|number| line_position(number, spacing))) {
                    chords.push(Chord { line: [y, z], from, to });
                }
            }
        }
    }
    chords.sort_unstable_by(|a, b| a.line.cmp(&b.line).then(a.from.total_cmp(&b.from)).then(a.to.total_cmp(&b.to)));
    chords.dedup_by(|next, last| {
        let joined = next.line == last.line && next.from <= last.to;
        if joined {
            last.to = last.to.max(next.to);
        }
        joined
    });
    chords
}

/// Integrals over a solid of 1, of the position `p` and of `p p^T`, at unit density.
struct Moments {
    volume: f64,
    first: DVec3,
    second: DMat3,
}

impl Moments {
    /// Adds a prism along x with a square cross-section.
    fn add(&mut self, &Chord { line, from, to }: &Chord, spacing: f64) {
        let [y, z] = line.map(|number| line_position(number, spacing));
        // Integrals of 1, x and x^2.
        let length = (to - from) * spacing * spacing;
        let x = length * 0.5 * (from + to);
        let xx = length / 3.0 * (from * from + from * to + to * to);
        let first = DVec3::new(x, y * length, z * length);
        self.volume += length;
        self.first += first;
        self.second += DMat3::from_cols(DVec3::new(xx, x * y, x * z), first * y, first * z);
    }

    /// Converts the moments to the shape's frame and to the centre of mass.
    fn finish(self, middle: DVec3) -> MassProperties {
        if self.volume <= 0.0 {
            return MassProperties { volume: 0.0, center_of_mass: middle.as_vec3(), inertia: Mat3::ZERO };
        }
        let center = self.first / self.volume;
        let outer = DMat3::from_cols(center * center.x, center * center.y, center * center.z);
        let turn = DMat3::from_quat(LINES);
        let second = turn.transpose() * (self.second - outer * self.volume) * turn;
        let trace = second.x_axis.x + second.y_axis.y + second.z_axis.z;
        let inertia = (DMat3::from_diagonal(DVec3::splat(trace)) - second).as_mat3();
        MassProperties {
            volume: self.volume as f32,
            center_of_mass: (middle + turn.transpose() * center).as_vec3(),
            // Symmetric to the last bit.
            inertia: (inertia + inertia.transpose()) * 0.5,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        medial_axis::{
            MedialAxis, ma,
            oracle::{self, Envelope},
        },
        random::Random,
    };

    /// Checks the documented error. `moments` are the expected principal moments along x, y, z.
    fn check(name: &str, axis: &MedialAxis, volume: f64, center: Vec3, moments: [f64; 3]) {
        let mass = axis.mass();
        let error = f64::from(mass.volume) / volume - 1.0;
        let shift = mass.center_of_mass.distance(center) / (2.0 * axis.bounding_sphere().radius);
        let turns = [0, 1, 2].map(|i| f64::from(mass.inertia.col(i)[i]) / moments[i] - 1.0);
        let [x, y, z] = turns;
        println!("{name}: volume {error:+.1e}, centre {shift:.1e}, moments {x:+.1e} {y:+.1e} {z:+.1e}");
        assert!(error.abs() < 1e-3 && shift < 1e-3 && turns.iter().all(|e| e.abs() < 2e-3), "{name}");
        for (row, col) in [(0, 1), (0, 2), (1, 2)] {
            assert!(f64::from(mass.inertia.col(col)[row].abs()) < 2e-3 * moments[col], "{name}: {}", mass.inertia);
            assert_eq!(mass.inertia.col(col)[row], mass.inertia.col(row)[col], "{name}");
        }
    }

    /// Properties of a tapered capsule as a solid of revolution, computed with fine slices: volume, distance of the centre of mass from the larger ball's
    /// centre, and the moments along and across the axis about the centre of mass.
    fn tapered(r0: f64, r1: f64, length: f64) -> (f64, f64, f64, f64) {
        let steps = 400_000;
        let (least, greatest) = (-r0, length + r1);
        let slice = (greatest - least) / f64::from(steps);
        let sin = (r0 - r1) / length;
        let cos = (1.0 - sin * sin).sqrt();
        let (mut volume, mut first, mut second, mut along, mut across) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for step in 0..steps {
            let x = least + (f64::from(step) + 0.5) * slice;
            let square = if x < r0 * sin {
                r0 * r0 - x * x
            } else if x > length + r1 * sin {
                r1 * r1 - (x - length).powi(2)
            } else {
                ((r0 - x * sin) / cos).powi(2)
            };
            let disc = PI * square * slice;
            volume += disc;
            first += disc * x;
            second += disc * x * x;
            along += disc * square / 2.0;
            across += disc * square / 4.0;
        }
        (volume, first / volume, along, across + second - first * first / volume)
    }

    #[test]
    fn analytic_solids() {
        let ball = MedialAxis::sphere(0.5).unwrap();
        let volume = 4.0 / 3.0 * PI * 0.125;
        check("sphere", &ball, volume, Vec3::ZERO, [0.4 * volume * 0.25; 3]);

        let far = Vec3::new(5000.0, -300.0, 20.0);
        let capsule = MedialAxis::capsule(far - Vec3::Y, far + Vec3::Y, 0.25).unwrap();
        let (volume, _, along, across) = tapered(0.25, 0.25, 2.0);
        assert!((volume / (PI * 0.0625 * (2.0 + 4.0 / 3.0 * 0.25)) - 1.0).abs() < 1e-6, "the reference is wrong");
        check("capsule", &capsule, volume, far, [across, along, across]);

        let (volume, center, along, across) = tapered(1.0, 0.2, 1.5);
        let cone = |axis: Vec3| MedialAxis::cone(Sphere::new(Vec3::ZERO, 1.0), Sphere::new(axis * 1.5, 0.2)).unwrap();
        for (i, axis) in [Vec3::X, Vec3::Y, Vec3::Z].into_iter().enumerate() {
            let mut moments = [across; 3];
            moments[i] = along;
            check("tapered capsule", &cone(axis), volume, axis * center as f32, moments);
        }

        let (major, minor) = (1.0f64, 0.3f64);
        let torus = MedialAxis::torus(major as f32, minor as f32, 256).unwrap();
        let volume = 2.0 * PI * PI * major * minor * minor;
        let (about_axis, across) =
            (volume * (major * major + 0.75 * minor * minor), volume * (0.5 * major * major + 0.625 * minor * minor));
        check("torus", &torus, volume, Vec3::ZERO, [across, about_axis, across]);

        let cuboid = MedialAxis::rounded_box(Vec3::new(0.5, 1.5, 1.0), 0.0).unwrap();
        let third = |a: f64, b: f64| 6.0 * (a * a + b * b) / 3.0;
        check("box", &cuboid, 6.0, Vec3::ZERO, [third(1.5, 1.0), third(0.5, 1.0), third(0.5, 1.5)]);
    }

    #[test]
    fn a_ball_is_exact_and_the_grid_comes_near_it() {
        for (center, radius) in [(Vec3::ZERO, 0.3), (Vec3::new(5.0, -2.0, 700.0), 2.0), (Vec3::ONE, 0.0)] {
            let ball = Sphere::new(center, radius);
            let mass = *MedialAxis::new(vec![ball], vec![]).unwrap().0.mass();
            let volume = 4.0 / 3.0 * std::f32::consts::PI * radius.powi(3);
            assert!((mass.volume - volume).abs() <= 1e-6 * volume, "{mass:?}");
            assert_eq!(mass.center_of_mass, center);
            let moment = 0.4 * volume * radius * radius;
            assert!((mass.inertia - Mat3::from_diagonal(Vec3::splat(moment))).abs_diff_eq(Mat3::ZERO, 1e-6 * moment));
            // The same ball twice, which takes the general code path.
            let twice = MassProperties::of_union(&[ball], &[Primitive::Sphere([0]); 2]);
            assert!(
                (twice.volume - volume).abs() <= 1e-3 * volume
                    && twice.center_of_mass.distance(center) <= 2e-3 * radius
            );
        }
    }

    #[test]
    fn a_slanted_needle_keeps_its_volume() {
        let mut random = Random(8);
        let (volume, ..) = tapered(0.005, 0.005, 2.0);
        for _ in 0..20 {
            let end = random.in_cube().normalize_or(Vec3::X);
            let needle = MedialAxis::capsule(-end, end, 0.005).unwrap();
            let error = f64::from(needle.mass().volume) / volume - 1.0;
            assert!(error.abs() < 1e-3, "{error:e} along {end}");
            // The moment about the middle, across the needle: nearly m l^2 / 12.
            let across = needle.mass().inertia.mul_vec3(end.any_orthonormal_vector()).length();
            assert!((f64::from(across) / (volume * 4.0 / 12.0) - 1.0).abs() < 0.01, "{across} along {end}");
        }
    }

    #[test]
    fn overlaps_count_once_and_flat_shapes_weigh_nothing() {
        let at = |x: f32| Sphere::new(Vec3::new(x, 0.0, 0.0), 1.0);
        let (pair, _) = MedialAxis::new(vec![at(0.0), at(1.0)], vec![]).unwrap();
        // Two unit balls minus their lens.
        let volume = 8.0 / 3.0 * PI - PI * 5.0 / 12.0;
        assert!((f64::from(pair.mass().volume) / volume - 1.0).abs() < 1e-3);
        let corners = [Vec3::X, Vec3::Y, Vec3::Z].map(|c| Sphere::new(c, 0.0)).to_vec();
        let (flat, _) = MedialAxis::new(corners, vec![Primitive::Slab([0, 1, 2])]).unwrap();
        let expected = MassProperties { volume: 0.0, center_of_mass: Vec3::splat(0.5), inertia: Mat3::ZERO };
        assert_eq!(*flat.mass(), expected);
    }

    #[test]
    fn needles_of_no_width_end_in_time() {
        for radius in [1e-30, 1e-10, 1e-4] {
            let axis = MedialAxis::capsule(Vec3::new(-1e5, -1e5, 0.0), Vec3::new(1e5, 1e5, 1.0), radius).unwrap();
            assert!(axis.mass().volume >= 0.0 && axis.mass().inertia.is_finite());
        }
    }

    #[test]
    fn models_agree_with_a_count_of_random_points() {
        let mut random = Random(10);
        let research = ["qmat/bear_q61.ma", "qmat/cow_q82.ma", "dinosaur.ma", "bug.ma"];
        for path in oracle::model_files(&["cow.ma", "spider.ma"], &research) {
            let name = path.display();
            let (axis, _) = ma::parse(&std::fs::read(&path).unwrap()).unwrap().into_medial_axis().unwrap();
            let start = std::time::Instant::now();
            let mass = MassProperties::of_union(axis.spheres(), axis.primitives());
            println!("{name}: {} primitives, {:.1?}", axis.primitives().len(), start.elapsed());
            assert_eq!(mass, *axis.mass(), "not deterministic");
            let envelope = Envelope::new(axis.spheres(), axis.primitives());
            let (aabb, count) = (axis.aabb(), 200_000);
            let (mut inside, mut sum) = (0, Vec3::ZERO);
            for _ in 0..count {
                let point = aabb.center() + aabb.half_extents() * random.in_cube();
                if envelope.distance(point.as_dvec3()) < 0.0 {
                    inside += 1;
                    sum += point - aabb.center();
                }
            }
            let fraction = f64::from(inside) / f64::from(count);
            let box_volume = f64::from((aabb.half_extents() * 2.0).element_product());
            // Four standard deviations of the count.
            let bound = 4.0 * ((1.0 - fraction) / fraction / f64::from(count)).sqrt();
            assert!((fraction * box_volume / f64::from(mass.volume) - 1.0).abs() < bound, "{name}");
            let center = aabb.center() + sum / inside as f32;
            let shift = (center - mass.center_of_mass).length() / aabb.half_extents().length();
            assert!(shift < 4.0 / f64::from(inside).sqrt() as f32, "{name}: {shift}");
        }
    }
}
