// Lower bounds of the time of impact of two primitives whose spheres move on lines: conservative advancement along separating directions. The CPU
// computes exact times for the pairs that are left, in src/query/time_of_impact.rs. Lengths are in metres.
//
// Each shader is for one kind of pair, which constants describe: `IS_SLAB1` and `IS_SLAB2` are true for slabs, `IS_BOX` if the second side is a box at
// rest around the origin. Other primitives are cones. A sphere is a cone with two equal spheres.

// The spheres `x y z radius` of a primitive. The third sphere of a cone is equal to its second. For a box, `a` holds the half extents.
struct Spheres {
    a: vec4f,
    b: vec4f,
    c: vec4f,
}

// A primitive whose spheres move on lines.
struct Moving {
    // Spheres at the start.
    start: Spheres,
    // Displacements of their centres.
    motion_a: vec3f,
    motion_b: vec3f,
    motion_c: vec3f,
}

fn spheres_at(moving: Moving, fraction: f32) -> Spheres {
    return Spheres(
        moving.start.a + vec4f(moving.motion_a * fraction, 0.0),
        moving.start.b + vec4f(moving.motion_b * fraction, 0.0),
        moving.start.c + vec4f(moving.motion_c * fraction, 0.0),
    );
}

// Returns the maxima of `n . x` over the spheres.
fn highs(spheres: Spheres, n: vec3f) -> vec3f {
    let centers = vec3f(dot(spheres.a.xyz, n), dot(spheres.b.xyz, n), dot(spheres.c.xyz, n));
    return centers + vec3f(spheres.a.w, spheres.b.w, spheres.c.w);
}

// Returns the minima of `n . x` over the spheres of the second side, or three times that of the box.
fn lows(second: Spheres, n: vec3f) -> vec3f {
    if IS_BOX {
        return vec3f(-dot(second.a.xyz, abs(n)));
    }
    return -highs(second, -n);
}

// Components of the displacements of the spheres along a direction.
fn motions(moving: Moving, n: vec3f) -> vec3f {
    return vec3f(dot(moving.motion_a, n), dot(moving.motion_b, n), dot(moving.motion_c, n));
}

// A direction from the first side to the second, and the gap between both sides along it: a lower bound of their distance.
struct Direction {
    // Unit vector.
    normal: vec3f,
    gap: f32,
}

fn along(first: Spheres, second: Spheres, normal: vec3f) -> Direction {
    let high = highs(first, normal);
    let low = lows(second, normal);
    return Direction(normal, min(low.x, min(low.y, low.z)) - max(high.x, max(high.y, high.z)));
}

fn wider(one: Direction, other: Direction) -> Direction {
    if other.gap > one.gap {
        return other;
    }
    return one;
}

// Also tests the outward normals of the faces of a slab. `sign`: -1 if the slab is the second side.
fn along_faces(given: Direction, slab: Spheres, sign: f32, first: Spheres, second: Spheres) -> Direction {
    let u = slab.b - slab.a;
    let v = slab.c - slab.a;
    let normal = cross(u.xyz, v.xyz);
    let det = dot(normal, normal);
    // A plane touches all three spheres on one side if its normal has this part in the plane of the centres.
    let part = (cross(v.xyz, normal) * u.w + cross(normal, u.xyz) * v.w) / -det;
    let height_squared = 1.0 - dot(part, part);
    if !(det > 0.0 && height_squared >= 0.0) {
        return given;
    }
    // The part is not accurate in a thin slab, so the sum may be longer than a unit vector.
    let height = normal * sqrt(height_squared / det);
    let front = along(first, second, sign * unit(part + height));
    return wider(wider(given, front), along(first, second, sign * unit(part - height)));
}

