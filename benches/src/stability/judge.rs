//! A world and its measurements, the same for every method.
//!
//! Overlaps are those of the exact shapes, by this crate's closed forms for distance, which tests compare with a search in f64. Everything else follows
//! from positions and velocities alone.

use bevy_medial::{
    geometry::Pose3,
    pipeline::{ContactMargin, OtherShape, Shape, contacts},
    query::Cuboid,
};
use glam::Vec3;

use super::methods::Method;
use crate::{
    body::{Body, Form, Kind, Setup, State},
    engines::Engine,
};

/// The overlap that an engine may leave: 5 mm by the settings of rapier and of avian, per unit of length, and a margin for rounding.
const ALLOWED_OVERLAP: f32 = 6e-3;

/// Additional overlap, in sizes of the smaller body, because bodies that hit each other may overlap by this much for a moment.
const OVERLAP: f32 = 0.02;

/// The max drift of a body at rest, in its sizes.
const DRIFT: f32 = 0.01;

/// A body with its shape and mass.
struct Tracked {
    body: Body,
    shape: Option<Shape>,
    mass: bevy_medial::medial_axis::MassProperties,
    size: f32,
    gone: bool,
}

impl Tracked {
    fn new(body: &Body) -> Self {
        let shape = body.form.axis().map(|axis| Shape { axis, scale: body.scale });
        Self { body: body.clone(), shape, mass: body.mass(), size: body.size(), gone: false }
    }
}

/// An engine and the bodies in it.
pub struct World {
    engine: Box<dyn Engine>,
    setup: Setup,
    bodies: Vec<Tracked>,
    /// Seconds so far.
    pub time: f32,
}

impl World {
    /// An empty world.
    ///
    /// # Errors
    /// Those of the engine.
    pub fn new(method: &Method, setup: Setup) -> Result<Self, String> {
        Ok(Self { engine: (method.make)(setup)?, setup, bodies: Vec::new(), time: 0.0 })
    }

    /// Adds a body, and returns its number.
    ///
    /// # Errors
    /// If the engine cannot make its shape.
    pub fn add(&mut self, body: Body) -> Result<usize, String> {
        self.engine.spawn(&body)?;
        self.bodies.push(Tracked::new(&body));
        Ok(self.bodies.len() - 1)
    }

    /// A floor whose top is at height 0.
    pub fn add_floor(&mut self) -> Result<usize, String> {
        let unit = self.setup.unit;
        let half = Vec3::new(20.0, 1.0, 20.0) * unit;
        self.add(Body::fixed(Form::Cuboid(half)).at(Vec3::Y * -unit))
    }

    /// Runs a step of another length.
    ///
    /// # Errors
    /// If the pose or the velocity of a body is not finite afterwards.
    pub fn step_of(&mut self, dt: f32) -> Result<(), String> {
        self.engine.step(dt);
        self.time += dt;
        for i in self.dynamic() {
            let State { pose, linear, angular } = self.state(i);
            let finite = pose.translation.is_finite() && pose.rotation.is_finite();
            if !(finite && linear.is_finite() && angular.is_finite()) {
                return Err(format!("not a number: after {:.2} s", self.time));
            }
        }
        Ok(())
    }

    /// Runs steps.
    ///
    /// # Errors
    /// If the pose or the velocity of a body is not finite afterwards.
    pub fn step(&mut self, steps: u32) -> Result<(), String> {
        (0..steps).try_for_each(|_| self.step_of(self.setup.dt))
    }

    /// Runs steps for a time.
    ///
    /// # Errors
    /// If the pose or the velocity of a body is not finite afterwards.
    pub fn run(&mut self, seconds: f32) -> Result<(), String> {
        self.step((seconds / self.setup.dt).round() as u32)
    }

    pub fn state(&self, body: usize) -> State {
        self.engine.state(body)
    }

    pub fn size(&self, body: usize) -> f32 {
        self.bodies[body].size
    }

    pub fn mass(&self, body: usize) -> f32 {
        self.bodies[body].mass.volume
    }

    pub fn teleport(&mut self, body: usize, pose: Pose3) {
        self.engine.teleport(body, pose);
    }

    pub fn push(&mut self, body: usize, linear: Vec3) {
        self.engine.push(body, linear);
    }

    pub fn despawn(&mut self, body: usize) {
        self.engine.despawn(body);
        self.bodies[body].gone = true;
    }

