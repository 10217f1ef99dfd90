// Time of impact of two primitives whose spheres move on lines: conservative advancement along the separating direction. Counterpart:
// src/query/time_of_impact.rs. This version uses f32 only, with all coordinates relative to the first sphere of the first side, which moves.

// The primitives stay apart.
const SEPARATED: u32 = 0u;
// The primitives first touch at the fraction.
const HIT: u32 = 1u;
// The primitives touch or overlap at the start.
const OVERLAPPING: u32 = 2u;
// The search reached the iteration limit: the fraction is before the first touch, if there is one.
const ITERATION_LIMIT: u32 = 3u;

// A hull whose spheres move on lines over the step. A box is at rest.
struct Moving {
    // Hull at the start of the step.
    hull: Hull,
    // Displacement of the centres over the step, in metres.
    motion: array<vec3f, 3>,
}

struct TimeOfImpact {
    // One of the constants above.
    status: u32,
    // Time as a fraction of the step.
    fraction: f32,
    // Number of iterations.
    rounds: u32,
    // Distance and normal at that time.
    separation: Separation,
}

// A pair at an instant, relative to the origin at that instant.
struct Instant {
    // Time as a fraction of the step.
    fraction: f32,
    // Both hulls at that time.
    first: Hull,
    second: Hull,
    // Distance and normal at that time.
    separation: Separation,
}

// Returns `start + motion * fraction`. The largest part of the product is exact, so that little accuracy is lost where the sum is small.
fn along(start: vec3f, motion: vec3f, fraction: f32) -> vec3f {
    let coarse = bitcast<vec3f>(bitcast<vec3u>(motion) & vec3u(0xfffff000u));
    let early = bitcast<f32>(bitcast<u32>(fraction) & 0xfffff000u);
    return ((start + coarse * early) + (motion - coarse) * early) + motion * (fraction - early);
}

fn hull_at(moving: ptr<function, Moving>, fraction: f32) -> Hull {
    var hull = (*moving).hull;
    for (var i = 0u; i < hull.count; i++) {
        hull.spheres[i] = vec4f(along(hull.spheres[i].xyz, (*moving).motion[i], fraction), hull.spheres[i].w);
    }
    return hull;
}

// Makes the first side's first sphere the origin, unless the second side is a box, whose middle is the origin.
fn make_relative(first: ptr<function, Moving>, second: ptr<function, Moving>) {
    if (*second).hull.count == BOX {
        return;
    }
    let origin = vec4f((*first).hull.spheres[0].xyz, 0.0);
    let motion = (*first).motion[0];
    for (var i = 0u; i < (*first).hull.count; i++) {
        (*first).hull.spheres[i] -= origin;
        (*first).motion[i] -= motion;
    }
    for (var i = 0u; i < (*second).hull.count; i++) {
        (*second).hull.spheres[i] -= origin;
        (*second).motion[i] -= motion;
    }
}

fn instant(first: ptr<function, Moving>, second: ptr<function, Moving>, fraction: f32, hint: u32) -> Instant {
    var hull1 = hull_at(first, fraction);
    var hull2 = hull_at(second, fraction);
    let found = separation(&hull1, &hull2, hint);
    return Instant(fraction, hull1, hull2, found);
}

// Returns the fraction until which the gap along the instant's normal stays above `distance`. Nothing touches until then.
fn cleared_until(
    first: ptr<function, Moving>,
    second: ptr<function, Moving>,
    now: ptr<function, Instant>,
    distance: f32,
) -> f32 {
    let n = (*now).separation.normal;
    var root = MAX;
    // Pointers can only refer to variables.
    var other = (*now).second;
    for (var j = 0u; j < max(other.count, 1u); j++) {
        var least: f32;
        var least_motion = 0.0;
        if other.count == BOX {
            least = low(&other, n);
        } else {
            let sphere = other.spheres[j];
            least = dot(sphere.xyz, n) - sphere.w;
            least_motion = dot((*second).motion[j], n);
        }
        for (var i = 0u; i < (*now).first.count; i++) {
            let sphere = (*now).first.spheres[i];
            let closing = dot((*first).motion[i], n) - least_motion;
            if closing > 0.0 {
                root = min(root, max(least - (dot(sphere.xyz, n) + sphere.w) - distance, 0.0) / closing);
            }
        }
    }
    return (*now).fraction + root;
}

// Returns the dot product of a point and a direction, as coefficients of 1, t and t squared. The point moves from `p` to `q`, the direction from `m` to `n`.
fn quadratic(p: vec3f, q: vec3f, m: vec3f, n: vec3f) -> vec3f {
    let dp = q - p;
    let dn = n - m;
    return vec3f(dot(p, m), dot(p, dn) + dot(dp, m), dot(dp, dn));
}

// Returns true if a quadratic function is positive from 0 to 1.
fn is_positive(c: vec3f) -> bool {
    var lowest = 0.0;
    if c.z > 0.0 {
        lowest = clamp(-c.y / (2.0 * c.z), 0.0, 1.0);
    }
    return c.x > 0.0 && c.x + c.y + c.z > 0.0 && (c.z * lowest + c.y) * lowest + c.x > 0.0;
}

