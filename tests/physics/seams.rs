//! Seams: bodies slide over the inner edges of floors, and of their own shapes, as if these were of one piece.

use bevy::prelude::*;
use bevy_medial::{
    geometry::{Primitive, Sphere},
    medial_axis::MedialAxis,
    prelude::*,
};
use bevy_rapier3d::prelude::*;

use crate::common::*;

/// Reach of the floors along x, from 1 m behind the origin, and to either side; their top is at height 0.
const LENGTH: f32 = 13.0;
const BACK: f32 = 1.0;
const SIDE: f32 = 1.5;

/// A grid of points at height `height(x, z)` over the floors' rectangle, and the corners of its cells: two triangles each.
struct Grid {
    points: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
}

impl Grid {
    /// `cell`: size of the cells along x and z, roughly. `rising`: which diagonal they are cut along.
    fn new(cell: [f32; 2], rising: bool) -> Self {
        let [nx, nz] = [(LENGTH / cell[0]).ceil() as u32, (2.0 * SIDE / cell[1]).ceil() as u32];
        let at = |i: u32, k: u32| {
            Vec3::new(LENGTH * i as f32 / nx as f32 - BACK, 0.0, 2.0 * SIDE * k as f32 / nz as f32 - SIDE)
        };
        let points = (0..=nx).flat_map(|i| (0..=nz).map(move |k| at(i, k))).collect();
        let number = |i: u32, k: u32| i * (nz + 1) + k;
        let triangles = (0..nx)
            .flat_map(|i| (0..nz).map(move |k| (i, k)))
            .flat_map(|(i, k)| {
                let [a, b, c, d] = [number(i, k), number(i, k + 1), number(i + 1, k + 1), number(i + 1, k)];
                if rising { [[a, b, c], [a, c, d]] } else { [[a, b, d], [b, c, d]] }
            })
            .collect();
        Self { points, triangles }
    }

    /// Moves the points about within the plane.
    fn shaken(mut self, by: f32) -> Self {
        let mut random = Random(7);
        for point in &mut self.points {
            *point += random.vector() * Vec3::new(by, 0.0, by);
        }
        self
    }

    fn mesh(self) -> Collider {
        Collider::trimesh(self.points, self.triangles).unwrap()
    }

    /// A plate whose top is the grid.
    fn plate(self, radius: f32) -> MedialAxis {
        let spheres = self.points.into_iter().map(|point| Sphere::new(point - Vec3::Y * radius, radius)).collect();
        MedialAxis::new(spheres, self.triangles.into_iter().map(Primitive::Slab).collect()).unwrap().0
    }
}

/// What bodies slide on. Those up to `SEAMLESS` have no seam, those from `SEPARATE` on are several bodies.
const FLOORS: &[&str] = &[
    "one box",
    "one cuboid",
    "mesh /",
    "mesh \\",
    "coarse mesh",
    "long triangles",
    "wide triangles",
    "shaken mesh",
    "height field",
    "voxels",
    "compound",
    "medial plate",
    "shaken medial plate",
    "boxes",
    "cuboids",
];

