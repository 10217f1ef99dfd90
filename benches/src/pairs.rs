//! Moving primitives: those of a shape, and pairs from a file. `examples/pairs.rs` documents the format of the file.

use std::{
    collections::{HashMap, hash_map::Entry},
    fmt,
};

use bevy_medial::{
    geometry::{Pose3, Sphere},
    medial_axis::MedialAxis,
    pipeline::{Hull, Shape},
    query::{Cuboid, Moving, MovingPair},
};
use glam::{DQuat, DVec3, Quat, Vec3};

/// A moving primitive.
#[derive(Clone, Copy)]
pub enum Primitive {
    Sphere(Moving<1>),
    Cone(Moving<2>),
    Slab(Moving<3>),
}

/// The second side of a pair.
#[derive(Clone, Copy)]
pub enum Second {
    Primitive(Primitive),
    Box { half: Vec3 },
}

/// A pair in relative coordinates.
pub struct Pair {
    /// The kinds of both sides, and the category.
    pub labels: [String; 2],
    pub first: Primitive,
    pub second: Second,
}

/// Calls a generic function with the content of two primitives of a type with the variants `Sphere`, `Cone` and `Slab`.
#[macro_export]
macro_rules! for_primitives {
    ($kinds:ident: $first:expr, $second:expr, |$a:ident, $b:ident| $body:expr) => {
        match ($first, $second) {
            ($kinds::Sphere($a), $kinds::Sphere($b)) => $body,
            ($kinds::Sphere($a), $kinds::Cone($b)) => $body,
            ($kinds::Sphere($a), $kinds::Slab($b)) => $body,
            ($kinds::Cone($a), $kinds::Sphere($b)) => $body,
            ($kinds::Cone($a), $kinds::Cone($b)) => $body,
            ($kinds::Cone($a), $kinds::Slab($b)) => $body,
            ($kinds::Slab($a), $kinds::Sphere($b)) => $body,
            ($kinds::Slab($a), $kinds::Cone($b)) => $body,
            ($kinds::Slab($a), $kinds::Slab($b)) => $body,
        }
    };
}

impl Primitive {
    /// The primitive, if it has `N` spheres.
    pub(crate) fn moving<const N: usize>(&self) -> Option<Moving<N>> {
        let (start, motion): (&[Sphere], &[Vec3]) = match self {
            Primitive::Sphere(moving) => (&moving.start, &moving.motion),
            Primitive::Cone(moving) => (&moving.start, &moving.motion),
            Primitive::Slab(moving) => (&moving.start, &moving.motion),
        };
        Some(Moving { start: start.try_into().ok()?, motion: motion.try_into().ok()? })
    }
}

/// The primitives of a shape, with spheres that move on lines from their start to their end.
pub fn moving_primitives(shape: &Shape, poses: [&Pose3; 2]) -> impl Iterator<Item = Primitive> {
    (0..shape.len() as u32).map(move |primitive| match shape.hull(primitive) {
        Hull::Sphere(spheres) => Primitive::Sphere(between(spheres, poses)),
        Hull::Cone(spheres) => Primitive::Cone(between(spheres, poses)),
        Hull::Slab(spheres) => Primitive::Slab(between(spheres, poses)),
    })
}

fn between<const N: usize>(spheres: [Sphere; N], [start, end]: [&Pose3; 2]) -> Moving<N> {
    let placed = spheres.map(|sphere| Sphere::new(start.transform_point(sphere.center), sphere.radius));
    Moving { start: placed, motion: std::array::from_fn(|i| end.transform_point(spheres[i].center) - placed[i].center) }
}

/// Boxes as medial meshes of slabs, by the bits of their half extents.
#[derive(Default)]
pub struct Boxes(HashMap<[u32; 3], Shape>);

impl Boxes {
    /// The box with these half extents. `None` if they are not valid.
    pub fn shape(&mut self, half: Vec3) -> Option<Shape> {
        match self.0.entry(half.to_array().map(f32::to_bits)) {
            Entry::Occupied(known) => Some(known.get().clone()),
            Entry::Vacant(new) => Some(new.insert(Shape::new(MedialAxis::rounded_box(half, 0.0).ok()?)).clone()),
        }
    }
}

/// The pairs of primitives with `N` and `M` spheres.
pub fn of_kind<'a, const N: usize, const M: usize>(pairs: impl IntoIterator<Item = &'a Pair>) -> Vec<MovingPair<N, M>> {
    let moving = |pair: &Pair| match pair.second {
        Second::Primitive(second) => Some((pair.first.moving()?, second.moving()?)),
        Second::Box { .. } => None,
    };
    pairs.into_iter().filter_map(moving).collect()
}

/// The pairs of a primitive with `N` spheres and a box.
pub fn against_boxes<'a, const N: usize>(pairs: impl IntoIterator<Item = &'a Pair>) -> Vec<(Moving<N>, Cuboid)> {
    let against = |pair: &Pair| match pair.second {
        Second::Box { half } => Some((pair.first.moving()?, Cuboid { half })),
        Second::Primitive(_) => None,
    };
    pairs.into_iter().filter_map(against).collect()
}

/// The pairs in the text of a file. An error contains the number of its line.
pub fn read(text: &str) -> impl Iterator<Item = Result<Pair, (usize, LineError)>> {
    text.lines().enumerate().filter_map(|(index, line)| {
        let line = line.split('#').next().unwrap_or("").trim();
        (!line.is_empty()).then(|| parse(line).map_err(|error| (index + 1, error)))
    })
}

