//! The kernels against a reference in f64 of another make, on random pairs of every category and kind.

mod pairs;
mod reference;

use std::{
    sync::{
        Mutex,
        atomic::{AtomicUsize, Ordering},
    },
    time::Instant,
};

use bevy_medial::query::{TimeOfImpact, TimeOfImpactStatus, alternating, time_of_impact};
use pairs::{CATEGORIES, KINDS, Pair, Random, Truth, Verdict, judge, kind_name, random_pair};

/// Runs `task` for every category and kind on all cores; results in order.
fn for_each_case<T: Send>(task: impl Fn(usize, usize) -> T + Sync) -> Vec<T> {
    let count = CATEGORIES.len() * KINDS.len();
    let next = AtomicUsize::new(0);
    let results: Mutex<Vec<(usize, T)>> = Mutex::new(Vec::new());
    let threads = std::thread::available_parallelism().map_or(2, Into::into);
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                loop {
                    let case = next.fetch_add(1, Ordering::Relaxed);
                    if case >= count {
                        break;
                    }
                    let result = task(case / KINDS.len(), case % KINDS.len());
                    results.lock().unwrap().push((case, result));
                }
            });
        }
    });
    let mut results = results.into_inner().unwrap();
    results.sort_by_key(|result| result.0);
    results.into_iter().map(|result| result.1).collect()
}

/// How often each truth was met, and each verdict given.
#[derive(Default)]
struct Score {
    truths: [usize; 3],
    verdicts: [usize; 7],
    failures: Vec<(Pair, TimeOfImpact, Verdict)>,
}

impl Score {
    fn of(category: usize, kind: usize, pairs: usize, kernel: impl Fn(&Pair) -> TimeOfImpact) -> Self {
        let mut score = Score::default();
        let seed: u64 = std::env::var("SEED").ok().and_then(|s| s.parse().ok()).unwrap_or(0);
        let mut random = Random(((seed * 13 + category as u64) * 8 + kind as u64) << 32);
        for _ in 0..pairs {
            let pair = random_pair(&mut random, category, KINDS[kind]);
            let answer = kernel(&pair);
            let (truth, verdict) = judge(&pair, &answer);
            score.truths[truth as usize] += 1;
            score.verdicts[verdict as usize] += 1;
            if verdict != Verdict::Good && score.failures.len() < 3 {
                score.failures.push((pair, answer, verdict));
            }
        }
        score
    }
}

fn advancement(pair: &Pair) -> TimeOfImpact {
    let (first, second) = pair.relative();
    for_kinds!(first, second, |a, b| hulls: time_of_impact(&a, &b, 1.0), cuboid: time_of_impact(&a, &b, 1.0))
}

