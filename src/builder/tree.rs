//! The triangles of the input in a hierarchy: closest points and winding numbers.

use glam::{DVec3, Vec3A};

const LEAF_SIZE: usize = 4;

/// A node holds the triangles `from..to`; its left child follows it.
struct Node {
    min: Vec3A,
    max: Vec3A,
    from: u32,
    to: u32,
    /// Right child, 0 for a leaf.
    right: u32,
    /// Seen from afar the triangles are a dipole: the sum of their area vectors, at their mean place.
    dipole: Vec3A,
    middle: Vec3A,
    /// Beyond this distance from `middle` the dipole stands for the triangles.
    far_squared: f32,
}

/// Triangles, sorted so that neighbours in the list are neighbours in space.
pub(super) struct TriangleTree {
    nodes: Vec<Node>,
    triangles: Vec<[DVec3; 3]>,
    /// The same, as the queries read them.
    narrow: Vec<[Vec3A; 3]>,
    /// Place of each triangle in the list that the tree was made from.
    order: Vec<u32>,
}

/// How many radii of a node away its dipole is exact enough.
const FAR: f64 = 2.0;

impl TriangleTree {
    pub fn new(source: &[[DVec3; 3]]) -> Self {
        let mut order: Vec<u32> = (0..source.len() as u32).collect();
        let centers: Vec<DVec3> = source.iter().map(|[a, b, c]| (a + b + c) / 3.0).collect();
        let mut tree = Self { nodes: Vec::new(), triangles: Vec::new(), narrow: Vec::new(), order: Vec::new() };
        if !source.is_empty() {
            tree.split(source, &centers, &mut order, 0);
        }
        tree.triangles = order.iter().map(|&i| source[i as usize]).collect();
        tree.narrow = tree.triangles.iter().map(|t| t.map(|p| p.as_vec3a())).collect();
        tree.order = order;
        tree
    }

    /// Adds the node of `items`, which start at `from` of the sorted list, and those below it.
    fn split(&mut self, source: &[[DVec3; 3]], centers: &[DVec3], items: &mut [u32], from: usize) {
        let corners = items.iter().flat_map(|&i| source[i as usize]);
        let (min, max) = corners.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(lo, hi), p| (lo.min(p), hi.max(p)));
        let (mut dipole, mut middle, mut area) = (DVec3::ZERO, DVec3::ZERO, 0.0);
        for &i in items.iter() {
            let [a, b, c] = source[i as usize];
            let vector = (b - a).cross(c - a) * 0.5;
            dipole += vector;
            area += vector.length();
            middle += centers[i as usize] * vector.length();
        }
        middle /= area;
        let reach = (max - middle).max(middle - min).length();
        let index = self.nodes.len();
        self.nodes.push(Node {
            min: min.as_vec3a(),
            max: max.as_vec3a(),
            from: from as u32,
            to: (from + items.len()) as u32,
            right: 0,
            dipole: dipole.as_vec3a(),
            middle: middle.as_vec3a(),
            far_squared: (FAR * reach).powi(2) as f32,
        });
        if items.len() <= LEAF_SIZE {
            return;
        }
        let places = items.iter().map(|&i| centers[i as usize]);
        let (lo, hi) = places.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(lo, hi), p| (lo.min(p), hi.max(p)));
        let axis = (hi - lo).max_position();
        let half = items.len() / 2;
        items.select_nth_unstable_by(half, |&a, &b| {
            centers[a as usize][axis].total_cmp(&centers[b as usize][axis]).then(a.cmp(&b))
        });
        let (left, right) = items.split_at_mut(half);
        self.split(source, centers, left, from);
        self.nodes[index].right = self.nodes.len() as u32;
        self.split(source, centers, right, from + half);
    }

    /// The triangles in the order of the tree.
    pub fn triangles(&self) -> &[[DVec3; 3]] {
        &self.triangles
    }

    /// For each triangle in the order of the tree, its index in the source.
    pub fn order(&self) -> &[u32] {
        &self.order
    }

    /// The point of the triangles that is nearest to `point`, if one is nearer than `limit`.
    pub fn closest(&self, point: DVec3, limit: f64) -> Option<DVec3> {
        self.closest_with_triangle(point, limit).map(|(closest, _)| closest)
    }

    /// The same with the place of the triangle in the order of the tree.
    pub fn closest_with_triangle(&self, point: DVec3, limit: f64) -> Option<(DVec3, usize)> {
        let mut best = (limit * limit) as f32;
        let mut found = None;
        let point = point.as_vec3a();
        let gap = |node: &Node| (node.min - point).max(point - node.max).max(Vec3A::ZERO).length_squared();
        let mut stack = [(0u32, 0.0f32); 64];
        let mut top = 1;
        if self.nodes.is_empty() {
            return None;
        }
        stack[0] = (0, gap(&self.nodes[0]));
        while top > 0 {
            top -= 1;
            let (index, distance) = stack[top];
            if distance >= best {
                continue;
            }
            let node = &self.nodes[index as usize];
            if node.right == 0 {
                for index in node.from as usize..node.to as usize {
                    let triangle = &self.narrow[index];
                    let q = closest_on_triangle(point, triangle);
                    let squared = q.distance_squared(point);
                    if squared < best {
                        best = squared;
                        found = Some((q.as_dvec3(), index));
                    }
                }
                continue;
            }
            let (left, right) = (index + 1, node.right);
            let (near_left, near_right) = (gap(&self.nodes[left as usize]), gap(&self.nodes[right as usize]));
            let (first, second) = if near_left <= near_right {
                ((left, near_left), (right, near_right))
            } else {
                ((right, near_right), (left, near_left))
            };
            stack[top] = second;
            stack[top + 1] = first;
            top += 2;
        }
        found
    }

    /// How often the triangles wind round `point`: 1 within a closed surface, 0 outside, in between near a hole.
    pub fn winding(&self, point: DVec3) -> f64 {
        let mut sum = 0.0;
        let point = point.as_vec3a();
        let mut stack = [0u32; 64];
        let mut top = usize::from(!self.nodes.is_empty());
        while top > 0 {
            top -= 1;
            let index = stack[top];
            let node = &self.nodes[index as usize];
            let away = node.middle - point;
            let squared = away.length_squared();
            if squared > node.far_squared {
                sum += node.dipole.dot(away) / (squared * squared.sqrt());
            } else if node.right == 0 {
                let triangles = &self.narrow[node.from as usize..node.to as usize];
                sum += triangles.iter().map(|t| solid_angle(point, t)).sum::<f32>();
            } else {
                stack[top] = node.right;
                stack[top + 1] = index + 1;
                top += 2;
            }
        }
        f64::from(sum) / (4.0 * std::f64::consts::PI)
    }

    /// True within the solid, whichever way its triangles turn.
    pub fn is_inside(&self, point: DVec3) -> bool {
        self.winding(point).abs() > 0.5
    }
}

fn solid_angle(point: Vec3A, [a, b, c]: &[Vec3A; 3]) -> f32 {
    let (a, b, c) = (*a - point, *b - point, *c - point);
    let (la, lb, lc) = (a.length(), b.length(), c.length());
    let numerator = a.dot(b.cross(c));
    let denominator = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
    2.0 * numerator.atan2(denominator)
}

/// By the region of the point among those of the triangle's corners, edges and inside.
fn closest_on_triangle(p: Vec3A, &[a, b, c]: &[Vec3A; 3]) -> Vec3A {
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
