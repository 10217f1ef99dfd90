//! Bullets at a running character, compared with steps 100 times as fine on the skinned triangles.
//!
//! The reference moves each bullet on a line relative to the running character, by conservative advancement: it advances by the time in which neither
//! bullet nor limbs can close the gap. The triangles have the pose in the middle of each fine step.

use std::{error::Error, f32::consts::PI};

use bevy::{ecs::message::MessageCursor, prelude::*};
use bevy_medial::{medial_axis::MedialAxis, prelude::*, random::Random, scenes::Bullet};
use bevy_rapier3d::{
    parry::{
        query::{PointQuery, PointQueryWithLocation},
        shape::{TriMesh, Triangle},
    },
    prelude::{CollisionGroups, GravityScale, Group, RigidBody, Velocity},
};

use super::{Actor, Cast, add_axis, cpu_app};

/// Radius of a bullet in metres. It is larger than the fit error, so a bullet that goes as deep as this has its centre outside.
pub const RADIUS: f32 = 0.03;
/// Number of steps after which the bullets of a volley are removed.
const STEPS: u32 = 8;
/// Number of bullets in flight at the same time.
const VOLLEY: usize = 200;
/// Number of fine steps in a step.
const FINE: u32 = 100;
const DT: f32 = 1.0 / 60.0;
/// Least distance of a new bullet from the character, in metres.
const CLEARANCE: f32 = 0.05;
/// Upper bound of the velocity of the triangles relative to the running character, in metres per second.
const LIMBS: f32 = 20.0;
/// Least displacement between two samples of the reference, in metres.
const SAMPLE: f32 = 5.0e-4;

/// A bullet, its hit in the app, and its touch of the triangles in the reference.
#[derive(Clone, Debug)]
pub struct Flight {
    /// Velocity in the world in metres per second.
    pub velocity: Vec3,
    /// Place relative to the character at the start.
    start: Vec3,
    /// Number of the step at whose end the flight starts.
    begin: u32,
    /// Time of the first hit since the start in seconds, and the index of the joint.
    pub hit: Option<(f32, Option<usize>)>,
    /// True if the velocity at the end is another one.
    pub is_deflected: bool,
    /// Distance of the bullet from the triangles at the time of the hit, in metres.
    pub off: f32,
    /// Time of the first touch of the triangles since the start, in seconds.
    pub touch: Option<f32>,
    /// Least distance from the triangles in metres. It is negative inside, and not below the negative fit error.
    pub least: f32,
    /// The joint of the nearest point of the triangles at the first touch; without a touch, at the time of the hit in the app.
    pub joint: usize,
    /// The joint of the nearest point of the triangles at the time of the hit in the app.
    pub joint_at_hit: usize,
    /// All joints of points of the triangles within the fit error of this point.
    pub joints: Vec<usize>,
}

impl Flight {
    pub fn speed(&self) -> f32 {
        self.velocity.length()
    }
}

/// Shoots bullets of random directions, at speeds of 10 to 1,000 m/s whose logarithms are evenly distributed, and evaluates them.
///
/// `fit_error`: largest error of the medial mesh in metres, below [`RADIUS`].
///
/// # Errors
/// If shapes are not valid.
pub fn shoot(actor: &Actor, bullets: usize, fit_error: f32, seed: u64) -> Result<Vec<Flight>, Box<dyn Error>> {
    let mut flights = fly(actor, bullets, seed)?;
    Reference::new(actor, fit_error)?.trace(&mut flights)?;
    Ok(flights)
}

/// Numbers of bullets with certain outcomes. The fit error is the tolerance.
#[derive(Clone, Copy, Debug, Default)]
pub struct Score {
    pub bullets: usize,
    /// Bullets that touch the triangles.
    pub touching: usize,
    /// Bullets that hit in the app.
    pub hits: usize,
    /// Bullets that pass deeper than the tolerance and hit nothing in the app.
    pub lost: usize,
    /// Hits of bullets that pass farther than the tolerance.
    pub false_hits: usize,
    /// Bullets without a hit that come within 10 cm.
    pub near_misses: usize,
    /// Bullets without a hit whose velocity changes.
    pub disturbed: usize,
    /// Hits at whose time the bullet is within the tolerance of the triangles.
    pub in_place: usize,
    /// Hits whose time differs from that of the first touch by at most the tolerance over the speed.
    pub in_time: usize,
    /// Hits with the joint of the nearest point of the triangles at their first touch, or at the hit without a touch. A bullet may graze one limb by less
    /// than the tolerance and hit another.
    pub same_joint: usize,
    /// Hits with the joint of the nearest point of the triangles at the time of the hit.
    pub same_joint_at_hit: usize,
    /// Hits with the joint of a point of the triangles within the tolerance.
    pub joint_within: usize,
}

