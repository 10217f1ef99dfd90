//! The shape in the making, and the distance of points to its envelope.

use std::{
    collections::{BTreeSet, HashSet},
    f64::consts::{PI, TAU},
    ops::Range,
};

use glam::DVec3;

use super::parallel;
use crate::geometry::Primitive;

/// A medial sphere in f64.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Ball {
    pub center: DVec3,
    pub radius: f64,
}

impl Ball {
    pub fn distance(&self, point: DVec3) -> f64 {
        self.center.distance(point) - self.radius
    }
}

/// Spheres joined by edges and faces. Edges are sorted pairs and include those of the faces.
#[derive(Clone, Debug, Default)]
pub(super) struct Complex {
    pub balls: Vec<Ball>,
    pub edges: Vec<[u32; 2]>,
    pub faces: Vec<[u32; 3]>,
}

/// The three edges of a face.
pub(super) fn edges_of([a, b, c]: [u32; 3]) -> [[u32; 2]; 3] {
    [[a, b], [b, c], [a, c]]
}

impl Complex {
    /// Faces, edges of no face, spheres of no edge.
    pub fn primitives(&self) -> Vec<Primitive> {
        let covered: HashSet<[u32; 2]> = self.faces.iter().flat_map(|&f| edges_of(f)).collect();
        let mut joined = vec![false; self.balls.len()];
        self.edges.iter().flatten().for_each(|&i| joined[i as usize] = true);
        let slabs = self.faces.iter().map(|&f| Primitive::Slab(f));
        let cones = self.edges.iter().filter(|e| !covered.contains(*e)).map(|&e| Primitive::Cone(e));
        let alone = (0..self.balls.len()).filter(|&i| !joined[i]).map(|i| Primitive::Sphere([i as u32]));
        slabs.chain(cones).chain(alone).collect()
    }

    /// Drops spheres that nothing refers to, and numbers the others anew.
    pub fn compact(&mut self, gone: &BTreeSet<u32>) {
        let mut next = 0;
        let numbers: Vec<u32> = (0..self.balls.len() as u32)
            .map(|i| {
                next += u32::from(!gone.contains(&i));
                next.saturating_sub(1)
            })
            .collect();
        let mut index = 0;
        self.balls.retain(|_| {
            index += 1;
            !gone.contains(&(index - 1))
        });
        self.edges.iter_mut().flatten().for_each(|i| *i = numbers[*i as usize]);
        self.faces.iter_mut().flatten().for_each(|i| *i = numbers[*i as usize]);
        self.edges.sort_unstable();
        self.faces.sort_unstable();
    }

    pub fn envelope(&self) -> Envelope {
        Envelope::of(&self.balls, self.primitives())
    }
}

/// The primitives of a complex, prepared for distances.
pub(super) struct Envelope {
    pub primitives: Vec<Primitive>,
    pub hulls: Vec<Hull>,
}

/// The primitive nearest to a point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Hit {
    /// Signed distance to the primitive, negative within.
    pub distance: f64,
    pub primitive: u32,
    /// Weights of the primitive's spheres, which blend to the sphere nearest to the point.
    pub weights: [f64; 3],
    /// Unit direction from the centre of that sphere to the point.
    pub normal: DVec3,
}

/// Points in an order in which neighbours are near, cut into blocks with a bound each.
#[derive(Default)]
pub(super) struct Points {
    pub positions: Vec<DVec3>,
    blocks: Vec<Ball>,
    lanes: Vec<Lanes>,
    /// Middles of the blocks of each group.
    middles: Vec<Lanes>,
}

const BLOCK: usize = 16;

/// Blocks that share a list of primitives: as many as fit one set of lanes.
const GROUP: usize = BLOCK;

/// More than distances in f32 are off.
const ROUNDING: f32 = 1e-5;

/// The points of a block, coordinate by coordinate; the last block is filled up with its last point.
#[derive(Clone, Copy)]
struct Lanes {
    x: [f32; BLOCK],
    y: [f32; BLOCK],
    z: [f32; BLOCK],
}

