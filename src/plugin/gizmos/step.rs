//! Lines of the last step, drawn again in every frame.

use bevy::prelude::*;

use super::{MedialGizmo, MedialGizmoLayer, MedialGizmos, wireframe};
use crate::{
    geometry::{Aabb, Pose3, Primitive},
    pipeline::{Shape, Side, Solid, swept_cone},
    plugin::MedialStep,
};

/// Sides of a circle.
const SIDES: u32 = 16;

/// Makes the next step report its candidates if they are to be drawn.
pub(super) fn ask_for_candidates(mut step: ResMut<MedialStep>, store: Res<GizmoConfigStore>) {
    let (group, layers) = store.config::<MedialGizmos>();
    let wanted = group.enabled && layers.candidates.enabled;
    if step.input.report_candidates != wanted {
        step.input.report_candidates = wanted;
    }
}

/// Draws the layers that are on.
pub(super) fn draw(
    step: Res<MedialStep>,
    store: Res<GizmoConfigStore>,
    overrides: Query<&'static MedialGizmo>,
    lines: Gizmos<MedialGizmos>,
) {
    let layers = store.config::<MedialGizmos>().1;
    let mut draw = Draw { step: &step, overrides, lines };
    draw.skins([&layers.spheres, &layers.cones, &layers.slabs]);
    draw.boxes(&layers.boxes);
    draw.hierarchy(&layers.hierarchy);
    draw.swept_cones(&layers.swept_cones);
    draw.candidates(&layers.candidates);
    draw.contacts(&layers.contacts, layers.normal_length);
    draw.stops(&layers.stops, layers.normal_length);
}

/// Returns the colour of a layer for an entity; none if it is not to be drawn.
pub(super) fn color(layer: &MedialGizmoLayer, gizmo: Option<&MedialGizmo>) -> Option<Color> {
    match gizmo {
        Some(gizmo) => (layer.enabled && gizmo.enabled).then(|| gizmo.color.unwrap_or(layer.color)),
        None => layer.enabled.then_some(layer.color),
    }
}

struct Draw<'a, 'w, 's> {
    step: &'a MedialStep,
    overrides: Query<'w, 's, &'static MedialGizmo>,
    lines: Gizmos<'w, 's, MedialGizmos>,
}