    /// # Errors
    /// If the engine cannot make its shape.
    pub fn resize(&mut self, body: usize, scale: f32) -> Result<(), String> {
        let State { pose, .. } = self.state(body);
        let description = Body { scale, pose, ..self.bodies[body].body.clone() };
        self.engine.resize(body, &description)?;
        self.bodies[body] = Tracked::new(&description);
        Ok(())
    }

    /// The dynamic bodies.
    pub fn dynamic(&self) -> Vec<usize> {
        let is_dynamic = |i: &usize| self.bodies[*i].body.kind == Kind::Dynamic && !self.bodies[*i].gone;
        (0..self.bodies.len()).filter(is_dynamic).collect()
    }

    /// Centre of mass.
    pub fn center(&self, body: usize) -> Vec3 {
        self.state(body).pose.transform_point(self.bodies[body].mass.center_of_mass)
    }

    /// The centres of the spheres of a body's shape, in the world.
    pub fn sphere_centers(&self, body: usize) -> Vec<Vec3> {
        let pose = self.state(body).pose;
        let Some(Shape { axis, scale }) = &self.bodies[body].shape else { return Vec::new() };
        axis.spheres().iter().map(|sphere| pose.transform_point(sphere.center * *scale)).collect()
    }

    /// Height of the lowest point of a body.
    pub fn lowest(&self, body: usize) -> f32 {
        let pose = self.state(body).pose;
        let Some(Shape { axis, scale }) = &self.bodies[body].shape else { return 0.0 };
        let heights = axis.spheres().iter().map(|s| pose.transform_point(s.center * *scale).y - s.radius * *scale);
        heights.fold(f32::INFINITY, f32::min)
    }

    /// Momentum of a body.
    pub fn momentum(&self, body: usize) -> Vec3 {
        self.state(body).linear * self.mass(body)
    }

    /// Kinetic energy of a body.
    pub fn kinetic(&self, body: usize) -> f32 {
        let State { pose, linear, angular } = self.state(body);
        let local = pose.rotation.inverse() * angular;
        let mass = &self.bodies[body].mass;
        0.5 * (mass.volume * linear.length_squared() + local.dot(mass.inertia * local))
    }

    /// Kinetic energy of all bodies, and the energy that they would gain by falling to height 0.
    pub fn energy(&self) -> f32 {
        let energy = |i| self.kinetic(i) + self.mass(i) * self.setup.gravity * self.center(i).y;
        self.dynamic().into_iter().map(energy).sum()
    }

    /// Gain of energy relative to `at_first`, the energy at the start; negative for a loss. The present energy is that of the centres of mass. Energy of
    /// rotation is left out, because without gyroscopic forces it changes as a body turns.
    pub fn energy_gain(&self, at_first: f32) -> f32 {
        let energy =
            |i| self.mass(i) * (0.5 * self.state(i).linear.length_squared() + self.setup.gravity * self.center(i).y);
        self.dynamic().into_iter().map(energy).sum::<f32>() / at_first - 1.0
    }

    /// Depth of the overlap of two bodies, in metres; 0 without an overlap.
    pub fn depth(&self, one: usize, other: usize) -> f32 {
        let (first, second) = if self.bodies[one].shape.is_some() { (one, other) } else { (other, one) };
        let Some(shape1) = &self.bodies[first].shape else { return 0.0 };
        let pose12 = self.state(first).pose.inv_mul(&self.state(second).pose);
        let mut contacts = Vec::new();
        let reach = ContactMargin::new(0.0, self.setup.unit);
        match (&self.bodies[second].body.form, &self.bodies[second].shape) {
            (Form::Cuboid(half), _) => {
                let half = *half * self.bodies[second].body.scale;
                contacts::find(shape1, OtherShape::Parts(&Cuboid { half }), &pose12, reach, &mut contacts);
            }
            (_, Some(shape2)) => contacts::find(shape1, OtherShape::Shape(shape2), &pose12, reach, &mut contacts),
            (_, None) => {}
        }
        contacts.iter().map(|contact| -contact.distance).fold(0.0, f32::max)
    }

    /// Allowed overlap of two bodies, in metres.
    pub fn allowed(&self, one: usize, other: usize) -> f32 {
        ALLOWED_OVERLAP * self.setup.unit + OVERLAP * self.size(one).min(self.size(other))
    }

