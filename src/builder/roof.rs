//! The exact medial mesh of a convex region.
//!
//! The balls `(x, r)` inside the region satisfy `n . x + r <= d` for each of its planes. So they form a convex polytope in four dimensions, a roof over the
//! region:
//!
//! ```text
//!      r |   *-----*         *  corner: a sphere of the medial mesh
//!        |  /       \        the face between two planes: a sheet of the medial axis, on which the radius changes linearly
//!  floor | *---------*
//!        +------------- x
//! ```
//!
//! Slabs between the corners of a sheet reproduce it exactly. The floor is the radius of the rounded edges.

use std::f64::consts::TAU;

use glam::{DVec3, DVec4};

use super::hull::Ball;
use crate::geometry::Primitive;

/// Distances below this part of the diagonal are zero.
pub(super) const CLOSE: f64 = 1e-5;

/// A plane with its unit normal, which points out of a region.
#[derive(Clone, Copy, Debug)]
pub(super) struct Plane {
    pub normal: DVec3,
    pub offset: f64,
}

impl Plane {
    /// Distance of a point above the plane.
    pub fn height(&self, point: DVec3) -> f64 {
        self.normal.dot(point) - self.offset
    }

    /// The same plane with the opposite normal.
    pub fn flipped(&self) -> Self {
        Self { normal: -self.normal, offset: -self.offset }
    }
}

/// Balls with `normal . (x, r) <= offset`.
#[derive(Clone, Copy)]
struct Bound {
    normal: DVec4,
    offset: f64,
}

/// Centre and radius of a ball, and one bit for each bound that it touches.
#[derive(Clone, Copy)]
struct Corner {
    ball: DVec4,
    tight: u128,
}

/// The balls inside a convex region, with a smallest radius.
#[derive(Clone)]
pub(super) struct Roof {
    bounds: Vec<Bound>,
    corners: Vec<Corner>,
}

impl Roof {
    /// `None` if there is no such ball, or if the region has too many planes.
    pub fn new(planes: &[Plane], floor: f64) -> Option<Self> {
        // Balls in a simplex around the solid, whose diagonal is 1.
        const FAR: f64 = 2.0;
        let axes = [DVec4::X, DVec4::Y, DVec4::Z];
        let mut bounds: Vec<Bound> = axes.iter().map(|&axis| Bound { normal: -axis, offset: FAR }).collect();
        bounds.push(Bound { normal: DVec4::NEG_W, offset: -floor });
        bounds.push(Bound { normal: DVec4::new(1.0, 1.0, 1.0, 2.0), offset: 3.0 * FAR });
        let least = DVec4::new(-FAR, -FAR, -FAR, floor);
        let extent = 6.0 * FAR - 2.0 * floor;
        let others = [DVec4::X, DVec4::Y, DVec4::Z, 0.5 * DVec4::W].map(|axis| least + extent * axis);
        let balls = others.into_iter().chain([least]);
        let corners = balls.enumerate().map(|(without, ball)| Corner { ball, tight: 0b11111 & !(1 << without) });
        let mut roof = Self { corners: corners.collect(), bounds };
        planes.iter().all(|plane| roof.cut(plane)).then_some(roof)
    }

    /// The balls of the part of the region below a plane. `None` if there is no such ball, or if the part has too many planes.
    pub fn below(&self, plane: &Plane) -> Option<Self> {
        let mut part = self.clone();
        part.cut(plane).then_some(part)
    }

