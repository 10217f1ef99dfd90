//! Scores of answers for random pairs of every category and kind, as a table.

use std::sync::{
    Mutex,
    atomic::{AtomicUsize, Ordering},
};

use bevy_medial::{
    query::{TimeOfImpactStatus, Touch},
    random::Random,
};

use crate::pairs::{CATEGORIES, KINDS, Pair, Verdict, judge, kind_name, random_pair};

/// A number from the environment, or else `default`. Unoptimised builds divide the default by 20.
pub fn setting(name: &str, default: u64) -> u64 {
    let default = if cfg!(debug_assertions) { default.div_ceil(20) } else { default };
    std::env::var(name).map_or(default, |text| text.parse().expect(name))
}

/// Runs `task` for every category and kind on all cores. Each case has its own random numbers; the results are in order of the cases.
pub fn for_each_case<T: Send>(stream: u64, task: impl Fn(usize, usize, Random) -> T + Sync) -> Vec<T> {
    let seed = setting("KERNEL_SEED", 0);
    let count = CATEGORIES.len() * KINDS.len();
    let next = AtomicUsize::new(0);
    let results = Mutex::new(Vec::new());
    let threads = std::thread::available_parallelism().map_or(2, Into::into);
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                loop {
                    let case = next.fetch_add(1, Ordering::Relaxed);
                    if case >= count {
                        break;
                    }
                    let random = Random((seed << 40) ^ (stream << 32) ^ ((case as u64) << 48));
                    let result = task(case / KINDS.len(), case % KINDS.len(), random);
                    results.lock().unwrap().push((case, result));
                }
            });
        }
    });
    let mut results = results.into_inner().unwrap();
    results.sort_by_key(|(case, _)| *case);
    results.into_iter().map(|(_, result)| result).collect()
}

/// Counts of truths and verdicts, and up to five wrong answers.
#[derive(Default)]
pub struct Score {
    pub truths: [usize; 3],
    pub verdicts: [usize; 7],
    pub gave_up: usize,
    failures: Vec<(Pair, Touch, Verdict)>,
}

impl Score {
    pub fn of(
        category: usize,
        kind: usize,
        mut random: Random,
        pairs: u64,
        kernel: impl Fn(&[Pair]) -> Vec<Touch>,
    ) -> Self {
        let mut score = Score::default();
        let pairs: Vec<Pair> = (0..pairs).map(|_| random_pair(&mut random, category, KINDS[kind])).collect();
        let answers = kernel(&pairs);
        assert_eq!(answers.len(), pairs.len());
        for (pair, answer) in pairs.into_iter().zip(answers) {
            let (truth, verdict) = judge(&pair, &answer);
            score.truths[truth as usize] += 1;
            score.verdicts[verdict as usize] += 1;
            score.gave_up += usize::from(answer.status == TimeOfImpactStatus::IterationLimit);
            if verdict != Verdict::Good && score.failures.len() < 5 {
                score.failures.push((pair, answer, verdict));
            }
        }
        score
    }
}

/// Prints the table and returns the counts of verdicts over all cases.
pub fn summary(scores: &[Score]) -> [usize; 7] {
    println!(
        "{:16} {:12} {:>8} {:>8} {:>8} | {:>7} {:>7} {:>7} {:>7} {:>7} {:>7} | {:>7}",
        "category",
        "kind",
        "overlap",
        "hit",
        "apart",
        "missed",
        "late",
        "early",
        "false",
        "overlap",
        "invalid",
        "gave up"
    );
    let row = |category: &str, kind: &str, truths: [usize; 3], v: [usize; 7], gave_up: usize| {
        println!(
            "{category:16} {kind:12} {:8} {:8} {:8} | {:7} {:7} {:7} {:7} {:7} {:7} | {gave_up:7}",
            truths[0], truths[1], truths[2], v[1], v[2], v[3], v[4], v[5], v[6]
        );
    };
    let (mut truths, mut verdicts, mut gave_up) = ([0; 3], [0; 7], 0);
    for (case, score) in scores.iter().enumerate() {
        let (category, kind) = (CATEGORIES[case / KINDS.len()], kind_name(KINDS[case % KINDS.len()]));
        row(category, &kind, score.truths, score.verdicts, score.gave_up);
        truths.iter_mut().zip(score.truths).for_each(|(total, count)| *total += count);
        verdicts.iter_mut().zip(score.verdicts).for_each(|(total, count)| *total += count);
        gave_up += score.gave_up;
    }
    row("total", "", truths, verdicts, gave_up);
    verdicts
}

/// Asserts that no answer is wrong, and that each case has enough pairs that touch and enough that stay apart.
pub fn assert_all_good(scores: &[Score], pairs: u64, kinds: usize) {
    let verdicts = summary(scores);
    for (pair, answer, verdict) in scores.iter().flat_map(|score| &score.failures) {
        println!("{pair} # {verdict:?}: {:?} {}", answer.status, answer.fraction);
    }
    for (case, score) in scores.iter().enumerate().filter(|(case, _)| case % KINDS.len() < kinds) {
        let (category, kind) = (CATEGORIES[case / KINDS.len()], kind_name(KINDS[case % KINDS.len()]));
        let enough = pairs as usize / 50;
        let [overlaps, hits, apart] = score.truths;
        assert!(apart >= enough, "{category} {kind}: only {apart} pairs stay apart");
        let reached = if category == "separating" { overlaps + hits } else { hits };
        assert!(reached >= enough / 2, "{category} {kind}: only {reached} pairs touch");
    }
    assert_eq!(verdicts[1..], [0; 6], "missed, late, early, false alarms, overlaps missed, invalid");
}