fn spawn_floor(app: &mut App, kind: &str) {
    let columns = |size: f32| (0..(LENGTH / size) as u32).map(move |i| (i as f32 + 0.5) * size - BACK);
    let collider = match kind {
        "one box" => {
            app.world_mut().spawn((StaticObb::new(20.0, 0.5, 20.0), Transform::from_xyz(0.0, -0.5, 0.0)));
            return;
        }
        "boxes" => {
            for x in columns(0.5) {
                app.world_mut().spawn((StaticObb::new(0.25, 0.5, SIDE), Transform::from_xyz(x, -0.5, 0.0)));
            }
            return;
        }
        "cuboids" => {
            for x in columns(0.5) {
                let cuboid = Collider::cuboid(0.25, 0.5, SIDE);
                app.world_mut().spawn((RigidBody::Fixed, cuboid, Transform::from_xyz(x, -0.5, 0.0)));
            }
            return;
        }
        "medial plate" | "shaken medial plate" => {
            let by = if kind == "medial plate" { 0.0 } else { 0.05 };
            let mesh = mesh(app, Grid::new([0.25, 0.25], true).shaken(by).plate(0.1));
            app.world_mut().spawn((RigidBody::Fixed, mesh, StaticObb::default(), Transform::IDENTITY));
            return;
        }
        "one cuboid" => Collider::compound(vec![(Vec3::NEG_Y * 0.5, Quat::IDENTITY, Collider::cuboid(20.0, 0.5, 20.0))]),
        "mesh /" => Grid::new([0.25, 0.25], true).mesh(),
        "mesh \\" => Grid::new([0.25, 0.25], false).mesh(),
        "coarse mesh" => Grid::new([1.0, 1.0], true).mesh(),
        "long triangles" => Grid::new([LENGTH, 0.05], true).mesh(),
        "wide triangles" => Grid::new([0.05, 2.0 * SIDE], true).mesh(),
        "shaken mesh" => Grid::new([0.25, 0.25], true).shaken(0.1).mesh(),
        "height field" => {
            let (rows, columns) = (13, 53);
            let field = Collider::heightfield(vec![0.0; rows * columns], rows, columns, Vec3::new(LENGTH, 1.0, 2.0 * SIDE));
            app.world_mut().spawn((RigidBody::Fixed, field, Transform::from_xyz(0.5 * LENGTH - BACK, 0.0, 0.0)));
            return;
        }
        "voxels" => {
            let range = |from: f32, to: f32| (from * 4.0) as i32..(to * 4.0) as i32;
            let cells: Vec<IVec3> = range(-BACK, LENGTH - BACK)
                .flat_map(|x| range(-SIDE, SIDE).map(move |z| IVec3::new(x, -1, z)))
                .collect();
            Collider::voxels(Vec3::splat(0.25), &cells)
        }
        "compound" => {
            let part = |x: f32| (Vec3::new(x, -0.5, 0.0), Quat::IDENTITY, Collider::cuboid(0.25, 0.5, SIDE));
            Collider::compound(columns(0.5).map(part).collect())
        }
        _ => unreachable!("{kind}"),
    };
    app.world_mut().spawn((RigidBody::Fixed, collider, Transform::IDENTITY));
}

/// What slides.
#[derive(Clone)]
enum Slider {
    Medial(MedialAxis),
    Rapier(Collider),
}

/// Sliders and the height at which their origin is over the floor. Those of rapier's own are there to compare with.
fn sliders() -> Vec<(&'static str, Slider, f32)> {
    let capsule = |half: Vec3| Slider::Medial(MedialAxis::capsule(-half, half, 0.1).unwrap());
    let rounded = |radius: f32| Slider::Medial(MedialAxis::rounded_box(Vec3::new(0.3, 0.1, 0.2), radius).unwrap());
    vec![
        ("ball", Slider::Medial(MedialAxis::sphere(0.2).unwrap()), 0.2),
        ("small ball", Slider::Medial(MedialAxis::sphere(0.03).unwrap()), 0.03),
        ("capsule along", capsule(Vec3::X * 0.3), 0.1),
        ("capsule across", capsule(Vec3::Z * 0.3), 0.1),
        ("rounded box", rounded(0.03), 0.1),
        ("sharp box", rounded(0.0), 0.1),
        ("torus", Slider::Medial(MedialAxis::torus(0.3, 0.08, 24).unwrap()), 0.08),
        ("model torus", Slider::Medial(model("torus")), 0.0525),
        ("rapier ball", Slider::Rapier(Collider::ball(0.2)), 0.2),
        ("rapier capsule", Slider::Rapier(Collider::capsule_z(0.3, 0.1)), 0.1),
        ("rapier cuboid", Slider::Rapier(Collider::cuboid(0.3, 0.1, 0.2)), 0.1),
    ]
}

/// What came of a slide.
#[derive(Clone, Copy, Debug, Default)]
struct Slide {
    /// Speed lost along its way, in percent a metre.
    speed: f32,
    /// Way lost, in percent.
    way: f32,
    /// Farthest up and down from where it lay, in millimetres.
    up: f32,
    down: f32,
    /// Farthest off its line, in millimetres.
    aside: f32,
    /// Steps in which it was stopped.
    stops: usize,
}

impl Slide {
    fn worst(self, other: Self) -> Self {
        Self {
            speed: self.speed.max(other.speed),
            way: self.way.max(other.way),
            up: self.up.max(other.up),
            down: self.down.min(other.down),
            aside: self.aside.max(other.aside),
            stops: self.stops.max(other.stops),
        }
    }
}