impl Lanes {
    fn new(points: &[DVec3]) -> Self {
        let at = |i: usize| points[i.min(points.len() - 1)].as_vec3();
        Self {
            x: std::array::from_fn(|i| at(i).x),
            y: std::array::from_fn(|i| at(i).y),
            z: std::array::from_fn(|i| at(i).z),
        }
    }
}

impl Points {
    pub fn new(positions: Vec<DVec3>) -> Self {
        let blocks: Vec<Ball> = positions.chunks(BLOCK).map(bound).collect();
        let lanes = positions.chunks(BLOCK).map(Lanes::new).collect();
        let middles = blocks.chunks(GROUP).map(|g| Lanes::new(&g.iter().map(|b| b.center).collect::<Vec<_>>()));
        let middles = middles.collect();
        Self { positions, blocks, lanes, middles }
    }

    /// The places of each block's points, and a ball around them.
    pub fn blocks(&self) -> impl Iterator<Item = (Range<usize>, &Ball)> {
        self.blocks.iter().enumerate().map(|(block, bound)| (self.range(block), bound))
    }

    /// Signed distances from a primitive, up to the rounding of an f32, of the points of those blocks that pass.
    pub fn distances<'a>(
        &'a self,
        hull: &'a Hull,
        passes: impl Fn(Range<usize>, f64) -> bool + 'a,
    ) -> impl Iterator<Item = (usize, f64)> + 'a {
        let near = self
            .blocks()
            .zip(&self.lanes)
            .filter(move |((range, bound), _)| passes(range.clone(), hull.distance(bound.center) - bound.radius));
        near.flat_map(|((range, _), lanes)| range.zip(hull.distances(lanes).map(f64::from)))
    }

    fn range(&self, block: usize) -> Range<usize> {
        block * BLOCK..self.positions.len().min((block + 1) * BLOCK)
    }
}

/// A ball around points.
fn bound(points: &[DVec3]) -> Ball {
    let (min, max) = points.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(lo, hi), &p| (lo.min(p), hi.max(p)));
    let center = (min + max) * 0.5;
    Ball { center, radius: points.iter().map(|p| p.distance(center)).fold(0.0, f64::max) }
}

/// A point on a primitive's surface: of the sphere at `weights` that in direction `normal`.
#[derive(Clone, Copy, Debug)]
pub(super) struct SurfacePoint {
    pub primitive: u32,
    pub weights: [f64; 3],
    pub normal: DVec3,
    /// The area that it stands for.
    pub area: f64,
}

impl Envelope {
    pub fn of(balls: &[Ball], primitives: Vec<Primitive>) -> Self {
        let hulls = primitives.iter().map(|p| Hull::new(balls, p)).collect();
        Self { primitives, hulls }
    }

    pub fn point(&self, s: &SurfacePoint) -> DVec3 {
        let ball = self.hulls[s.primitive as usize].blend(&s.weights);
        ball.center + s.normal * ball.radius
    }

    /// Points about `spacing` apart on the surfaces of all spheres, cones and slabs, be they visible or not.
    pub fn surface(&self, spacing: f64) -> Vec<SurfacePoint> {
        let mut points = self.sides(spacing);
        let mut seen = HashSet::new();
        for (primitive, (spheres, hull)) in (0..).zip(self.primitives.iter().zip(&self.hulls)) {
            for (at, &sphere) in spheres.indices().iter().enumerate() {
                if seen.insert(sphere) {
                    let mut weights = [0.0; 3];
                    weights[at] = 1.0;
                    sample_sphere(hull.blend(&weights).radius, spacing, |normal, area| {
                        points.push(SurfacePoint { primitive, weights, normal, area });
                    });
                }
            }
        }
        points
    }

