//! Time of a step with many characters, and with rigid bodies of the same shape in their place.

use std::time::Instant;

use bevy::prelude::*;
use bevy_medial::{medial_axis::MedialAxis, prelude::*, random::Random};
use bevy_rapier3d::prelude::RigidBody;

use super::{Actor, Cast, add_axis, cpu_app};
use crate::activity::median;

/// Shapes in the place of the characters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shapes {
    /// No shapes: only joints that move.
    Nothing,
    /// Kinematic rigid bodies in the bind pose, which bob up and down.
    Rigid,
    /// Skinned shapes.
    Skinned,
}

/// A scene of characters that run on the spot.
#[derive(Clone, Copy, Debug)]
pub struct Scene {
    pub shapes: Shapes,
    pub characters: usize,
    /// Number of dynamic balls around the legs of each character.
    pub balls: usize,
    /// Number of steps.
    pub steps: u32,
}

/// Medians over the steps of a scene.
#[derive(Clone, Copy, Debug)]
pub struct Cost {
    /// Time of an update in milliseconds.
    pub update: f64,
    /// Processor time of an update on all threads in milliseconds, a mean. Other programs disturb it less. NaN if the system does not report it.
    pub processor: f64,
    /// Number of pairs in contact.
    pub contact_pairs: f64,
}

const DT: f32 = 1.0 / 60.0;
/// Number of steps before the first one that is measured.
const WARM_UP: u32 = 12;
/// Radius of a ball in metres.
const RADIUS: f32 = 0.1;
/// Distance between neighbours in metres.
const SPACING: f32 = 3.0;

/// Processor time of this program so far on all threads, in milliseconds: the first number of each thread's `schedstat` is in nanoseconds.
fn processor_ms() -> f64 {
    let threads = std::fs::read_dir("/proc/self/task").into_iter().flatten().flatten();
    let times = threads.filter_map(|thread| {
        let text = std::fs::read_to_string(thread.path().join("schedstat")).ok()?;
        text.split_whitespace().next()?.parse::<f64>().ok()
    });
    times.reduce(|sum, time| sum + time).map_or(f64::NAN, |nanoseconds| nanoseconds * 1e-6)
}

impl Scene {
    /// Runs the scene. The animation writes local transforms outside the measured time; their propagation is within it.
    pub fn run(&self, actor: &Actor) -> Cost {
        let mut app = cpu_app(DT);
        let mesh = add_axis(&mut app, &actor.axis);
        let side = (self.characters as f32).sqrt().ceil() as usize;
        let casts: Vec<Cast> = (0..self.characters)
            .map(|index| {
                let offset = Vec3::new((index % side) as f32, 0.0, (index / side) as f32) * SPACING;
                let cast = Cast::spawn(&mut app, actor, offset);
                self.dress(&mut app, &cast, &mesh);
                self.drop_balls(&mut app, offset, index);
                cast
            })
            .collect();
        let (mut updates, mut pairs, mut processor) = (Vec::new(), Vec::new(), 0.0);
        for step in 1..=WARM_UP + self.steps {
            let time = step as f32 * DT;
            for (index, cast) in casts.iter().enumerate() {
                // The characters are out of step, as in a game.
                let phase = index as f32 * 0.37 * actor.character.period;
                cast.animate(&mut app, actor, time + phase);
                if self.shapes == Shapes::Rigid
                    && let Some(mut place) = app.world_mut().get_mut::<Transform>(cast.root)
                {
                    place.translation = cast.offset + Vec3::Y * 0.03 * (20.0 * (time + phase)).sin();
                }
            }
            let (clock, before) = (Instant::now(), processor_ms());
            app.update();
            if step > WARM_UP {
                updates.push(clock.elapsed().as_secs_f64() * 1e3);
                processor += processor_ms() - before;
                let output = &app.world().resource::<MedialStep>().output;
                pairs.push(output.pairs.iter().filter(|pair| !pair.manifolds.is_empty()).count() as f64);
            }
        }
        Cost { update: median(updates), processor: processor / f64::from(self.steps), contact_pairs: median(pairs) }
    }

    fn dress(&self, app: &mut App, cast: &Cast, mesh: &Handle<MedialAxis>) {
        let mut root = app.world_mut().entity_mut(cast.root);
        match self.shapes {
            Shapes::Nothing => {}
            Shapes::Rigid => {
                let place = Transform::from_translation(cast.offset);
                root.insert((RigidBody::KinematicPositionBased, MedialMesh(mesh.clone()), place));
            }
            Shapes::Skinned => _ = root.insert(SkinnedMedialMesh::new(mesh.clone())),
        }
    }

    /// Balls within walls around the character.
    fn drop_balls(&self, app: &mut App, offset: Vec3, seed: usize) {
        if self.balls == 0 {
            return;
        }
        let mut random = Random(seed as u64 + 1);
        let Ok(ball) = MedialAxis::sphere(RADIUS) else { return };
        let mesh = MedialMesh(add_axis(app, &ball));
        let mut wall = |place: Vec3, half: Vec3| {
            let wall = StaticObb { half_extents: half };
            app.world_mut().spawn((wall, Transform::from_translation(offset + place)));
        };
        wall(Vec3::NEG_Y * 0.6, Vec3::new(0.8, 0.5, 0.8));
        for (side, along) in [(Vec3::X, Vec3::Z), (Vec3::Z, Vec3::X)] {
            [-0.7, 0.7]
                .iter()
                .for_each(|aside| wall(side * *aside + Vec3::Y * 0.7, side * 0.1 + (along + Vec3::Y) * 0.8));
        }
        for number in 0..self.balls {
            let cell = Vec3::new((number % 2) as f32 - 0.5, 0.0, (number / 2 % 2) as f32 - 0.5) * 0.8;
            let place = offset + cell + random.in_cube() * 0.02 + Vec3::Y * (0.1 + 0.22 * (number / 4) as f32);
            app.world_mut().spawn((RigidBody::Dynamic, mesh.clone(), Transform::from_translation(place)));
        }
    }
}