// Returns true if nothing touches between two instants: their normals, interpolated, separate the two sides.
fn clear_between(here: ptr<function, Instant>, there: ptr<function, Instant>, distance: f32) -> bool {
    let m = (*here).separation.normal;
    let n = (*there).separation.normal;
    var other = (*here).second;
    for (var j = 0u; j < max(other.count, 1u); j++) {
        var least: vec3f;
        if other.count == BOX {
            let start = low(&other, m);
            least = vec3f(start, low(&other, n) - start, 0.0);
        } else {
            let sphere = other.spheres[j];
            least = quadratic(sphere.xyz, (*there).second.spheres[j].xyz, m, n);
            least.x -= sphere.w;
        }
        for (var i = 0u; i < (*here).first.count; i++) {
            let sphere = (*here).first.spheres[i];
            var greatest = quadratic(sphere.xyz, (*there).first.spheres[i].xyz, m, n);
            greatest.x += sphere.w + distance;
            if !is_positive(least - greatest) {
                return false;
            }
        }
    }
    return true;
}

// Returns the largest displacement of a sphere of one side relative to one of the other, in metres.
fn fastest(first: ptr<function, Moving>, second: ptr<function, Moving>) -> f32 {
    var most = 0.0;
    for (var i = 0u; i < (*first).hull.count; i++) {
        if (*second).hull.count == BOX {
            most = max(most, length((*first).motion[i]));
        }
        for (var j = 0u; j < (*second).hull.count; j++) {
            most = max(most, length((*first).motion[i] - (*second).motion[j]));
        }
    }
    return most;
}

// Returns the first fraction of the step at which two moving hulls are within `distance` metres of each other. Both are in one frame, in which a box
// is at rest at the origin.
//
// All iterations evaluate the pair at one place of the code, because that code is long.
fn time_of_impact(given1: Moving, given2: Moving, distance: f32) -> TimeOfImpact {
    var first = given1;
    var second = given2;
    make_relative(&first, &second);
    var extents = 0.0;
    var touching = 0.0;
    var shortest = 0.0;
    // The last instant at which nothing touches, and the fraction until which nothing touches.
    var here: Instant;
    var cleared = 0.0;
    // Length of the next trial step as a fraction, and whether it is halved if it fails.
    var step = 0.0;
    var halve = false;
    var next = 0.0;
    var rounds = 0u;
    while rounds < MAX_ROUNDS {
        var now = instant(&first, &second, next, here.separation.feature);
        rounds++;
        if rounds == 1u {
            var hull1 = now.first;
            var hull2 = now.second;
            extents = max(extent(&hull1), extent(&hull2));
            touching = distance + TOUCH_ROUNDING * extents;
            if now.separation.distance <= distance + CONTACT_ROUNDING * extents {
                return TimeOfImpact(OVERLAPPING, 0.0, rounds, now.separation);
            }
        } else if abs(now.separation.distance - distance) <= NEAR_TOUCH * extents
            && now.separation.loss > TILT_ROUNDING * extents {
            // Near the target, a tilted normal would end the search too early.
            var hull1 = now.first;
            var hull2 = now.second;
            now.separation = refined(&hull1, &hull2, now.separation);
        }
        let before = here.separation.distance;
        let after = now.separation.distance;
        if rounds <= MAX_ADVANCES {
            if after <= touching && rounds > 1u {
                return TimeOfImpact(HIT, next, rounds, now.separation);
            }
            here = now;
            cleared = cleared_until(&first, &second, &here, distance);
        } else {
            // The part of the trial step after which the distance would be the target, if it changed linearly.
            let part = (before - 0.5 * (distance + touching)) / (before - after);
            let clear = after > distance && clear_between(&here, &now, distance);
            if clear && after <= touching {
                return TimeOfImpact(HIT, next, rounds, now.separation);
            } else if clear {
                here = now;
                if next >= 1.0 {
                    return TimeOfImpact(SEPARATED, 1.0, rounds, here.separation);
                }
                cleared = cleared_until(&first, &second, &here, distance);
                var rest = 2.0;
                if after < before {
                    rest = min(part - 1.0, 2.0);
                }
                step = max(step * rest, SHORTEST_TRIAL * shortest);
                halve = false;
            } else if step <= shortest {
                return TimeOfImpact(HIT, min(cleared, next), rounds, here.separation);
            } else {
                if halve || after > touching {
                    step *= 0.5;
                } else {
                    step *= clamp(part, 0.1, 0.9);
                }
                halve = !halve;
            }
        }
        if cleared > 1.0 {
            return TimeOfImpact(SEPARATED, cleared, rounds, here.separation);
        }
        if rounds < MAX_ADVANCES {
            next = cleared;
            continue;
        }
        if rounds == MAX_ADVANCES {
            shortest = max(TIME_TOLERANCE * extents / fastest(&first, &second), EPSILON);
            step = FIRST_TRIAL * max(shortest, cleared - here.fraction);
        }
        next = min(here.fraction + step, 1.0);
        step = next - here.fraction;
    }
    return TimeOfImpact(ITERATION_LIMIT, here.fraction, rounds, here.separation);
}
