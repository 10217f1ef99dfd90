//! What stands for a shape in engines that know no medial meshes: the same set of points, of the engine's own shapes.
//!
//! Balls and capsules are what they are, slabs of one radius are rounded triangles; other cones and slabs are convex hulls of points all over
//! their spheres. Several primitives are a compound.

use avian3d::prelude::Collider as AvianCollider;
use bevy_medial::{
    geometry::{Primitive, Sphere},
    medial_axis::{MedialAxis, triangulate},
};
use bevy_rapier3d::parry::{
    math::Pose,
    shape::{SharedShape, TriMeshFlags},
};
use glam::{Quat, Vec3};

use crate::world::{Body, Form, Kind};

/// Points on each sphere of a convex hull.
const POINTS: usize = 64;

/// Vertices around a cone of a triangle mesh.
const SEGMENTS: u32 = 16;

/// A convex part.
enum Part {
    Ball(Sphere),
    Capsule([Vec3; 2], f32),
    RoundTriangle([Vec3; 3], f32),
    Hull(Vec<Vec3>),
}

fn parts(axis: &MedialAxis, scale: f32) -> Vec<Part> {
    let part = |primitive: &Primitive| {
        let spheres: Vec<Sphere> =
            primitive.indices().iter().map(|&i| axis.spheres()[i as usize].scaled(scale)).collect();
        match spheres[..] {
            [ball] => Part::Ball(ball),
            [a, b] if a.radius == b.radius => Part::Capsule([a.center, b.center], a.radius),
            [a, b, c] if a.radius == b.radius && b.radius == c.radius && a.radius > 0.0 => {
                Part::RoundTriangle([a.center, b.center, c.center], a.radius)
            }
            _ => Part::Hull(spheres.iter().flat_map(points).collect()),
        }
    };
    axis.primitives().iter().map(part).collect()
}

/// Points on a sphere, evenly spread.
fn points(sphere: &Sphere) -> Vec<Vec3> {
    let count = if sphere.radius > 0.0 { POINTS } else { 1 };
    let golden = std::f32::consts::PI * (3.0 - 5f32.sqrt());
    let point = |i: usize| {
        let y = 1.0 - 2.0 * (i as f32 + 0.5) / count as f32;
        let (sin, cos) = (golden * i as f32).sin_cos();
        let across = (1.0 - y * y).sqrt();
        sphere.center + sphere.radius * Vec3::new(across * cos, y, across * sin)
    };
    (0..count).map(point).collect()
}

fn flat() -> String {
    "no shape: a convex hull without a volume".into()
}

/// The shape of a body in rapier. `triangles`: bodies that move are triangle meshes.
///
/// # Errors
/// If points span no volume.
pub fn rapier_shape(body: &Body, triangles: bool) -> Result<SharedShape, String> {
    match &body.form {
        Form::Cuboid(half) if !triangles || body.kind != Kind::Dynamic => {
            let half = *half * body.scale;
            Ok(SharedShape::cuboid(half.x, half.y, half.z))
        }
        Form::Triangles(positions, indices) => {
            SharedShape::trimesh_with_flags(positions.clone(), indices.clone(), TriMeshFlags::FIX_INTERNAL_EDGES)
                .map_err(|error| error.to_string())
        }
        form => {
            let axis = form.axis().ok_or_else(flat)?;
            if triangles && body.kind == Kind::Dynamic {
                return surface(&axis, body.scale);
            }
            let shape = |part: Part| {
                let shape = match part {
                    Part::Ball(ball) => {
                        return Ok((Pose::from_translation(ball.center), SharedShape::ball(ball.radius)));
                    }
                    Part::Capsule([a, b], radius) => SharedShape::capsule(a, b, radius),
                    Part::RoundTriangle([a, b, c], radius) => SharedShape::round_triangle(a, b, c, radius),
                    Part::Hull(points) => SharedShape::convex_hull(&points).ok_or_else(flat)?,
                };
                Ok((Pose::IDENTITY, shape))
            };
            let mut shapes = parts(&axis, body.scale).into_iter().map(shape).collect::<Result<Vec<_>, String>>()?;
            let is_one = shapes.len() == 1 && shapes[0].0.translation == Vec3::ZERO;
            Ok(if is_one { shapes.remove(0).1 } else { SharedShape::compound(shapes) })
        }
    }
}

/// The surface as triangles.
fn surface(axis: &MedialAxis, scale: f32) -> Result<SharedShape, String> {
    let surface = triangulate(axis.spheres(), axis.primitives(), SEGMENTS);
    let positions = surface.positions.iter().map(|position| Vec3::from(*position) * scale).collect();
    let triangles = surface.indices.chunks_exact(3).map(|corners| [corners[0], corners[1], corners[2]]).collect();
    SharedShape::trimesh(positions, triangles).map_err(|error| format!("no shape: {error}"))
}

/// The shape of a body in avian.
///
/// # Errors
/// If points span no volume.
pub fn avian_shape(body: &Body) -> Result<AvianCollider, String> {
    let axis = match &body.form {
        Form::Cuboid(half) => {
            let whole = *half * (2.0 * body.scale);
            return Ok(AvianCollider::cuboid(whole.x, whole.y, whole.z));
        }
        Form::Triangles(positions, indices) => {
            let flags = avian3d::prelude::TrimeshFlags::FIX_INTERNAL_EDGES;
            return AvianCollider::try_trimesh_with_config(positions.clone(), indices.clone(), flags)
                .map_err(|error| error.to_string());
        }
        Form::Medial(axis) => axis,
    };
    let shape = |part: Part| {
        let shape = match part {
            Part::Ball(ball) => return Ok((ball.center, Quat::IDENTITY, AvianCollider::sphere(ball.radius))),
            Part::Capsule([a, b], radius) => AvianCollider::capsule_endpoints(radius, a, b),
            // It knows no rounded triangles.
            Part::RoundTriangle(corners, radius) => {
                let points = corners.iter().flat_map(|corner| points(&Sphere::new(*corner, radius))).collect();
                AvianCollider::convex_hull(points).ok_or_else(flat)?
            }
            Part::Hull(points) => AvianCollider::convex_hull(points).ok_or_else(flat)?,
        };
        Ok((Vec3::ZERO, Quat::IDENTITY, shape))
    };
    let mut shapes = parts(axis, body.scale).into_iter().map(shape).collect::<Result<Vec<_>, String>>()?;
    let is_one = shapes.len() == 1 && shapes[0].0 == Vec3::ZERO;
    Ok(if is_one { shapes.remove(0).2 } else { AvianCollider::compound(shapes) })
}
