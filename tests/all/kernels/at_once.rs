//! The batch kernel compared with the reference, with the kernel for single pairs, and with itself on other batches.

use bevy_medial::{
    geometry::Sphere,
    query::{Moving, MovingPair, TimeOfImpactStatus, Touch, time_of_impact, times_of_impact},
    random::Random,
};
use glam::Vec3;

use super::{advancement, one_by_one};
use crate::{
    pairs::{CATEGORIES, KINDS, Pair, Verdict, judge, random_pair},
    score::{Score, assert_all_good, for_each_case, setting},
};

/// Kinds without boxes come first.
const HULLS: usize = 5;

/// A computation on pairs in the form that the kernel takes.
trait Task {
    type Output;

    fn run<const N: usize, const M: usize>(self, pairs: &[MovingPair<N, M>]) -> Self::Output;
}

/// Runs a task for pairs of one kind.
fn typed<T: Task>(kind: usize, pairs: &[Pair], task: T) -> T::Output {
    fn run<const N: usize, const M: usize, T: Task>(pairs: &[Pair], task: T) -> T::Output {
        let moving = |spheres: (&[Sphere], &[Vec3])| (spheres.0.to_vec(), spheres.1.to_vec());
        let typed: Vec<MovingPair<N, M>> = pairs
            .iter()
            .map(|pair| {
                let (first, second) = pair.relative();
                let [first, second] = for_kinds!(first, second, |a, b|
                    hulls: [moving((&a.start, &a.motion)), moving((&b.start, &b.motion))],
                    cuboid: unreachable!("{a:?} {b:?}"));
                let wrong = "a pair of another kind";
                (
                    Moving { start: first.0.try_into().expect(wrong), motion: first.1.try_into().expect(wrong) },
                    Moving { start: second.0.try_into().expect(wrong), motion: second.1.try_into().expect(wrong) },
                )
            })
            .collect();
        task.run(&typed)
    }
    match KINDS[kind] {
        (1, 2) => run::<1, 2, T>(pairs, task),
        (1, 3) => run::<1, 3, T>(pairs, task),
        (2, 2) => run::<2, 2, T>(pairs, task),
        (2, 3) => run::<2, 3, T>(pairs, task),
        (3, 3) => run::<3, 3, T>(pairs, task),
        kind => unreachable!("{kind:?}"),
    }
}

/// Runs the batch kernel until a fraction of the step.
struct AtOnce(f32);

impl Task for AtOnce {
    type Output = Vec<Touch>;

    fn run<const N: usize, const M: usize>(self, pairs: &[MovingPair<N, M>]) -> Vec<Touch> {
        times_of_impact(pairs, self.0)
    }
}

#[test]
fn times_of_impact_agree_with_reference() {
    check_times_of_impact(setting("KERNEL_PAIRS", 1_000));
}

#[test]
#[ignore = "exhaustive"]
fn exhaustive_times_of_impact_agree_with_reference() {
    check_times_of_impact(setting("KERNEL_PAIRS", 9_700));
}

fn check_times_of_impact(pairs: u64) {
    let scores = for_each_case(4, |category, kind, random| {
        if kind < HULLS {
            Score::of(category, kind, random, pairs, |pairs| typed(kind, pairs, AtOnce(1.0)))
        } else {
            Score::default()
        }
    });
    assert_all_good(&scores, pairs, HULLS);
}