    /// Removes the balls that protrude from a plane. Returns false if none is left.
    fn cut(&mut self, plane: &Plane) -> bool {
        let bound = Bound { normal: plane.normal.extend(1.0), offset: plane.offset };
        let heights: Vec<f64> = self.corners.iter().map(|c| bound.normal.dot(c.ball) - bound.offset).collect();
        if heights.iter().all(|&height| height < -CLOSE) {
            return true;
        }
        let slot = self.corners.iter().fold(0, |used, corner| used | corner.tight).trailing_ones();
        let Some(bit) = 1u128.checked_shl(slot) else { return false };
        self.bounds.resize(self.bounds.len().max(slot as usize + 1), bound);
        self.bounds[slot as usize] = bound;
        let mut corners = vec![];
        for (below, _) in heights.iter().enumerate().filter(|(_, height)| **height < -CLOSE) {
            for (above, _) in heights.iter().enumerate().filter(|(_, height)| **height > CLOSE) {
                if let Some(tight) = self.edge(below, above) {
                    let along = heights[below] / (heights[below] - heights[above]);
                    let ball = self.corners[below].ball.lerp(self.corners[above].ball, along);
                    corners.push(Corner { ball, tight: tight | bit });
                }
            }
        }
        let old = self.corners.iter().zip(&heights).filter(|(_, height)| **height <= CLOSE);
        let touching = |height: f64| if height < -CLOSE { 0 } else { bit };
        corners.extend(old.map(|(c, &height)| Corner { tight: c.tight | touching(height), ..*c }));
        self.corners = corners;
        heights.iter().any(|&height| height < -CLOSE)
    }

    /// The bounds of the edge between two corners, if there is one.
    fn edge(&self, from: usize, to: usize) -> Option<u128> {
        let common = self.corners[from].tight & self.corners[to].tight;
        let holds = |at: usize| at == from || at == to || self.corners[at].tight & common != common;
        (common.count_ones() >= 3 && (0..self.corners.len()).all(holds)).then_some(common)
    }

    /// The planes of the region that a ball touches, with their bits.
    fn sides(&self) -> impl Iterator<Item = (Plane, u128)> {
        let used = self.corners.iter().fold(0, |used, corner| used | corner.tight);
        let sides = self.bounds.iter().enumerate().map(|(slot, bound)| (bound, 1 << slot));
        let sides = sides.filter(move |(bound, bit)| bound.normal.w == 1.0 && used & bit != 0);
        sides.map(|(bound, bit)| (Plane { normal: bound.normal.truncate(), offset: bound.offset }, bit))
    }

    /// The planes of the region without those that bound nothing.
    pub fn planes(&self) -> Vec<Plane> {
        self.sides().map(|(plane, _)| plane).collect()
    }

    /// The corners.
    pub fn balls(&self) -> impl Iterator<Item = Ball> {
        self.corners.iter().map(|corner| Ball { center: corner.ball.truncate(), radius: corner.ball.w })
    }

    /// The largest ball.
    pub fn largest(&self) -> Ball {
        let first = Ball { center: DVec3::ZERO, radius: 0.0 };
        self.balls().fold(first, |most, ball| if ball.radius > most.radius { ball } else { most })
    }

    /// Slabs of all sheets, between corners.
    pub fn slabs(&self) -> Vec<Primitive> {
        let sides: Vec<(Plane, u128)> = self.sides().collect();
        let mut slabs = vec![];
        for (at, (first, bit)) in sides.iter().enumerate() {
            for (second, other) in &sides[at + 1..] {
                let across = (first.normal - second.normal).normalize_or_zero();
                slabs.extend(self.fan(|corner| corner.tight & bit != 0 && corner.tight & other != 0, across));
            }
        }
        slabs.retain(|slab| slab.indices().len() == 3);
        slabs
    }

    /// The primitives of the largest balls, without the slopes of the roof.
    pub fn ridge(&self) -> Vec<Primitive> {
        let most = self.largest().radius;
        let is_top = |corner: &Corner| corner.ball.w > most - CLOSE;
        let top: Vec<DVec3> = self.corners.iter().filter(|c| is_top(c)).map(|c| c.ball.truncate()).collect();
        let from_first = top.iter().map(|point| point - top[0]);
        let across = from_first.clone().zip(from_first.skip(1)).map(|(a, b)| a.cross(b));
        let across = across.max_by(|a, b| a.length_squared().total_cmp(&b.length_squared())).unwrap_or_default();
        self.fan(is_top, across.normalize_or_zero())
    }