/// An error in a line.
#[derive(Debug)]
pub enum LineError {
    Fields(usize),
    Header(String),
    Kind { side: char, kind: String },
    Number { side: char, text: String },
    NotFinite { side: char, text: String },
    Count { side: char, kind: String, wanted: usize, found: usize },
    NegativeSize { side: char },
    Rotation,
}

impl fmt::Display for LineError {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            LineError::Fields(found) => {
                write!(f, "found {found} fields split by `|`, wanted at least 3: `category kindA kindB | A | B`")
            }
            LineError::Header(head) => write!(f, "`{head}` is not `category kindA kindB`"),
            LineError::Kind { side, kind } => {
                write!(f, "{side} has the unknown kind `{kind}`; the kinds are sphere, cone, slab and, for B, box")
            }
            LineError::Number { side, text } => write!(f, "{side}: `{text}` is not a number"),
            LineError::NotFinite { side, text } => write!(f, "{side}: `{text}` is not finite"),
            LineError::Count { side, kind, wanted, found } => {
                write!(f, "{side} is a {kind} of {found} numbers, wanted {wanted}")
            }
            LineError::NegativeSize { side } => write!(f, "{side} has a negative radius or half extent"),
            LineError::Rotation => write!(f, "B: the box's rotation is not a unit quaternion"),
        }
    }
}

fn parse(line: &str) -> Result<Pair, LineError> {
    let fields: Vec<&str> = line.split('|').collect();
    let [head, first, second, ..] = fields[..] else { return Err(LineError::Fields(fields.len())) };
    let head: Vec<&str> = head.split_whitespace().collect();
    let [category, kind1, kind2] = head[..] else { return Err(LineError::Header(head.join(" "))) };

    let first_numbers = numbers('A', first)?;
    let second_numbers = numbers('B', second)?;
    // Coordinates are relative to a centre of the first primitive, so that positions far from the origin lose no precision.
    let origin = first_numbers.get(..3).map_or(Vec3::ZERO, Vec3::from_slice);
    let (pose_rotation, pose_origin, second) = if kind2 == "box" {
        let [cx, cy, cz, qx, qy, qz, qw, hx, hy, hz] = count('B', kind2, &second_numbers)?;
        let rotation = Quat::from_xyzw(qx, qy, qz, qw);
        if (rotation.length() - 1.0).abs() > 1e-3 {
            return Err(LineError::Rotation);
        }
        let half = Vec3::new(hx, hy, hz);
        if half.min_element() < 0.0 {
            return Err(LineError::NegativeSize { side: 'B' });
        }
        // A box is at rest, so coordinates are those of its frame.
        (rotation.as_dquat().normalize().inverse(), Vec3::new(cx, cy, cz), Second::Box { half })
    } else {
        let second = primitive('B', kind2, &second_numbers, origin, DQuat::IDENTITY)?;
        (DQuat::IDENTITY, origin, Second::Primitive(second))
    };
    let first = primitive('A', kind1, &first_numbers, pose_origin, pose_rotation)?;
    Ok(Pair { labels: [format!("{kind1}-{kind2}"), category.into()], first, second })
}

fn numbers(side: char, text: &str) -> Result<Vec<f32>, LineError> {
    text.split_whitespace()
        .map(|word| {
            let number: f32 = word.parse().map_err(|_| LineError::Number { side, text: word.into() })?;
            if number.is_finite() { Ok(number) } else { Err(LineError::NotFinite { side, text: word.into() }) }
        })
        .collect()
}

fn count<const K: usize>(side: char, kind: &str, numbers: &[f32]) -> Result<[f32; K], LineError> {
    numbers.try_into().map_err(|_| LineError::Count { side, kind: kind.into(), wanted: K, found: numbers.len() })
}

fn primitive(side: char, kind: &str, numbers: &[f32], origin: Vec3, rotation: DQuat) -> Result<Primitive, LineError> {
    let wanted = match kind {
        "sphere" => 1,
        "cone" => 2,
        "slab" => 3,
        _ => return Err(LineError::Kind { side, kind: kind.into() }),
    };
    if numbers.len() != 7 * wanted {
        return Err(LineError::Count { side, kind: kind.into(), wanted: 7 * wanted, found: numbers.len() });
    }
    let spheres: Vec<(Sphere, Vec3)> = numbers
        .chunks_exact(7)
        .map(|n| {
            // In f64, so that the rotation into the frame of a box adds only one rounding.
            let turned = |v: DVec3| (rotation * v).as_vec3();
            let center = turned(Vec3::from_slice(n).as_dvec3() - origin.as_dvec3());
            (Sphere::new(center, n[3]), turned(Vec3::from_slice(&n[4..]).as_dvec3()))
        })
        .collect();
    if spheres.iter().any(|(sphere, _)| sphere.radius < 0.0) {
        return Err(LineError::NegativeSize { side });
    }
    Ok(match wanted {
        1 => Primitive::Sphere(moving(&spheres)),
        2 => Primitive::Cone(moving(&spheres)),
        _ => Primitive::Slab(moving(&spheres)),
    })
}

fn moving<const N: usize>(spheres: &[(Sphere, Vec3)]) -> Moving<N> {
    Moving { start: std::array::from_fn(|i| spheres[i].0), motion: std::array::from_fn(|i| spheres[i].1) }
}
