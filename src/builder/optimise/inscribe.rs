//! Replaces a shape of thin parts by one inside the solid.
//!
//! A fit reduces errors relative to the diagonal. For thin parts these are small, even where spheres protrude by many times the thickness, or where a plate has
//! gaps between its slabs.

use std::collections::BTreeSet;

use arrayvec::ArrayVec;
use glam::DVec3;

use crate::{
    builder::{
        envelope::{Complex, edges_of},
        hull::{Ball, Hull},
        parallel,
        solid::Solid,
        surface_samples::{Samples, medial_ball},
    },
    geometry::Primitive,
};

/// Largest distance that a cone or slab protrudes from the solid, as a part of its radius there.
const PROTRUSION: f64 = 0.3;

/// Weights of the points of a cone and of a slab that are examined.
const CONE: [[f64; 3]; 3] = [[0.5, 0.5, 0.0], [0.75, 0.25, 0.0], [0.25, 0.75, 0.0]];
const SLAB: [[f64; 3]; 4] = [[1.0 / 3.0; 3], [0.6, 0.2, 0.2], [0.2, 0.6, 0.2], [0.2, 0.2, 0.6]];

/// Each sphere becomes the largest ball inside the solid at the nearest point of the surface. Edges and faces are all those
/// between neighbours that lie inside.
pub(super) fn inscribe(complex: &Complex, parts: &[u32], samples: &Samples, solid: &Solid) -> Complex {
    let balls = parallel::map(parts.len(), 8, |i| {
        let ball = complex.balls[i];
        let Some((point, triangle)) = solid.tree.closest_with_triangle(ball.center, None) else { return ball };
        let [a, b, c] = solid.tree.triangles()[triangle as usize];
        medial_ball(solid, parts[i], point, (b - a).cross(c - a).normalize_or_zero())
    });
    // The nearest spheres of a point are neighbours.
    let nearest = parallel::map(samples.len(), 64, |i| {
        let point = samples.points.positions[i];
        let of_part = (0..parts.len()).filter(|&ball| parts[ball] == samples.parts[i]);
        let mut near: Vec<(f64, u32)> =
            of_part.map(|ball| (balls[ball].center.distance_squared(point), ball as u32)).collect();
        near.sort_by(|a, b| a.0.total_cmp(&b.0));
        near.iter().take(3).map(|&(_, ball)| ball).collect::<ArrayVec<u32, 3>>()
    });
    let (mut pairs, mut triples) = (complex.edges.iter().copied().collect::<BTreeSet<_>>(), BTreeSet::new());
    for mut near in nearest {
        if let [a, b, ..] = near[..] {
            pairs.insert([a.min(b), a.max(b)]);
        }
        near.sort_unstable();
        triples.extend(near.into_inner().ok());
    }
    let neighbors: Vec<Primitive> =
        triples.into_iter().map(Primitive::Slab).chain(pairs.into_iter().map(Primitive::Cone)).collect();
    let inside = parallel::map(neighbors.len(), 8, |i| is_inside(&neighbors[i], &balls, solid));
    let (mut edges, mut faces) = (BTreeSet::new(), vec![]);
    for (primitive, _) in neighbors.iter().zip(inside).filter(|(_, inside)| *inside) {
        match *primitive {
            Primitive::Slab(face) => {
                faces.push(face);
                edges.extend(edges_of(face));
            }
            Primitive::Cone(edge) => _ = edges.insert(edge),
            Primitive::Sphere(_) => {}
        }
    }
    Complex { balls, edges: edges.into_iter().collect(), faces }
}

/// True if a cone or a slab protrudes little from the solid.
fn is_inside(primitive: &Primitive, balls: &[Ball], solid: &Solid) -> bool {
    let hull = Hull::new(balls, primitive);
    let weights: &[[f64; 3]] = if primitive.indices().len() == 3 { &SLAB } else { &CONE };
    weights.iter().all(|weights| {
        let ball = hull.blend(weights);
        let out = |nearest: DVec3| ball.radius - nearest.distance(ball.center);
        let fits = solid.tree.closest(ball.center, f64::INFINITY).is_some_and(|p| out(p) <= PROTRUSION * ball.radius);
        fits && solid.is_inside(ball.center)
    })
}
