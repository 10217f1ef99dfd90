//! Cells of the table of flights: what flies at what, how fast, and with which spin.

use super::*;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Aim {
    Wall,
    Resting,
    HeadOn,
}

/// One combination of shape, target, speed and spin.
pub struct Cell {
    pub shape: Shape,
    pub aim: Aim,
    /// In metres per second.
    pub speed: f32,
    /// Largest angular speed, in radians per second.
    pub spin: f32,
    /// Creates the app; the argument is the length of a step in seconds. The reference always runs on the CPU.
    pub app: fn(f32) -> App,
}

/// A body in free flight.
#[derive(Clone, Copy)]
pub(super) struct Flyer {
    pub(super) pose: Pose3,
    pub(super) velocity: Velocity,
}

/// The flying body, and the other body unless the target is the wall.
pub(super) type Flight = Vec<Flyer>;

/// A rod and concave models, scaled to a metre. Models of the shared folder replace those of the project if the folder exists.
pub fn shapes() -> Vec<(&'static str, Shape)> {
    let rod = MedialAxis::capsule(Vec3::X * -0.5, Vec3::X * 0.5, 0.02).unwrap();
    let folder = assets().join("../../shared/models/qmat");
    let shared = if folder.is_dir() { load_models(&folder).unwrap() } else { Vec::new() };
    let concave = |name: &'static str| {
        let found = shared.iter().find(|model| model.name.starts_with(name));
        let axis = found.map_or_else(|| model(name), |model| model.axis.clone());
        let scale = 0.5 / axis.bounding_sphere().radius;
        (name, Shape { axis, scale })
    };
    vec![("rod", Shape::new(rod)), concave("torus"), concave("spider"), concave("bug")]
}

impl Cell {
    /// The motion of a body as rapier integrates it with steps of `dt`. The body turns at a constant rate, slightly below its angular velocity.
    pub(super) fn motion(&self, flyer: &Flyer, dt: f32) -> Motion {
        let spin = flyer.velocity.angular.as_dvec3();
        let sweep = Sweep {
            start: flyer.pose,
            end: flyer.pose,
            translation: flyer.velocity.linear,
            rotation: (spin.normalize_or_zero() * rate(spin.length(), dt)).as_vec3(),
            local_center: self.shape.center_of_mass(),
        };
        Motion::new(&sweep, DVec3::ZERO)
    }

    pub(super) fn radius(&self) -> f32 {
        let bound = self.shape.bounding_sphere();
        bound.radius + bound.center.distance(self.shape.center_of_mass())
    }

    /// A flyer with the given centre of mass, and with random rotation and spin.
    pub(super) fn flyer(&self, random: &mut Random, center: Vec3, linear: Vec3, spin: f32) -> Flyer {
        let rotation = random.rotation();
        let pose = Pose3::from_parts(center - rotation * self.shape.center_of_mass(), rotation);
        let angular = random.in_ball().normalize_or(Vec3::X) * spin * (0.3 + 0.7 * random.unit());
        Flyer { pose, velocity: Velocity { linear, angular } }
    }

    /// A flight towards the point `beside` the target's centre, at a time when both bodies are apart.
    pub(super) fn flight(&self, random: &mut Random, tilt: f32, beside: Vec3) -> Flight {
        let away = 2.0 * self.radius() + 0.2;
        let direction = (Vec3::X + random.in_ball() * Vec3::new(0.0, tilt, tilt)).normalize();
        let first = self.flyer(random, beside - direction * away, direction * self.speed, self.spin);
        match self.aim {
            Aim::Wall => vec![first],
            Aim::Resting => vec![first, self.flyer(random, Vec3::ZERO, Vec3::ZERO, 0.0)],
            Aim::HeadOn => {
                vec![first, self.flyer(random, Vec3::X * away, Vec3::X * -self.speed, self.spin)]
            }
        }
    }