impl Score {
    /// Counts the flights at speeds within a range.
    pub fn new<'a>(flights: impl IntoIterator<Item = &'a Flight>, tolerance: f32, speeds: [f32; 2]) -> Self {
        let mut score = Self::default();
        let within = |flight: &&Flight| (speeds[0]..speeds[1]).contains(&flight.speed());
        for flight in flights.into_iter().filter(within) {
            score.bullets += 1;
            score.touching += usize::from(flight.touch.is_some());
            let Some((time, joint)) = flight.hit else {
                score.lost += usize::from(flight.least <= -tolerance);
                score.near_misses += usize::from(flight.least > 0.0 && flight.least < 0.1);
                score.disturbed += usize::from(flight.is_deflected);
                continue;
            };
            score.hits += 1;
            score.false_hits += usize::from(flight.least > tolerance);
            score.in_place += usize::from(flight.off.abs() <= tolerance);
            let late = flight.touch.map_or(f32::INFINITY, |touch| (time - touch).abs());
            score.in_time += usize::from(late * flight.speed() <= tolerance);
            score.same_joint += usize::from(joint == Some(flight.joint));
            score.same_joint_at_hit += usize::from(joint == Some(flight.joint_at_hit));
            score.joint_within += usize::from(joint.is_some_and(|joint| flight.joints.contains(&joint)));
        }
        score
    }
}

/// Shoots volleys in an app.
fn fly(actor: &Actor, bullets: usize, seed: u64) -> Result<Vec<Flight>, Box<dyn Error>> {
    let (mut app, mut random) = (cpu_app(DT), Random(seed));
    let mesh = add_axis(&mut app, &actor.axis);
    let cast = Cast::spawn(&mut app, actor, Vec3::ZERO);
    app.world_mut().entity_mut(cast.root).insert(SkinnedMedialMesh::new(mesh));
    let ball = MedialMesh(add_axis(&mut app, &MedialAxis::sphere(RADIUS)?));
    let (mut flights, mut steps, mut cursor) = (Vec::new(), 0, MessageCursor::default());
    let mut advance = |app: &mut App| {
        steps += 1;
        cast.animate(app, actor, steps as f32 * DT);
        app.update();
        steps
    };
    let mut begin = (0..4).map(|_| advance(&mut app)).last().unwrap_or_default();
    while flights.len() < bullets {
        let volley = aim(actor, begin, VOLLEY.min(bullets - flights.len()), &mut random)?;
        let displacement = actor.displacement(begin as f32 * DT);
        let entities: Vec<Entity> = volley.iter().map(|flight| spawn(&mut app, &ball, flight, displacement)).collect();
        let first = flights.len();
        flights.extend(volley);
        for step in 0..STEPS {
            advance(&mut app);
            for message in cursor.read(app.world().resource::<Messages<MedialContactStarted>>()) {
                let is_own = |entity: &Entity| [message.entity1, message.entity2].contains(entity);
                let Some(number) = entities.iter().position(is_own) else { continue };
                let joint = message.touch.joint1.or(message.touch.joint2);
                let joint = joint.and_then(|joint| cast.joints.iter().position(|known| *known == joint));
                flights[first + number].hit.get_or_insert(((step as f32 + message.touch.fraction) * DT, joint));
            }
        }
        for (flight, entity) in flights[first..].iter_mut().zip(entities) {
            flight.is_deflected = app.world().get::<Velocity>(entity).is_none_or(|now| now.linear != flight.velocity);
            app.world_mut().despawn(entity);
        }
        begin += STEPS;
    }
    Ok(flights)
}

/// Bullets that would be near a vertex of the character at some time of the flight, and start outside. The surface has about one vertex per cell of a grid.
fn aim(actor: &Actor, begin: u32, count: usize, random: &mut Random) -> Result<Vec<Flight>, Box<dyn Error>> {
    let time = begin as f32 * DT;
    let triangles = triangles(actor, time)?;
    let (mesh, skin) = (actor.mesh.mesh(), actor.mesh.skin());
    let mut flights = Vec::with_capacity(count);
    while flights.len() < count {
        let later = (1.5 + 4.0 * random.unit()) * DT;
        let vertex = random.below(mesh.positions.len());
        let poses = actor.poses(&actor.character.pose(time + later));
        let target = skin.pose_point(vertex, mesh.positions[vertex], &poses) + random.in_ball() * 0.25;
        let velocity = random.direction().as_vec3() * 10.0 * 100.0f32.powf(random.unit());
        let start = target - (velocity - Vec3::X * actor.speed) * later;
        if !is_clear(&triangles, start) {
            continue;
        }
        flights.push(Flight {
            velocity,
            start,
            begin,
            hit: None,
            is_deflected: false,
            off: 0.0,
            touch: None,
            least: f32::INFINITY,
            joint: 0,
            joint_at_hit: 0,
            joints: Vec::new(),
        });
    }
    Ok(flights)
}