impl Draw<'_, '_, '_> {
    fn color(&self, layer: &MedialGizmoLayer, entity: Entity) -> Option<Color> {
        color(layer, self.overrides.get(entity).ok())
    }

    /// The same for a pair. It is the colour of the first side if that has its own, or else that of the second.
    fn color_of_pair(&self, layer: &MedialGizmoLayer, sides: [Side; 2]) -> Option<Color> {
        let [first, second] = sides.map(|side| self.color(layer, self.step.info(side).entity));
        first.zip(second).map(|(first, second)| if first == layer.color { second } else { first })
    }

    fn add_box(&mut self, pose: Pose3, aabb: Aabb, color: Color) {
        let transform = Transform::from_translation(pose.transform_point(aabb.center()))
            .with_rotation(pose.rotation)
            .with_scale(aabb.half_extents() * 2.0);
        self.lines.cube(transform, color);
    }

    /// Skinned shapes, whose lines change in each step.
    fn skins(&mut self, layers: [&MedialGizmoLayer; 3]) {
        for (body, info) in self.step.input.bodies.iter().zip(&self.step.infos) {
            if let Some(shape) = body.solid.deforming() {
                let colors = layers.map(|layer| self.color(layer, info.entity));
                wireframe::draw(&mut self.lines, shape.axis(), &body.sweep.end, colors);
            }
        }
    }

    fn boxes(&mut self, layer: &MedialGizmoLayer) {
        for (body, info) in self.step.statics.bodies().iter().zip(&self.step.static_infos) {
            if let Some(color) = self.color(layer, info.entity) {
                self.add_box(body.pose, body.solid.aabb(), color);
            }
        }
    }

    fn hierarchy(&mut self, layer: &MedialGizmoLayer) {
        if layer.enabled {
            for aabb in self.step.statics.bvh().inner_boxes() {
                self.add_box(Pose3::IDENTITY, aabb, layer.color);
            }
        }
    }

    fn swept_cones(&mut self, layer: &MedialGizmoLayer) {
        for (body, info) in self.step.input.bodies.iter().zip(&self.step.infos).filter(|(body, _)| body.active) {
            let Some(color) = self.color(layer, info.entity) else { continue };
            let cone = swept_cone(body);
            let displacement = cone[1].center - cone[0].center;
            let direction = displacement.try_normalize().unwrap_or(Vec3::Y);
            let rotation = Quat::from_rotation_arc(Vec3::Z, direction);
            for sphere in cone {
                let circle = Isometry3d::new(sphere.center, rotation);
                self.lines.circle(circle, sphere.radius, color).resolution(SIDES);
            }
            for side in [Vec3::X, Vec3::Y, Vec3::NEG_X, Vec3::NEG_Y] {
                let start = cone[0].center + rotation * side * cone[0].radius;
                self.lines.line(start, start + displacement, color);
            }
        }
    }

    fn candidates(&mut self, layer: &MedialGizmoLayer) {
        for candidates in &self.step.output.candidates {
            let Some(color) = self.color_of_pair(layer, candidates.sides) else { continue };
            let sides = candidates.sides.map(|side| (self.step.solid(side), self.step.final_pose(side)));
            let [Some(shape1), shape2] = sides.map(|(solid, _)| solid.medial()) else { continue };
            let [(_, pose1), (solid2, pose2)] = sides;
            for [primitive1, primitive2] in candidates.primitives.indices() {
                let from = pose1.transform_point(middle(shape1, primitive1));
                let to = match shape2 {
                    Some(shape2) => pose2.transform_point(middle(shape2, primitive2)),
                    None => nearest_of_box(solid2, &pose2, from),
                };
                self.lines.line(from, to, color);
            }
        }
    }

    fn contacts(&mut self, layer: &MedialGizmoLayer, length: f32) {
        for pair in &self.step.output.pairs {
            let Some(color) = self.color_of_pair(layer, [pair.first, pair.second]) else { continue };
            let end = self.step.final_pose(pair.first);
            let manifolds = &self.step.output.manifolds[pair.manifolds.clone()];
            for contact in manifolds.iter().flat_map(|manifold| manifold.contacts()) {
                let point = end.transform_point(contact.point1);
                self.lines.arrow(point, point + end.rotation * contact.normal1 * length, color);
            }
        }
    }

    fn stops(&mut self, layer: &MedialGizmoLayer, length: f32) {
        for stop in &self.step.output.stops {
            let side = Side::Body(stop.body);
            let Some(color) = self.color(layer, self.step.info(side).entity) else { continue };
            let solid = self.step.solid(side);
            // Medial shapes have retained lines.
            if solid.medial().is_none() {
                self.add_box(stop.pose, solid.aabb(), color);
            }
        }
        for pair in &self.step.output.pairs {
            let sides = [pair.first, pair.second];
            let stops =
                sides.iter().filter_map(|side| side.body()).any(|body| self.step.output.stop_of(body).is_some());
            let Some(impact) = pair.impact.filter(|_| stops) else { continue };
            if let Some(color) = self.color_of_pair(layer, sides) {
                let reach = impact.normal * (0.5 * length);
                self.lines.cross(impact.point, length, color);
                self.lines.line(impact.point - reach, impact.point + reach, color);
            }
        }
    }
}

/// The mean of a primitive's sphere centres, in the frame of the body.
fn middle(shape: &Shape, primitive: u32) -> Vec3 {
    let primitive: &Primitive = &shape.axis.primitives()[primitive as usize];
    let centers = primitive.indices().iter().map(|&i| shape.axis.spheres()[i as usize].center);
    centers.sum::<Vec3>() * (shape.scale / primitive.indices().len() as f32)
}

/// The point of a solid's box that is nearest to a point, both in the world.
fn nearest_of_box(solid: &Solid, pose: &Pose3, point: Vec3) -> Vec3 {
    let Aabb { min, max } = solid.aabb();
    pose.transform_point(pose.inverse_transform_point(point).clamp(min, max))
}