/// Nearly all answers agree within the tolerance for late answers. The other pairs graze, and both answers are good.
#[test]
fn batches_agree_with_single_pairs() {
    let pairs = setting("KERNEL_PAIRS", 2_000);
    let differing = for_each_case(5, |category, kind, mut random| {
        if kind >= HULLS {
            return 0;
        }
        let pairs: Vec<Pair> = (0..pairs).map(|_| random_pair(&mut random, category, KINDS[kind])).collect();
        let answers = typed(kind, &pairs, AtOnce(1.0)).into_iter().zip(one_by_one(advancement)(&pairs));
        let mut differing = 0;
        for (pair, (many, single)) in pairs.iter().zip(answers) {
            let (size, speed) = pair.size_and_speed();
            let tolerance = 1e-4 * size / speed + 1e-6;
            let hits = many.status != TimeOfImpactStatus::Separated;
            if many.status != single.status || hits && f64::from((many.fraction - single.fraction).abs()) > tolerance {
                differing += 1;
                let verdicts = [&many, &single].map(|answer| judge(pair, answer).1);
                assert_eq!(verdicts, [Verdict::Good; 2], "{pair}: {many:?} {single:?}");
            }
        }
        differing
    });
    let (differing, all) = (differing.iter().sum::<usize>(), pairs as usize * CATEGORIES.len() * HULLS);
    println!("{differing} of {all} differ from the kernel for single pairs");
    assert!(differing * 200 < all, "{differing} of {all}");
}

/// A search with an earlier end finds the touches before that end and no others. Few answers differ: those of grazes and of touches at the end.
#[test]
fn touches_before_an_earlier_end_are_found() {
    let pairs = setting("KERNEL_PAIRS", 2_000) as usize;
    let (mut hit, mut apart, mut differing) = (0, 0, 0);
    for (kind, spheres) in KINDS.into_iter().enumerate().take(HULLS) {
        let mut random = Random(100 + kind as u64);
        let pairs: Vec<Pair> = (0..pairs).map(|i| random_pair(&mut random, i % CATEGORIES.len(), spheres)).collect();
        let whole = typed(kind, &pairs, AtOnce(1.0));
        for end in [0.0, 0.25, 0.5] {
            for ((pair, whole), part) in pairs.iter().zip(&whole).zip(typed(kind, &pairs, AtOnce(end))) {
                let (size, speed) = pair.size_and_speed();
                let near = |a: f32, b: f32| f64::from((a - b).abs()) <= 1e-4 * size / speed + 1e-6;
                let [whole_hits, part_hits] = [whole, &part].map(|t| t.status != TimeOfImpactStatus::Separated);
                assert!(if part_hits { part.fraction <= end } else { part.fraction == end }, "{part:?} until {end}");
                if part_hits {
                    hit += 1;
                    if !(whole_hits && near(part.fraction, whole.fraction)) {
                        differing += 1;
                        assert_eq!(judge(pair, &part).1, Verdict::Good, "{pair}: {part:?} of {whole:?}");
                    }
                } else if whole_hits && whole.fraction <= end {
                    differing += 1;
                    let none = Touch { fraction: 1.0, ..part };
                    let graze = judge(pair, &none).1 == Verdict::Good;
                    assert!(graze || near(whole.fraction, end), "{pair}: {part:?} of {whole:?}");
                } else {
                    apart += 1;
                }
            }
        }
    }
    println!("{hit} hit, {apart} do not, {differing} differ from the search over the whole step");
    assert!(hit > 1000 && apart > 1000 && differing * 200 < hit + apart, "{hit}, {apart}, {differing}");
}

/// Runs pairs in several orders and batch sizes.
struct Regrouped(Random);

impl Task for Regrouped {
    type Output = ();

    fn run<const N: usize, const M: usize>(mut self, pairs: &[MovingPair<N, M>]) {
        let bits = |touch: &Touch| (touch.status, touch.fraction.to_bits());
        let expected: Vec<_> = times_of_impact(pairs, 1.0).iter().map(bits).collect();
        for size in [1, 3, 16, 17] {
            let found: Vec<_> = pairs.chunks(size).flat_map(|pairs| times_of_impact(pairs, 1.0)).collect();
            assert_eq!(found.iter().map(bits).collect::<Vec<_>>(), expected, "{size} at a time");
        }
        let mut order: Vec<usize> = (0..pairs.len()).collect();
        for _ in 0..4 {
            for i in (1..order.len()).rev() {
                order.swap(i, self.0.below(i + 1));
            }
            let shuffled: Vec<_> = order.iter().map(|&i| pairs[i]).collect();
            for (&i, touch) in order.iter().zip(times_of_impact(&shuffled, 1.0)) {
                assert_eq!(bits(&touch), expected[i], "in another order");
            }
        }
    }
}