    /// The same without the spheres.
    pub fn sides(&self, spacing: f64) -> Vec<SurfacePoint> {
        let mut points = vec![];
        for (primitive, hull) in (0..).zip(&self.hulls) {
            let mut push = |weights: [f64; 3], normal: DVec3, area: f64| {
                points.push(SurfacePoint { primitive, weights, normal, area });
            };
            match hull {
                Hull::Sphere(_) => {}
                Hull::Cone(cone) => cone.sample(spacing, |t, n, area| push([1.0 - t, t, 0.0], n, area)),
                Hull::Slab(slab) => {
                    slab.sample(spacing, &mut push);
                    for (edge, cone) in slab.cones.iter().enumerate() {
                        cone.sample(spacing, |t, n, area| push(edge_weights(edge, t), n, area));
                    }
                }
            }
        }
        points
    }

    /// The nearest primitive to each point.
    pub fn hits(&self, points: &Points) -> Vec<Hit> {
        let all: Vec<u32> = (0..self.hulls.len() as u32).collect();
        self.hits_among(points, &all)
    }

    /// The nearest of some primitives to each point, infinitely far if there is none.
    pub fn hits_among(&self, points: &Points, among: &[u32]) -> Vec<Hit> {
        if among.is_empty() {
            let none = Hit { distance: f64::INFINITY, primitive: u32::MAX, weights: [0.0; 3], normal: DVec3::Z };
            return vec![none; points.positions.len()];
        }
        let groups = points.blocks.len().div_ceil(GROUP);
        let hits = parallel::map(groups, 1, |group| {
            let blocks = group * GROUP..points.blocks.len().min((group + 1) * GROUP);
            let positions = points.range(blocks.start).start..points.range(blocks.end - 1).end;
            let shared = self.near(&bound(&points.positions[positions.clone()]), among);
            let gaps: Vec<[f32; BLOCK]> =
                shared.iter().map(|&p| self.hulls[p as usize].distances(&points.middles[group])).collect();
            let mut hits = Vec::with_capacity(positions.len());
            for (at, block) in blocks.enumerate() {
                let least = gaps.iter().map(|g| g[at]).fold(f32::INFINITY, f32::min);
                let reach = least + 2.0 * points.blocks[block].radius as f32 + ROUNDING;
                let near: Vec<u32> =
                    shared.iter().zip(&gaps).filter(|(_, gaps)| gaps[at] <= reach).map(|(&p, _)| p).collect();
                let nearest = self.nearest(&points.lanes[block], &near);
                hits.extend(
                    points.range(block).zip(nearest).map(|(i, nearest)| self.hit(points.positions[i], nearest)),
                );
            }
            hits
        });
        hits.into_iter().flatten().collect()
    }

    /// Those of some primitives that may be the nearest to a point in a ball.
    fn near(&self, ball: &Ball, among: &[u32]) -> Vec<u32> {
        let gaps: Vec<f64> = among.iter().map(|&i| self.hulls[i as usize].distance(ball.center)).collect();
        let reach = gaps.iter().copied().fold(f64::INFINITY, f64::min) + 2.0 * ball.radius;
        among.iter().zip(gaps).filter(|(_, gap)| *gap <= reach).map(|(&i, _)| i).collect()
    }

    /// The nearest of some primitives to each point of a block, up to the rounding of an f32.
    fn nearest(&self, lanes: &Lanes, among: &[u32]) -> [u32; BLOCK] {
        let mut nearest = [among.first().copied().unwrap_or(0); BLOCK];
        if among.len() < 2 {
            return nearest;
        }
        let mut least = [f32::INFINITY; BLOCK];
        for &primitive in among {
            let distances = self.hulls[primitive as usize].distances(lanes);
            for i in 0..BLOCK {
                let nearer = distances[i] < least[i];
                least[i] = if nearer { distances[i] } else { least[i] };
                nearest[i] = if nearer { primitive } else { nearest[i] };
            }
        }
        nearest
    }

    fn hit(&self, point: DVec3, primitive: u32) -> Hit {
        let (distance, weights) = self.hulls[primitive as usize].closest(point);
        let center = self.hulls[primitive as usize].blend(&weights).center;
        Hit { distance, primitive, weights, normal: (point - center).normalize_or(DVec3::Z) }
    }
}

