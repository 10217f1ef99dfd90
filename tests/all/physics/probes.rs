//! Rays and point projections on medial shapes, compared with f64 distances.

use std::cell::Cell;

use bevy_medial::{pipeline::Shape, rapier::MedialShape};
use bevy_rapier3d::parry::query::{PointQuery, Ray, RayCast};
use glam::{DVec3, Vec3};

use crate::{
    common::*,
    random_steps,
    reference::{Ball, Difference},
};

/// Allowed deviation, in bounding radii.
const ACCURACY: f64 = 1e-4;

/// A shape in f64.
struct Exact {
    primitives: Vec<Vec<Ball>>,
    size: f64,
}

impl Exact {
    fn new(shape: &Shape) -> Self {
        let spheres = shape.axis.spheres();
        let ball = |&i: &u32| {
            let sphere = spheres[i as usize].scaled(shape.scale);
            Ball { center: sphere.center.as_dvec3(), radius: sphere.radius.into(), motion: DVec3::ZERO }
        };
        Self {
            primitives: shape.axis.primitives().iter().map(|p| p.indices().iter().map(ball).collect()).collect(),
            size: shape.bounding_sphere().radius.into(),
        }
    }

    /// Distance to the nearest primitive. Inside the shape it is any negative number.
    fn distance(&self, point: DVec3) -> f64 {
        let point = [Ball { center: point, ..Ball::default() }];
        let distances = self.primitives.iter().map(|balls| Difference::new(balls, &point).distance().upper);
        distances.fold(f64::INFINITY, f64::min)
    }

    /// Time of the first touch of a ray.
    fn enter(&self, origin: DVec3, direction: DVec3, max_time: f64) -> Option<f64> {
        let ray = [Ball { center: origin, radius: 0.0, motion: direction * max_time }];
        let times = self.primitives.iter().filter_map(|balls| {
            Difference::new(balls, &ray).first_within(0.0, self.size).map(|fraction| fraction * max_time)
        });
        times.min_by(f64::total_cmp)
    }
}

fn shapes() -> Vec<Shape> {
    let models = ["bear", "torus", "spider"].map(model);
    let all = random_steps::shapes().iter().cloned().chain(models);
    all.enumerate().map(|(i, axis)| Shape { axis, scale: [1.0, 0.4, 2.5][i % 3] }).collect()
}

fn medial(shape: &Shape) -> MedialShape {
    MedialShape::new(shape.clone(), 0)
}

#[test]
fn rays_enter_and_leave_the_union() {
    let mut random = Random(1);
    let [mut hits, mut misses, mut cut, mut inside, mut passed, mut wrong] = [0; 6];
    for shape in shapes() {
        let (exact, medial) = (Exact::new(&shape), medial(&shape));
        let bound = shape.bounding_sphere();
        for _ in 0..150 {
            let reach = [0.6, 1.5, 30.0][random.below(3)] * bound.radius;
            let origin = bound.center + random.in_ball() * reach;
            let target = bound.center + random.in_ball() * bound.radius;
            let direction = (target - origin) * (0.2 + random.unit());
            let max_time = 8.0;
            let ray = Ray::new(origin, direction);
            let speed = f64::from(direction.length());
            let at = |time: f64| origin.as_dvec3() + direction.as_dvec3() * time;
            let tolerance = ACCURACY * exact.size + 4e-7 * f64::from(reach);

            let solid = medial.cast_local_ray_and_get_normal(&ray, max_time, true);
            let truth = exact.enter(at(0.0), direction.as_dvec3(), max_time.into());
            match (solid, truth) {
                (None, None) => misses += 1,
                // A grazing ray may miss.
                (None, Some(time)) => {
                    let sunk =
                        (1..50).any(|i| exact.distance(at(time + f64::from(i) * tolerance / speed)) < -tolerance);
                    wrong += usize::from(sunk);
                }
                (Some(hit), _) => {
                    let time = f64::from(hit.time_of_impact);
                    hits += 1;
                    let off = exact.distance(at(time));
                    if time > 0.0 {
                        assert!(off.abs() < tolerance, "off the surface by {off}");
                    } else {
                        assert!(off < tolerance, "off the shape by {off}");
                    }
                    if let Some(truth) = truth {
                        // Along a grazing ray the time is less accurate than the point.
                        let early = exact.distance(at(truth - 20.0 * tolerance / speed));
                        assert!(time <= truth + tolerance / speed || exact.distance(at(truth)) > -tolerance);
                        assert!(time >= truth - 20.0 * tolerance / speed || early < tolerance);
                    }
                    assert!((hit.normal.length() - 1.0).abs() < 1e-3, "{}", hit.normal);
                    if time > 0.0 {
                        assert!(hit.normal.dot(direction) <= 1e-3 * direction.length());
                        let half = medial.cast_local_ray_and_get_normal(&ray, hit.time_of_impact * 0.5, true);
                        assert!(half.is_none(), "a hit beyond the end");
                        cut += 1;
                    }
                }
            }

            let hollow = medial.cast_local_ray_and_get_normal(&ray, max_time, false);
            if !solid.is_some_and(|hit| hit.time_of_impact == 0.0) {
                assert_eq!(hollow.map(|hit| hit.time_of_impact), solid.map(|hit| hit.time_of_impact));
                continue;
            }
            inside += 1;
            let Some(exit) = hollow else {
                assert!(exact.distance(at(f64::from(max_time))) < tolerance, "no exit");
                continue;
            };
            let time = f64::from(exit.time_of_impact);
            assert!(exact.distance(at(time)).abs() < tolerance, "{} off at the exit", exact.distance(at(time)));
            assert!(exit.normal.dot(direction) <= 1e-3 * direction.length(), "the normal does not face the ray");
            let beyond = exact.distance(at(time + 5.0 * tolerance / speed));
            assert!(beyond > -tolerance, "{beyond} inside behind the exit");
            for i in 1..40 {
                let before = exact.distance(at(time * f64::from(i) / 40.0));
                assert!(before < tolerance, "outside by {before} before the exit");
            }
            let first = shape.axis.primitives().iter().enumerate().filter_map(|(i, _)| {
                let part = Exact { primitives: vec![exact.primitives[i].clone()], size: exact.size };
                (part.distance(at(0.0)) < 0.0 && part.distance(at(time)) > tolerance).then_some(())
            });
            passed += usize::from(first.count() > 0);
        }
    }
    println!("{hits} hits, {misses} misses, {inside} from inside, {passed} through more than one primitive");
    assert_eq!(wrong, 0);
    assert!(
        hits > 400 && misses > 150 && cut > 200 && inside > 100 && passed > 30,
        "{hits} {misses} {cut} {inside} {passed}"
    );
}