/// Returns true if a bullet at a place is outside and has the least distance. The distance from triangles is the same on both
/// sides, and the normals of a skin with folds are ambiguous, so the winding number decides.
fn is_clear(triangles: &TriMesh, place: Vec3) -> bool {
    let solid_angle = |triangle: Triangle| {
        let [a, b, c] = [triangle.a - place, triangle.b - place, triangle.c - place];
        let [p, q, r] = [a.length(), b.length(), c.length()];
        2.0 * a.dot(b.cross(c)).atan2(p * q * r + a.dot(b) * r + b.dot(c) * p + c.dot(a) * q)
    };
    let winding = || triangles.triangles().map(solid_angle).sum::<f32>() / (4.0 * PI);
    triangles.distance_to_local_point(place, true) >= RADIUS + CLEARANCE
        && (!triangles.local_aabb().contains_local_point(place) || winding().abs() < 0.5)
}

/// The skinned triangles at a time, relative to the character.
fn triangles(actor: &Actor, time: f32) -> Result<TriMesh, Box<dyn Error>> {
    let mesh = actor.mesh.posed(&actor.poses(&actor.character.pose(time)));
    TriMesh::new(mesh.positions, mesh.triangles)
        .map_err(|error| format!("the triangles of the character: {error}").into())
}

/// Bullets hit nothing except the character.
fn spawn(app: &mut App, ball: &MedialMesh, flight: &Flight, displacement: Vec3) -> Entity {
    let only_others = CollisionGroups::new(Group::GROUP_1, !Group::GROUP_1);
    let place = Transform::from_translation(displacement + flight.start);
    let motion = (Velocity::linear(flight.velocity), GravityScale(0.0));
    app.world_mut().spawn((RigidBody::Dynamic, ball.clone(), place, motion, only_others, Bullet)).id()
}

/// The next event of a flight in the reference.
#[derive(Clone, Copy)]
enum Event {
    /// The flight goes on at this time since its start.
    Goes(usize, f32),
    /// The time of the flight's hit in the app.
    Hits(usize, f32),
}

struct Reference<'a> {
    actor: &'a Actor,
    fit_error: f32,
    /// Events by the number of their fine step, from the start of a cycle of the gait.
    events: Vec<Vec<Event>>,
    /// Number of fine steps of a cycle.
    cycle: u32,
}

impl<'a> Reference<'a> {
    fn new(actor: &'a Actor, fit_error: f32) -> Result<Self, Box<dyn Error>> {
        if fit_error >= RADIUS {
            return Err(format!("the fit error of {fit_error} m is not below the bullets' radius of {RADIUS} m").into());
        }
        let cycle = (actor.character.period / DT).round() as u32 * FINE;
        Ok(Self { actor, fit_error, events: vec![Vec::new(); (cycle + STEPS * FINE + 1) as usize], cycle })
    }

    fn trace(mut self, flights: &mut [Flight]) -> Result<(), Box<dyn Error>> {
        for (number, flight) in flights.iter().enumerate() {
            self.push(flight, Event::Goes(number, 0.0));
            if let Some((time, _)) = flight.hit {
                self.push(flight, Event::Hits(number, time));
            }
        }
        for fine in 0..self.events.len() {
            if self.events[fine].is_empty() {
                continue;
            }
            let mesh = triangles(self.actor, (fine as f32 + 0.5) * DT / FINE as f32)?;
            for event in std::mem::take(&mut self.events[fine]) {
                match event {
                    Event::Goes(number, time) => {
                        if let Some(next) = self.advance(&mesh, &mut flights[number], time, fine) {
                            self.push(&flights[number], Event::Goes(number, next));
                        }
                    }
                    Event::Hits(number, time) => {
                        let flight = &mut flights[number];
                        let place = self.place(flight, time);
                        flight.off = mesh.distance_to_local_point(place, true) - RADIUS;
                        let (nearest, within) = self.joints(&mesh, place);
                        flight.joint_at_hit = nearest;
                        if flight.touch.is_none() {
                            (flight.joint, flight.joints) = (nearest, within);
                        }
                    }
                }
            }
        }
        Ok(())
    }

