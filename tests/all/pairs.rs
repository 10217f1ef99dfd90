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

/// A pair of the category, computed in f64 and rounded at the end. Bodies measure about 1, except the smaller one of `uneven`.
pub fn random_pair(random: &mut Random, category: usize, (count1, count2): (usize, usize)) -> Pair {
    let name = CATEGORIES[category];
    let smaller = if name == "uneven" { random.magnitude(-3.2, -2.8) } else { random.magnitude(-0.5, 0.0) };
    let sizes = if random.chance(0.5) { [1.0, smaller] } else { [smaller, 1.0] };
    let mut first = random_hull(random, name, count1, sizes[0]);
    let mut half = DVec3::ZERO;
    let mut rotation = DQuat::IDENTITY;
    let mut second = if count2 > 0 {
        random_hull(random, name, count2, sizes[1])
    } else {
        half = (cube(random).abs() + 0.05) * sizes[1];
        match name {
            "thin" => half[random.below(3)] = 1e-3 * sizes[1] * random.magnitude(-0.5, 0.5),
            "sharp" if random.chance(0.1) => half[random.below(3)] = 0.0,
            _ => {}
        }
        if name != "parallel" || random.chance(0.2) {
            rotation = random.direction_rotation();
        }
        corners(half, DVec3::ZERO, rotation)
    };

    // Position, and motion roughly towards each other.
    let reach = |balls: &[Ball]| balls.iter().map(|b| b.center.length() + b.radius).fold(0.0, f64::max);
    let (reach1, reach2) = (reach(&first), reach(&second));
    let towards = random.direction();
    let apart = match name {
        "overlap" => random.range(0.0, 0.7),
        "resting" => random.range(0.7, 2.0),
        "separating" => random.range(0.3, 2.0),
        _ => random.range(0.6, 3.0),
    } * (reach1 + reach2);
    let mut place = towards * apart;
    if name == "parallel" && random.chance(0.5) {
        // Exactly aligned in some coordinates.
        let axis = random.below(3);
        for k in 0..3 {
            if k == axis || random.chance(0.3) {
                continue;
            }
            place[k] = if random.chance(0.5) { 0.0 } else { random.range(-0.3, 0.3) };
        }
        if random.chance(0.5) {
            place[axis] = apart;
        }
    }
    let aside = random.direction().reject_from(towards) * (reach1 + reach2) * random.range(0.0, 1.2);
    // This displacement brings a random point of one body to a random point of the other.
    let aim = place + point_of(random, &second) - point_of(random, &first);
    let mut motion = match name {
        "fast" if random.chance(0.6) => aim.normalize() * reach1.max(reach2) * random.magnitude(1.0, 3.0),
        "separating" | "resting" | "fast" => DVec3::ZERO,
        _ if random.chance(0.6) => aim / random.range(0.1, 1.2),
        _ => DVec3::ZERO,
    };
    motion = match name {
        _ if motion != DVec3::ZERO => motion,
        "fast" => (towards * apart + aside).normalize() * reach1.max(reach2) * random.magnitude(1.0, 3.0),
        "separating" => (aside * 0.5 - towards * apart) * random.range(0.1, 2.0),
        "resting" if random.chance(0.5) => random.direction() * random.range(0.0, 2.0) * (reach1 + reach2),
        "overlap" => random.direction() * random.range(0.0, 1.0) * (reach1 + reach2),
        _ => (towards * apart + aside) * random.range(0.4, 2.5),
    };
    if name == "parallel" && random.chance(0.4) {
        // Motion straight along an axis, so that faces meet or slide exactly.
        let axis = DVec3::AXES[random.below(3)];
        motion = axis * motion.dot(axis);
    }
    if random.chance(0.01) {
        motion = DVec3::ZERO;
    }
    let turning = if name == "parallel" || name == "thin" { 0.3 } else { 0.8 };
    let share = if count2 > 0 { random.range(0.0, 1.0) } else { 1.0 };
    let wobble1 = random.chance(turning);
    set_motion(random, &mut first, motion * share, wobble1, sizes[0]);
    if count2 > 0 {
        let wobble2 = random.chance(turning);
        set_motion(random, &mut second, motion * (share - 1.0), wobble2, sizes[1]);
    }
    for ball in &mut second {
        ball.center += place;
    }

    // Shift the second body until both just touch.
    let mut difference = Difference::new(&first, &second);
    let size = reach1.max(reach2);
    let nudge = match name {
        "grazing" => graze(random, &mut difference, size),
        "resting" => {
            let wanted = size * random.range(-1.0, 1.0) * if random.chance(0.8) { 1e-5 } else { 1e-6 };
            (0..4).map(|_| settle(&mut difference, 0.0, wanted)).sum()
        }
        _ => DVec3::ZERO,
    };
    let origin = if name == "far" { random.direction() * random.range(500.0, 5000.0) } else { DVec3::ZERO };
    let round = |balls: &[Ball], by: DVec3| -> Vec<(Sphere, Vec3)> {
        balls.iter().map(|b| (Sphere::new((b.center + by).as_vec3(), b.radius as f32), b.motion.as_vec3())).collect()
    };
    Pair {
        category,
        first: round(&first, origin),
        second: if count2 > 0 {
            Second::Hull(round(&second, origin + nudge))
        } else {
            Second::Box(Placed {
                center: (place + origin + nudge).as_vec3(),
                rotation: rotation.as_quat(),
                half: half.as_vec3(),
            })
        },
    }
}