    /// Checks that no two bodies overlap by more than `times` the allowed depth.
    ///
    /// # Errors
    /// If two bodies do. The message describes the worst overlap.
    pub fn check_overlaps(&self, times: f32) -> Result<(), String> {
        let dynamic = self.dynamic();
        let mut worst = (0.0, 0.0);
        for &i in &dynamic {
            for j in (0..self.bodies.len()).filter(|j| !self.bodies[*j].gone && (*j < i || !dynamic.contains(j))) {
                let depth = self.depth(i, j);
                let ratio = depth / self.allowed(i, j);
                if ratio > worst.0 {
                    worst = (ratio, 100.0 * depth / self.size(i).min(self.size(j)));
                }
            }
        }
        if worst.0 > times { Err(format!("overlap: {:.1} % of a body at {:.2} s", worst.1, self.time)) } else { Ok(()) }
    }

    /// Checks that all dynamic bodies rest for a time: drift, speed and overlap.
    ///
    /// # Errors
    /// If one of these is too large. The message names it.
    pub fn check_rest(&mut self, seconds: f32) -> Result<(), String> {
        let bodies = self.dynamic();
        let start: Vec<State> = bodies.iter().map(|&i| self.state(i)).collect();
        let mut fastest = 0.0f32;
        for _ in 0..(seconds / self.setup.dt).round() as u32 {
            self.step(1)?;
            fastest = bodies.iter().map(|&i| self.state(i).linear.length()).fold(fastest, f32::max);
        }
        for (&i, before) in bodies.iter().zip(&start) {
            let after = self.state(i);
            let turned = before.pose.rotation.angle_between(after.pose.rotation) * 0.5 * self.size(i);
            let moved = before.pose.translation.distance(after.pose.translation);
            let drift = moved.max(turned) / self.size(i);
            if drift > DRIFT {
                return Err(format!("drift: by {:.1} % of its size in {seconds:.0} s of rest", 100.0 * drift));
            }
        }
        let limit = 0.1 * self.setup.unit;
        if fastest > limit {
            return Err(format!("jitter: at {fastest:.2} m/s at rest"));
        }
        self.check_overlaps(1.0)
    }
}

/// The first touch of two bodies in free flight: its time, its point, and the unit normal from the first to the second body. `None` without a touch
/// within `end` seconds.
pub fn first_touch(first: &Body, second: &Body, end: f32) -> Option<(f32, Vec3, Vec3)> {
    let (Some(axis1), Some(axis2)) = (first.form.axis(), second.form.axis()) else { return None };
    let [shape1, shape2] = [(axis1, first.scale), (axis2, second.scale)].map(|(axis, scale)| Shape { axis, scale });
    let speed = first.linear.distance(second.linear);
    let later =
        |body: &Body, time: f32| Pose3::from_parts(body.pose.translation + body.linear * time, body.pose.rotation);
    let bounds = [&shape1, &shape2].map(|shape| shape.bounding_sphere());
    let (mut time, mut contacts) = (0.0, Vec::new());
    while time <= end {
        let poses = [later(first, time), later(second, time)];
        let middles = [0, 1].map(|i| poses[i].transform_point(bounds[i].center));
        let far = middles[0].distance(middles[1]) - bounds[0].radius - bounds[1].radius;
        let mut apart = far;
        if far < 0.1 {
            contacts.clear();
            let reach = 0.2;
            contacts::find(&shape1, OtherShape::Shape(&shape2), &poses[0].inv_mul(&poses[1]), reach, &mut contacts);
            let nearest = contacts.iter().min_by(|a, b| a.distance.total_cmp(&b.distance));
            apart = nearest.map_or(reach, |contact| contact.distance);
            if let Some(contact) = nearest.filter(|contact| contact.distance < 1e-4) {
                let normal = poses[0].rotation * contact.normal1;
                return Some((time, poses[0].transform_point(contact.point1), normal));
            }
        }
        time += apart.max(5e-5) / speed;
    }
    None
}

/// The impulse along the normal that separates two free bodies without friction and restitution (Newton's law of impact). It is the min transfer of a hit.
pub fn impulse(first: &Body, second: &Body, (time, point, normal): (f32, Vec3, Vec3)) -> f32 {
    let mut inverse_mass = 0.0;
    for body in [first, second] {
        let mass = body.mass();
        let rotation = glam::Mat3::from_quat(body.pose.rotation);
        let center = body.pose.transform_point(mass.center_of_mass) + body.linear * time;
        let arm = (point - center).cross(normal);
        let inertia = rotation * mass.inertia * rotation.transpose();
        inverse_mass += 1.0 / mass.volume + arm.dot(inertia.inverse() * arm);
    }
    (first.linear - second.linear).dot(normal) / inverse_mass
}