// Returns the direction of minimum distance. Where the centres of both sides cross, the gap along it is smaller than their distance.
fn separating_direction(first: Spheres, second: Spheres) -> Direction {
    var best = FAR;
    let edge1 = edge(first.a, first.b);
    if IS_BOX {
        best = edge_to_box(best, edge1, second.a.xyz);
        if IS_SLAB1 {
            best = edge_to_box(best, edge(first.b, first.c), second.a.xyz);
            best = edge_to_box(best, edge(first.c, first.a), second.a.xyz);
        }
    } else {
        let edge2 = edge(second.a, second.b);
        best = between_edges(best, edge1, edge2);
        if IS_SLAB2 {
            best = between_edges(best, edge1, edge(second.b, second.c));
            best = between_edges(best, edge1, edge(second.c, second.a));
        }
        if IS_SLAB1 {
            // The edges of the second side again, for each other edge of the first.
            var next = first;
            for (var k = 0u; k < 2u; k++) {
                next = Spheres(next.b, next.c, next.a);
                let own = edge(next.a, next.b);
                best = between_edges(best, own, edge2);
                if IS_SLAB2 {
                    best = between_edges(best, own, edge(second.b, second.c));
                    best = between_edges(best, own, edge(second.c, second.a));
                }
            }
        }
    }
    var found = along(first, second, unit(best.apart));
    if IS_SLAB1 {
        found = along_faces(found, first, 1.0, first, second);
    }
    if IS_SLAB2 {
        found = along_faces(found, second, -1.0, first, second);
    }
    return found;
}

// Returns the time in which the gap along a direction shrinks to `distance`, or more.
fn time_to(first: Moving, second: Moving, now1: Spheres, now2: Spheres, normal: vec3f, distance: f32) -> f32 {
    let high = highs(now1, normal);
    let high_motion = motions(first, normal);
    let low = lows(now2, normal) - distance;
    var low_motion = vec3f(0.0);
    if !IS_BOX {
        low_motion = motions(second, normal);
    }
    // Each sphere of the first side against each of the second, in three rotations.
    var least = time_to_close(low - high, high_motion - low_motion);
    if !IS_BOX {
        least = min(least, time_to_close(low.yzx - high, high_motion - low_motion.yzx));
        least = min(least, time_to_close(low.zxy - high, high_motion - low_motion.zxy));
    }
    return min(least.x, min(least.y, least.z));
}

fn time_to_close(gap: vec3f, closing: vec3f) -> vec3f {
    return select(vec3f(MAX), max(gap, vec3f(0.0)) / closing, closing > vec3f(0.0));
}

// Value of a bound if nothing touches.
const NEVER: f32 = 2.0;

struct Bound {
    // True if both sides may come within the reach.
    is_near: bool,
    // Lower bound of the fraction at which they come within the touch distance, or `NEVER`.
    touch: f32,
    // True if they may be within the reach at the end.
    is_near_at_end: bool,
}

// Returns bounds for two moving sides. `reach` is not less than `touch`. The end is tested if `tests_end`.
//
// All iterations evaluate the pair at one place of the code, because that code is long.
fn bound(first: Moving, second: Moving, reach: f32, touch: f32, tests_end: bool) -> Bound {
    var found = Bound(false, NEVER, false);
    var time = 0.0;
    var is_end = false;
    for (var round = 0u; round < 2u * MAX_ADVANCES; round++) {
        let now1 = spheres_at(first, time);
        let now2 = spheres_at(second, time);
        let direction = separating_direction(now1, now2);
        if is_end {
            found.is_near_at_end = direction.gap <= reach;
            return found;
        }
        found.is_near = found.is_near || direction.gap <= reach;
        let distance = select(reach, touch, found.is_near);
        var advance = 0.0;
        if direction.gap > distance {
            advance = time_to(first, second, now1, now2, direction.normal, distance);
        }
        time += advance;
        if time > 1.0 {
            if !found.is_near || !tests_end {
                return found;
            }
            is_end = true;
        } else if advance < SHORTEST_ADVANCE {
            if found.is_near {
                found.touch = time;
                if !tests_end {
                    return found;
                }
                is_end = true;
            }
            found.is_near = true;
        }
        if is_end {
            time = 1.0;
        }
    }
    // Out of iterations: nothing is known about the rest.
    found.is_near = true;
    found.touch = select(time, found.touch, is_end);
    found.is_near_at_end = tests_end;
    return found;
}