/// Lays a slider on the floor, gives it speed and watches it for a second.
fn slide(floor: &str, slider: &Slider, height: f32, speed: f32, heading: f32, turns: bool) -> Slide {
    let mut app = app();
    spawn_floor(&mut app, floor);
    let turn = Quat::from_rotation_y(heading);
    let at = Transform::from_xyz(-0.413, height, 0.019).with_rotation(turn);
    let body = match slider {
        Slider::Medial(axis) => spawn_body(&mut app, axis.clone(), at),
        Slider::Rapier(collider) => app.world_mut().spawn((RigidBody::Dynamic, collider.clone(), at)).id(),
    };
    let locked = if turns { LockedAxes::empty() } else { LockedAxes::ROTATION_LOCKED };
    let friction = Friction { coefficient: 0.0, combine_rule: CoefficientCombineRule::Min };
    let restitution = Restitution { coefficient: 0.0, combine_rule: CoefficientCombineRule::Min };
    app.world_mut().entity_mut(body).insert((locked, friction, restitution, Sleeping::disabled(), Velocity::zero()));
    run(&mut app, 30);
    let start = position(&mut app, body);
    let forward = turn * Vec3::X;
    app.world_mut().entity_mut(body).insert(Velocity::linear(forward * speed));
    let mut slide = Slide::default();
    let steps = 60;
    for _ in 0..steps {
        app.update();
        let way = position(&mut app, body) - start;
        slide.up = slide.up.max(way.y * 1e3);
        slide.down = slide.down.min(way.y * 1e3);
        slide.aside = slide.aside.max(way.reject_from(forward).with_y(0.0).length() * 1e3);
        if std::env::var("DUMP").is_ok() {
            let output = &app.world().resource::<MedialStep>().output;
            let v = rigid(&mut app, body).linvel();
            let output = &app.world().resource::<MedialStep>().output;
            if output.manifolds.iter().any(|m| m.normal1.y.abs() < 0.99998) || !output.stops.is_empty() {
                println!("x {} z {} v {v} stops {:?}", start.x + way.x, start.z + way.z, output.stops.iter().map(|s| s.fraction).collect::<Vec<_>>());
                for pair in &output.pairs { if let Some(i) = pair.impact { println!("    {i:?}"); } }
                for m in &output.manifolds { for c in m.contacts() { println!("    n {:.4} p1 {:.5} p2 {:.5} d {:.6} [{} {}]", m.normal1, c.point1, c.point2, c.distance, c.primitive1, c.primitive2); } }
            }
        }
        slide.stops += usize::from(!app.world().resource::<MedialStep>().output.stops.is_empty());
    }
    let rigid = rigid(&mut app, body);
    let (way, end) = ((rigid.translation() - start).dot(forward), rigid.linvel().dot(forward));
    let expected = speed * steps as f32 * DT;
    slide.speed = (1.0 - end / speed) * 100.0 / expected;
    slide.way = (1.0 - way / expected) * 100.0;
    slide
}

#[test]
fn nothing_trips_at_a_seam() {
    let only = |name: &str, variable: &str| std::env::var(variable).is_ok_and(|wanted| !name.contains(&wanted));
    println!("{:20} {:15} {:>8} {:>8} {:>7} {:>7} {:>7} {:>5}", "floor", "slider", "speed%/m", "way%", "up mm", "down", "aside", "stops");
    for floor in FLOORS {
        if only(floor, "FLOOR") {
            continue;
        }
        for (name, slider, height) in sliders() {
            if only(name, "SLIDER") || (name.contains("rapier") && std::env::var("RAPIER").is_err()) {
                continue;
            }
            let mut worst = Slide::default();
            for speed in std::env::var("SPEED").map_or(vec![1.0, 3.0, 10.0], |s| vec![s.parse().unwrap()]) {
                for (heading, turns) in [(0.0, false), (0.07, false), (0.0, true)] {
                    let slide = slide(floor, &slider, height, speed, heading, turns);
                    if std::env::var("EACH").is_ok() {
                        println!("{speed} {heading} {turns} {slide:?}");
                    }
                    worst = worst.worst(slide);
                }
            }
            let Slide { speed, way, up, down, aside, stops } = worst;
            println!("{floor:20} {name:15} {speed:8.3} {way:8.3} {up:7.3} {down:7.3} {aside:7.3} {stops:5}");
        }
    }
}
