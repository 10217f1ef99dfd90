//! The scenes of the paper, each frame with several methods.

use bevy::{prelude::*, tasks::ComputeTaskPool};
use bevy_medial::{
    pipeline::{Statics, StepInput},
    plugin::MedialStep,
    prelude::MedialBudget,
    scenes::{Model, Monitor, Scene, headless_app, set_budget},
};
use bevy_medial_compare::{
    activity::{Activity, active},
    culling::{Comparison, Cull, Figures},
    demo::SEED,
    figures::PAPER_MS,
    paper::flat::{Detection, Flat, FlatStep},
};

/// A scene of the paper.
pub struct PaperScene {
    pub name: &'static str,
    /// The figure that shows its times.
    pub figure: &'static str,
    /// Number of primitive pairs in the scene.
    pub pairs: usize,
    /// Mean time of culling and detection in milliseconds on an RTX 2060S: with the medial axis transform, with trees of oriented boxes, of spheres.
    pub paper_ms: Option<[f64; 3]>,
}

pub const SCENES: [PaperScene; 4] = [
    PaperScene { name: "rods", figure: "9, 10 top", pairs: 2_100_000, paper_ms: PAPER_MS[0].1 },
    PaperScene { name: "dinosaur", figure: "10 middle, 11", pairs: 3_800_000, paper_ms: PAPER_MS[1].1 },
    PaperScene { name: "tori", figure: "10 bottom, 11", pairs: 861_900, paper_ms: PAPER_MS[2].1 },
    PaperScene { name: "stairs", figure: "7, 8", pairs: 330_000, paper_ms: PAPER_MS[3].1 },
];

/// The cullings beside the hybrid one. The flat methods follow.
pub const CULLS: [Cull; 5] = [Cull::BvhObb, Cull::BvhSphere, Cull::BvhAabb, Cull::BvhMedial, Cull::None];
pub const DETECTIONS: [Detection; 3] = [Detection::Alternating, Detection::Advancement, Detection::Lanes];

/// The flat methods run in every frame with this number.
const FLAT_EVERY: usize = 5;

/// Results of a frame.
pub struct Frame {
    /// Hybrid culling and the other one, for each of [`CULLS`].
    pub cullings: [[Figures; 2]; CULLS.len()],
    /// For each of [`DETECTIONS`], in some frames.
    pub flat: Option<[FlatStep; DETECTIONS.len()]>,
    /// True if a body is awake.
    pub is_awake: bool,
    /// True if many bodies touch and move.
    pub is_active: bool,
}

/// Results of a scene.
pub struct SceneResult {
    pub scene: &'static PaperScene,
    pub bodies: usize,
    /// Budget of the bodies, in percent.
    pub budget: f32,
    /// Primitive pairs of all body pairs.
    pub pairs: usize,
    pub frames: Vec<Frame>,
    /// Number and input of the frame with most primitive pairs after the culling of bodies.
    pub busiest: (usize, (StepInput, Statics)),
}

/// Runs a scene at the budget whose number of primitive pairs is nearest to that of the paper.
///
/// # Errors
/// If a culling changes the result of a frame.
pub fn run(paper: &'static PaperScene, models: &[Model], quick: bool) -> Result<SceneResult, String> {
    let scene = Scene::by_name(paper.name).ok_or_else(|| format!("there is no scene `{}`", paper.name))?;
    let budget = if quick { 5.0 } else { budget_for(scene, paper.pairs, models) };
    let mut app = app_of(scene, budget, models);
    let mut comparisons: Vec<Comparison> = CULLS.into_iter().filter_map(Comparison::with).collect();
    let (mut flat, mut frames, mut activity) = (Flat::default(), Vec::new(), Vec::new());
    let (mut most, mut busiest) = (0, Default::default());
    let steps = if quick { 60.min(scene.steps) } else { scene.steps };
    for number in 0..steps as usize {
        app.update();
        for comparison in &mut comparisons {
            comparison.run(app.world())?;
        }
        let cullings = std::array::from_fn(|i| comparisons[i].last().unwrap_or([Figures::default(); 2]));
        let step = app.world().resource::<MedialStep>();
        let flat = match number % FLAT_EVERY {
            0 => Some(flat_steps(&mut flat, step)?),
            _ => None,
        };
        if let Some([first, ..]) = flat.as_ref().filter(|[first, ..]| first.primitive_pairs > most) {
            most = first.primitive_pairs;
            busiest = (number, (step.input.clone(), step.statics.clone()));
        }
        let contact_pairs = step.output.pairs.iter().filter(|pair| !pair.manifolds.is_empty()).count();
        let energy = app.world().resource::<Monitor>().rows.last().map_or(0.0, |row| row.kinetic_energy_per_kg);
        activity.push(Activity { contact_pairs, energy });
        let is_awake = step.input.bodies.iter().any(|body| body.active);
        frames.push(Frame { cullings, flat, is_awake, is_active: false });
    }
    for (frame, is_active) in frames.iter_mut().zip(active(&activity)) {
        frame.is_active = is_active;
    }
    let step = app.world().resource::<MedialStep>();
    Ok(SceneResult { scene: paper, bodies: step.input.bodies.len(), budget, pairs: pairs(step), frames, busiest })
}

fn flat_steps(flat: &mut Flat, step: &MedialStep) -> Result<[FlatStep; DETECTIONS.len()], String> {
    let mut steps: [FlatStep; DETECTIONS.len()] = Default::default();
    for (result, detection) in steps.iter_mut().zip(DETECTIONS) {
        *result = flat.step(&step.input, &step.statics, detection)?;
    }
    Ok(steps)
}

fn app_of(scene: &Scene, budget: f32, models: &[Model]) -> App {
    ComputeTaskPool::get_or_init(Default::default);
    let mut app = headless_app(1.0 / 60.0);
    set_budget(&mut app, MedialBudget::Percent(budget));
    scene.spawn(app.world_mut(), models, SEED);
    app
}

/// The budget, in percent, with which a scene has about this number of primitive pairs.
fn budget_for(scene: &Scene, wanted: usize, models: &[Model]) -> f32 {
    let far = |budget: f32| {
        let mut app = app_of(scene, budget, models);
        // Levels of detail are chosen in the first update.
        app.update();
        app.update();
        (pairs(app.world().resource::<MedialStep>()) as f64 / wanted as f64).ln().abs()
    };
    // From 4 % down to 0.1 %.
    let budgets = (0..=60).map(|number| 4.0 * 40f32.powf(-number as f32 / 60.0));
    let trials = budgets.map(|budget| (budget, far(budget)));
    trials.min_by(|a, b| a.1.total_cmp(&b.1)).map_or(1.0, |(budget, _)| budget)
}

/// The number of primitive pairs of all body pairs.
fn pairs(step: &MedialStep) -> usize {
    let counts: Vec<usize> = step.input.bodies.iter().map(|body| body.solid.len()).collect();
    let total: usize = counts.iter().sum();
    let squares: usize = counts.iter().map(|count| count * count).sum();
    let fixed: usize = step.statics.bodies().iter().map(|body| body.solid.len()).sum();
    (total * total - squares) / 2 + total * fixed
}
