use glam::{DVec3, Vec3};

use super::*;
use crate::{
    medial_axis::{
        ma,
        oracle::{self, Envelope},
    },
    random::Random,
};

fn ball(x: f32, y: f32, z: f32, radius: f32) -> Sphere {
    Sphere::new(Vec3::new(x, y, z), radius)
}

/// Checks all guarantees of a clean-up, with `points` random points near the surface.
fn check(
    name: &str,
    spheres: Vec<Sphere>,
    primitives: Vec<Primitive>,
    points: u32,
    random: &mut Random,
) -> CleanupReport {
    let (clean_spheres, clean, report) = clean_up(spheres.clone(), primitives.clone());
    let mut all = primitives.clone();
    add_isolated_spheres(&spheres, &mut all, &mut CleanupReport::default());
    let before = Envelope::new(&spheres, &all);
    let after = Envelope::new(&clean_spheres, &clean);
    let size = before.size();
    for _ in 0..points {
        let point = before.point_near_surface(random);
        let error = (before.distance(point) - after.distance(point)).abs();
        assert!(error <= 1e-6 * size, "{name}: off by {error:e} of {size:e} at {point}; {spheres:?} {primitives:?}");
    }
    assert!(!clean.iter().any(|p| oracle::is_degenerate(&clean_spheres, p)), "{name}: {clean_spheres:?} {clean:?}");
    assert!(used(clean_spheres.len(), &clean).iter().all(|&used| used), "{name}");
    let edges: Vec<[u32; 2]> = clean
        .iter()
        .filter_map(|p| if let &Primitive::Slab([i, j, k]) = p { Some([[i, j], [j, k], [i, k]]) } else { None })
        .flatten()
        .collect();
    assert!(!clean.iter().any(|p| matches!(p, Primitive::Cone(e) if edges.contains(e))), "{name}");
    let (again_spheres, again, nothing) = clean_up(clean_spheres.clone(), clean.clone());
    assert!(nothing.is_empty(), "{name}: a second clean-up found {nothing}");
    assert_eq!((again_spheres, again), (clean_spheres, clean), "{name}");
    report
}

#[test]
fn models_keep_their_envelope() {
    let mut random = Random(2);
    let own = ["cow.ma", "deer.ma", "dinosaur.ma"];
    let research = [
        "dinosaur.ma",
        "bug.ma",
        "cactus.ma",
        "torus.ma",
        "qmat/armadillo_q97.ma",
        "qmat/bear_q61.ma",
        "qmat/bug_q44.ma",
        "qmat/cow_q82.ma",
        "qmat/dolphin_q58.ma",
        "qmat/spider_q48.ma",
        "qmat/stanford-bunny_q82.ma",
    ];
    for (index, path) in oracle::model_files(&own, &research).iter().enumerate() {
        let file = ma::parse(&std::fs::read(path).unwrap()).unwrap();
        let name = path.display().to_string();
        let (mut spheres, mut primitives) = (file.spheres.clone(), file.primitives());
        if index < own.len() {
            add_degenerate_primitives(&mut spheres, &mut primitives);
        }
        let degenerate = primitives.iter().filter(|p| oracle::is_degenerate(&spheres, p)).count();
        let report = check(&name, spheres, primitives, 10_000, &mut random);
        println!("{name}: {degenerate} degenerate; {report}");
        assert_eq!(degenerate > 0, report.degenerate_cones + report.degenerate_slabs > 0, "{name}");
        let must_be_degenerate = index < own.len() || path.ends_with("shared/models/dinosaur.ma");
        assert!(!must_be_degenerate || degenerate > 0, "{name}: the model has no degenerate primitives to test");
    }
}

/// Adds cones and slabs with spheres inside another sphere, because the project's files contain no degenerate primitive.
fn add_degenerate_primitives(spheres: &mut Vec<Sphere>, primitives: &mut Vec<Primitive>) {
    for (number, primitive) in primitives.clone().iter().enumerate().step_by(5) {
        let [i, j] = [primitive.indices()[0], primitive.indices()[1]];
        let outer = spheres[i as usize];
        let inner = spheres.len() as u32;
        spheres.push(Sphere::new(outer.center + Vec3::X * (0.3 * outer.radius), 0.5 * outer.radius));
        primitives.push(match number % 2 {
            0 => Primitive::Cone([i, inner]),
            _ => Primitive::Slab([i, j, inner]),
        });
    }
}

