//! Random moving pairs of every category and kind, and a judge of answers.

use std::fmt;

use bevy_medial::{
    geometry::Sphere,
    query::{Cuboid, Moving, TimeOfImpactStatus, Touch},
    random::Random,
};
pub use bevy_medial_compare::pairs::Primitive;
use glam::{DQuat, DVec3, Quat, Vec3};

use crate::reference::{Ball, Difference, TOUCHING};

mod random;

pub use random::random_pair;

pub const CATEGORIES: [&str; 13] = [
    "generic",
    "fast",
    "grazing",
    "parallel",
    "thin",
    "sharp",
    "near_degenerate",
    "degenerate",
    "overlap",
    "uneven",
    "far",
    "separating",
    "resting",
];

/// Numbers of spheres of the first and the second body, 0 for a box.
pub const KINDS: [(usize, usize); 8] = [(1, 2), (1, 3), (2, 2), (2, 3), (3, 3), (1, 0), (2, 0), (3, 0)];

pub fn kind_name((first, second): (usize, usize)) -> String {
    let name = |spheres: usize| ["box", "sphere", "cone", "slab"][spheres];
    format!("{}-{}", name(first), name(second))
}

/// A point of the cube from -1 to 1.
fn cube(random: &mut Random) -> DVec3 {
    DVec3::from_array([(); 3].map(|()| random.range(-1.0, 1.0)))
}

/// A box at rest, as in a file of pairs.
#[derive(Clone, Copy)]
struct Placed {
    center: Vec3,
    rotation: Quat,
    half: Vec3,
}

#[derive(Clone)]
enum Second {
    Hull(Vec<(Sphere, Vec3)>),
    Box(Placed),
}

/// A moving pair: the f32 numbers of one line of a file of pairs.
#[derive(Clone)]
pub struct Pair {
    category: usize,
    first: Vec<(Sphere, Vec3)>,
    second: Second,
}

/// The second side in the form that the kernels take.
#[derive(Clone, Copy)]
pub enum Other {
    Hull(Primitive),
    Box(Cuboid),
}

/// Runs an expression with the concrete types of both sides.
macro_rules! for_kinds {
    ($first:expr, $second:expr, |$a:ident, $b:ident| hulls: $hulls:expr, cuboid: $cuboid:expr) => {{
        use $crate::pairs::{Other, Primitive};
        macro_rules! second {
            ($a0:expr) => {{
                let $a = $a0;
                match $second {
                    Other::Hull(Primitive::Sphere($b)) => $hulls,
                    Other::Hull(Primitive::Cone($b)) => $hulls,
                    Other::Hull(Primitive::Slab($b)) => $hulls,
                    Other::Box($b) => $cuboid,
                }
            }};
        }
        match $first {
            Primitive::Sphere(a) => second!(a),
            Primitive::Cone(a) => second!(a),
            Primitive::Slab(a) => second!(a),
        }
    }};
}

impl Pair {
    /// The pair relative to a centre of the first body, or in the frame of the box. So positions far from the origin lose no precision.
    pub fn relative(&self) -> (Primitive, Other) {
        let (origin, rotation, second) = match &self.second {
            Second::Hull(spheres) => {
                let origin = self.first[0].0.center;
                (origin, Quat::IDENTITY, Other::Hull(hull(spheres, origin, Quat::IDENTITY)))
            }
            Second::Box(placed) => {
                (placed.center, placed.rotation.normalize().inverse(), Other::Box(Cuboid { half: placed.half }))
            }
        };
        (hull(&self.first, origin, rotation), second)
    }

    fn difference(&self) -> Difference {
        let second: Vec<Ball> = match &self.second {
            Second::Hull(spheres) => spheres.iter().map(ball).collect(),
            Second::Box(placed) => {
                corners(placed.half.as_dvec3(), placed.center.as_dvec3(), placed.rotation.as_dquat().normalize())
            }
        };
        Difference::new(&self.first.iter().map(ball).collect::<Vec<_>>(), &second)
    }

    /// The larger extent of the two bodies, and the largest relative speed of two vertices.
    pub fn size_and_speed(&self) -> (f64, f64) {
        let extent = |spheres: &[(Sphere, Vec3)]| {
            let first = spheres[0].0.center.as_dvec3();
            spheres.iter().map(|(s, _)| s.center.as_dvec3().distance(first)).fold(0.0, f64::max)
                + spheres.iter().map(|(s, _)| f64::from(s.radius)).fold(0.0, f64::max)
        };
        let other = match &self.second {
            Second::Hull(spheres) => extent(spheres),
            Second::Box(placed) => f64::from(placed.half.max_element()),
        };
        (extent(&self.first).max(other), self.difference().speed())
    }
}

fn ball((sphere, motion): &(Sphere, Vec3)) -> Ball {
    Ball { center: sphere.center.as_dvec3(), radius: f64::from(sphere.radius), motion: motion.as_dvec3() }
}

/// A box as the hull of eight points.
pub fn corners(half: DVec3, center: DVec3, rotation: DQuat) -> Vec<Ball> {
    (0..8)
        .map(|k| {
            let sign = DVec3::from_array([1, 2, 4].map(|bit| if k & bit == 0 { -1.0 } else { 1.0 }));
            Ball { center: center + rotation * (half * sign), ..Ball::default() }
        })
        .collect()
}