    /// Number of the first fine step of a flight.
    fn first(&self, flight: &Flight) -> u32 {
        flight.begin * FINE % self.cycle
    }

    fn push(&mut self, flight: &Flight, event: Event) {
        let (Event::Goes(_, time) | Event::Hits(_, time)) = event;
        let fine = self.first(flight) + ((time / DT * FINE as f32) as u32).min(STEPS * FINE);
        self.events[fine as usize].push(event);
    }

    /// Place of a flight relative to the character.
    fn place(&self, flight: &Flight, time: f32) -> Vec3 {
        flight.start + (flight.velocity - Vec3::X * self.actor.speed) * time
    }

    /// Advances a flight to the end of a fine step or beyond it. Returns the time, or `None` at the end of the flight.
    fn advance(&self, mesh: &TriMesh, flight: &mut Flight, mut time: f32, fine: usize) -> Option<f32> {
        let end = (fine as u32 + 1 - self.first(flight)) as f32 * DT / FINE as f32;
        let rate = (flight.velocity - Vec3::X * self.actor.speed).length() + LIMBS;
        while time < end {
            let place = self.place(flight, time);
            let distance = mesh.distance_to_local_point(place, true) - RADIUS;
            if distance <= 0.0 && flight.touch.is_none() {
                flight.touch = Some(time);
                (flight.joint, flight.joints) = self.joints(mesh, place);
            }
            flight.least = flight.least.min(distance).max(-self.fit_error);
            if distance <= -self.fit_error {
                return None;
            }
            time += distance.max(SAMPLE) / rate;
        }
        (time < STEPS as f32 * DT).then_some(time)
    }

    /// The joint of the point of the triangles that is nearest to a place, and the joints of all points within the fit error of it.
    fn joints(&self, mesh: &TriMesh, place: Vec3) -> (usize, Vec<usize>) {
        let (nearest, (triangle, location)) = mesh.project_local_point_and_get_location(place, false);
        let joint = |triangle: u32, shares: [f32; 3]| {
            let weights = self.actor.mesh.skin().weights();
            let mut sums = vec![0.0; self.actor.character.joints.len()];
            for (vertex, share) in mesh.indices()[triangle as usize].iter().zip(shares) {
                weights[*vertex as usize]
                    .iter()
                    .for_each(|(joint, weight)| sums[usize::from(*joint)] += share * weight);
            }
            (0..sums.len()).max_by(|&a, &b| sums[a].total_cmp(&sums[b])).unwrap_or_default()
        };
        let shares = location.barycentric_coordinates().unwrap_or([1.0, 0.0, 0.0]);
        let first = joint(triangle, shares);
        let mut joints = vec![first];
        for (number, triangle) in (0..).zip(mesh.triangles()) {
            let (near, location) = triangle.project_local_point_and_get_location(nearest.point, false);
            if near.point.distance(nearest.point) <= self.fit_error {
                joints.push(joint(number, location.barycentric_coordinates().unwrap_or([1.0, 0.0, 0.0])));
            }
        }
        joints.sort_unstable();
        joints.dedup();
        (first, joints)
    }
}

#[cfg(test)]
mod tests {
    use bevy_medial::scenes::characters::Character;

    use super::*;

    #[test]
    fn bullets_start_outside() {
        let actor = Actor::new(Character::biped(), 26, 0.0).unwrap();
        let (mut inside, mut outside) = (0, 0);
        for step in 0..10 {
            let time = step as f32 * 4.0 * DT;
            let mut spheres = vec![];
            let poses = actor.poses(&actor.character.pose(time));
            actor.axis.skin().unwrap().pose(actor.axis.spheres(), &poses, &mut spheres);
            let triangles = triangles(&actor, time).unwrap();
            for sphere in spheres {
                // The middle of the trunk is far from its surface.
                if triangles.distance_to_local_point(sphere.center, true) >= RADIUS + CLEARANCE {
                    assert!(!is_clear(&triangles, sphere.center), "{} at {time} s is inside", sphere.center);
                    inside += 1;
                }
                let far = sphere.center.normalize() * 4.0;
                outside += usize::from(is_clear(&triangles, far));
            }
        }
        assert!(inside > 10 && outside > 200, "{inside} inside, {outside} outside");
    }
}
