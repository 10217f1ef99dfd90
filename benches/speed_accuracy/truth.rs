//! The exact first touch of two triangle meshes: conservative advancement in f64, of triangles against triangles.
//!
//! The method is independent of the library's kernels: it uses no medial spheres and no closed forms for motion. A pair of triangles is advanced by a
//! time in which it cannot touch, until its distance is at most [`TOUCH`]. Trees of bounding spheres give the order of the pairs, and end the search
//! when no remaining pair can touch earlier.

use std::{
    cmp::{Ordering, Reverse},
    collections::BinaryHeap,
};

use bevy_medial::{builder::TriangleMesh, geometry::Sweep};
use glam::{DQuat, DVec3};

/// Distance at which triangles touch, in metres.
pub const TOUCH: f64 = 1e-9;

/// A triangle mesh with a tree over its triangles.
pub struct ExactMesh {
    triangles: Vec<[DVec3; 3]>,
    /// Nodes in depth-first order: the left child follows its parent.
    nodes: Vec<Node>,
}

struct Node {
    center: DVec3,
    radius: f64,
    kind: Kind,
}

enum Kind {
    Triangle(usize),
    /// Index of the right child.
    Inner(usize),
}

impl ExactMesh {
    /// Builds the tree over all triangles of a mesh.
    pub fn new(mesh: &TriangleMesh) -> Self {
        let triangles = mesh.triangles.iter().map(|t| mesh.corners(*t).map(|p| p.as_dvec3())).collect();
        let mut exact = Self { triangles, nodes: Vec::new() };
        let mut order: Vec<usize> = (0..exact.triangles.len()).collect();
        if !order.is_empty() {
            exact.split(&mut order);
        }
        exact
    }

    fn split(&mut self, order: &mut [usize]) {
        let corners = || order.iter().flat_map(|&t| self.triangles[t]);
        let (min, max) =
            corners().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(min, max), p| (min.min(p), max.max(p)));
        let center = (min + max) * 0.5;
        let radius = corners().map(|p| p.distance(center)).fold(0.0, f64::max);
        let at = self.nodes.len();
        if let [triangle] = order {
            self.nodes.push(Node { center, radius, kind: Kind::Triangle(*triangle) });
            return;
        }
        self.nodes.push(Node { center, radius, kind: Kind::Inner(0) });
        let axis = (max - min).max_position();
        let key = |t: &usize| self.triangles[*t].iter().map(|p| p[axis]).sum::<f64>();
        let middle = order.len() / 2;
        order.select_nth_unstable_by(middle, |a, b| key(a).total_cmp(&key(b)));
        let (left, right) = order.split_at_mut(middle);
        self.split(left);
        self.nodes[at].kind = Kind::Inner(self.nodes.len());
        self.split(right);
    }
}

/// A rigid motion over fractions from 0 to 1: the centre of mass on a line, the rotation at a constant rate.
#[derive(Clone, Copy)]
pub struct Motion {
    center: DVec3,
    rotation: DQuat,
    local_center: DVec3,
    velocity: DVec3,
    spin: DVec3,
}

impl Motion {
    /// The same motion as a sweep.
    pub fn new(sweep: &Sweep) -> Self {
        let rotation = sweep.start.rotation.as_dquat().normalize();
        let local_center = sweep.local_center.as_dvec3();
        Self {
            center: sweep.start.translation.as_dvec3() + rotation * local_center,
            rotation,
            local_center,
            velocity: sweep.translation.as_dvec3(),
            spin: sweep.rotation.as_dvec3(),
        }
    }

    /// The motion of a body that rests at its pose of an instant.
    pub fn frozen(&self, fraction: f64) -> Self {
        let (rotation, center) = self.frame(fraction);
        Self { center, rotation, velocity: DVec3::ZERO, spin: DVec3::ZERO, ..*self }
    }

    fn frame(&self, fraction: f64) -> (DQuat, DVec3) {
        (DQuat::from_scaled_axis(self.spin * fraction) * self.rotation, self.center + self.velocity * fraction)
    }

    fn point(&self, fraction: f64, local: DVec3) -> DVec3 {
        let (rotation, center) = self.frame(fraction);
        center + rotation * (local - self.local_center)
    }

