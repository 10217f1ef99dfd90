use bytemuck::{Pod, Zeroable};
use glam::Vec3;

/// A medial sphere.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[cfg_attr(feature = "serialize", derive(serde::Serialize, serde::Deserialize))]
pub struct Sphere {
    /// Centre in metres, in the frame of the shape that owns the sphere.
    pub center: Vec3,
    /// Radius in metres, zero or more.
    pub radius: f32,
}

impl Sphere {
    /// A sphere with the given centre and radius.
    #[inline]
    pub const fn new(center: Vec3, radius: f32) -> Self {
        Self { center, radius }
    }

    /// True if `other` lies inside this sphere. Evaluated in f64, where the f32 input is exact.
    pub fn contains(&self, other: &Sphere) -> bool {
        let reach = f64::from(self.radius) - f64::from(other.radius);
        reach >= 0.0 && self.center.as_dvec3().distance_squared(other.center.as_dvec3()) <= reach * reach
    }

    /// Distance from `point` to the farthest point of the sphere.
    pub fn farthest(&self, point: Vec3) -> f32 {
        self.center.distance(point) + self.radius
    }

    /// Linear interpolation from `self` (`t = 0`) to `other` (`t = 1`).
    pub fn lerp(&self, other: &Sphere, t: f32) -> Sphere {
        Sphere::new(self.center.lerp(other.center, t), self.radius + (other.radius - self.radius) * t)
    }

    /// The same sphere in a shape that is `scale` times as large.
    pub fn scaled(&self, scale: f32) -> Sphere {
        Sphere::new(self.center * scale, self.radius * scale)
    }
}

/// A medial primitive: the indices of its one to three spheres in the shape's sphere list.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "serialize", derive(serde::Serialize, serde::Deserialize))]
pub enum Primitive {
    /// One sphere.
    Sphere([u32; 1]),
    /// Medial cone: the convex hull of two spheres (a tapered capsule).
    Cone([u32; 2]),
    /// Medial slab: the convex hull of three spheres (a rounded triangle of varying thickness).
    Slab([u32; 3]),
}

impl Primitive {
    /// Indices of the spheres.
    pub fn indices(&self) -> &[u32] {
        match self {
            Primitive::Sphere(i) => i,
            Primitive::Cone(i) => i,
            Primitive::Slab(i) => i,
        }
    }

    /// The primitive with other indices for the same spheres.
    pub(crate) fn renumbered(&self, number: impl Fn(u32) -> u32) -> Self {
        match *self {
            Primitive::Sphere(i) => Primitive::Sphere(i.map(number)),
            Primitive::Cone(i) => Primitive::Cone(i.map(number)),
            Primitive::Slab(i) => Primitive::Slab(i.map(number)),
        }
    }

    /// The primitive's non-degenerate parts, at most two, whose union is the same set of points (paper, section 3).
    ///
    /// * A sphere inside another sphere of the primitive adds no volume, for any interpolation of the two, and is removed.
    /// * A slab has a plane that touches its three spheres exactly if the in-plane gradient `g` of the radius is
    ///   shorter than 1. Otherwise the nearest sphere to any point lies on an edge through which `g` leaves the
    ///   triangle: along `g` the distance never grows. There are one or two such edges, and the slab is the union of their cones.
    ///   (There are two if a middle sphere bulges out of the hull of the outer ones; the paper keeps the cone of the two
    ///   larger spheres, which can lose volume.)
    /// * Three spheres with centres on a line are a slab of the second kind with `g` across the line.
    ///
    /// Primitives within a relative tolerance of 1e-7 of a degenerate one count as degenerate. The surface moves by no more than that, and the f32
    /// kernels never see a radius gradient of 1 or a triangle of zero height.
    ///
    /// # Panics
    /// If an index is out of range.
    pub fn simplified(self, spheres: &[Sphere]) -> Parts {
        let contains = |i: u32, j: u32| {
            let (a, b) = (&spheres[i as usize], &spheres[j as usize]);
            let distance = a.center.as_dvec3().distance(b.center.as_dvec3());
            distance * (1.0 - NEARLY) <= f64::from(a.radius) - f64::from(b.radius)
        };
        match self {
            Primitive::Sphere(_) => Parts([Some(self), None]),
            Primitive::Cone([i, j]) if contains(i, j) => Parts([Some(Primitive::Sphere([i])), None]),
            Primitive::Cone([i, j]) if contains(j, i) => Parts([Some(Primitive::Sphere([j])), None]),
            Primitive::Cone(_) => Parts([Some(self), None]),
            Primitive::Slab(index) => {
                let edges: [[u32; 2]; 3] =
                    std::array::from_fn(|vertex| [index[(vertex + 1) % 3], index[(vertex + 2) % 3]]);
                for (vertex, edge) in index.into_iter().zip(edges) {
                    if edge.into_iter().any(|other| contains(other, vertex)) {
                        return Primitive::Cone(edge).simplified(spheres);
                    }
                }
                let Some(open) = open_edges(index.map(|i| spheres[i as usize])) else {
                    return Parts([Some(self), None]);
                };
                let mut cones = (0..3).filter(|&edge| open[edge]).map(|edge: usize| Primitive::Cone(edges[edge]));
                Parts([cones.next(), cones.next()])
            }
        }
    }
}

