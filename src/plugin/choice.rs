//! Choice of the faster back end, by trials in the app's own steps.

use std::time::Duration;

use crate::constants::LEAST_GPU_TIME;

/// Number of timed steps for each back end. The shortest time for a body counts, because the first GPU steps allocate buffers and upload shapes.
const TRIED: usize = 8;
/// Number of steps after which a GPU with fewer answers than [`TRIED`] counts as slower.
const PATIENCE: u32 = 120;
/// Number of steps after which both are tried again.
const HOLDS: u32 = 600;

/// The current choice and the current trial.
#[derive(Default)]
pub(super) struct Choice {
    made: Option<Made>,
    trial: Option<Trial>,
}

struct Made {
    on_gpu: bool,
    /// Number of bodies in the step of the choice.
    bodies: usize,
    /// Number of steps since the choice.
    steps: u32,
}

/// A trial: the CPU and the GPU cull alternate steps.
struct Trial {
    /// Name of the GPU.
    gpu: String,
    /// Seconds for a body in the steps of the CPU and of the GPU.
    times: [Vec<f64>; 2],
    steps: u32,
}

impl Choice {
    /// Returns true if the GPU should cull the next step, because it is faster or because it is being tried.
    pub fn is_gpu(&self) -> bool {
        match (&self.trial, &self.made) {
            (Some(trial), _) => trial.steps % 2 == 1,
            (None, Some(made)) => made.on_gpu,
            (None, None) => false,
        }
    }

    /// Returns true if the GPU should look ahead, because it may cull one of the next steps.
    pub fn looks_ahead(&self) -> bool {
        self.trial.is_some() || self.is_gpu()
    }

    /// Records the back end and the duration of a step of a number of bodies. `gpu` returns the name of a GPU that is ready. Returns a line for the log if
    /// another back end has become the faster one.
    pub fn note(
        &mut self,
        on_gpu: bool,
        bodies: usize,
        time: Duration,
        gpu: impl FnOnce() -> Option<String>,
    ) -> Option<String> {
        let bodies = bodies.max(1);
        let Some(trial) = &mut self.trial else {
            self.made.iter_mut().for_each(|made| made.steps += 1);
            if !self.holds(bodies) && (on_gpu || time >= LEAST_GPU_TIME) {
                self.trial = gpu().map(|gpu| Trial { gpu, times: Default::default(), steps: 0 });
            }
            return None;
        };
        trial.steps += 1;
        let times = &mut trial.times[usize::from(on_gpu)];
        times.push(time.as_secs_f64() / bodies as f64);
        if trial.times.iter().any(|times| times.len() < TRIED) && trial.steps < PATIENCE {
            return None;
        }
        let Trial { gpu, times: [cpu, answers], .. } = self.trial.take()?;
        let least = |times: &[f64]| times.iter().copied().fold(f64::INFINITY, f64::min);
        let is_answered = answers.len() >= TRIED;
        let [cpu, answer] = [least(&cpu), least(&answers)];
        let on_gpu = is_answered && answer < cpu;
        let before = self.made.replace(Made { on_gpu, bodies, steps: 0 });
        if before.is_some_and(|before| before.on_gpu == on_gpu) {
            return None;
        }
        let chosen = if on_gpu { "GPU" } else { "CPU" };
        let in_step = |seconds: f64| format!("{:.3} ms", seconds * bodies as f64 * 1e3);
        let answer = if is_answered { in_step(answer) } else { "too long".into() };
        Some(format!(
            "medial meshes are culled on the {chosen}: a step of {bodies} bodies takes {answer} with `{gpu}`, {} with the CPU",
            in_step(cpu)
        ))
    }

    /// Returns true while the choice is valid: for some time, and while the number of bodies is at most doubled or halved.
    fn holds(&self, bodies: usize) -> bool {
        self.made
            .as_ref()
            .is_some_and(|made| made.steps < HOLDS && bodies <= 2 * made.bodies && made.bodies <= 2 * bodies)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BODIES: usize = 1000;

    /// Runs steps with these durations in microseconds on the CPU and on the GPU, if the GPU answers. Returns the number of steps on the GPU, and the log.
    fn run(choice: &mut Choice, steps: usize, bodies: usize, cpu: u64, gpu: Option<u64>) -> (usize, Vec<String>) {
        let (mut on_gpu, mut lines) = (0, Vec::new());
        for step in 0..steps {
            let answered = gpu.filter(|_| choice.is_gpu());
            // Only every eighth step is fast, as the first steps of a trial are slow.
            let time = Duration::from_micros(answered.unwrap_or(cpu) + if step / 2 % 8 < 7 { 100 } else { 0 });
            on_gpu += usize::from(answered.is_some());
            lines.extend(choice.note(answered.is_some(), bodies, time, || Some("some GPU".into())));
        }
        (on_gpu, lines)
    }

    #[test]
    fn the_faster_back_end_is_chosen_and_logged() {
        let mut choice = Choice::default();
        let (on_gpu, lines) = run(&mut choice, 101, BODIES, 2000, Some(300));
        assert_eq!(on_gpu, 100 - TRIED);
        assert_eq!(
            lines,
            [
                "medial meshes are culled on the GPU: a step of 1000 bodies takes 0.300 ms with `some GPU`, 2.000 ms with the CPU"
            ]
        );
        let mut choice = Choice::default();
        let (on_gpu, lines) = run(&mut choice, 101, BODIES, 2000, Some(3000));
        assert_eq!(on_gpu, TRIED);
        assert!(lines.len() == 1 && lines[0].starts_with("medial meshes are culled on the CPU:"), "{lines:?}");
    }

    #[test]
    fn trials_alternate_and_compare_times_for_a_body() {
        let mut choice = Choice::default();
        run(&mut choice, 1, BODIES, 2000, Some(300));
        let mut order = Vec::new();
        // The scene grows all the time. The GPU takes half as long for a body.
        for step in 0..2 * TRIED {
            let (is_gpu, bodies) = (choice.is_gpu(), BODIES * (step + 1));
            order.push(is_gpu);
            let time = Duration::from_micros((bodies * if is_gpu { 1 } else { 2 }) as u64);
            choice.note(is_gpu, bodies, time, || None);
        }
        assert!(order.chunks(2).all(|pair| pair == [false, true]), "{order:?}");
        assert!(choice.is_gpu());
    }

    #[test]
    fn fast_steps_are_not_tried() {
        let mut choice = Choice::default();
        assert_eq!(run(&mut choice, 100, BODIES, 700, Some(300)), (0, Vec::new()));
    }

    #[test]
    fn both_are_tried_again_when_the_scene_has_changed() {
        let mut choice = Choice::default();
        run(&mut choice, 1 + 2 * TRIED, BODIES, 2000, Some(3000));
        // The same choice again is not logged.
        let (on_gpu, lines) = run(&mut choice, HOLDS as usize + 2 * TRIED, BODIES, 2000, Some(3000));
        assert_eq!((on_gpu, lines.len()), (TRIED, 0));
        let (on_gpu, lines) = run(&mut choice, 101, 4 * BODIES, 2000, Some(300));
        assert_eq!((on_gpu, lines.len()), (100 - TRIED, 1));
    }

    #[test]
    fn a_gpu_that_does_not_answer_is_the_slower_one() {
        let mut choice = Choice::default();
        let (_, lines) = run(&mut choice, 200, BODIES, 2000, None);
        assert_eq!(
            lines,
            [
                "medial meshes are culled on the CPU: a step of 1000 bodies takes too long with `some GPU`, 2.000 ms with the CPU"
            ]
        );
    }
}