fn hull(spheres: &[(Sphere, Vec3)], origin: Vec3, rotation: Quat) -> Primitive {
    // Computed in f64, so that the rotation into the frame of a box adds only one rounding.
    let rotation = rotation.as_dquat().normalize();
    let turned = |v: DVec3| (rotation * v).as_vec3();
    let place = |i: usize| Sphere::new(turned(spheres[i].0.center.as_dvec3() - origin.as_dvec3()), spheres[i].0.radius);
    let turn = |i: usize| turned(spheres[i].1.as_dvec3());
    fn moving<const N: usize>(place: impl Fn(usize) -> Sphere, turn: impl Fn(usize) -> Vec3) -> Moving<N> {
        Moving { start: std::array::from_fn(place), motion: std::array::from_fn(turn) }
    }
    match spheres.len() {
        1 => Primitive::Sphere(moving(place, turn)),
        2 => Primitive::Cone(moving(place, turn)),
        _ => Primitive::Slab(moving(place, turn)),
    }
}

/// The pair as a line of a file of pairs.
impl fmt::Display for Pair {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let spheres = |f: &mut fmt::Formatter, spheres: &[(Sphere, Vec3)]| {
            spheres.iter().try_for_each(|(s, v)| {
                write!(f, " {} {} {} {} {} {} {}", s.center.x, s.center.y, s.center.z, s.radius, v.x, v.y, v.z)
            })
        };
        let second = if let Second::Hull(spheres) = &self.second { spheres.len() } else { 0 };
        write!(f, "{} {} |", CATEGORIES[self.category], kind_name((self.first.len(), second)).replace('-', " "))?;
        spheres(f, &self.first)?;
        write!(f, " |")?;
        match &self.second {
            Second::Hull(second) => spheres(f, second)?,
            Second::Box(Placed { center: c, rotation: q, half: h }) => {
                write!(f, " {} {} {} {} {} {} {} {} {} {}", c.x, c.y, c.z, q.x, q.y, q.z, q.w, h.x, h.y, h.z)?;
            }
        }
        let difference = self.difference();
        let start = difference.distance().lower;
        let toi = if start <= 0.0 { Some(0.0) } else { difference.first_within(0.0, self.size_and_speed().0) };
        let distances: Vec<(f64, f64)> =
            (0..=4096).map(|i| f64::from(i) / 4096.0).map(|t| (t, difference.at(t).distance().lower)).collect();
        let least = |until: f64| distances.iter().filter(|d| d.0 <= until).map(|d| d.1).fold(f64::INFINITY, f64::min);
        let toi_text = toi.map_or("none".into(), |t| t.to_string());
        let before = if toi.is_some() { start.min(TOUCHING) } else { least(1.0) };
        write!(f, " | {toi_text} {start} {before} {}", least(1.0))
    }
}

/// The true outcome of a pair.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Truth {
    Overlap,
    Hit,
    Apart,
}

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Verdict {
    Good,
    Missed,
    Late,
    Early,
    FalseAlarm,
    OverlapMissed,
    Invalid,
}

/// Distance, in sizes of the pair, at which an f32 answer may count as a touch. A pair that grazes by less stays this close for longer than
/// the tolerances of time allow.
const ROUNDING: f64 = 2e-6;

/// Judges an answer by the tolerances for files of pairs. A late or early answer is also good if the pair is within [`ROUNDING`] of touching
/// at that time.
///
/// Where centres cross, the reference's distance ends at minus the radii, which is zero for sharp edges. So a miss also counts if no
/// translation of the tolerance's length separates the bodies.
pub fn judge(pair: &Pair, answer: &Touch) -> (Truth, Verdict) {
    let difference = pair.difference();
    let (size, speed) = pair.size_and_speed();
    let start = difference.distance();
    let overlap = answer.status == TimeOfImpactStatus::Overlapping;
    let hit = answer.status != TimeOfImpactStatus::Separated;
    let fraction = f64::from(answer.fraction);
    let toi = if start.upper <= 0.0 { Some(0.0) } else { difference.first_within(0.0, size) };
    let truth = match toi {
        _ if start.upper <= 0.0 => Truth::Overlap,
        Some(_) => Truth::Hit,
        None => Truth::Apart,
    };
    // Touches shallower than the tolerance may be missed; deeper hits may not.
    let deep_at = |t: f64, tolerance: f64| difference.at(t).deeper_than(tolerance * size);
    let verdict = if hit && !(0.0..=1.0).contains(&fraction) {
        Verdict::Invalid
    } else if overlap && start.lower < 1e-5 * size {
        Verdict::Good
    } else if truth == Truth::Overlap {
        let clear = start.lower < -1e-6 * size || (start.lower < 0.0 && deep_at(0.0, 1e-6));
        if clear && !(hit && fraction == 0.0) { Verdict::OverlapMissed } else { Verdict::Good }
    } else if let Some(toi) = toi {
        let slack = size / speed.max(1e-30);
        if !hit {
            let deep = difference.first_within(-1e-5 * size, size).is_some()
                || (1..=16).any(|i| deep_at(toi + (1.0 - toi) * f64::from(i) / 16.0, 1e-5));
            if deep { Verdict::Missed } else { Verdict::Good }
        } else if fraction - toi > 1e-4 * slack + 5e-7
            && difference.first_within(-ROUNDING * size, size).is_some_and(|t| t < fraction)
        {
            Verdict::Late
        } else if toi - fraction > 1e-3 * slack + 5e-7 && difference.at(fraction).distance().upper > ROUNDING * size {
            Verdict::Early
        } else {
            Verdict::Good
        }
    } else if hit && difference.first_within(1e-4 * size, size).is_none() {
        Verdict::FalseAlarm
    } else {
        Verdict::Good
    };
    (truth, verdict)
}
