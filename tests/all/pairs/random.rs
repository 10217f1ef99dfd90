//! Random pairs of each category.

use super::*;

/// A pair of the category, computed in f64 and rounded at the end. Bodies measure about 1, except the smaller one of `uneven`.
pub fn random_pair(random: &mut Random, category: usize, (count1, count2): (usize, usize)) -> Pair {
    let name = CATEGORIES[category];
    let smaller = if name == "uneven" { random.magnitude(-3.2, -2.8) } else { random.magnitude(-0.5, 0.0) };
    let sizes = if random.chance(0.5) { [1.0, smaller] } else { [smaller, 1.0] };
    let mut first = random_hull(random, name, count1, sizes[0]);
    let mut half = DVec3::ZERO;
    let mut rotation = DQuat::IDENTITY;
    let mut second = if count2 > 0 {
        random_hull(random, name, count2, sizes[1])
    } else {
        half = (cube(random).abs() + 0.05) * sizes[1];
        match name {
            "thin" => half[random.below(3)] = 1e-3 * sizes[1] * random.magnitude(-0.5, 0.5),
            "sharp" if random.chance(0.1) => half[random.below(3)] = 0.0,
            _ => {}
        }
        if name != "parallel" || random.chance(0.2) {
            rotation = random.direction_rotation();
        }
        corners(half, DVec3::ZERO, rotation)
    };

    // Position, and motion roughly towards each other.
    let reach = |balls: &[Ball]| balls.iter().map(|b| b.center.length() + b.radius).fold(0.0, f64::max);
    let (reach1, reach2) = (reach(&first), reach(&second));
    let towards = random.direction();
    let apart = match name {
        "overlap" => random.range(0.0, 0.7),
        "resting" => random.range(0.7, 2.0),
        "separating" => random.range(0.3, 2.0),
        _ => random.range(0.6, 3.0),
    } * (reach1 + reach2);
    let mut place = towards * apart;
    if name == "parallel" && random.chance(0.5) {
        // Exactly aligned in some coordinates.
        let axis = random.below(3);
        for k in 0..3 {
            if k == axis || random.chance(0.3) {
                continue;
            }
            place[k] = if random.chance(0.5) { 0.0 } else { random.range(-0.3, 0.3) };
        }
        if random.chance(0.5) {
            place[axis] = apart;
        }
    }
    let aside = random.direction().reject_from(towards) * (reach1 + reach2) * random.range(0.0, 1.2);
    // This displacement brings a random point of one body to a random point of the other.
    let aim = place + point_of(random, &second) - point_of(random, &first);
    let mut motion = match name {
        "fast" if random.chance(0.6) => aim.normalize() * reach1.max(reach2) * random.magnitude(1.0, 3.0),
        "separating" | "resting" | "fast" => DVec3::ZERO,
        _ if random.chance(0.6) => aim / random.range(0.1, 1.2),
        _ => DVec3::ZERO,
    };
    motion = match name {
        _ if motion != DVec3::ZERO => motion,
        "fast" => (towards * apart + aside).normalize() * reach1.max(reach2) * random.magnitude(1.0, 3.0),
        "separating" => (aside * 0.5 - towards * apart) * random.range(0.1, 2.0),
        "resting" if random.chance(0.5) => random.direction() * random.range(0.0, 2.0) * (reach1 + reach2),
        "overlap" => random.direction() * random.range(0.0, 1.0) * (reach1 + reach2),
        _ => (towards * apart + aside) * random.range(0.4, 2.5),
    };
    if name == "parallel" && random.chance(0.4) {
        // Motion straight along an axis, so that faces meet or slide exactly.
        let axis = DVec3::AXES[random.below(3)];
        motion = axis * motion.dot(axis);
    }
    if random.chance(0.01) {
        motion = DVec3::ZERO;
    }
    let turning = if name == "parallel" || name == "thin" { 0.3 } else { 0.8 };
    let share = if count2 > 0 { random.range(0.0, 1.0) } else { 1.0 };
    let wobble1 = random.chance(turning);
    set_motion(random, &mut first, motion * share, wobble1, sizes[0]);
    if count2 > 0 {
        let wobble2 = random.chance(turning);
        set_motion(random, &mut second, motion * (share - 1.0), wobble2, sizes[1]);
    }
    for ball in &mut second {
        ball.center += place;
    }

    // Shift the second body until both just touch.
    let mut difference = Difference::new(&first, &second);
    let size = reach1.max(reach2);
    let nudge = match name {
        "grazing" => graze(random, &mut difference, size),
        "resting" => {
            let wanted = size * random.range(-1.0, 1.0) * if random.chance(0.8) { 1e-5 } else { 1e-6 };
            (0..4).map(|_| settle(&mut difference, 0.0, wanted)).sum()
        }
        _ => DVec3::ZERO,
    };
    let origin = if name == "far" { random.direction() * random.range(500.0, 5000.0) } else { DVec3::ZERO };
    let round = |balls: &[Ball], by: DVec3| -> Vec<(Sphere, Vec3)> {
        balls.iter().map(|b| (Sphere::new((b.center + by).as_vec3(), b.radius as f32), b.motion.as_vec3())).collect()
    };
    Pair {
        category,
        first: round(&first, origin),
        second: if count2 > 0 {
            Second::Hull(round(&second, origin + nudge))
        } else {
            Second::Box(Placed {
                center: (place + origin + nudge).as_vec3(),
                rotation: rotation.as_quat(),
                half: half.as_vec3(),
            })
        },
    }
}

