//! Skinned shapes: a waving tentacle and a running biped, and the bodies and rays that hit them.

use bevy::{math::Affine3A, prelude::*};
use bevy_medial::{
    builder::{FitOptions, fit_skinned},
    geometry::{Primitive, Sphere},
    medial_axis::{JointWeights, MedialAxis, Skin, SkinJoint},
    pipeline::Hull,
    prelude::*,
    query::separation,
    scenes::{Bullet, characters::Character},
};
use bevy_rapier3d::prelude::*;

use crate::common::*;

/// Length of a joint of the tentacle in metres. The tentacle lies along x in the bind pose.
pub const LENGTH: f32 = 0.5;

/// A tentacle of seven spheres and three joints. Spheres between two joints follow both.
pub fn tentacle() -> MedialAxis {
    let x = |i: usize| 0.5 * LENGTH * i as f32;
    let spheres: Vec<Sphere> = (0..7).map(|i| Sphere::new(Vec3::X * x(i), 0.1 - 0.01 * i as f32)).collect();
    let cones = (0..6).map(|i| Primitive::Cone([i, i + 1])).collect();
    let (axis, _) = MedialAxis::new(spheres, cones).unwrap();
    let joint = |i: usize| SkinJoint {
        name: ["root", "middle", "tip"][i].into(),
        inverse_bind: Affine3A::from_translation(-Vec3::X * LENGTH * i as f32),
    };
    let weights = axis.spheres().iter().map(|sphere| -> JointWeights {
        let place = (sphere.center.x / LENGTH).min(2.0);
        let (first, share) = (place as u16, place.fract());
        [(first, 1.0 - share), ((first + 1).min(2), share), (0, 0.0), (0, 0.0)]
    });
    let skin = Skin::new([0, 1, 2].map(joint), &weights.collect::<Vec<_>>()).unwrap();
    axis.with_skin(skin).unwrap()
}

/// Places of the tentacle's joints at a time in seconds. The tip moves at about 10 m/s.
fn waving(time: f32) -> Vec<Affine3A> {
    let turn =
        |i: f32| Quat::from_euler(EulerRot::XYZ, 0.3, 0.5 * (7.0 * time + i).sin(), 0.8 * (9.0 * time + 2.0 * i).cos());
    let mut place = Affine3A::IDENTITY;
    let joint = |i: f32| {
        let at = Vec3::X * if i > 0.0 { LENGTH } else { 0.4 * (3.0 * time).sin() };
        place *= Affine3A::from_rotation_translation(turn(i), at);
        place
    };
    [0.0, 1.0, 2.0].map(joint).into()
}

/// A biped of this many spheres.
pub fn biped_axis(spheres: usize) -> MedialAxis {
    let options = FitOptions { spheres: Some(spheres), searches: Some(1), ..FitOptions::default() };
    let mesh = Character::biped().mesh().unwrap();
    let levels = fit_skinned(&mesh, &options, &|_| std::ops::ControlFlow::Continue(())).unwrap();
    levels.into_medial_axis().unwrap()
}

/// An animated entity with a skinned shape.
pub struct Puppet {
    pub entity: Entity,
    pub joints: Vec<Entity>,
    pub axis: MedialAxis,
    pub steps: u32,
    parents: Vec<Option<usize>>,
    /// Places of the joints in the world at a time in seconds.
    places: Box<dyn Fn(f32) -> Vec<Affine3A>>,
}

impl Puppet {
    fn spawn(
        app: &mut App,
        axis: MedialAxis,
        parents: Vec<Option<usize>>,
        places: impl Fn(f32) -> Vec<Affine3A> + 'static,
    ) -> Self {
        let mesh = app.world_mut().resource_mut::<Assets<MedialAxis>>().add(axis.clone());
        let entity = app.world_mut().spawn(SkinnedMedialMesh::new(mesh)).id();
        let mut joints: Vec<Entity> = Vec::new();
        for (joint, parent) in axis.skin().unwrap().joints().iter().zip(&parents) {
            let parent = parent.map_or(entity, |parent| joints[parent]);
            let name = Name::new(joint.name.clone());
            joints.push(app.world_mut().spawn((name, Transform::default(), ChildOf(parent))).id());
        }
        Self { entity, joints, axis, steps: 0, parents, places: Box::new(places) }
    }