/// Relative tolerance of the tests for degenerate primitives.
const NEARLY: f64 = 1.0e-7;

/// One or two primitives.
#[derive(Clone, Copy, Debug)]
pub struct Parts([Option<Primitive>; 2]);

impl Parts {
    /// The primitives.
    pub fn iter(&self) -> impl Iterator<Item = &Primitive> {
        self.0.iter().flatten()
    }
}

/// For a degenerate slab: true for each vertex if the radius gradient leaves the triangle through the opposite edge.
/// `None` for a proper slab. Evaluated in f64, where the f32 input is exact.
fn open_edges(spheres: [Sphere; 3]) -> Option<[bool; 3]> {
    let center = spheres.map(|s| s.center.as_dvec3());
    let radius = spheres.map(|s| f64::from(s.radius));
    let (e2, e3) = (center[1] - center[0], center[2] - center[0]);
    let normal = e2.cross(e3);
    let area_squared = normal.length_squared();
    let longest =
        (0..3).max_by(|&a, &b| length_opposite(&center, a).total_cmp(&length_opposite(&center, b))).unwrap_or(0);
    if area_squared <= NEARLY * NEARLY * length_opposite(&center, longest).powi(4) {
        // Collinear: the sphere opposite to the longest edge is the middle one. It may bulge out of the cone of the other two.
        let [middle, from, to] = [longest, (longest + 1) % 3, (longest + 2) % 3];
        let along = center[to] - center[from];
        let length_squared = along.length_squared();
        let t = if length_squared > 0.0 { (center[middle] - center[from]).dot(along) / length_squared } else { 0.0 };
        let bulges = length_squared == 0.0 || radius[middle] > radius[from] + t * (radius[to] - radius[from]);
        return Some(std::array::from_fn(|edge| (edge == middle) != bulges));
    }
    // g . e2 = r2 - r1 and g . e3 = r3 - r1, with g in the plane.
    let g = (e3.cross(normal) * -(radius[1] - radius[0]) + e2.cross(normal) * (radius[2] - radius[0])) / -area_squared;
    (g.length() >= 1.0 - NEARLY).then(|| {
        // The outward edge normals sum to zero, so at least one edge is closed. The comparisons guarantee that in spite of rounding.
        let out: [f64; 3] =
            std::array::from_fn(|vertex| g.dot((center[(vertex + 2) % 3] - center[(vertex + 1) % 3]).cross(normal)));
        let least = out.iter().copied().fold(f64::INFINITY, f64::min);
        let greatest = out.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        out.map(|flow| flow == greatest || (flow >= 0.0 && flow > least))
    })
}

fn length_opposite(center: &[glam::DVec3; 3], vertex: usize) -> f64 {
    center[(vertex + 1) % 3].distance(center[(vertex + 2) % 3])
}
