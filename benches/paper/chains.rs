//! Body pairs that chains of cones leave, with one to eight links.

use std::time::Instant;

use bevy_medial::{
    geometry::{Pose3, Sphere, Sweep},
    medial_axis::MedialAxis,
    pipeline::{Body, Shape, Statics, StepInput},
    plugin::MedialStep,
    prelude::MedialBudget,
    random::Random,
    scenes::{Model, Scene, headless_app, set_budget},
};
use bevy_medial_compare::{
    demo::SEED,
    paper::chains::{continued, pairs},
};
use glam::Vec3;

/// Numbers of links.
pub const LINKS: [usize; 4] = [1, 2, 4, 8];

/// Steps over which motions are swept: one, and the look-ahead of the pipelined culling on the GPU.
const LOOK_AHEADS: [usize; 2] = [1, 4];

/// Body pairs in total over some steps.
pub struct ChainRow {
    pub name: &'static str,
    pub look_ahead: usize,
    /// For each of [`LINKS`].
    pub pairs: [usize; LINKS.len()],
    /// Time of the tests of all body pairs, in milliseconds.
    pub times_ms: [f64; LINKS.len()],
}

/// Rows for scenes, and for bodies that spin.
pub fn rows(models: &[Model], quick: bool) -> Vec<ChainRow> {
    let mut rows = Vec::new();
    for name in ["rods", "dinosaur", "tori", "stairs", "bullets"] {
        let Some(scene) = Scene::by_name(name) else { continue };
        rows.extend(counted(name, &recorded(scene, models, if quick { 5 } else { 100 })));
    }
    let dinosaurs = models.iter().find(|model| model.name == "dinosaur").map(|model| model.axis.clone());
    rows.extend(dinosaurs.into_iter().flat_map(|axis| counted("200 dinosaurs at 30 rad/s", &[spinning(axis)])));
    // The centre of mass is far from the centre of the bounding sphere.
    let hammer = MedialAxis::cone(Sphere::new(Vec3::ZERO, 0.25), Sphere::new(Vec3::X, 0.02));
    rows.extend(hammer.into_iter().flat_map(|axis| counted("200 clubs at 30 rad/s", &[spinning(axis)])));
    rows
}

fn counted(name: &'static str, steps: &[(StepInput, Statics)]) -> Vec<ChainRow> {
    let row = |look_ahead: usize| {
        let steps: Vec<_> = steps.iter().map(|(input, statics)| (continued(input, look_ahead), statics)).collect();
        let found = LINKS.map(|links| {
            let clock = Instant::now();
            let pairs = steps.iter().map(|(input, statics)| pairs(input, statics, links)).sum();
            (pairs, clock.elapsed().as_secs_f64() * 1e3)
        });
        ChainRow { name, look_ahead, pairs: found.map(|(pairs, _)| pairs), times_ms: found.map(|(_, time)| time) }
    };
    LOOK_AHEADS.map(row).into()
}

/// Inputs of the first steps of a scene.
fn recorded(scene: &Scene, models: &[Model], steps: usize) -> Vec<(StepInput, Statics)> {
    let mut app = headless_app(1.0 / 60.0);
    set_budget(&mut app, MedialBudget::default());
    scene.spawn(app.world_mut(), models, SEED);
    let step = |_| {
        app.update();
        let step = app.world().resource::<MedialStep>();
        (step.input.clone(), step.statics.clone())
    };
    (0..steps).map(step).collect()
}

/// 200 bodies that spin at 30 rad/s and fly at up to 5 m/s, 1.5 times as far from each other as they are wide.
fn spinning(axis: MedialAxis) -> (StepInput, Statics) {
    const STEP: f32 = 1.0 / 60.0;
    let mut random = Random(3);
    let shape = Shape::new(axis);
    let spacing = 3.0 * shape.bounding_sphere().radius;
    let body = |number: usize| {
        let place = Vec3::new((number % 6) as f32, (number / 6 % 6) as f32, (number / 36) as f32) * spacing;
        let pose = Pose3::from_parts(place + random.in_cube() * 0.2 * spacing, random.rotation());
        let spin = random.direction().as_vec3() * 30.0;
        let velocity = random.in_cube() * 5.0;
        Body::new(shape.clone(), Sweep::at_rates(pose, shape.center_of_mass(), velocity * STEP, spin * STEP))
    };
    (StepInput { bodies: (0..200).map(body).collect(), ..StepInput::default() }, Statics::default())
}
