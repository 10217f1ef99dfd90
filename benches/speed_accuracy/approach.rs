//! Seeded approaches of two bodies, classified by their outcome.

use bevy_medial::{
    geometry::{Pose3, Sweep},
    random::Random,
};
use glam::{Quat, Vec3};
use indicatif::ProgressBar;
use serde::Serialize;

use crate::{
    models::Model,
    truth::{Motion, Touch, first_touch, is_confirmed},
};

/// The outcome of an approach.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Class {
    /// The bodies hit each other.
    Hit,
    /// The path of the contact point is within 12 degrees of the surface.
    Graze,
    /// The bodies pass each other by less than 2 % of the smaller body's diagonal.
    Miss,
}

/// The motion of two bodies over a step.
pub struct Approach {
    pub sweeps: [Sweep; 2],
    pub class: Class,
    /// The first touch. `None` for a miss.
    pub truth: Option<Touch>,
    /// Speed of the contact point relative to the other body, in metres per step. For a miss, the length of the step.
    pub speed: f64,
}

/// Share of grazes among all approaches.
const GRAZES: f32 = 0.2;
/// Share of near misses among all approaches.
const MISSES: f32 = 0.2;

/// In a graze, the component of the relative speed along the normal is below this part of it.
const GRAZING: f64 = 0.2;

/// Max distance of a near miss, as a part of the smaller body's diagonal.
const NEAR: f64 = 0.02;

/// Approaches of two models. In a step they move by 10 to 100 % of the smaller size, and turn by up to a radian. The touch is in about the first 60 % of
/// the step, so that less exact shapes touch within the step as well.
///
/// # Errors
/// If bisection does not confirm a first touch.
pub fn approaches(models: [&Model; 2], count: usize, seed: u64) -> Result<Vec<Approach>, String> {
    let wanted = |class: Class| match class {
        Class::Graze => (count as f32 * GRAZES) as usize,
        Class::Miss => (count as f32 * MISSES) as usize,
        Class::Hit => count - (count as f32 * GRAZES) as usize - (count as f32 * MISSES) as usize,
    };
    let mut random = Random(seed);
    let mut found: Vec<Approach> = Vec::new();
    let progress = ProgressBar::new(count as u64).with_message("approaches");
    while found.len() < count {
        let Some(approach) = approach(models, &mut random) else { continue };
        if found.iter().filter(|other| other.class == approach.class).count() == wanted(approach.class) {
            continue;
        }
        if let Some(truth) = &approach.truth {
            let motions = approach.sweeps.each_ref().map(Motion::new);
            if !is_confirmed(models.map(|model| &model.exact), &motions, truth, approach.speed) {
                return Err(format!("{} and {}: {truth:?} is not a first touch", models[0].name, models[1].name));
            }
        }
        found.push(approach);
        progress.inc(1);
    }
    progress.finish_and_clear();
    Ok(found)
}

/// A random approach. The bodies first fly past each other without turning. The step is then placed around their touch or their near miss, with turns,
/// and classified by its own first touch. `None` if the bodies overlap at the start or do not come near each other.
fn approach(models: [&Model; 2], random: &mut Random) -> Option<Approach> {
    let meshes = models.map(|model| &model.exact);
    let size = models[0].diagonal.min(models[1].diagonal);
    let near = NEAR * f64::from(size);
    let radii = models[0].radius + models[1].radius;

    let direction = random.direction().as_vec3();
    let aside = random.direction().as_vec3().reject_from_normalized(direction) * radii;
    let length = 3.0 * radii;
    let starts = [Vec3::ZERO, direction * 0.5 * length + aside];
    let rotations = starts.map(|_| random.direction_rotation().as_quat());
    let centers = models.map(|model| model.center_of_mass);
    let pose = |side: usize, center, rotation| Pose3::from_parts(center - rotation * centers[side], rotation);
    let flight = |side: usize| {
        let translation = if side == 0 { direction * length } else { Vec3::ZERO };
        Motion::new(&Sweep::at_rates(pose(side, starts[side], rotations[side]), centers[side], translation, Vec3::ZERO))
    };
    let flown = [0, 1].map(flight);
    let touch = first_touch(meshes, &flown, 0.0, 1.0);
    let middle = touch.or_else(|| first_touch(meshes, &flown, near, 1.0))?.fraction as f32;

    let step = size * 0.1 * 10f32.powf(random.unit());
    let before = 0.1 + 0.5 * random.unit();
    let share = random.unit();
    let sweeps = [0, 1].map(|side: usize| {
        let (flown, share) = if side == 0 { (direction * length * middle, share) } else { (Vec3::ZERO, share - 1.0) };
        let (translation, turn) = (direction * step * share, random.direction().as_vec3() * random.unit());
        let center = starts[side] + flown - translation * before;
        let rotation = (Quat::from_scaled_axis(turn * -before) * rotations[side]).normalize();
        Sweep::at_rates(pose(side, center, rotation), centers[side], translation, turn)
    });
    let motions = sweeps.each_ref().map(Motion::new);
    // Because of the turns, the bodies may overlap at the start of the step.
    first_touch(meshes, &motions.map(|m| m.frozen(0.0)), 0.25 * near, 1.0).is_none().then_some(())?;
    let truth = first_touch(meshes, &motions, 0.0, 1.0);
    let (class, speed) = match &truth {
        Some(touch) => {
            let [first, second] = motions.map(|m| m.velocity_at(touch.fraction, touch.point));
            let slip = first - second;
            let grazes = slip.dot(touch.normal) < GRAZING * slip.length();
            (if grazes { Class::Graze } else { Class::Hit }, slip.length())
        }
        None => {
            first_touch(meshes, &motions, near, 1.0)?;
            (Class::Miss, f64::from(step))
        }
    };
    Some(Approach { sweeps, class, truth, speed })
}
