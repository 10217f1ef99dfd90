//! Trees of several volumes over the primitives of two bodies that are near each other.

use std::time::Instant;

use bevy::tasks::{ComputeTaskPool, TaskPool};
use bevy_medial::{
    geometry::{Pose3, Sweep},
    medial_axis::MedialAxis,
    pipeline::{Body, PairFilter, Shape, Statics, StepInput, StepOutput, Workspace},
    random::Random,
};
use bevy_medial_compare::baselines::{Kind, pair::tree_pair};
use glam::Vec3;

/// Distances of the centres of bounding spheres, as parts of the sum of their radii.
pub const DISTANCES: [f32; 3] = [0.4, 0.7, 1.0];

const KINDS: [(&str, Kind); 4] = [
    ("medial primitives", Kind::Medial),
    ("oriented boxes", Kind::Obb),
    ("spheres", Kind::Sphere),
    ("aligned boxes", Kind::Aabb),
];

/// Number of placements of each pair of models at each distance.
const PLACEMENTS: usize = 10;

/// Means over all pairs of models and their placements.
#[derive(Clone, Copy, Debug, Default)]
pub struct HierarchyRow {
    pub volume: &'static str,
    /// Number of tested node pairs. The hybrid does not count them.
    pub tests: Option<f64>,
    /// Number of primitive pairs that remain.
    pub candidates: f64,
    /// Time to bound both trees over a step, in microseconds.
    pub update_us: Option<f64>,
    /// Time to search a pair, in microseconds.
    pub search_us: f64,
    /// Time to build both trees, in milliseconds.
    pub build_ms: Option<f64>,
    /// Bytes of the trees over the number of primitives.
    pub bytes: Option<f64>,
}

/// A pair of shapes with some motions.
struct Case {
    shapes: [Shape; 2],
    sweeps: Vec<[Sweep; 2]>,
}

/// For each distance: a row for each kind of tree, and one for the hybrid culling.
pub fn rows(models: &[MedialAxis], quick: bool) -> Vec<HierarchyRow> {
    let models = if quick { &models[..3] } else { models };
    let mut rows = Vec::new();
    for (seed, distance) in (1..).zip(DISTANCES) {
        let mut random = Random(seed);
        let cases: Vec<Case> = (0..models.len())
            .flat_map(|i| (i..models.len()).map(move |j| [i, j]))
            .map(|pair| case(pair.map(|i| Shape::new(models[i].clone())), distance, &mut random))
            .collect();
        rows.extend(KINDS.iter().map(|(name, kind)| of_trees(name, *kind, &cases)));
        rows.push(of_hybrid(&cases));
    }
    rows
}

fn case(shapes: [Shape; 2], distance: f32, random: &mut Random) -> Case {
    let [bound1, bound2] = shapes.each_ref().map(Shape::bounding_sphere);
    let apart = distance * (bound1.radius + bound2.radius);
    let size = bound1.radius.min(bound2.radius);
    let sweeps = (0..PLACEMENTS).map(|_| {
        let direction = random.direction().as_vec3();
        let mut sweep = |shape: &Shape, middle: Vec3| {
            let rotation = random.rotation();
            let pose = Pose3::from_parts(middle - rotation * shape.bounding_sphere().center, rotation);
            Sweep::at_rates(pose, shape.center_of_mass(), random.in_cube() * 0.1 * size, random.in_cube() * 0.1)
        };
        [sweep(&shapes[0], Vec3::ZERO), sweep(&shapes[1], direction * apart)]
    });
    let sweeps = sweeps.collect();
    Case { shapes, sweeps }
}

fn of_trees(volume: &'static str, kind: Kind, cases: &[Case]) -> HierarchyRow {
    let (mut tests, mut candidates, mut memory, mut primitives) = (0, 0, 0, 0);
    let [mut build, mut update, mut search] = [0.0; 3];
    for Case { shapes, sweeps } in cases {
        let begin = Instant::now();
        let mut trees = tree_pair(kind, [&shapes[0], &shapes[1]]);
        build += begin.elapsed().as_secs_f64();
        memory += trees.memory();
        primitives += shapes[0].len() + shapes[1].len();
        for sweeps in sweeps {
            let begin = Instant::now();
            trees.refit(sweeps);
            update += begin.elapsed().as_secs_f64();
            let begin = Instant::now();
            let (found, tested) = trees.between();
            search += begin.elapsed().as_secs_f64();
            (tests, candidates) = (tests + tested, candidates + found.len());
        }
    }
    let count = (cases.len() * PLACEMENTS) as f64;
    HierarchyRow {
        volume,
        tests: Some(tests as f64 / count),
        candidates: candidates as f64 / count,
        update_us: Some(update * 1e6 / count),
        search_us: search * 1e6 / count,
        build_ms: Some(build * 1e3 / cases.len() as f64),
        bytes: Some(memory as f64 / primitives as f64),
    }
}

fn of_hybrid(cases: &[Case]) -> HierarchyRow {
    let pool: &TaskPool = ComputeTaskPool::get_or_init(Default::default);
    let (mut workspace, mut output) = (Workspace::default(), StepOutput::default());
    let (mut search, mut candidates) = (0.0, 0);
    for Case { shapes, sweeps } in cases {
        for sweeps in sweeps {
            let bodies = [0, 1].map(|i: usize| Body::new(shapes[i].clone(), sweeps[i]));
            let input = StepInput { bodies: bodies.into(), ..StepInput::default() };
            workspace.step(&input, &Statics::default(), |_, _| PairFilter::Stopping, pool, &mut output);
            search += output.times.mid.as_secs_f64();
            candidates += output.counts.candidates;
        }
    }
    let count = (cases.len() * PLACEMENTS) as f64;
    HierarchyRow {
        volume: "hybrid",
        candidates: candidates as f64 / count,
        search_us: search * 1e6 / count,
        ..HierarchyRow::default()
    }
}