#[test]
fn invalid_rays_hit_nothing() {
    let medial = medial(&Shape::new(model("bear")));
    let hit = |origin, direction, max| medial.cast_local_ray_and_get_normal(&Ray::new(origin, direction), max, false);
    let outside = Vec3::X * 20.0;
    assert!(hit(outside, Vec3::ZERO, f32::MAX).is_none());
    assert!(hit(Vec3::NAN, Vec3::X, f32::MAX).is_none());
    assert!(hit(outside, Vec3::NAN, f32::MAX).is_none());
    assert!(hit(outside, -Vec3::X, -1.0).is_none());
    assert!(hit(outside, Vec3::X, f32::INFINITY).is_none());
}

#[test]
fn points_find_the_nearest_surface() {
    let mut random = Random(2);
    let [mut outside, mut inside, mut not_nearest] = [0; 3];
    let worst = Cell::new(0.0f64);
    for shape in shapes() {
        let (exact, medial) = (Exact::new(&shape), medial(&shape));
        let bound = shape.bounding_sphere();
        for _ in 0..150 {
            let reach = [0.7, 3.0][random.below(2)] * bound.radius;
            let point = bound.center + random.in_ball() * reach;
            let distance = exact.distance(point.as_dvec3());
            let tolerance = ACCURACY * exact.size;
            let found = medial.project_local_point(point, false);
            let found_distance = f64::from(found.point.distance(point));
            assert!(found.is_inside == (distance <= 0.0) || distance.abs() < tolerance);
            assert_eq!(medial.contains_local_point(point), found.is_inside);
            let off = exact.distance(found.point.as_dvec3());
            assert!(
                off.abs() < tolerance,
                "{off} off the surface, {found_distance} from a point at distance {distance}"
            );
            assert_eq!(medial.project_local_point_and_get_feature(point).0.point, found.point);
            if !found.is_inside {
                outside += 1;
                assert!((found_distance - distance).abs() < tolerance, "{found_distance} instead of {distance}");
                assert_eq!(medial.project_local_point(point, true).point, found.point);
                continue;
            }
            inside += 1;
            assert_eq!(medial.project_local_point(point, true).point, point);
            // No sampled point that is nearer is outside.
            let mut nearer = 0.0f64;
            for _ in 0..150 {
                let near = point.as_dvec3()
                    + random.in_ball().normalize().as_dvec3() * found_distance * (0.5 + 0.5 * f64::from(random.unit()));
                if exact.distance(near) > tolerance {
                    nearer = nearer.max(1.0 - near.distance(point.as_dvec3()) / found_distance);
                }
            }
            worst.set(worst.get().max(nearer));
            not_nearest += usize::from(nearer > 0.02);
        }
    }
    println!("{outside} outside, {inside} inside, {not_nearest} not the nearest, at worst by {:.3}", worst.get());
    assert!(outside > 300 && inside > 150, "{outside} {inside}");
    assert!(not_nearest * 20 < inside, "{not_nearest} of {inside}");
}