/// One primitive, prepared.
pub(super) enum Hull {
    Sphere(Ball),
    Cone(Cone),
    Slab(Box<Slab>),
}

/// The hull of two spheres.
pub(super) struct Cone {
    from: Ball,
    along: DVec3,
    widening: f64,
    inverse_length_squared: f64,
    /// By how much, per distance from the axis, the nearest sphere lies past the foot of the perpendicular, as a fraction of the axis.
    slant: f64,
}

/// The hull of three spheres.
pub(super) struct Slab {
    from: Ball,
    u: DVec3,
    v: DVec3,
    widening: [f64; 2],
    normal: DVec3,
    /// Rows that take an in-plane offset to its weights.
    to_weights: [DVec3; 2],
    /// In-plane shift of the nearest sphere per distance from the plane; `None` without a common tangent plane.
    slant: Option<DVec3>,
    cones: [Cone; 3],
}

impl Hull {
    pub fn new(balls: &[Ball], primitive: &Primitive) -> Self {
        let ball = |i: u32| balls[i as usize];
        match *primitive {
            Primitive::Sphere([i]) => Hull::Sphere(ball(i)),
            Primitive::Cone([i, j]) => Hull::Cone(Cone::new(ball(i), ball(j))),
            Primitive::Slab([i, j, k]) => Hull::Slab(Box::new(Slab::new(ball(i), ball(j), ball(k)))),
        }
    }

    pub fn distance(&self, point: DVec3) -> f64 {
        self.closest(point).0
    }

    /// Signed distances of a block of points.
    fn distances(&self, lanes: &Lanes) -> [f32; BLOCK] {
        match self {
            Hull::Sphere(ball) => Cone::new(*ball, *ball).distances(lanes),
            Hull::Cone(cone) => cone.distances(lanes),
            Hull::Slab(slab) => slab.distances(lanes),
        }
    }

    /// Signed distance, and the weights of the nearest sphere.
    pub fn closest(&self, point: DVec3) -> (f64, [f64; 3]) {
        match self {
            Hull::Sphere(ball) => (ball.distance(point), [1.0, 0.0, 0.0]),
            Hull::Cone(cone) => {
                let (distance, t) = cone.closest(point);
                (distance, [1.0 - t, t, 0.0])
            }
            Hull::Slab(slab) => slab.closest(point),
        }
    }

    /// The sphere at some weights.
    pub fn blend(&self, w: &[f64; 3]) -> Ball {
        match self {
            Hull::Sphere(ball) => *ball,
            Hull::Cone(c) => Ball { center: c.from.center + c.along * w[1], radius: c.from.radius + c.widening * w[1] },
            Hull::Slab(s) => Ball {
                center: s.from.center + s.u * w[1] + s.v * w[2],
                radius: s.from.radius + s.widening[0] * w[1] + s.widening[1] * w[2],
            },
        }
    }
}

/// Fractional part of multiples of the golden ratio: evenly spread, whatever their number.
const GOLDEN: f64 = 0.618_033_988_749_894_9;

fn sample_sphere(radius: f64, spacing: f64, mut push: impl FnMut(DVec3, f64)) {
    const LEAST: f64 = 16.0;
    let area = 4.0 * PI * radius * radius;
    let count = (area / (spacing * spacing)).max(LEAST) as usize;
    for i in 0..count {
        let z = 1.0 - (2 * i + 1) as f64 / count as f64;
        let (sin, cos) = (TAU * GOLDEN * i as f64).sin_cos();
        let flat = (1.0 - z * z).sqrt();
        push(DVec3::new(flat * cos, flat * sin, z), area / count as f64);
    }
}

/// Weights in a slab at `t` along its edge ab, bc or ac.
fn edge_weights(edge: usize, t: f64) -> [f64; 3] {
    match edge {
        0 => [1.0 - t, t, 0.0],
        1 => [0.0, 1.0 - t, t],
        _ => [1.0 - t, 0.0, t],
    }
}

