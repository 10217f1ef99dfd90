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
    /// A sphere from centre and radius.
    pub const fn new(center: Vec3, radius: f32) -> Self {
        Self { center, radius }
    }

    /// True if `other` lies within this sphere. Evaluated in f64, in which the f32 input is exact.
    pub fn contains(&self, other: &Sphere) -> bool {
        let reach = f64::from(self.radius) - f64::from(other.radius);
        reach >= 0.0 && self.center.as_dvec3().distance_squared(other.center.as_dvec3()) <= reach * reach
    }

    /// The sphere on the way from `self` (`t = 0`) to `other` (`t = 1`).
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

    /// The primitive's non-degenerate parts, at most two, whose union is the same set of points (paper, section 3).
    ///
    /// * A cone with one sphere inside the other is that sphere.
    /// * A slab has a plane that touches its three spheres exactly when the in-plane gradient `g` of the radius is
    ///   shorter than 1. Otherwise the nearest sphere to any point lies on an edge through which `g` leaves the
    ///   triangle: along any other edge the distance still falls towards the inside. There are one or two such edges,
    ///   and their cones, themselves simplified, are the slab. (Two, where a middle sphere bulges out of the hull of
    ///   the outer ones; the paper keeps the cone of the two larger spheres, which can lose volume.)
    /// * Three spheres with centres on a line are a slab of the second kind with `g` across the line.
    ///
    /// # Panics
    /// If an index is out of range.
    pub fn simplified(self, spheres: &[Sphere]) -> Parts {
        let mut parts = Parts::default();
        match self {
            Primitive::Sphere(_) => parts.push(self),
            Primitive::Cone([i, j]) => {
                let (a, b) = (&spheres[i as usize], &spheres[j as usize]);
                parts.push(if a.contains(b) {
                    Primitive::Sphere([i])
                } else if b.contains(a) {
                    Primitive::Sphere([j])
                } else {
                    self
                });
            }
            Primitive::Slab(index) => match open_edges(index.map(|i| spheres[i as usize])) {
                None => parts.push(self),
                Some(edges) => {
                    for (edge, open) in edges.into_iter().enumerate() {
                        if open {
                            let cone = Primitive::Cone([index[(edge + 1) % 3], index[(edge + 2) % 3]]);
                            for part in cone.simplified(spheres).iter() {
                                parts.push(*part);
                            }
                        }
                    }
                    parts.drop_covered(spheres);
                }
            },
        }
        parts
    }
}

/// One or two primitives.
#[derive(Clone, Copy, Debug, Default)]
pub struct Parts {
    items: [Option<Primitive>; 2],
}

impl Parts {
    /// The primitives.
    pub fn iter(&self) -> impl Iterator<Item = &Primitive> {
        self.items.iter().flatten()
    }

    fn push(&mut self, part: Primitive) {
        if self.items[0].is_none() {
            self.items[0] = Some(part);
        } else {
            debug_assert!(self.items[1].is_none(), "a vector leaves a triangle through at most two edges");
            self.items[1] = Some(part);
        }
    }

    /// Drops a sphere that the other part has, or holds, as well.
    fn drop_covered(&mut self, spheres: &[Sphere]) {
        let [Some(first), Some(second)] = self.items else { return };
        let covered = |part: Primitive, by: Primitive| match part {
            Primitive::Sphere([s]) => {
                by.indices().iter().any(|&i| spheres[i as usize].contains(&spheres[s as usize]))
            }
            _ => false,
        };
        if covered(second, first) {
            self.items = [Some(first), None];
        } else if covered(first, second) {
            self.items = [Some(second), None];
        }
    }
}

/// For a degenerate slab: whether its radius gradient leaves through the edge opposite to each vertex.
/// `None` for a proper slab. Evaluated in f64, in which the f32 input is exact.
fn open_edges(spheres: [Sphere; 3]) -> Option<[bool; 3]> {
    let center = spheres.map(|s| s.center.as_dvec3());
    let radius = spheres.map(|s| f64::from(s.radius));
    let (e2, e3) = (center[1] - center[0], center[2] - center[0]);
    let normal = e2.cross(e3);
    let area_squared = normal.length_squared();
    let longest = (0..3).max_by(|&a, &b| length_opposite(&center, a).total_cmp(&length_opposite(&center, b))).unwrap_or(0);
    if area_squared <= 1e-24 * length_opposite(&center, longest).powi(4) {
        // On a line: the sphere opposite to the longest edge is the middle one. Does it bulge?
        let [middle, from, to] = [longest, (longest + 1) % 3, (longest + 2) % 3];
        let along = center[to] - center[from];
        let length_squared = along.length_squared();
        let t = if length_squared > 0.0 { (center[middle] - center[from]).dot(along) / length_squared } else { 0.0 };
        let bulges = length_squared == 0.0 || radius[middle] > radius[from] + t * (radius[to] - radius[from]);
        return Some(std::array::from_fn(|edge| (edge == middle) != bulges));
    }
    // g . e2 = r2 - r1 and g . e3 = r3 - r1, with g in the plane.
    let g = (e3.cross(normal) * -(radius[1] - radius[0]) + e2.cross(normal) * (radius[2] - radius[0])) / -area_squared;
    (g.length_squared() >= 1.0).then(|| {
        // The outward edge normals add up to zero, so one of the three is never open; rounding must not say otherwise.
        let out: [f64; 3] = std::array::from_fn(|vertex| {
            g.dot((center[(vertex + 2) % 3] - center[(vertex + 1) % 3]).cross(normal))
        });
        let least = out.iter().copied().fold(f64::INFINITY, f64::min);
        let greatest = out.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        out.map(|flow| flow == greatest || (flow >= 0.0 && flow > least))
    })
}

fn length_opposite(center: &[glam::DVec3; 3], vertex: usize) -> f64 {
    center[(vertex + 1) % 3].distance(center[(vertex + 2) % 3])
}
