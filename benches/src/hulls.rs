//! Distance of a mesh from the surface of a union of convex hulls.

use bevy_medial::builder::{Deviation, TriangleMesh};
use bevy_rapier3d::parry::{query::PointQuery, shape::ConvexPolyhedron};
use glam::Vec3;

/// Distance of a mesh from the surface of the union of convex hulls, in percent of the mesh's diagonal.
pub fn hull_error(mesh: &TriangleMesh, hulls: &[&ConvexPolyhedron]) -> Deviation {
    const SAMPLES_PER_DIAGONAL: f32 = 300.0;
    let spacing = mesh.diagonal() / SAMPLES_PER_DIAGONAL;
    let percent = 100.0 / mesh.diagonal();
    let mut tally = Tally::default();
    for triangle in &mesh.triangles {
        sample(mesh.corners(*triangle), spacing, |point, area| tally.add(distance(hulls, point).abs() * percent, area));
    }
    tally.deviation()
}

/// Signed distance of a point to the union. It is exact outside. Inside it is the negative depth in the deepest hull, which is a lower bound of the depth.
fn distance(hulls: &[&ConvexPolyhedron], point: Vec3) -> f32 {
    let depth = hulls.iter().map(|hull| depth(hull, point)).fold(f32::NEG_INFINITY, f32::max);
    if depth > 0.0 {
        return -depth;
    }
    hulls.iter().map(|hull| hull.distance_to_local_point(point, true)).fold(f32::INFINITY, f32::min)
}

/// Depth of a point in a hull, negative outside.
fn depth(hull: &ConvexPolyhedron, point: Vec3) -> f32 {
    let corner = |first: u32| hull.points()[hull.vertices_adj_to_face()[first as usize] as usize];
    let planes = hull.faces().iter().map(|face| (corner(face.first_vertex_or_edge) - point).dot(face.normal));
    planes.fold(f32::INFINITY, f32::min)
}

/// Calls `visit` with points of a triangle about `spacing` apart, each with the area that it represents.
fn sample([a, b, c]: [Vec3; 3], spacing: f32, mut visit: impl FnMut(Vec3, f32)) {
    let longest = a.distance(b).max(b.distance(c)).max(c.distance(a));
    let count = ((longest / spacing).ceil() as u32).clamp(1, 300);
    let area = (b - a).cross(c - a).length() * 0.5 / (count * count) as f32;
    let mut at = |i: f32, j: f32| visit(a + ((b - a) * i + (c - a) * j) / count as f32, area);
    for i in 0..count {
        for j in 0..count - i {
            at(i as f32 + 1.0 / 3.0, j as f32 + 1.0 / 3.0);
            if i + j + 1 < count {
                at(i as f32 + 2.0 / 3.0, j as f32 + 2.0 / 3.0);
            }
        }
    }
}

#[derive(Default)]
struct Tally {
    max: f32,
    sum: f64,
    area: f64,
}

impl Tally {
    fn add(&mut self, distance: f32, area: f32) {
        self.max = self.max.max(distance);
        self.sum += f64::from(distance) * f64::from(area);
        self.area += f64::from(area);
    }

    fn deviation(&self) -> Deviation {
        Deviation { max: self.max, mean: (self.sum / self.area.max(f64::MIN_POSITIVE)) as f32 }
    }
}