impl Cone {
    fn sample(&self, spacing: f64, mut push: impl FnMut(f64, DVec3, f64)) {
        if self.slant.is_infinite() {
            return;
        }
        let length = self.along.length();
        let axis = self.along / length;
        let (e1, e2) = axis.any_orthonormal_pair();
        let sine = self.widening / length;
        let cosine = (1.0 - sine * sine).sqrt();
        let rings = (length * cosine / spacing).ceil().max(2.0);
        for ring in 0..rings as usize {
            let t = (ring as f64 + 0.5) / rings;
            let around = TAU * (self.from.radius + t * self.widening) * cosine;
            let count = (around / spacing).ceil().max(5.0);
            for i in 0..count as usize {
                let (sin, cos) = (TAU * (i as f64 / count + GOLDEN * ring as f64)).sin_cos();
                let normal = (e1 * cos + e2 * sin) * cosine - axis * sine;
                push(t, normal, around * length * cosine / (rings * count));
            }
        }
    }

    pub fn new(from: Ball, to: Ball) -> Self {
        let along = to.center - from.center;
        let widening = to.radius - from.radius;
        let length_squared = along.length_squared();
        let rest = length_squared - widening * widening;
        let (inverse_length_squared, slant) = if rest > 1e-12 * length_squared && length_squared > 1e-24 {
            (1.0 / length_squared, widening / (length_squared * rest).sqrt())
        } else {
            // One sphere holds the other: all points are nearest to it.
            (0.0, if widening > 0.0 { f64::INFINITY } else { f64::NEG_INFINITY })
        };
        Self { from, along, widening, inverse_length_squared, slant }
    }

    fn distances(&self, lanes: &Lanes) -> [f32; BLOCK] {
        let [ax, ay, az] = self.from.center.as_vec3().to_array();
        let [dx, dy, dz] = self.along.as_vec3().to_array();
        let (radius, widening) = (self.from.radius as f32, self.widening as f32);
        let (inverse, slant) = (self.inverse_length_squared as f32, self.slant.clamp(-1e6, 1e6) as f32);
        // Of a degenerate cone the slant alone decides.
        let (inverse, lift) = if self.slant.is_finite() { (inverse, 0.0) } else { (0.0, 1.0) };
        std::array::from_fn(|i| {
            let (x, y, z) = (lanes.x[i] - ax, lanes.y[i] - ay, lanes.z[i] - az);
            let foot = (x * dx + y * dy + z * dz) * inverse;
            let (hx, hy, hz) = (x - foot * dx, y - foot * dy, z - foot * dz);
            let height = (hx * hx + hy * hy + hz * hz).sqrt() + lift;
            let t = (foot + slant * height).clamp(0.0, 1.0);
            let (qx, qy, qz) = (x - t * dx, y - t * dy, z - t * dz);
            (qx * qx + qy * qy + qz * qz).sqrt() - (radius + widening * t)
        })
    }

    fn closest(&self, point: DVec3) -> (f64, f64) {
        let offset = point - self.from.center;
        let t = if self.slant.is_finite() {
            let foot = offset.dot(self.along) * self.inverse_length_squared;
            let height = (offset - self.along * foot).length();
            (foot + self.slant * height).clamp(0.0, 1.0)
        } else if self.slant > 0.0 {
            1.0
        } else {
            0.0
        };
        ((offset - self.along * t).length() - (self.from.radius + self.widening * t), t)
    }
}

impl Slab {
    fn new(a: Ball, b: Ball, c: Ball) -> Self {
        let (u, v) = (b.center - a.center, c.center - a.center);
        let widening = [b.radius - a.radius, c.radius - a.radius];
        let cross = u.cross(v);
        let area_squared = cross.length_squared();
        let (uu, vv, uv) = (u.length_squared(), v.length_squared(), u.dot(v));
        let proper = area_squared > 1e-12 * uu * vv;
        let to_weights = if proper {
            [(u * vv - v * uv) / area_squared, (v * uu - u * uv) / area_squared]
        } else {
            [DVec3::ZERO; 2]
        };
        let gradient = to_weights[0] * widening[0] + to_weights[1] * widening[1];
        let rest = 1.0 - gradient.length_squared();
        Self {
            from: a,
            u,
            v,
            widening,
            normal: cross.normalize_or_zero(),
            to_weights,
            slant: (proper && rest > 1e-12).then(|| gradient / rest.sqrt()),
            cones: [Cone::new(a, b), Cone::new(b, c), Cone::new(a, c)],
        }
    }

