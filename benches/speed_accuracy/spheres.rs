//! Shapes of spheres only, like the leaves of a sphere tree.

use bevy_medial::{
    geometry::{Primitive, Sphere},
    medial_axis::{MedialAxis, MedialAxisError},
};
use glam::Vec3;

use crate::models::Model;

/// Distance between neighbours among the candidate spheres, and among the points of the surface to cover, as a part of the diagonal.
const SPACING: f32 = 0.01;

/// Chooses `count` spheres in the volume of the finest medial mesh. Each reaches the point of the surface that is farthest from all spheres before.
///
/// # Errors
/// If there are too many spheres.
pub fn inscribed(model: &Model, count: usize) -> Result<MedialAxis, MedialAxisError> {
    let spacing = SPACING * model.diagonal;
    let all = model.medial.last().map_or_else(Vec::new, |finest| within(&finest.axis, spacing));
    let surface = points(model, spacing);
    let mut distances = vec![f32::INFINITY; surface.len()];
    let mut chosen: Vec<Sphere> = Vec::new();
    for _ in 0..count {
        let farthest = distances.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1)).map(|(at, _)| surface[at]);
        let Some(point) = farthest else { break };
        let gap = |sphere: &Sphere| (sphere.center.distance(point) - sphere.radius).abs();
        let Some(best) = all.iter().min_by(|a, b| gap(a).total_cmp(&gap(b))) else { break };
        chosen.push(*best);
        for (distance, point) in distances.iter_mut().zip(&surface) {
            *distance = distance.min(best.center.distance(*point) - best.radius);
        }
    }
    MedialAxis::new(chosen, Vec::new()).map(|(axis, _)| axis)
}

/// Spheres that fill the primitives of a medial mesh.
fn within(axis: &MedialAxis, spacing: f32) -> Vec<Sphere> {
    let mut found = axis.spheres().to_vec();
    for primitive in axis.primitives() {
        let [a, b, c] = match *primitive {
            Primitive::Sphere(_) => continue,
            Primitive::Cone([i, j]) => [i, j, j],
            Primitive::Slab(corners) => corners,
        }
        .map(|index| axis.spheres()[index as usize]);
        let mix = |u: f32, v: f32| {
            let w = 1.0 - u - v;
            Sphere::new(a.center * w + b.center * u + c.center * v, a.radius * w + b.radius * u + c.radius * v)
        };
        let longest = a.center.distance(b.center).max(a.center.distance(c.center)).max(b.center.distance(c.center));
        let steps = (longest / spacing).ceil().max(1.0) as u32;
        let is_cone = matches!(primitive, Primitive::Cone(_));
        for i in 0..=steps {
            for j in 0..=if is_cone { 0 } else { steps - i } {
                found.push(mix(i as f32 / steps as f32, j as f32 / steps as f32));
            }
        }
    }
    found
}

/// The vertices and the centroids of the triangles, at most one in each cell of a grid with the given spacing.
fn points(model: &Model, spacing: f32) -> Vec<Vec3> {
    let mesh = &model.mesh;
    let middles = mesh.triangles.iter().map(|triangle| mesh.corners(*triangle).iter().sum::<Vec3>() / 3.0);
    let mut taken = std::collections::HashSet::new();
    let cell = |point: &Vec3| (*point / spacing).floor().as_ivec3();
    mesh.positions.iter().copied().chain(middles).filter(|point| taken.insert(cell(point))).collect()
}
