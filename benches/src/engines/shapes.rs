//! Shapes of bodies in engines without medial meshes: the stand-in of a body, or the same set of points in shapes of the engine.
//!
//! Balls and capsules exist in every engine. A slab of one radius is a rounded triangle. Other cones and slabs are convex hulls of points on their
//! spheres. Several primitives form a compound.

#[cfg(feature = "peers")]
use avian3d::prelude::{Collider as AvianCollider, TrimeshFlags};
use bevy_medial::{
    geometry::{Primitive, Sphere},
    medial_axis::MedialAxis,
};
use bevy_rapier3d::parry::{
    math::Pose,
    shape::{SharedShape, TriMeshFlags},
};
use glam::Vec3;

use crate::body::{Body, Form, StandIn};

/// Points on each sphere of a convex hull.
const POINTS: usize = 64;

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

fn scaled(points: &[Vec3], scale: f32) -> Vec<Vec3> {
    points.iter().map(|point| *point * scale).collect()
}

fn flat() -> String {
    "no shape: a convex hull without a volume".into()
}

/// The input of an engine without medial meshes.
enum Given<'a> {
    Cuboid(Vec3),
    Parts(Vec<Part>),
    /// A hollow body, at scale 1.
    Surface(&'a [Vec3], &'a [[u32; 3]]),
    /// A static surface, at scale 1.
    Ground(&'a [Vec3], &'a [[u32; 3]]),
}

impl<'a> Given<'a> {
    fn of(body: &'a Body) -> Self {
        match (&body.stand_in, &body.form) {
            (Some(StandIn::Hulls(hulls)), _) => {
                Self::Parts(hulls.iter().map(|hull| Part::Hull(scaled(hull, body.scale))).collect())
            }
            (Some(StandIn::Surface(mesh)), _) => Self::Surface(&mesh.positions, &mesh.triangles),
            (None, Form::Cuboid(half)) => Self::Cuboid(*half * body.scale),
            (None, Form::Medial(axis)) => Self::Parts(parts(axis, body.scale)),
            (None, Form::Triangles(positions, triangles)) => Self::Ground(positions, triangles),
        }
    }
}

/// The shape of a body in rapier.
///
/// # Errors
/// If points span no volume.
pub fn rapier_shape(body: &Body) -> Result<SharedShape, String> {
    let parts = match Given::of(body) {
        Given::Cuboid(half) => return Ok(SharedShape::cuboid(half.x, half.y, half.z)),
        Given::Surface(positions, triangles) => {
            return SharedShape::trimesh(scaled(positions, body.scale), triangles.to_vec())
                .map_err(|error| format!("no shape: {error}"));
        }
        Given::Ground(positions, triangles) => {
            let flags = TriMeshFlags::FIX_INTERNAL_EDGES;
            return SharedShape::trimesh_with_flags(scaled(positions, body.scale), triangles.to_vec(), flags)
                .map_err(|error| error.to_string());
        }
        Given::Parts(parts) => parts,
    };
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
    let mut shapes = parts.into_iter().map(shape).collect::<Result<Vec<_>, String>>()?;
    let is_one = shapes.len() == 1 && shapes[0].0.translation == Vec3::ZERO;
    Ok(if is_one { shapes.remove(0).1 } else { SharedShape::compound(shapes) })
}

/// The shape of a body in avian.
///
/// # Errors
/// If points span no volume.
#[cfg(feature = "peers")]
pub fn avian_shape(body: &Body) -> Result<AvianCollider, String> {
    use glam::Quat;
    let parts = match Given::of(body) {
        Given::Cuboid(half) => return Ok(AvianCollider::cuboid(2.0 * half.x, 2.0 * half.y, 2.0 * half.z)),
        Given::Surface(positions, triangles) | Given::Ground(positions, triangles) => {
            let flags = TrimeshFlags::FIX_INTERNAL_EDGES;
            return AvianCollider::try_trimesh_with_config(scaled(positions, body.scale), triangles.to_vec(), flags)
                .map_err(|error| error.to_string());
        }
        Given::Parts(parts) => parts,
    };
    let shape = |part: Part| {
        let shape = match part {
            Part::Ball(ball) => return Ok((ball.center, Quat::IDENTITY, AvianCollider::sphere(ball.radius))),
            Part::Capsule([a, b], radius) => AvianCollider::capsule_endpoints(radius, a, b),
            // Avian has no rounded triangles.
            Part::RoundTriangle(corners, radius) => {
                let points = corners.iter().flat_map(|corner| points(&Sphere::new(*corner, radius))).collect();
                AvianCollider::convex_hull(points).ok_or_else(flat)?
            }
            Part::Hull(points) => AvianCollider::convex_hull(points).ok_or_else(flat)?,
        };
        Ok((Vec3::ZERO, Quat::IDENTITY, shape))
    };
    let mut shapes = parts.into_iter().map(shape).collect::<Result<Vec<_>, String>>()?;
    let is_one = shapes.len() == 1 && shapes[0].0 == Vec3::ZERO;
    Ok(if is_one { shapes.remove(0).2 } else { AvianCollider::compound(shapes) })
}
