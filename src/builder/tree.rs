//! A hierarchy of the triangles of the input, for closest points and winding numbers.
//!
//! The eight children of a node, and the eight triangles of a leaf, are processed in SIMD lanes.

use std::f32::consts::{FRAC_PI_2, PI};

use fearless_simd::{Level, Simd, dispatch, f32x8, mask32x8, prelude::*};
use glam::DVec3;

use super::vectors::{ROUNDING, Vectors, splat};

/// Number of children of a node, and of triangles of a leaf.
const WIDTH: usize = 8;
use crate::query::number::Vector;

/// Eight children. The triangles of each child are consecutive.
struct Node {
    /// Indices of nodes, or of leaves from [`LEAF`] on. Lanes without a child are 0 and are never visited.
    children: [u32; WIDTH],
    /// Boxes of the children. Lanes without a child have an infinitely distant box.
    min: Vectors<WIDTH>,
    max: Vectors<WIDTH>,
    /// Dipoles that approximate the triangles of a child from afar: the sum of their area vectors, at their mean position.
    dipole: Vectors<WIDTH>,
    middle: Vectors<WIDTH>,
    /// Squared distance from the middle above which the dipole replaces the triangles.
    far_squared: [f32; WIDTH],
}

/// First index of leaves among the indices of children.
const LEAF: u32 = 1 << 31;

/// Eight triangles. Missing ones are copies of the last.
struct Leaf {
    corners: [Vectors<WIDTH>; 3],
    /// Unit vectors in the plane that point outwards from the edges 01, 12 and 20.
    outward: [Vectors<WIDTH>; 3],
    inverse_lengths_squared: [[f32; WIDTH]; 3],
    normal: Vectors<WIDTH>,
}

/// Triangles, sorted so that neighbours in the list are neighbours in space.
pub(super) struct TriangleTree {
    nodes: Vec<Node>,
    /// The leaves, each with the next eight triangles.
    leaves: Vec<Leaf>,
    triangles: Vec<[DVec3; 3]>,
    /// Index of each triangle in the list that the tree was built from.
    order: Vec<u32>,
}

/// Distance, in radii of a child, above which its dipole is accurate enough.
const FAR: f64 = 2.0;

/// Stack size for any tree of up to `u32::MAX` triangles: at most seven children per level are pending.
const STACK: usize = 80;

impl TriangleTree {
    pub fn new(source: &[[DVec3; 3]]) -> Self {
        let mut order: Vec<u32> = (0..source.len() as u32).collect();
        let centers: Vec<DVec3> = source.iter().map(|[a, b, c]| (a + b + c) / 3.0).collect();
        let mut tree = Self { nodes: vec![], leaves: vec![], triangles: vec![], order: vec![] };
        if !source.is_empty() {
            tree.add_node(source, &centers, &mut order, 0);
        }
        tree.triangles = order.iter().map(|&i| source[i as usize]).collect();
        tree.leaves = tree.triangles.chunks(WIDTH).map(Leaf::new).collect();
        tree.order = order;
        tree
    }

    /// Adds the node of `items`, which start at `from` in the sorted list, and the nodes below it. Returns its index.
    fn add_node(&mut self, source: &[[DVec3; 3]], centers: &[DVec3], items: &mut [u32], from: usize) -> u32 {
        let number = self.nodes.len();
        let mut parts = vec![items];
        while parts.len() < WIDTH {
            let halves = parts.into_iter().flat_map(|part| <[_; 2]>::from(halves(centers, part)));
            parts = halves.collect();
        }
        parts.retain(|part| !part.is_empty());
        let bounds: Vec<Bounds> = parts.iter().map(|items| Bounds::new(source, centers, items)).collect();
        self.nodes.push(Node::new(&bounds));
        let mut from = from;
        for (at, items) in parts.into_iter().enumerate() {
            let next = from + items.len();
            let child = if items.len() <= WIDTH {
                LEAF + (from / WIDTH) as u32
            } else {
                self.add_node(source, centers, items, from)
            };
            self.nodes[number].children[at] = child;
            from = next;
        }
        number as u32
    }

    /// The triangles in the order of the tree.
    pub fn triangles(&self) -> &[[DVec3; 3]] {
        &self.triangles
    }

