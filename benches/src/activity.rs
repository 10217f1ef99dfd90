//! The active steps of a run, and medians.

/// A measure of the activity in a step.
#[derive(Clone, Copy, Debug)]
pub struct Activity {
    /// Pairs of bodies with contacts.
    pub contact_pairs: usize,
    /// Kinetic energy, in any unit.
    pub energy: f32,
}

/// True for each active step. An active step has at least 30 % of the max number of contact pairs of any step, and 3 % of the max
/// kinetic energy: bodies touch, and are not at rest.
pub fn active(steps: &[Activity]) -> Vec<bool> {
    let most_pairs = steps.iter().map(|step| step.contact_pairs).max().unwrap_or(0);
    let most_energy = steps.iter().map(|step| step.energy).fold(0.0, f32::max);
    let is_active = |step: &Activity| {
        step.contact_pairs > 0
            && step.contact_pairs as f32 >= 0.3 * most_pairs as f32
            && step.energy >= 0.03 * most_energy
    };
    steps.iter().map(is_active).collect()
}

/// The median, or the upper one of an even number of values. NaN without values.
pub fn median(values: impl IntoIterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.into_iter().collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}