fn point_of(random: &mut Random, balls: &[Ball]) -> DVec3 {
    let weights: Vec<f64> = balls.iter().map(|_| random.range(0.0, 1.0)).collect();
    balls.iter().zip(&weights).map(|(ball, weight)| ball.center * *weight).sum::<DVec3>() / weights.iter().sum::<f64>()
}

/// Shifts the second body along the direction of the shortest distance until the distance is `wanted`.
fn settle(difference: &mut Difference, fraction: f64, wanted: f64) -> DVec3 {
    let now = difference.at(fraction).distance();
    let shift = now.normal.normalize_or(DVec3::Y) * (wanted - now.lower);
    difference.shift(shift);
    shift
}

/// Shifts the second body until the smallest distance over the step is within about 1e-3 of zero, in sizes of the pair.
fn graze(random: &mut Random, difference: &mut Difference, size: f64) -> DVec3 {
    let wanted = size * random.magnitude(-6.0, -3.0) * if random.chance(0.5) { 1.0 } else { -1.0 };
    let mut shift = DVec3::ZERO;
    for samples in [12, 8, 8] {
        // The smallest of a few samples, then a finer search around it.
        let distance = |t: f64| difference.at(t).distance().lower;
        let best = (0..=samples)
            .map(|i| f64::from(i) / f64::from(samples))
            .map(|t| (distance(t), t))
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .map_or(0.0, |best| best.1);
        let (mut low, mut high) =
            ((best - 1.0 / f64::from(samples)).max(0.0), (best + 1.0 / f64::from(samples)).min(1.0));
        for _ in 0..14 {
            let (a, b) = (low + (high - low) * 0.4, low + (high - low) * 0.6);
            if distance(a) < distance(b) { high = b } else { low = a }
        }
        shift += settle(difference, (low + high) * 0.5, wanted);
    }
    shift
}

/// Gives every vertex the motion of the body. If `turning`, each vertex also moves by the chord of a rotation, or by a random stretch.
fn set_motion(random: &mut Random, balls: &mut [Ball], motion: DVec3, turning: bool, size: f64) {
    let rotation = DQuat::from_axis_angle(random.direction(), random.range(-1.5, 1.5));
    let stretch = random.chance(0.5);
    for ball in balls {
        ball.motion = motion;
        if turning {
            ball.motion += if stretch { cube(random) * size * 0.5 } else { rotation * ball.center - ball.center };
        }
    }
}

fn random_hull(random: &mut Random, category: &str, count: usize, size: f64) -> Vec<Ball> {
    let mut balls: Vec<Ball> = (0..count)
        .map(|_| Ball {
            center: cube(random) * 0.7 * size,
            radius: random.range(0.02, 0.3) * size,
            motion: DVec3::ZERO,
        })
        .collect();
    match category {
        "thin" => balls.iter_mut().for_each(|b| b.radius = size * random.magnitude(-3.5, -2.5)),
        "sharp" => {
            let keep = random.below(2 * count);
            for (i, ball) in balls.iter_mut().enumerate() {
                if i != keep || random.chance(0.5) {
                    ball.radius = 0.0;
                }
            }
        }
        "parallel" => {
            let axis = random.below(3);
            let start = balls[0].center;
            for (i, ball) in balls.iter_mut().enumerate().skip(1) {
                ball.center = start + DVec3::AXES[(axis + i) % 3] * size * random.range(0.1, 1.2);
            }
            if random.chance(0.6) {
                let radius = balls[0].radius;
                balls.iter_mut().for_each(|b| b.radius = radius);
            }
        }
        "near_degenerate" | "degenerate" if count > 1 => {
            let near = category == "near_degenerate";
            degenerate(random, &mut balls, near, size);
        }
        _ => {}
    }
    balls
}

/// Puts the last sphere into the hull of the others. If `near`, it is only inside or outside by a small distance.
fn degenerate(random: &mut Random, balls: &mut [Ball], near: bool, size: f64) {
    let last = balls.len() - 1;
    let hair =
        if near { size * random.magnitude(-6.0, -2.0) * if random.chance(0.7) { 1.0 } else { -1.0 } } else { 0.0 };
    balls[0].radius = random.range(0.1, 1.2) * size;
    let aside = random.direction();
    if last == 1 || random.chance(0.3) {
        // Inside the first sphere: near its surface, or anywhere.
        let small = balls[0].radius * random.range(0.02, 0.95);
        let room = balls[0].radius - small;
        let room = if near { room + hair } else { room * random.range(0.0, 0.999) };
        balls[last] = Ball { center: balls[0].center + aside * room, radius: small, ..balls[last] };
    } else {
        // Near the hull of the first two: on their axis, with a larger or smaller radius, or beside the axis.
        let (a, b) = (balls[0], balls[1]);
        let t = random.range(0.0, 1.0);
        let radius = a.radius + (b.radius - a.radius) * t;
        let small = match random.below(3) {
            0 => radius,
            1 => radius * random.range(1.0, 1.5),
            _ => radius * random.range(0.1, 1.0),
        };
        let room = if random.chance(0.5) { 0.0 } else { (radius - small).max(0.0) };
        balls[2] = Ball { center: a.center.lerp(b.center, t) + aside * (room + hair), radius: small, ..a };
        if !near && random.chance(0.1) {
            balls[2] = if random.chance(0.5) { a } else { Ball { radius: b.radius * 0.5, ..b } };
        }
    }
    let turn = random.below(last + 1);
    balls.rotate_left(turn);
}