    /// For each triangle in the order of the tree, its index in the source.
    pub fn order(&self) -> &[u32] {
        &self.order
    }

    /// The point of the triangles that is nearest to `point`, if it is nearer than `limit`.
    pub fn closest(&self, point: DVec3, limit: f64) -> Option<DVec3> {
        self.nearest(point, limit).map(|(triangle, _)| self.closest_on(triangle, point))
    }

    /// The nearest point, and the index of its triangle in the order of the tree. `near`: a triangle that may be nearby, for speed.
    pub fn closest_with_triangle(&self, point: DVec3, near: Option<u32>) -> Option<(DVec3, u32)> {
        let known = near.map(|triangle| (self.closest_on(triangle, point), triangle));
        // With this allowance, triangles at the same distance are found in the same order as without a hint.
        let limit = known.map_or(f64::INFINITY, |(closest, _)| closest.distance(point) + f64::from(ROUNDING));
        let (triangle, _) = self.nearest(point, limit)?;
        known.filter(|known| known.1 == triangle).or_else(|| Some((self.closest_on(triangle, point), triangle)))
    }

    fn closest_on(&self, triangle: u32, point: DVec3) -> DVec3 {
        closest_on_triangle(point, &self.triangles[triangle as usize])
    }

    /// The distance of the nearest triangle, degenerate or not, up to the rounding of an f32.
    pub fn distance(&self, point: DVec3) -> f32 {
        self.nearest(point, f64::INFINITY).map_or(f32::INFINITY, |(_, squared)| squared.sqrt())
    }

    /// The nearest triangle that is nearer than `limit`, and its squared distance.
    fn nearest(&self, point: DVec3, limit: f64) -> Option<(u32, f32)> {
        let mut best = (limit * limit) as f32;
        let mut found = None;
        dispatch!(Level::new(), simd => {
            let wide = splat(simd, point);
            let mut stack = [(0, 0.0); STACK];
            let mut top = usize::from(!self.nodes.is_empty());
            while top > 0 {
                top -= 1;
                let (child, gap) = stack[top];
                if gap >= best {
                    continue;
                }
                if child >= LEAF {
                    let leaf = (child - LEAF) as usize;
                    let squares = self.leaves[leaf].distances_squared(simd, wide);
                    for lane in lanes(squares.simd_lt(best).to_bitmask()) {
                        if squares[lane] < best {
                            best = squares[lane];
                            found = Some((leaf * WIDTH + lane) as u32);
                        }
                    }
                    continue;
                }
                let node = &self.nodes[child as usize];
                let gaps = node.gaps_squared(simd, wide);
                // The nearest child is visited first.
                let bottom = top;
                for lane in lanes(gaps.simd_lt(best).to_bitmask()) {
                    let mut at = top;
                    while at > bottom && stack[at - 1].1 < gaps[lane] {
                        stack[at] = stack[at - 1];
                        at -= 1;
                    }
                    stack[at] = (node.children[lane], gaps[lane]);
                    top += 1;
                }
            }
        });
        found.map(|triangle| (triangle, best))
    }

    /// Winding number of the triangles around `point`: 1 inside a closed surface, 0 outside, a fraction near a hole.
    pub fn winding(&self, point: DVec3) -> f64 {
        dispatch!(Level::new(), simd => {
            let mut sum = f32x8::splat(simd, 0.0);
            let wide = splat(simd, point);
            let mut stack = [0; STACK];
            let mut top = usize::from(!self.nodes.is_empty());
            while top > 0 {
                top -= 1;
                let child = stack[top];
                if child >= LEAF {
                    let leaf = (child - LEAF) as usize;
                    let count = (self.triangles.len() - leaf * WIDTH).min(WIDTH);
                    let there = mask32x8::from_bitmask(simd, (1 << count) - 1);
                    sum += there.select(self.leaves[leaf].solid_angles(simd, wide), f32x8::splat(simd, 0.0));
                    continue;
                }
                let node = &self.nodes[child as usize];
                let (angles, far) = node.dipoles(simd, wide);
                sum += angles;
                for lane in lanes(!far.to_bitmask()) {
                    stack[top] = node.children[lane];
                    top += 1;
                }
            }
            f64::from(sum.as_slice().iter().sum::<f32>()) / (4.0 * std::f64::consts::PI)
        })
    }