    /// First time, in seconds, at which the pair comes within `level` metres, up to `end`.
    pub(super) fn first_within(&self, flight: &Flight, level: f32, end: f64) -> Option<f64> {
        let motions: Vec<Motion> = flight.iter().map(|flyer| self.motion(flyer, DT)).collect();
        let center = self.shape.center_of_mass().as_dvec3();
        let fastest: f64 =
            motions.iter().map(|m| m.translation.length() + m.spin.length() * self.radius() as f64).sum();
        let mut time = 0.0;
        let mut contacts = Vec::new();
        while time <= end {
            let middles: Vec<DVec3> = motions.iter().map(|m| m.point(center, time)).collect();
            let far = match middles[..] {
                [one, other] => one.distance(other) - 2.0 * f64::from(self.radius()),
                _ => middles[0].x.abs() - f64::from(self.radius() + WALL.x),
            };
            let near = 0.25;
            let apart = if far > f64::from(near) {
                far
            } else {
                let pose1 = motions[0].pose(time);
                let (second, pose2) = match motions.get(1) {
                    Some(motion) => (OtherShape::Shape(&self.shape), motion.pose(time)),
                    None => (OtherShape::Parts(&Cuboid { half: WALL }), Pose3::IDENTITY),
                };
                contacts.clear();
                contacts::find(&self.shape, second, &pose1.inv_mul(&pose2), near, &mut contacts);
                f64::from(contacts.iter().map(|contact| contact.distance).fold(near, f32::min))
            };
            if apart <= f64::from(level) {
                return Some(time);
            }
            time += (apart - f64::from(level)).max(2e-4) / fastest;
        }
        None
    }

    /// Time in seconds until the bodies have passed each other.
    pub(super) fn passage(&self) -> f64 {
        f64::from((4.0 * self.radius() + 0.4) / self.speed)
    }

    /// The flight at another time, in seconds.
    pub(super) fn from(&self, flight: &Flight, time: f64) -> Flight {
        let later = |flyer: &Flyer| Flyer { pose: self.motion(flyer, DT).pose(time), ..*flyer };
        flight.iter().map(later).collect()
    }

    /// Flights that touch their target after 1.3 to 2.7 steps and would sink into it; and the same flights `lead` steps earlier.
    pub(super) fn hits(&self, random: &mut Random, count: usize, lead: u32) -> [Vec<Flight>; 2] {
        let mut flights = [const { Vec::new() }; 2];
        while flights[0].len() < count {
            let beside = random.in_ball() * Vec3::new(0.0, 0.5, 0.5) * self.radius();
            let flight = self.flight(random, 0.4, beside);
            let sinks = self.first_within(&flight, -0.005, self.passage()).is_some();
            if let Some(touch) = self.first_within(&flight, 0.0, self.passage()).filter(|_| sinks) {
                let phase = f64::from((1.3 + 1.4 * random.unit()) * DT);
                for (flights, steps) in flights.iter_mut().zip([0, lead]) {
                    flights.push(self.from(&flight, touch - phase - f64::from(steps) * f64::from(DT)));
                }
            }
        }
        flights
    }

    /// Flights that pass their target within a few centimetres. They start `lead` steps earlier.
    pub(super) fn misses(&self, random: &mut Random, count: usize, lead: u32) -> Vec<Flight> {
        let mut flights = Vec::new();
        while flights.len() < count {
            let mut flight = self.flight(random, 0.0, Vec3::ZERO);
            let start = flight[0].pose.translation;
            let side = random.in_ball() * Vec3::new(0.0, 1.0, 1.0);
            let (side, rim) = match self.aim {
                Aim::Wall => (Vec3::Y, WALL.y),
                _ => (side.normalize_or(Vec3::Y), 0.0),
            };
            let (mut near, mut far) = (rim, rim + 2.0 * self.radius() + 0.05);
            let mut passes = |offset: f32| {
                flight[0].pose.translation = start + side * offset;
                self.first_within(&flight, CLEARANCE as f32 + 1e-3, self.passage()).is_none()
            };
            assert!(passes(far));
            for _ in 0..7 {
                let middle = 0.5 * (near + far);
                *(if passes(middle) { &mut far } else { &mut near }) = middle;
            }
            flight[0].pose.translation = start + side * far;
            let phase = f64::from(random.unit() * DT);
            flights.push(self.from(&flight, -phase - f64::from(lead) * f64::from(DT)));
        }
        flights
    }
}
