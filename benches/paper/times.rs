//! Times of the methods over the frames of a scene, and faults of the published time of impact.

use bevy_medial_compare::culling::Figures;

use crate::scenes::{CULLS, Frame, SceneResult};

/// Names of the methods, in the order of their numbers.
pub const METHODS: [&str; 9] = [
    "hybrid",
    "trees of oriented boxes",
    "trees of spheres",
    "trees of aligned boxes",
    "trees of medial primitives",
    "no culling of primitives",
    "flat, alternating",
    "flat, advancement",
    "flat, in lanes",
];

/// Cost of a method in a frame.
pub struct Cost {
    pub ms: f64,
    /// Pairs that its culling leaves.
    pub body_pairs: f64,
    pub primitive_pairs: f64,
}

/// The cost of a method in a frame. `None` if it did not run.
pub fn cost(frame: &Frame, method: usize) -> Option<Cost> {
    let of = |figures: &Figures| Cost {
        ms: figures.total_ms(),
        body_pairs: figures.body_pairs,
        primitive_pairs: figures.candidates,
    };
    match method {
        0 => Some(of(&frame.cullings[0][0])),
        _ if method <= CULLS.len() => Some(of(&frame.cullings[method - 1][1])),
        _ => {
            let step = &frame.flat.as_ref()?[method - 1 - CULLS.len()];
            Some(Cost {
                ms: step.culling_ms + step.detection_ms,
                body_pairs: step.first_touches.len() as f64,
                primitive_pairs: step.primitive_pairs as f64,
            })
        }
    }
}

/// The time of a method in a frame, in milliseconds. `None` if it did not run.
fn time(frame: &Frame, method: usize) -> Option<f64> {
    cost(frame, method).map(|cost| cost.ms)
}

/// The frames of a mean.
#[derive(Clone, Copy)]
pub enum Over {
    Awake,
    Active,
}

impl Over {
    fn frames(self, result: &SceneResult) -> impl Iterator<Item = &Frame> + Clone {
        result.frames.iter().filter(move |frame| match self {
            Over::Awake => frame.is_awake,
            Over::Active => frame.is_active,
        })
    }

    /// The mean time of a method over the frames in which it ran, in milliseconds.
    pub fn mean_ms(self, result: &SceneResult, method: usize) -> f64 {
        let (count, sum) = self.frames(result).filter_map(|frame| time(frame, method)).fold((0, 0.0), add);
        sum / f64::from(count)
    }

    /// The ratio of the times of a method and of the hybrid, over the frames in which both ran.
    pub fn ratio(self, result: &SceneResult, method: usize) -> f64 {
        let both = self.frames(result).filter_map(|frame| {
            // Beside each tree the hybrid ran in turns with it.
            let beside = frame.cullings.get(method.wrapping_sub(1)).unwrap_or(&frame.cullings[0])[0];
            Some((time(frame, method)?, beside.total_ms()))
        });
        let (own, hybrid) = both.fold((0.0, 0.0), |sums, times| (sums.0 + times.0, sums.1 + times.1));
        own / hybrid
    }
}

fn add((count, sum): (u32, f64), value: f64) -> (u32, f64) {
    (count + 1, sum + value)
}

/// First touches of the alternation that differ from those of the advancement, over all body pairs and frames.
#[derive(Clone, Copy, Default)]
pub struct Faults {
    pub touches: usize,
    pub missed: usize,
    pub late: usize,
    pub false_positives: usize,
}

/// Touches that are later by less than this fraction of a frame are not late.
pub const LATE: f32 = 1e-3;

pub fn faults(result: &SceneResult) -> Faults {
    let mut faults = Faults::default();
    for [alternating, advancement, _] in result.frames.iter().filter_map(|frame| frame.flat.as_ref()) {
        for (&(_, found), &(_, truth)) in alternating.first_touches.iter().zip(&advancement.first_touches) {
            // The alternation ignores overlaps at the start.
            if truth == 0.0 {
                continue;
            }
            faults.touches += usize::from(truth < 1.0);
            faults.missed += usize::from(truth < 1.0 && found == 1.0);
            faults.late += usize::from(found < 1.0 && found > truth + LATE);
            faults.false_positives += usize::from(truth == 1.0 && found < 1.0);
        }
    }
    faults
}