    /// True inside the solid, for either orientation of its triangles.
    pub fn is_inside(&self, point: DVec3) -> bool {
        self.winding(point).abs() > 0.5
    }
}

/// The lanes whose bits are set.
#[inline(always)]
fn lanes(mut bits: u64) -> impl Iterator<Item = usize> {
    std::iter::from_fn(
        #[inline(always)]
        move || {
            let lane = bits.trailing_zeros() as usize;
            bits &= bits.wrapping_sub(1);
            (lane < WIDTH).then_some(lane)
        },
    )
}

/// Splits items into two halves along the widest axis. All leaves of the left half are full.
fn halves<'a>(centers: &[DVec3], items: &'a mut [u32]) -> (&'a mut [u32], &'a mut [u32]) {
    let half = (items.len() / 2).next_multiple_of(WIDTH).min(items.len());
    if half < items.len() {
        let places = items.iter().map(|&i| centers[i as usize]);
        let (lo, hi) = places.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(lo, hi), p| (lo.min(p), hi.max(p)));
        let axis = (hi - lo).max_position();
        items.select_nth_unstable_by(half, |&a, &b| {
            centers[a as usize][axis].total_cmp(&centers[b as usize][axis]).then(a.cmp(&b))
        });
    }
    items.split_at_mut(half)
}

/// Data of a child that its node stores.
struct Bounds {
    min: DVec3,
    max: DVec3,
    dipole: DVec3,
    middle: DVec3,
    far_squared: f32,
}

impl Bounds {
    /// No child: infinitely distant, and with a zero dipole.
    const NONE: Self = Self {
        min: DVec3::INFINITY,
        max: DVec3::INFINITY,
        dipole: DVec3::ZERO,
        middle: DVec3::splat(1e3),
        far_squared: 0.0,
    };

    fn new(source: &[[DVec3; 3]], centers: &[DVec3], items: &[u32]) -> Self {
        let corners = items.iter().flat_map(|&i| source[i as usize]);
        let (min, max) = corners.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(lo, hi), p| (lo.min(p), hi.max(p)));
        let (mut dipole, mut middle, mut area) = (DVec3::ZERO, DVec3::ZERO, 0.0);
        for &i in items {
            let [a, b, c] = source[i as usize];
            let vector = (b - a).cross(c - a) * 0.5;
            dipole += vector;
            area += vector.length();
            middle += centers[i as usize] * vector.length();
        }
        middle /= area;
        let reach = (max - middle).max(middle - min).length();
        Self { min, max, dipole, middle, far_squared: (FAR * reach).powi(2) as f32 }
    }
}

impl Node {
    /// A node without the indices of its children, which are set later.
    fn new(bounds: &[Bounds]) -> Self {
        let lanes = |of: fn(&Bounds) -> DVec3| {
            Vectors::new(std::array::from_fn(|lane| of(bounds.get(lane).unwrap_or(&Bounds::NONE))))
        };
        let far_squared = std::array::from_fn(|lane| bounds.get(lane).unwrap_or(&Bounds::NONE).far_squared);
        Self {
            children: [0; WIDTH],
            min: lanes(|b| b.min),
            max: lanes(|b| b.max),
            dipole: lanes(|b| b.dipole),
            middle: lanes(|b| b.middle),
            far_squared,
        }
    }

    /// Squared distances of the children's boxes from `point`.
    #[inline(always)]
    fn gaps_squared<S: Simd>(&self, simd: S, point: Vector<f32x8<S>>) -> f32x8<S> {
        let (below, above) = (self.min.load(simd) - point, point - self.max.load(simd));
        let (x, y, z) = (below.x.max(above.x), below.y.max(above.y), below.z.max(above.z));
        Vector { x: x.max(0.0), y: y.max(0.0), z: z.max(0.0) }.length_squared()
    }

    /// Solid angles of the children's dipoles, zero for children that are too near, and a mask of the children that are far enough.
    #[inline(always)]
    fn dipoles<S: Simd>(&self, simd: S, point: Vector<f32x8<S>>) -> (f32x8<S>, mask32x8<S>) {
        let away = self.middle.load(simd) - point;
        let squared = away.length_squared();
        let far = squared.simd_gt(f32x8::load_array(simd, self.far_squared));
        let angles = self.dipole.load(simd).dot(away) / (squared * squared.sqrt());
        (far.select(angles, f32x8::splat(simd, 0.0)), far)
    }
}

