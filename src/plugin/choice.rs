//! Choice of the faster back end, by trials in the app's own steps.

use std::time::Duration;

use crate::constants::LEAST_GPU_PAIRS;

/// Number of timed steps for each back end. The shortest time counts, because the first GPU steps allocate buffers and upload shapes.
const TRIED: usize = 8;
/// Number of steps after which a GPU with fewer answers than [`TRIED`] counts as slower.
const PATIENCE: u32 = 120;
/// Number of steps after which both are tried again.
const HOLDS: u32 = 600;

/// The current choice and the current trial.
#[derive(Default)]
pub(super) struct Choice {
    made: Option<Made>,
    trial: Trial,
}

struct Made {
    on_gpu: bool,
    /// Number of primitive pairs in the step of the choice.
    pairs: usize,
    /// Number of steps since the choice.
    steps: u32,
}

/// Step times in a trial.
#[derive(Default)]
struct Trial {
    cpu: Vec<Duration>,
    gpu: Vec<Duration>,
    steps: u32,
}

impl Choice {
    /// Returns true if the GPU should cull a step of `pairs` primitive pairs, because it is faster or because it is being tried.
    pub fn is_gpu(&self, pairs: usize) -> bool {
        let tries_gpu = self.trial.cpu.len() == TRIED;
        pairs >= LEAST_GPU_PAIRS && self.holding(pairs).map_or(tries_gpu, |made| made.on_gpu)
    }

    /// Returns the choice while it is valid: for some time, and while the number of pairs is at most doubled or halved.
    fn holding(&self, pairs: usize) -> Option<&Made> {
        self.made.as_ref().filter(|made| made.steps < HOLDS && pairs <= 2 * made.pairs && made.pairs <= 2 * pairs)
    }

    /// Records the back end and the duration of a step. Returns a line for the log if another back end has become the faster one.
    pub fn note(&mut self, on_gpu: bool, pairs: usize, time: Duration, gpu: &str) -> Option<String> {
        if pairs < LEAST_GPU_PAIRS {
            return None;
        }
        if self.holding(pairs).is_some() {
            self.made.iter_mut().for_each(|made| made.steps += 1);
            return None;
        }
        self.trial.steps += 1;
        let times = if on_gpu { &mut self.trial.gpu } else { &mut self.trial.cpu };
        if times.len() < TRIED {
            times.push(time);
        }
        if self.trial.gpu.len() < TRIED && self.trial.steps < PATIENCE {
            return None;
        }
        let trial = std::mem::take(&mut self.trial);
        let cpu = trial.cpu.iter().min()?;
        let answer = trial.gpu.iter().min().filter(|_| trial.gpu.len() == TRIED);
        let faster = answer.is_some_and(|answer| answer < cpu);
        let before = self.made.replace(Made { on_gpu: faster, pairs, steps: 0 });
        if before.is_some_and(|before| before.on_gpu == faster) {
            return None;
        }
        let chosen = if faster { "GPU" } else { "CPU" };
        let time = answer.map_or_else(|| "too long".into(), |answer| format!("{answer:?}"));
        Some(format!(
            "medial meshes are culled on the {chosen}: for a step of {pairs} primitive pairs `{gpu}` takes {time}, the CPU {cpu:?}"
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PAIRS: usize = 1 << 20;

    /// Runs steps with these durations in microseconds on the CPU and on the GPU, if the GPU answers. Returns the number of steps on the GPU, and the log.
    fn run(choice: &mut Choice, steps: usize, pairs: usize, cpu: u64, gpu: Option<u64>) -> (usize, Vec<String>) {
        let (mut on_gpu, mut lines) = (0, Vec::new());
        for step in 0..steps {
            let answered = gpu.filter(|_| choice.is_gpu(pairs));
            // Only every eighth step is fast, as the first steps of a trial are slow.
            let time = Duration::from_micros(answered.unwrap_or(cpu) + if step % 8 < 7 { 100 } else { 0 });
            on_gpu += usize::from(answered.is_some());
            lines.extend(choice.note(answered.is_some(), pairs, time, "some GPU"));
        }
        (on_gpu, lines)
    }

    #[test]
    fn the_faster_one_is_chosen_and_told() {
        let mut choice = Choice::default();
        let (on_gpu, lines) = run(&mut choice, 100, PAIRS, 900, Some(300));
        assert_eq!(on_gpu, 100 - TRIED);
        assert_eq!(
            lines,
            [
                "medial meshes are culled on the GPU: for a step of 1048576 primitive pairs `some GPU` takes 300µs, the CPU 900µs"
            ]
        );
        let mut choice = Choice::default();
        let (on_gpu, lines) = run(&mut choice, 100, PAIRS, 300, Some(900));
        assert_eq!(on_gpu, TRIED);
        assert!(lines.len() == 1 && lines[0].starts_with("medial meshes are culled on the CPU:"), "{lines:?}");
    }

    #[test]
    fn small_scenes_are_not_tried() {
        let mut choice = Choice::default();
        assert_eq!(run(&mut choice, 100, LEAST_GPU_PAIRS - 1, 900, Some(300)), (0, Vec::new()));
    }

    #[test]
    fn both_are_tried_anew_where_things_have_changed() {
        let mut choice = Choice::default();
        run(&mut choice, 2 * TRIED, PAIRS, 300, Some(900));
        // The same choice again is not logged.
        let (on_gpu, lines) = run(&mut choice, HOLDS as usize + 2 * TRIED, PAIRS, 300, Some(900));
        assert_eq!((on_gpu, lines.len()), (TRIED, 0));
        let (on_gpu, lines) = run(&mut choice, 100, 4 * PAIRS, 900, Some(300));
        assert_eq!((on_gpu, lines.len()), (100 - TRIED, 1));
    }

    #[test]
    fn a_gpu_that_does_not_answer_is_the_slower_one() {
        let mut choice = Choice::default();
        let (_, lines) = run(&mut choice, 200, PAIRS, 900, None);
        assert_eq!(
            lines,
            [
                "medial meshes are culled on the CPU: for a step of 1048576 primitive pairs `some GPU` takes too long, the CPU 900µs"
            ]
        );
    }
}