    /// Velocity of the body at a point of the world at an instant, in metres per step.
    pub fn velocity_at(&self, fraction: f64, point: DVec3) -> DVec3 {
        self.velocity + self.spin.cross(point - self.center - self.velocity * fraction)
    }

    fn arm(&self, local: DVec3) -> f64 {
        local.distance(self.local_center)
    }
}

/// The first touch of two meshes.
#[derive(Clone, Copy, Debug)]
pub struct Touch {
    /// Fraction of the step.
    pub fraction: f64,
    /// Contact point in the world.
    pub point: DVec3,
    /// Unit normal from the first to the second.
    pub normal: DVec3,
}

/// Two nodes that do not touch before a fraction.
struct Entry {
    from: f64,
    nodes: [usize; 2],
}

impl PartialEq for Entry {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Entry {}

impl PartialOrd for Entry {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Entry {
    fn cmp(&self, other: &Self) -> Ordering {
        // At equal times, larger indices come first: these nodes are deeper, so the search reaches triangles sooner.
        self.from.total_cmp(&other.from).then(other.nodes.cmp(&self.nodes))
    }
}

/// The first fraction of the step, up to `limit`, at which two meshes come within `margin` metres of each other. They must not overlap at the start.
pub fn first_touch([mesh1, mesh2]: [&ExactMesh; 2], motions: &[Motion; 2], margin: f64, limit: f64) -> Option<Touch> {
    let mut best: Option<Touch> = None;
    let mut queue = BinaryHeap::from([Reverse(Entry { from: 0.0, nodes: [0, 0] })]);
    while let Some(Reverse(Entry { from, nodes: [i, j] })) = queue.pop() {
        let limit = best.map_or(limit, |touch| touch.fraction);
        if best.is_some() && from >= limit {
            break;
        }
        let (a, b) = (&mesh1.nodes[i], &mesh2.nodes[j]);
        let children = match (&a.kind, &b.kind) {
            (Kind::Triangle(first), Kind::Triangle(second)) => {
                let triangles = [&mesh1.triangles[*first], &mesh2.triangles[*second]];
                let touch = triangles_touch(triangles, motions, margin, [from, limit]);
                best = touch.filter(|t| best.is_none_or(|b| t.fraction < b.fraction)).or(best);
                continue;
            }
            (Kind::Inner(right), other) if a.radius >= b.radius || matches!(other, Kind::Triangle(_)) => {
                [[i + 1, j], [*right, j]]
            }
            (_, Kind::Inner(right)) => [[i, j + 1], [i, *right]],
            (Kind::Inner(right), _) => [[i + 1, j], [*right, j]],
        };
        for nodes in children {
            let spheres = [&mesh1.nodes[nodes[0]], &mesh2.nodes[nodes[1]]];
            queue.extend(
                spheres_from(spheres, motions, margin, [from, limit]).map(|from| Reverse(Entry { from, nodes })),
            );
        }
    }
    best
}

/// A fraction before which two nodes do not touch. `None` if they do not touch up to `limit`.
fn spheres_from([a, b]: [&Node; 2], motions: &[Motion; 2], margin: f64, [from, limit]: [f64; 2]) -> Option<f64> {
    const ROUNDS: usize = 6;
    let turns =
        motions[0].spin.length() * motions[0].arm(a.center) + motions[1].spin.length() * motions[1].arm(b.center);
    let mut time = from;
    for _ in 0..ROUNDS {
        let offset = motions[1].point(time, b.center) - motions[0].point(time, a.center);
        let distance = offset.length();
        let gap = distance - a.radius - b.radius - margin;
        if gap <= 0.0 {
            break;
        }
        let speed = (motions[0].velocity - motions[1].velocity).dot(offset / distance) + turns;
        if speed <= 0.0 {
            return None;
        }
        time += gap / speed;
        if time > limit {
            return None;
        }
    }
    Some(time)
}

/// The first time at which two triangles come within the margin.
fn triangles_touch(
    triangles: [&[DVec3; 3]; 2],
    motions: &[Motion; 2],
    margin: f64,
    [from, limit]: [f64; 2],
) -> Option<Touch> {
    let arm = |side: usize| triangles[side].iter().map(|p| motions[side].arm(*p)).fold(0.0, f64::max);
    let acceleration = [0, 1].map(|side| motions[side].spin.length_squared() * arm(side)).iter().sum::<f64>();
    let mut time = from;
    loop {
        let placed = [0, 1].map(|side: usize| {
            let (rotation, center) = motions[side].frame(time);
            triangles[side].map(|p| center + rotation * (p - motions[side].local_center))
        });
        let [point1, point2] = closest_points(&placed[0], &placed[1]);
        let distance = point1.distance(point2);
        let gap = distance - margin;
        let normal = (point2 - point1) / distance;
        if gap <= TOUCH {
            return (distance > 0.0).then_some(Touch { fraction: time, point: (point1 + point2) * 0.5, normal });
        }
        // The max speed of the corners along the normal at this time. Later it grows by no more than the acceleration.
        let forward = |side: usize, normal: DVec3| {
            let speeds = placed[side].map(|p| motions[side].velocity_at(time, p).dot(normal));
            speeds.into_iter().fold(f64::NEG_INFINITY, f64::max)
        };
        let speed = forward(0, normal) + forward(1, -normal);
        let root = speed + (speed * speed + 2.0 * acceleration * gap).sqrt();
        if root <= 0.0 {
            return None;
        }
        time += 2.0 * gap / root;
        if time > limit {
            return None;
        }
    }
}

/// The closest points of two triangles that do not cross.
fn closest_points(first: &[DVec3; 3], second: &[DVec3; 3]) -> [DVec3; 2] {
    let mut best = (f64::INFINITY, [DVec3::ZERO; 2]);
    let mut look = |points: [DVec3; 2]| {
        let square = points[0].distance_squared(points[1]);
        if square < best.0 {
            best = (square, points);
        }
    };
    for i in 0..3 {
        for j in 0..3 {
            look(closest_of_segments([first[i], first[(i + 1) % 3]], [second[j], second[(j + 1) % 3]]));
        }
    }
    for corner in 0..3 {
        if let Some(foot) = foot_within(first, second[corner]) {
            look([foot, second[corner]]);
        }
        if let Some(foot) = foot_within(second, first[corner]) {
            look([first[corner], foot]);
        }
    }
    best.1
}

/// The projection of a point onto the plane of a triangle, if it lies within the triangle.
fn foot_within([a, b, c]: &[DVec3; 3], point: DVec3) -> Option<DVec3> {
    let normal = (b - a).cross(c - a);
    let square = normal.length_squared();
    if square == 0.0 {
        return None;
    }
    let inside = [(a, b), (b, c), (c, a)].iter().all(|(p, q)| (*q - *p).cross(point - *p).dot(normal) >= 0.0);
    inside.then(|| point - normal * ((point - *a).dot(normal) / square))
}

/// The closest points of two segments.
fn closest_of_segments([p1, q1]: [DVec3; 2], [p2, q2]: [DVec3; 2]) -> [DVec3; 2] {
    let (d1, d2, r) = (q1 - p1, q2 - p2, p1 - p2);
    let (a, e, b, c, f) = (d1.dot(d1), d2.dot(d2), d1.dot(d2), d1.dot(r), d2.dot(r));
    let ratio = |value: f64, square: f64| if square > 0.0 { (value / square).clamp(0.0, 1.0) } else { 0.0 };
    let mut s = ratio(b * f - c * e, a * e - b * b);
    let t = ratio(b * s + f, e);
    s = ratio(b * t - c, a);
    [p1 + d1 * s, p2 + d2 * t]
}

/// True if bisection confirms a first touch: it searches for the time at which the meshes at rest come within 1 µm of each other. `speed` is the
/// relative speed of the meshes at the contact point, in metres per step.
pub fn is_confirmed(meshes: [&ExactMesh; 2], motions: &[Motion; 2], touch: &Touch, speed: f64) -> bool {
    const HAIR: f64 = 1e-6;
    let within = |time: f64| first_touch(meshes, &motions.map(|m| m.frozen(time)), HAIR, 1.0).is_some();
    if !within(touch.fraction) || within(0.0) {
        return false;
    }
    let [mut before, mut after] = [0.0, touch.fraction];
    for _ in 0..30 {
        let middle = 0.5 * (before + after);
        if within(middle) { after = middle } else { before = middle }
    }
    // The tolerance is 1 cm of path, because a graze is within `HAIR` long before it touches.
    let left = (touch.fraction - after) * speed;
    left <= 1e-2
}