impl Leaf {
    fn new(triangles: &[[DVec3; 3]]) -> Self {
        let triangles: [_; WIDTH] = std::array::from_fn(|lane| triangles[lane.min(triangles.len() - 1)]);
        let edges = triangles.map(|[a, b, c]| [b - a, c - b, a - c]);
        let normals = edges.map(|[ab, bc, _]| ab.cross(bc).normalize_or_zero());
        let outward = |k: usize| std::array::from_fn(|i| edges[i][k].cross(normals[i]).normalize_or_zero());
        let inverses = |k: usize| edges.map(|edge| edge[k].length_squared().max(1e-30).recip() as f32);
        Self {
            corners: std::array::from_fn(|k| Vectors::new(triangles.map(|t| t[k]))),
            outward: std::array::from_fn(|k| Vectors::new(outward(k))),
            inverse_lengths_squared: std::array::from_fn(inverses),
            normal: Vectors::new(normals),
        }
    }

    #[inline(always)]
    fn distances_squared<S: Simd>(&self, simd: S, point: Vector<f32x8<S>>) -> f32x8<S> {
        let [a, b, c] = &self.corners;
        let corners = [a.load(simd), b.load(simd), c.load(simd)];
        let mut to_rim = f32x8::splat(simd, f32::INFINITY);
        let mut beyond = f32x8::splat(simd, f32::NEG_INFINITY);
        for k in 0..3 {
            let (away, along) = (point - corners[k], corners[(k + 1) % 3] - corners[k]);
            let inverse = f32x8::load_array(simd, self.inverse_lengths_squared[k]);
            let t = (away.dot(along) * inverse).max(0.0).min(1.0);
            to_rim = to_rim.min((away - along * t).length_squared());
            beyond = beyond.max(away.dot(self.outward[k].load(simd)));
        }
        let height = (point - corners[0]).dot(self.normal.load(simd));
        beyond.simd_lt(0.0).select(height * height, to_rim)
    }

    #[inline(always)]
    fn solid_angles<S: Simd>(&self, simd: S, point: Vector<f32x8<S>>) -> f32x8<S> {
        let [a, b, c] = &self.corners;
        let (a, b, c) = (a.load(simd) - point, b.load(simd) - point, c.load(simd) - point);
        let [la, lb, lc] = [a.length(), b.length(), c.length()];
        let numerator = a.dot(b.cross(c));
        let denominator = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
        2.0 * atan2(numerator, denominator)
    }
}

/// Polynomial approximation of `atan2`, accurate to 1e-4 rad.
#[inline(always)]
fn atan2<S: Simd>(y: f32x8<S>, x: f32x8<S>) -> f32x8<S> {
    let (ax, ay) = (x.abs(), y.abs());
    let a = ax.min(ay) / ax.max(ay).max(f32::MIN_POSITIVE);
    let s = a * a;
    let r = ((-0.046_496_475 * s + 0.159_314_22) * s - 0.327_622_76) * s * a + a;
    let r = ay.simd_gt(ax).select(FRAC_PI_2 - r, r);
    let r = x.simd_lt(0.0).select(PI - r, r);
    r.copysign(y)
}

/// The nearest point of a triangle. The region of `p` decides: that of a corner, of an edge or of the inside.
pub(super) fn closest_on_triangle(p: DVec3, &[a, b, c]: &[DVec3; 3]) -> DVec3 {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(ap), ac.dot(ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return a;
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(bp), ac.dot(bp));
    if d3 >= 0.0 && d4 <= d3 {
        return b;
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return a + ab * (d1 / (d1 - d3));
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(cp), ac.dot(cp));
    if d6 >= 0.0 && d5 <= d6 {
        return c;
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return a + ac * (d2 / (d2 - d6));
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 >= d3 && d5 >= d6 {
        return b + (c - b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6)));
    }
    let scale = 1.0 / (va + vb + vc);
    a + ab * (vb * scale) + ac * (vc * scale)
}

#[cfg(test)]
mod tests;
