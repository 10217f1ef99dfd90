//! True overlap of bodies: exact surface against exact surface, regardless of the shapes in the simulation.

use bevy_medial::geometry::{Aabb, Pose3};
use bevy_rapier3d::parry::{
    query::PointQuery,
    shape::{TriMesh, TriMeshFlags},
};
use glam::Vec3;

use crate::{
    body::{Form, State},
    demo::{Demo, SceneBody},
};

/// Distance between points on the axis of a capsule and on the edges of a box, in metres.
const SPACING: f32 = 5e-3;

/// The exact surfaces of a scene.
pub struct Surfaces<'a> {
    demo: &'a Demo,
    meshes: Vec<TriMesh>,
    /// The world box of each body at the start. Only the boxes of fixed bodies are used.
    boxes: Vec<Aabb>,
}

impl<'a> Surfaces<'a> {
    /// # Errors
    /// If a mesh is not closed, because the normals of its surface have to separate inside from outside.
    pub fn new(demo: &'a Demo) -> Result<Self, String> {
        let meshes = demo.models.iter().map(|model| {
            let (positions, triangles) = (model.mesh.positions.clone(), model.mesh.triangles.clone());
            TriMesh::with_flags(positions, triangles, TriMeshFlags::ORIENTED)
                .map_err(|error| format!("{}: {error}", model.name))
        });
        let meshes = meshes.collect::<Result<_, _>>()?;
        let boxes = demo.bodies.iter().map(|body| demo.aabb(body).transformed(&body.body.pose, 1.0)).collect();
        Ok(Self { demo, meshes, boxes })
    }

    /// The deepest overlap of any two bodies, in percent of the smaller body's size: the max depth of a surface point of one body in the other.
    /// The points are the vertices of meshes, and closely spaced points on the axes of capsules and the edges of boxes.
    pub fn deepest(&self, states: &[State]) -> f32 {
        let bodies = &self.demo.bodies;
        let boxes: Vec<Aabb> = bodies
            .iter()
            .zip(states)
            .zip(&self.boxes)
            .map(
                |((body, state), fixed)| {
                    if body.is_dynamic() { self.demo.aabb(body).transformed(&state.pose, 1.0) } else { *fixed }
                },
            )
            .collect();
        let mut deepest = 0.0f32;
        for i in 0..bodies.len() {
            for j in i + 1..bodies.len() {
                // A box with NaN overlaps no other box.
                if !(bodies[i].is_dynamic() || bodies[j].is_dynamic()) || !boxes[i].overlaps(&boxes[j]) {
                    continue;
                }
                let size = bodies[i].size.min(bodies[j].size);
                let one = self.depth((&bodies[i], &states[i].pose), (&bodies[j], &states[j].pose));
                let other = self.depth((&bodies[j], &states[j].pose), (&bodies[i], &states[i].pose));
                deepest = deepest.max(100.0 * one.max(other) / size);
            }
        }
        deepest
    }

    /// Max depth of points of the first body in the second.
    fn depth(&self, (first, pose1): (&SceneBody, &Pose3), (second, pose2): (&SceneBody, &Pose3)) -> f32 {
        let to_second = pose2.inv_mul(pose1);
        let reach = self.demo.aabb(second);
        let mut deepest = 0.0f32;
        let mut look = |point: Vec3, radius: f32| {
            let point = to_second.transform_point(point);
            if reach.distance(point) <= radius {
                deepest = deepest.max(radius - self.distance(second, point));
            }
        };
        let scale = first.body.scale;
        match (first.model, first.capsule(), &first.body.form) {
            (Some(model), ..) => {
                self.demo.models[model].mesh.positions.iter().for_each(|vertex| look(*vertex * scale, 0.0));
            }
            (None, Some((ends, radius)), _) => along(ends, |point| look(point, radius)),
            (None, None, Form::Cuboid(half)) => {
                // Parts far from the other body are skipped: edges may be long.
                let near = self.demo.aabb(second).transformed(&to_second.inverse(), 1.0);
                edges(*half).for_each(|edge| {
                    if let Some(part) = within(edge, &near) {
                        along(part, |point| look(point, 0.0));
                    }
                });
            }
            (None, None, _) => {}
        }
        deepest
    }

    /// Signed distance of a point in the body's frame to its surface.
    fn distance(&self, body: &SceneBody, point: Vec3) -> f32 {
        let scale = body.body.scale;
        match (body.model, body.capsule(), &body.body.form) {
            (Some(model), ..) => {
                let found = self.meshes[model].project_local_point(point / scale, false);
                let distance = found.point.distance(point / scale) * scale;
                if found.is_inside { -distance } else { distance }
            }
            (None, Some(([a, b], radius)), _) => {
                let along = b - a;
                let t = ((point - a).dot(along) / along.length_squared()).clamp(0.0, 1.0);
                point.distance(a + along * t) - radius
            }
            (None, None, Form::Cuboid(half)) => {
                let beyond = point.abs() - *half;
                beyond.max(Vec3::ZERO).length() + beyond.max_element().min(0.0)
            }
            (None, None, _) => f32::INFINITY,
        }
    }
}

/// Calls `visit` with closely spaced points from one end to the other.
fn along([a, b]: [Vec3; 2], visit: impl FnMut(Vec3)) {
    let steps = (a.distance(b) / SPACING).ceil().max(1.0) as u32;
    (0..=steps).map(|step| a.lerp(b, step as f32 / steps as f32)).for_each(visit);
}

/// The part of a line that lies within a box.
fn within([a, b]: [Vec3; 2], aabb: &Aabb) -> Option<[Vec3; 2]> {
    aabb.crossing(a, b - a, 1.0).map(|times| times.map(|time| a.lerp(b, time)))
}

/// The twelve edges of a box.
fn edges(half: Vec3) -> impl Iterator<Item = [Vec3; 2]> {
    (0..3).flat_map(move |axis| {
        [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)].map(|(u, v)| {
            let mut end = half;
            end[(axis + 1) % 3] *= u;
            end[(axis + 2) % 3] *= v;
            let mut other = end;
            other[axis] = -other[axis];
            [other, end]
        })
    })
}