    /// The convex polygon of some corners, which lie in a plane with the normal `across`, as slabs; or the cone of two corners, or a single sphere.
    fn fan(&self, takes: impl Fn(&Corner) -> bool, across: DVec3) -> Vec<Primitive> {
        let chosen = (0..self.corners.len()).filter(|&i| takes(&self.corners[i]));
        let mut corners: Vec<(f64, u32)> = chosen.map(|i| (0.0, i as u32)).collect();
        match corners[..] {
            [] => vec![],
            [(_, a)] => vec![Primitive::Sphere([a])],
            [(_, a), (_, b)] => vec![Primitive::Cone([a, b])],
            _ => {
                let point = |i: u32| self.corners[i as usize].ball.truncate();
                let middle = corners.iter().map(|&(_, i)| point(i)).sum::<DVec3>() / corners.len() as f64;
                let (x, y) = across.any_orthonormal_pair();
                for (angle, i) in &mut corners {
                    let out = point(*i) - middle;
                    *angle = out.dot(y).atan2(out.dot(x)).rem_euclid(TAU);
                }
                corners.sort_by(|a, b| a.0.total_cmp(&b.0));
                let first = corners[0].1;
                let mut fan: Vec<[u32; 3]> =
                    corners[1..].windows(2).map(|pair| [first, pair[0].1, pair[1].1]).collect();
                fan.iter_mut().for_each(|slab| slab.sort_unstable());
                fan.into_iter().map(Primitive::Slab).collect()
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{geometry::Sphere, medial_axis::oracle::Envelope, random::Random};

    fn plane(normal: DVec3, offset: f64) -> Plane {
        Plane { normal: normal.normalize(), offset }
    }

    #[test]
    fn slabs_fill_random_regions() {
        const FLOOR: f64 = 0.01;
        let mut random = Random(3);
        let (mut inside, mut outside) = (0, 0);
        for number in 0..40 {
            // Few planes far apart, and cubes with many corners cut off.
            let mut planes: Vec<Plane> = (0..2 + number % 10)
                .map(|_| plane(random.in_cube().as_dvec3(), 0.1 + 0.25 * random.unit_f64()))
                .collect();
            planes.extend(DVec3::AXES.iter().flat_map(|&axis| [plane(axis, 0.3), plane(-axis, 0.25)]));
            let roof = Roof::new(&planes, FLOOR).unwrap();
            assert!(roof.planes().len() <= planes.len());
            let spheres: Vec<Sphere> = roof.balls().map(|b| Sphere::new(b.center.as_vec3(), b.radius as f32)).collect();
            let envelope = Envelope::new(&spheres, &roof.slabs());
            for _ in 0..2_000 {
                let point = random.in_cube().as_dvec3() * 0.4;
                let height = planes.iter().map(|plane| plane.height(point)).fold(f64::NEG_INFINITY, f64::max);
                let distance = envelope.distance(point);
                if height < -FLOOR {
                    inside += 1;
                    assert!(distance < 1e-5, "{number}: a gap of {distance} at {point}, {height}");
                } else if height > 0.0 {
                    outside += 1;
                    assert!(distance > height - 1e-5, "{number}: {distance} at {point}, {height}");
                }
            }
        }
        assert!(inside > 10_000 && outside > 10_000, "{inside} {outside}");
    }

    #[test]
    fn regions_without_a_ball_have_no_roof() {
        let slit = |width: f64| [plane(DVec3::X, 0.0), plane(DVec3::NEG_X, width)];
        assert!(Roof::new(&slit(0.1), 0.0).is_some());
        for (width, floor) in [(-0.1, 0.0), (0.0, 0.0), (0.1, 0.06)] {
            assert!(Roof::new(&slit(width), floor).is_none(), "{width} {floor}");
        }
        // More planes than a roof can have: a sphere of facets.
        let mut random = Random(4);
        let many: Vec<Plane> = (0..200).map(|_| plane(random.in_cube().as_dvec3(), 0.3)).collect();
        assert!(Roof::new(&many[..60], 0.0).is_some() && Roof::new(&many, 0.0).is_none());
    }
}