    pub fn tentacle(app: &mut App) -> Self {
        Self::spawn(app, tentacle(), vec![None, Some(0), Some(1)], waving)
    }

    /// A biped that runs at 5 m/s along x.
    pub fn biped(app: &mut App, axis: MedialAxis) -> Self {
        let character = Character::biped();
        let parents = character.joints.iter().map(|joint| joint.parent).collect();
        Self::spawn(app, axis, parents, move |time| {
            let run = Affine3A::from_translation(Vec3::X * 5.0 * time);
            character.pose(time).into_iter().map(|place| run * place).collect()
        })
    }

    /// Moves the joints to their places at the end of the next step.
    pub fn animate(&mut self, app: &mut App) {
        self.steps += 1;
        let places = (self.places)(self.time());
        for ((joint, parent), place) in self.joints.iter().zip(&self.parents).zip(&places) {
            let local = parent.map_or(*place, |parent| places[parent].inverse() * *place);
            *app.world_mut().get_mut::<Transform>(*joint).unwrap() = Transform::from_matrix(local.into());
        }
    }

    /// Runs a step.
    pub fn step(&mut self, app: &mut App) {
        self.animate(app);
        app.update();
    }

    /// Runs steps and records their messages.
    fn record(&mut self, app: &mut App, steps: u32) -> Record {
        let mut record = Record::default();
        for _ in 0..steps {
            self.animate(app);
            record.run(app, 1);
        }
        record
    }

    pub fn time(&self) -> f32 {
        self.steps as f32 * DT
    }

    pub fn pose<'a>(&self, app: &'a App) -> &'a SkinPose {
        app.world().get::<SkinPose>(self.entity).unwrap()
    }

    /// The spheres at a time, in the world.
    pub fn spheres_at(&self, time: f32) -> Vec<Sphere> {
        let (mut poses, mut spheres) = (Vec::new(), Vec::new());
        let skin = self.axis.skin().unwrap();
        skin.joint_poses(&(self.places)(time), &mut poses);
        skin.pose(self.axis.spheres(), &poses, &mut spheres);
        spheres
    }

    fn hulls_at(&self, time: f32) -> Vec<Hull> {
        let spheres = self.spheres_at(time);
        let at = |i: u32| spheres[i as usize];
        let hull = |primitive: &Primitive| match *primitive {
            Primitive::Sphere(index) => Hull::Sphere(index.map(at)),
            Primitive::Cone(index) => Hull::Cone(index.map(at)),
            Primitive::Slab(index) => Hull::Slab(index.map(at)),
        };
        self.axis.primitives().iter().map(hull).collect()
    }

    /// Returns the distances of a ball from the primitives at a time.
    fn distances_at(&self, time: f32, ball: Sphere) -> Vec<f32> {
        let distance = |hull: &Hull| match hull {
            Hull::Sphere(s) => separation(s, &[ball], 0).distance,
            Hull::Cone(s) => separation(s, &[ball], 0).distance,
            Hull::Slab(s) => separation(s, &[ball], 0).distance,
        };
        self.hulls_at(time).iter().map(distance).collect()
    }

    /// Returns the distance of a ball from the shape at a time.
    fn distance_at(&self, time: f32, ball: Sphere) -> f32 {
        self.distances_at(time, ball).into_iter().fold(f32::INFINITY, f32::min)
    }

    /// The joints with the largest weights at the primitives whose distance from a ball is the least, up to a tolerance.
    fn joints_at(&self, time: f32, ball: Sphere, tolerance: f32) -> Vec<Entity> {
        let (distances, hulls) = (self.distances_at(time, ball), self.hulls_at(time));
        let least = distances.iter().copied().fold(f32::INFINITY, f32::min);
        let near = (0..hulls.len()).filter(|&primitive| distances[primitive] <= least + tolerance);
        let skin = self.axis.skin().unwrap();
        let joint = |primitive: usize| {
            let shares = hulls[primitive].shares(ball.center);
            self.joints[usize::from(skin.joint_within(&self.axis.primitives()[primitive], &shares))]
        };
        near.map(joint).collect()
    }
}