#[test]
fn generated_hard_cases_keep_their_envelope() {
    let mut random = Random(3);
    let mut sum = [0; 4];
    for case in 0..6_000 {
        let spheres = oracle::hard_slab(&mut random, case % oracle::HARD_KINDS).to_vec();
        let report = check("hard slab", spheres, vec![Primitive::Slab([0, 1, 2])], 50, &mut random);
        let kept = if report.degenerate_slabs > 0 { 1 } else { 0 };
        sum[kept] += 1;
        sum[2] += usize::from(report.unused_spheres == 1);
        sum[3] += usize::from(report.unused_spheres == 2);
    }
    // Counts: kept slabs, simplified slabs, slabs that became one cone, slabs that became one sphere. The other simplified slabs became two cones.
    println!("{sum:?}");
    assert!(sum[0] > 500 && sum[2] > 500 && sum[3] > 100 && sum[1] > sum[2] + sum[3] + 500, "{sum:?}");
}

#[test]
fn random_soups_keep_their_envelope() {
    let mut random = Random(4);
    let mut sum = CleanupReport::default();
    for _ in 0..300 {
        // Coordinates from a small grid make coincidences, containment and lines frequent.
        let count = 3 + random.below(10);
        let mut grid = |n: usize| random.below(n) as f32 * 0.5;
        let spheres: Vec<_> = (0..count).map(|_| ball(grid(5), grid(3), grid(2), grid(4))).collect();
        let mut index = || random.below(count) as u32;
        let primitives: Vec<_> = (0..count)
            .flat_map(|_| [Primitive::Slab([(); 3].map(|()| index())), Primitive::Cone([(); 2].map(|()| index()))])
            .skip(3)
            .collect();
        let report = check("soup", spheres, primitives, 100, &mut random);
        sum.isolated_spheres += report.isolated_spheres;
        sum.duplicate_spheres += report.duplicate_spheres;
        sum.degenerate_cones += report.degenerate_cones;
        sum.degenerate_slabs += report.degenerate_slabs;
        sum.duplicate_primitives += report.duplicate_primitives;
        sum.covered_spheres += report.covered_spheres;
        sum.covered_cones += report.covered_cones;
        sum.covered_slabs += report.covered_slabs;
        sum.unused_spheres += report.unused_spheres;
    }
    println!("{sum}");
    assert_eq!(sum.to_string().split(", ").count(), 9, "some kind of change did not occur: {sum}");
}

#[test]
fn simplified_slab_is_the_union_of_its_parts() {
    // Compares the distance field of a slab, sampled without any closed form, with the field of its parts.
    let mut random = Random(5);
    let mut parts_seen = [0; 3];
    for case in 0..600 {
        let spheres = oracle::hard_slab(&mut random, case % oracle::HARD_KINDS);
        let slab = Envelope::new(&spheres, &[Primitive::Slab([0, 1, 2])]);
        let parts: Vec<_> = Primitive::Slab([0, 1, 2]).simplified(&spheres).iter().copied().collect();
        parts_seen[parts.len()] += 1;
        let union = Envelope::new(&spheres, &parts);
        for _ in 0..4 {
            let point = slab.point_near_surface(&mut random);
            let (truth, found) = (oracle::searched_distance(&spheres, point), union.distance(point));
            let size = slab.size();
            assert!((truth - found).abs() < 2e-7 * size, "{truth} {found} {spheres:?} {parts:?} {point}");
        }
    }
    assert!(parts_seen[0] == 0 && parts_seen[1] > 50 && parts_seen[2] > 50, "{parts_seen:?}");
}

#[test]
fn a_bulging_middle_sphere_leaves_two_cones() {
    let spheres = vec![ball(-2.0, 0.0, 0.0, 0.5), ball(0.0, 0.1, 0.0, 1.0), ball(2.0, 0.0, 0.0, 0.6)];
    let (_, primitives, report) = clean_up(spheres.clone(), vec![Primitive::Slab([0, 1, 2])]);
    assert_eq!(primitives, [Primitive::Cone([0, 1]), Primitive::Cone([1, 2])]);
    assert_eq!(report, CleanupReport { degenerate_slabs: 1, ..Default::default() });
    // The single cone of the two larger spheres would lose the smallest sphere.
    let kept = Envelope::new(&spheres, &[Primitive::Cone([1, 2])]);
    assert!(kept.distance(DVec3::new(-2.4, 0.0, 0.0)) > 1.0);
}

#[test]
fn of_spheres_that_touch_from_inside_the_outer_stays() {
    // The inner ball's surface touches the outer's at one side, along each axis in turn.
    for axis in [Vec3::X, Vec3::Y, Vec3::Z, -Vec3::X] {
        let spheres = vec![Sphere::new(axis, 1.0), Sphere::new(Vec3::ZERO, 2.0), Sphere::new(axis, 1.0)];
        let (kept, primitives, report) = clean_up(spheres, vec![]);
        assert_eq!((kept, primitives), (vec![ball(0.0, 0.0, 0.0, 2.0)], vec![Primitive::Sphere([0])]));
        assert_eq!(
            report.to_string(),
            "isolated spheres made primitives: 3, duplicate spheres merged: 1, duplicate primitives dropped: 1, \
             covered spheres dropped: 1, unused spheres dropped: 1"
        );
    }
}