#[test]
fn batch_size_and_order_do_not_change_answers() {
    let pairs = setting("KERNEL_PAIRS", 2_000) as usize;
    for (kind, spheres) in KINDS.into_iter().enumerate().take(HULLS) {
        let mut random = Random(kind as u64);
        let pairs: Vec<Pair> = (0..pairs).map(|i| random_pair(&mut random, i % CATEGORIES.len(), spheres)).collect();
        typed(kind, &pairs, Regrouped(random));
    }
}

fn sphere(x: f32, radius: f32, motion: f32) -> Moving<1> {
    Moving { start: [Sphere::new(Vec3::X * x, radius)], motion: [Vec3::X * motion] }
}

#[test]
fn spheres_touch_at_the_exact_time() {
    assert_eq!(times_of_impact::<1, 1>(&[], 1.0), []);
    let pairs: Vec<_> = (0..100).map(|i| (sphere(0.0, 0.5, 1.0), sphere(1.0 + 0.05 * i as f32, 0.25, -1.0))).collect();
    for (i, touch) in times_of_impact(&pairs, 1.0).iter().enumerate() {
        let expected = (0.25 + 0.05 * i as f32) / 2.0;
        if expected <= 1.0 {
            assert_eq!(touch.status, TimeOfImpactStatus::Hit, "{i}");
            assert!((touch.fraction - expected).abs() < 1e-5, "{touch:?}, expected {expected}");
        } else {
            assert_eq!(*touch, Touch { status: TimeOfImpactStatus::Separated, fraction: 1.0 }, "{i}");
        }
        let until = times_of_impact(&pairs[i..=i], 0.5)[0];
        assert_eq!(until.status == TimeOfImpactStatus::Hit, expected <= 0.5, "{i}");
    }
}

/// Pairs with invalid numbers do not change the answers of other pairs.
#[test]
fn invalid_pairs_do_not_change_other_answers() {
    let good = (sphere(0.0, 0.5, 1.0), sphere(1.5, 0.5, -1.0));
    let broken =
        [f32::NAN, f32::INFINITY, -f32::INFINITY, f32::MAX].map(|x| (sphere(0.0, 0.5, 1.0), sphere(x, 0.5, x)));
    let pairs: Vec<_> = broken.into_iter().flat_map(|broken| [broken, good]).collect();
    let alone = times_of_impact(&[good], 1.0)[0];
    assert_eq!(alone.status, TimeOfImpactStatus::Hit);
    assert!(times_of_impact(&pairs, 1.0).iter().skip(1).step_by(2).all(|touch| *touch == alone));
}

fn moving<const N: usize>(spheres: [[f32; 7]; N]) -> Moving<N> {
    Moving {
        start: spheres.map(|[x, y, z, radius, ..]| Sphere::new(Vec3::new(x, y, z), radius)),
        motion: spheres.map(|[.., x, y, z]| Vec3::new(x, y, z)),
    }
}

/// The cone grows during its motion. The tolerance for rounding follows its size at the start, wherever the search continues.
#[test]
fn a_growing_cone_is_not_hit_early() {
    let ball = moving([[-0.06986772, 0.055131763, -0.1585026, 0.07863786, 0.2006373, 0.017922811, 0.15733033]]);
    let cone = moving([
        [0.3831666, 0.09043917, 0.12956569, 0.05472606, -0.21996316, 0.44477, 0.10403721],
        [0.37323847, 0.10492098, 0.140525, 0.028565371, -0.64904517, -0.26999542, -0.21687496],
    ]);
    let single = time_of_impact(&ball, &cone, 1.0);
    let single = Touch { status: single.status, fraction: single.fraction };
    for touch in [single, times_of_impact(&[(ball, cone)], 1.0)[0]] {
        assert_eq!(touch.status, TimeOfImpactStatus::Hit);
        assert!((touch.fraction - 0.6626555).abs() < 1e-4, "{touch:?}");
    }
}