    fn sample(&self, spacing: f64, mut push: impl FnMut([f64; 3], DVec3, f64)) {
        let Some(slant) = self.slant else { return };
        // The slant is g / sqrt(1 - g^2) of the gradient g.
        let cosine = 1.0 / (1.0 + slant.length_squared()).sqrt();
        let area = 0.5 * self.u.cross(self.v).length() * cosine;
        let count = (area / (spacing * spacing)).ceil().max(2.0);
        for i in 0..count as usize {
            // The sequence of Roberts, folded into the triangle.
            let (s, t) = ((0.5 + 0.754_877_666 * i as f64).fract(), (0.5 + 0.569_840_291 * i as f64).fract());
            let (s, t) = if s + t > 1.0 { (1.0 - s, 1.0 - t) } else { (s, t) };
            for side in [self.normal, -self.normal] {
                push([1.0 - s - t, s, t], (side - slant) * cosine, area / count);
            }
        }
    }

    fn distances(&self, lanes: &Lanes) -> [f32; BLOCK] {
        let cones = self.cones.each_ref().map(|cone| cone.distances(lanes));
        let least: [f32; BLOCK] = std::array::from_fn(|i| cones[0][i].min(cones[1][i]).min(cones[2][i]));
        let Some(slant) = self.slant else { return least };
        let [ax, ay, az] = self.from.center.as_vec3().to_array();
        let [nx, ny, nz] = self.normal.as_vec3().to_array();
        let [sx, sy, sz] = self.to_weights[0].as_vec3().to_array();
        let [tx, ty, tz] = self.to_weights[1].as_vec3().to_array();
        // Per distance from the plane: the shift of the weights, and the distance from the shifted sphere's centre.
        let shift = self.to_weights.map(|row| row.dot(slant) as f32);
        let stretch = (1.0 + slant.length_squared()).sqrt() as f32;
        let (radius, widening) = (self.from.radius as f32, self.widening.map(|w| w as f32));
        std::array::from_fn(|i| {
            let (x, y, z) = (lanes.x[i] - ax, lanes.y[i] - ay, lanes.z[i] - az);
            let height = (x * nx + y * ny + z * nz).abs();
            let s = x * sx + y * sy + z * sz + shift[0] * height;
            let t = x * tx + y * ty + z * tz + shift[1] * height;
            let distance = height * stretch - (radius + s * widening[0] + t * widening[1]);
            let within = (s >= 0.0) & (t >= 0.0) & (s + t <= 1.0);
            if within & (distance < least[i]) { distance } else { least[i] }
        })
    }

    fn closest(&self, point: DVec3) -> (f64, [f64; 3]) {
        let offset = point - self.from.center;
        let mut open = [true; 3];
        if let Some(slant) = self.slant {
            let height = offset.dot(self.normal);
            let shifted = offset + slant * height.abs();
            let (s, t) = (shifted.dot(self.to_weights[0]), shifted.dot(self.to_weights[1]));
            // The edges that are seen from there: ab, bc, ac.
            open = [t < 0.0, s + t > 1.0, s < 0.0];
            if open == [false; 3] {
                let radius = self.from.radius + s * self.widening[0] + t * self.widening[1];
                let center = self.u * s + self.v * t;
                return ((offset - center).length() - radius, [1.0 - s - t, s, t]);
            }
        }
        let mut best = (f64::INFINITY, [0.0; 3]);
        for (edge, cone) in self.cones.iter().enumerate().filter(|(edge, _)| open[*edge]) {
            let (distance, t) = cone.closest(point);
            if distance < best.0 {
                best = (distance, edge_weights(edge, t));
            }
        }
        best
    }
}