#[test]
fn time_of_impact_agrees_with_reference() {
    let start = Instant::now();
    let pairs: usize = std::env::var("PAIRS").ok().and_then(|s| s.parse().ok()).unwrap_or(9_700);
    let scores = for_each_case(|category, kind| Score::of(category, kind, pairs, advancement));
    let mut total = [0; 7];
    for (case, score) in scores.iter().enumerate() {
        println!("{:16} {:12} {:?} {:?}", CATEGORIES[case / 8], kind_name(KINDS[case % 8]), score.truths, score.verdicts);
        for k in 0..7 { total[k] += score.verdicts[k]; }
    }
    for score in &scores {
        for (pair, answer, verdict) in &score.failures {
            println!("{pair} # {verdict:?} {:?} {} {}", answer.status, answer.fraction, answer.rounds);
        }
    }
    println!("{total:?} {:?}", start.elapsed());
}
#[test]
fn gapstat() {
    let mut random = Random(5);
    let mut hist = vec![0; 20];
    let mut n=0;
    let start=Instant::now();
    let mut bad=0;
    for i in 0..104*300 {
        let pair = random_pair(&mut random, i%13, KINDS[(i/13)%8]);
        let d = pair.difference();
        let t=random.range(0.0,1.0);
        let at=d.at(t);
        let (size,_)=pair.size_and_speed();
        let b = at.distance();
        let g=(b.upper-b.lower)/size;
        let h = (-g.max(1e-19).log10()) as usize;
        hist[h.min(19)]+=1; n+=1;
        if h<9 && bad<12 { bad+=1; println!("{} {:?} {g:e} {b:?}", CATEGORIES[i%13], KINDS[(i/13)%8]);  }
    }
    println!("{hist:?} {:?}", start.elapsed()/n);
}
#[derive(Default, Clone, Debug)]
struct Worst([(f64, String); 8]);
impl Worst { fn put(&mut self, k: usize, v: f64, what: impl Fn()->String) { if !(v <= self.0[k].0) { self.0[k] = (v, what()); } } }
use bevy_medial::{query::{Convex, MovingConvex, Cuboid, separation}, geometry::Sphere};
use reference::{Ball, Difference};
fn balls(s: &[Sphere]) -> Vec<Ball> { s.iter().map(|s| Ball { center: s.center.as_dvec3(), radius: s.radius.into(), ..Ball::default() }).collect() }
fn check<const N: usize, B: Convex + std::fmt::Debug>(worst: &mut Worst, a: &[Sphere; N], b: &B, second: &[Ball], random: &mut Random, n: usize) {
    let hint = if random.chance(0.5) { 0 } else { random.below(b.features::<N>()) };
    let got = separation(a, b, hint);
    let first = balls(a);
    let difference = Difference::new(&first, second);
    let want = difference.distance();
    let scale = f64::from(a.extent().max(b.extent())) + first.iter().chain(second).map(|b| b.center.length()).fold(0.0, f64::max);
    let d = f64::from(got.distance);
    let nn = got.normal.as_dvec3();
    let crossing = want.normal.length() < 0.999;
    let what = || format!("{a:?} {b:?} {hint} {got:?} {want:?}");
    worst.put(0, (difference.gap(nn) - d).abs() / scale, what);
    worst.put(1, (nn.length() - 1.0).abs(), what);
    worst.put(2, (got.point2.as_dvec3() - got.point1.as_dvec3() - nn * d).length() / scale, what);
    if crossing {
        if n % 8 == 0 && std::env::var("DEPTH").is_ok() {
            let depth = difference.depth(2000).0;
            worst.put(3, (d - depth) / scale, what);
            worst.put(4, (depth - d) / -depth, what);
        }
    } else {
        worst.put(7, (want.upper - want.lower)/scale, what);
        worst.put(5, (d - want.lower).abs() / scale, what);
        for (p, side) in [(got.point1, &first[..]), (got.point2, second)] {
            let off = Difference::new(&[Ball { center: p.as_dvec3(), ..Ball::default() }], side).distance().lower;
            worst.put(6, off.abs() / scale, || format!("{p:?} {side:?} {:?} {}", Difference::new(&[Ball { center: p.as_dvec3(), ..Ball::default() }], side).distance(), what()));
        }
    }
}
#[test]
fn sepstat() {
    let start=Instant::now();
    let r = for_each_case(|category, kind| {
        let mut worst = Worst::default();
        let mut random = Random(((77 * 13 + category as u64) * 8 + kind as u64) << 32);
        for n in 0..2000 {
            let pair = random_pair(&mut random, category, KINDS[kind]);
            let toi = advancement(&pair);
            let t = if toi.status == TimeOfImpactStatus::Hit && random.chance(0.5) { toi.fraction } else { random.range(0.0, 1.0) as f32 };
            let (a, b) = pair.relative();
            for_kinds!(a, b, |a, b| hulls: check(&mut worst, &a.at(t), &b.at(t), &balls(&b.at(t)), &mut random, n),
              cuboid: check(&mut worst, &a.at(t), &b, &pairs::corners(b.half.as_dvec3(), glam::DVec3::ZERO, glam::DQuat::IDENTITY), &mut random, n));
        }
        worst
    });
    for (i, w) in r.iter().enumerate() { println!("{:16} {:12} {:?}", CATEGORIES[i/8], kind_name(KINDS[i%8]), w.0.clone().map(|x| format!("{:.1e}", x.0))); }
    for k in [0,2,3,4,5,6,7] { let m = r.iter().map(|w| &w.0[k]).max_by(|a,b| a.0.total_cmp(&b.0)).unwrap(); println!("{k} {m:?}"); }
    for cat in [3,4,10] { for kind in 0..8 { let w = &r[cat*8+kind].0[2]; if w.0 > 1e-5 {println!("== {} {w:?}", CATEGORIES[cat]); }}}
    println!("{:?}", start.elapsed());
}