pub fn cpu_app() -> App {
    let mut app = app();
    app.world_mut().resource_mut::<MedialSettings>().backend = MedialBackend::Cpu;
    app
}

/// A ball that flies at a constant velocity.
pub struct Shot {
    pub entity: Entity,
    start: Vec3,
    velocity: Vec3,
    begin: f32,
}

const RADIUS: f32 = 0.03;

impl Shot {
    /// Shots hit nothing except the puppet.
    fn spawn(app: &mut App, begin: f32, start: Vec3, velocity: Vec3) -> Self {
        let ball = MedialAxis::sphere(RADIUS).unwrap();
        let entity = spawn_flying(app, ball, Transform::from_translation(start), Velocity::linear(velocity));
        let only_others = CollisionGroups::new(Group::GROUP_1, !Group::GROUP_1);
        app.world_mut().entity_mut(entity).insert((only_others, Bullet));
        Self { entity, start, velocity, begin }
    }

    fn at(&self, time: f32) -> Sphere {
        Sphere::new(self.start + self.velocity * (time - self.begin), RADIUS)
    }

    /// The first touch in steps at least 100 times as fine, and the smallest distance before it.
    fn reference(&self, puppet: &Puppet, steps: u32) -> (Option<f32>, f32) {
        let parts = if self.velocity.length() > 200.0 { 1000 } else { 100 };
        let mut least = f32::INFINITY;
        for i in 0..=parts * steps {
            let time = self.begin + i as f32 * DT / parts as f32;
            let distance = puppet.distance_at(time, self.at(time));
            least = least.min(distance);
            if distance <= 0.0 {
                return (Some(time), least);
            }
        }
        (None, least)
    }
}

/// Shots at 10 to 1,000 m/s, aimed at or past the puppet.
pub fn volley(app: &mut App, puppet: &Puppet, count: usize, random: &mut Random) -> Vec<Shot> {
    let begin = puppet.time();
    (0..count)
        .map(|i| {
            let speed = [10.0, 30.0, 100.0, 300.0, 1000.0][i % 5];
            let meeting = begin + (1.5 + 4.0 * random.unit()) * DT;
            let spheres = puppet.spheres_at(meeting);
            let target = spheres[random.below(spheres.len())].center + random.in_ball() * 0.25;
            let velocity = random.direction().as_vec3() * speed;
            Shot::spawn(app, begin, target - velocity * (meeting - begin), velocity)
        })
        .collect()
}

/// Numbers of shots.
#[derive(Debug, Default)]
struct Score {
    hits: usize,
    /// Hits at 300 m/s or more.
    fast: usize,
    misses: usize,
    /// Misses by less than 10 cm.
    near_misses: usize,
    right_joints: usize,
}

impl Score {
    /// Shoots volleys at a puppet and compares each shot with its reference. The sweep replaces arcs of spheres by lines, so it is accurate to 4 mm.
    fn shoot(&mut self, app: &mut App, puppet: &mut Puppet, random: &mut Random) {
        const TOLERANCE: f32 = 4e-3;
        let shots = volley(app, puppet, 60, random);
        let expected: Vec<_> = shots.iter().map(|shot| shot.reference(puppet, 8)).collect();
        let begin = puppet.steps;
        let record = puppet.record(app, 8);
        for (shot, (first, least)) in shots.iter().zip(expected) {
            let begins_inside = puppet.distance_at(shot.begin, shot.at(shot.begin)) < 0.01;
            if begins_inside || least.abs() < TOLERANCE && first.is_none() {
                continue;
            }
            let is_own = |message: &MedialContactStarted| [message.entity1, message.entity2].contains(&shot.entity);
            let reported = record.started.iter().find(|(_, message)| is_own(message));
            let speed = shot.velocity.length();
            let Some(time) = first else {
                assert!(reported.is_none(), "a shot at {speed} m/s that passes at {least} m hits: {reported:?}");
                assert_eq!(app.world().get::<Velocity>(shot.entity).unwrap().linear, shot.velocity);
                (self.misses, self.near_misses) = (self.misses + 1, self.near_misses + usize::from(least < 0.1));
                continue;
            };
            let Some((step, message)) = reported else {
                let later = (0..400).map(|i| time + i as f32 * 4e-3 / speed);
                let deepest = later.map(|t| puppet.distance_at(t, shot.at(t))).fold(f32::INFINITY, f32::min);
                assert!(deepest > -TOLERANCE, "a shot at {speed} m/s that goes {deepest} m deep is lost");
                continue;
            };
            let found = ((begin + step) as f32 - 1.0 + message.touch.fraction) * DT;
            // A graze begins over a long time, so the place counts as well as the time.
            let distance = puppet.distance_at(found, shot.at(found));
            let is_right = distance.abs() < TOLERANCE || (found - time).abs() < TOLERANCE / speed;
            assert!(is_right, "{speed} m/s: {distance} m off at {found}, not {time}");
            let joint = message.touch.joint1.or(message.touch.joint2);
            let joints = puppet.joints_at(time, shot.at(time), TOLERANCE);
            self.right_joints += usize::from(joint.is_some_and(|joint| joints.contains(&joint)));
            (self.hits, self.fast) = (self.hits + 1, self.fast + usize::from(speed >= 300.0));
        }
        shots.iter().for_each(|shot| _ = app.world_mut().despawn(shot.entity));
    }