fn point_of(random: &mut Random, balls: &[Ball]) -> DVec3 {
    let weights: Vec<f64> = balls.iter().map(|_| random.range(0.0, 1.0)).collect();
    balls.iter().zip(&weights).map(|(ball, weight)| ball.center * *weight).sum::<DVec3>() / weights.iter().sum::<f64>()
}

/// Shifts the second body along the direction of the shortest distance until the distance is `wanted`.
fn settle(difference: &mut Difference, fraction: f64, wanted: f64) -> DVec3 {
    let now = difference.at(fraction).distance();
    let shift = now.normal.normalize_or(DVec3::Y) * (wanted - now.lower);
    difference.shift(shift);
    shift
}

/// Shifts the second body until the smallest distance over the step is within about 1e-3 of zero, in sizes of the pair.
fn graze(random: &mut Random, difference: &mut Difference, size: f64) -> DVec3 {
    let wanted = size * random.magnitude(-6.0, -3.0) * if random.chance(0.5) { 1.0 } else { -1.0 };
    let mut shift = DVec3::ZERO;
    for samples in [12, 8, 8] {
        // The smallest of a few samples, then a finer search around it.
        let distance = |t: f64| difference.at(t).distance().lower;
        let best = (0..=samples)
            .map(|i| f64::from(i) / f64::from(samples))
            .map(|t| (distance(t), t))
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .map_or(0.0, |best| best.1);
        let (mut low, mut high) =
            ((best - 1.0 / f64::from(samples)).max(0.0), (best + 1.0 / f64::from(samples)).min(1.0));
        for _ in 0..14 {
            let (a, b) = (low + (high - low) * 0.4, low + (high - low) * 0.6);
            if distance(a) < distance(b) { high = b } else { low = a }
        }
        shift += settle(difference, (low + high) * 0.5, wanted);
    }
    shift
}

/// Gives every vertex the motion of the body. If `turning`, each vertex also moves by the chord of a rotation, or by a random stretch.
fn set_motion(random: &mut Random, balls: &mut [Ball], motion: DVec3, turning: bool, size: f64) {
    let rotation = DQuat::from_axis_angle(random.direction(), random.range(-1.5, 1.5));
    let stretch = random.chance(0.5);
    for ball in balls {
        ball.motion = motion;
        if turning {
            ball.motion += if stretch { cube(random) * size * 0.5 } else { rotation * ball.center - ball.center };
        }
    }
}

fn random_hull(random: &mut Random, category: &str, count: usize, size: f64) -> Vec<Ball> {
    let mut balls: Vec<Ball> = (0..count)
        .map(|_| Ball {
            center: cube(random) * 0.7 * size,
            radius: random.range(0.02, 0.3) * size,
            motion: DVec3::ZERO,
        })
        .collect();
    match category {
        "thin" => balls.iter_mut().for_each(|b| b.radius = size * random.magnitude(-3.5, -2.5)),
        "sharp" => {
            let keep = random.below(2 * count);
            for (i, ball) in balls.iter_mut().enumerate() {
                if i != keep || random.chance(0.5) {
                    ball.radius = 0.0;
                }
            }
        }
        "parallel" => {
            let axis = random.below(3);
            let start = balls[0].center;
            for (i, ball) in balls.iter_mut().enumerate().skip(1) {
                ball.center = start + DVec3::AXES[(axis + i) % 3] * size * random.range(0.1, 1.2);
            }
            if random.chance(0.6) {
                let radius = balls[0].radius;
                balls.iter_mut().for_each(|b| b.radius = radius);
            }
        }
        "near_degenerate" | "degenerate" if count > 1 => {
            let near = category == "near_degenerate";
            degenerate(random, &mut balls, near, size);
        }
        _ => {}
    }
    balls
}

/// Puts the last sphere into the hull of the others. If `near`, it is only inside or outside by a small distance.
fn degenerate(random: &mut Random, balls: &mut [Ball], near: bool, size: f64) {
    let last = balls.len() - 1;
    let hair =
        if near { size * random.magnitude(-6.0, -2.0) * if random.chance(0.7) { 1.0 } else { -1.0 } } else { 0.0 };
    balls[0].radius = random.range(0.1, 1.2) * size;
    let aside = random.direction();
    if last == 1 || random.chance(0.3) {
        // Inside the first sphere: near its surface, or anywhere.
        let small = balls[0].radius * random.range(0.02, 0.95);
        let room = balls[0].radius - small;
        let room = if near { room + hair } else { room * random.range(0.0, 0.999) };
        balls[last] = Ball { center: balls[0].center + aside * room, radius: small, ..balls[last] };
    } else {
        // Near the hull of the first two: on their axis, with a larger or smaller radius, or beside the axis.
        let (a, b) = (balls[0], balls[1]);
        let t = random.range(0.0, 1.0);
        let radius = a.radius + (b.radius - a.radius) * t;
        let small = match random.below(3) {
            0 => radius,
            1 => radius * random.range(1.0, 1.5),
            _ => radius * random.range(0.1, 1.0),
        };
        let room = if random.chance(0.5) { 0.0 } else { (radius - small).max(0.0) };
        balls[2] = Ball { center: a.center.lerp(b.center, t) + aside * (room + hair), radius: small, ..a };
        if !near && random.chance(0.1) {
            balls[2] = if random.chance(0.5) { a } else { Ball { radius: b.radius * 0.5, ..b } };
        }
    }
    let turn = random.below(last + 1);
    balls.rotate_left(turn);
}