    fn check(&self, hits: usize) {
        println!("{self:?}");
        let Self { fast, near_misses, right_joints, .. } = *self;
        assert!(self.hits > hits && 4 * fast > hits && 4 * near_misses > hits, "{self:?}");
        assert!(100 * right_joints >= 97 * self.hits, "{self:?}");
    }
}

#[test]
fn shots_hit_a_waving_tentacle_as_in_fine_steps() {
    let (mut random, mut score, mut app) = (Random(51), Score::default(), cpu_app());
    let mut tentacle = Puppet::tentacle(&mut app);
    (0..4).for_each(|_| tentacle.step(&mut app));
    (0..6).for_each(|_| score.shoot(&mut app, &mut tentacle, &mut random));
    score.check(80);
}

#[test]
fn shots_hit_a_running_biped_as_in_fine_steps() {
    let (mut random, mut score, mut app) = (Random(55), Score::default(), cpu_app());
    let mut biped = Puppet::biped(&mut app, biped_axis(40));
    (0..4).for_each(|_| biped.step(&mut app));
    (0..4).for_each(|_| score.shoot(&mut app, &mut biped, &mut random));
    score.check(40);
}

#[test]
fn a_waving_tentacle_pushes_balls_and_none_stays_inside() {
    let mut random = Random(53);
    let (mut pushed, mut fast, mut deepest) = (0, 0, 0.0f32);
    for _ in 0..4 {
        let mut app = cpu_app();
        let mut tentacle = Puppet::tentacle(&mut app);
        (0..4).for_each(|_| tentacle.step(&mut app));
        let mut balls = Vec::new();
        while balls.len() < 25 {
            let at = Vec3::X * 0.8 + random.in_ball();
            let own = Sphere::new(at, 0.1);
            let is_free = tentacle.distance_at(tentacle.time(), own) > 0.02
                && balls.iter().all(|(_, other): &(Entity, Vec3)| other.distance(at) > 0.21);
            if is_free {
                let ball = MedialAxis::sphere(0.1).unwrap();
                balls.push((spawn_flying(&mut app, ball, Transform::from_translation(at), Velocity::zero()), at));
            }
        }
        for _ in 0..40 {
            tentacle.step(&mut app);
            for (ball, _) in &balls {
                let at = position(&mut app, *ball);
                deepest = deepest.min(tentacle.distance_at(tentacle.time(), Sphere::new(at, 0.1)));
            }
        }
        for (ball, start) in &balls {
            let body = rigid(&mut app, *ball);
            pushed += usize::from(body.translation().distance(*start) > 0.05);
            fast += usize::from(body.linvel().length() > 1.0);
            assert!(body.linvel().length() < 30.0, "{}", body.linvel());
        }
    }
    println!("{pushed} pushed, {fast} fast, deepest {deepest}");
    assert!(pushed > 10 && fast > 10 && deepest > -0.02, "{pushed} {fast} {deepest}");
}
