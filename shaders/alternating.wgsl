// The published time of impact by alternation, as a baseline. Counterpart: src/query/alternating.rs. The back end does not use it.
// Lengths are in metres.

// Most iterations of a search.
const MOST_ALTERNATIONS: u32 = 8u;

// The nearest spheres so far, as in `nearer.wgsl`, with the spheres themselves.
struct Nearest {
    // Distance of their surfaces.
    distance: f32,
    // Spheres `x y z radius`, one of each side.
    first: vec4f,
    second: vec4f,
    // Difference of their centres, from the first side to the second.
    apart: vec3f,
}

const FAR: Nearest = Nearest(MAX, vec4f(0.0), vec4f(0.0), vec3f(0.0, 1.0, 0.0));

fn nearer(best: Nearest, first: vec4f, second: vec4f) -> Nearest {
    let apart = second.xyz - first.xyz;
    let distance = length(apart) - first.w - second.w;
    if distance < best.distance {
        return Nearest(distance, first, second, apart);
    }
    return best;
}

// Returns the barycentric weights of the second and the third sphere of a slab at a point in the plane of the centres.
fn weights_on_face(slab: Spheres, point: vec3f) -> vec2f {
    let u = slab.b.xyz - slab.a.xyz;
    let v = slab.c.xyz - slab.a.xyz;
    let normal = cross(u, v);
    let det = dot(normal, normal);
    if det == 0.0 {
        return vec2f(0.0);
    }
    let to_point = point - slab.a.xyz;
    return vec2f(dot(cross(to_point, v), normal), dot(cross(u, to_point), normal)) / det;
}

// Returns the sphere of the face of a slab that is nearest to a point, or the first sphere if it is on an edge.
fn on_face(slab: Spheres, point: vec3f) -> vec4f {
    let u = slab.b - slab.a;
    let v = slab.c - slab.a;
    let normal = cross(u.xyz, v.xyz);
    let det = dot(normal, normal);
    // Gradient of the radius in the plane.
    let gradient = (cross(v.xyz, normal) * u.w + cross(normal, u.xyz) * v.w) / det;
    let square = dot(gradient, gradient);
    if !(det > 0.0 && square < 1.0) {
        return slab.a;
    }
    let height = abs(dot(point - slab.a.xyz, normal)) * inverseSqrt(det);
    let weights = weights_on_face(slab, point + gradient * (height * inverseSqrt(1.0 - square)));
    if min(min(weights.x, weights.y), 1.0 - weights.x - weights.y) < 0.0 {
        return slab.a;
    }
    return slab.a + u * weights.x + v * weights.y;
}

fn nearest_spheres(first: Spheres, second: Spheres) -> Nearest {
    var best = FAR;
    var one = first;
    for (var i = 0u; i < select(1u, 3u, IS_SLAB1); i++) {
        var other = second;
        for (var j = 0u; j < select(1u, 3u, IS_SLAB2); j++) {
            best = between_edges(best, edge(one.a, one.b), edge(other.a, other.b));
            other = Spheres(other.b, other.c, other.a);
        }
        one = Spheres(one.b, one.c, one.a);
    }
    if IS_SLAB1 {
        best = nearer(best, on_face(first, second.a.xyz), second.a);
        best = nearer(best, on_face(first, second.b.xyz), second.b);
        best = nearer(best, on_face(first, second.c.xyz), second.c);
    }
    if IS_SLAB2 {
        best = nearer(best, first.a, on_face(second, first.a.xyz));
        best = nearer(best, first.b, on_face(second, first.b.xyz));
        best = nearer(best, first.c, on_face(second, first.c.xyz));
    }
    return best;
}

// A sphere in motion: its centre at the start, and its displacement.
struct Trace {
    start: vec3f,
    motion: vec3f,
}

// Returns the motion of a sphere of a side, given the side and the centre of the sphere at an instant.
fn trace_of(moving: Moving, now: Spheres, point: vec3f, is_slab: bool) -> Trace {
    var weights = vec2f(0.0);
    if is_slab {
        weights = weights_on_face(now, point);
    } else {
        let axis = now.b.xyz - now.a.xyz;
        weights.x = dot(point - now.a.xyz, axis) / max(dot(axis, axis), 1.0e-38);
    }
    let first = 1.0 - weights.x - weights.y;
    return Trace(
        moving.start.a.xyz * first + moving.start.b.xyz * weights.x + moving.start.c.xyz * weights.y,
        moving.motion_a * first + moving.motion_b * weights.x + moving.motion_c * weights.y,
    );
}

// First contact of two spheres during the step, or else their closest approach, and whether they touch.
struct Approach {
    fraction: f32,
    touches: bool,
}

// `offset`: vector between the centres at the start. `motion`: its change over the step. `radii`: sum of the radii.
fn approach(offset: vec3f, motion: vec3f, radii: f32) -> Approach {
    let speed_squared = dot(motion, motion);
    let excess = dot(offset, offset) - radii * radii;
    if speed_squared == 0.0 {
        return Approach(0.0, excess <= 0.0);
    }
    let half_slope = dot(offset, motion);
    let discriminant = half_slope * half_slope - speed_squared * excess;
    let root = sqrt(max(discriminant, 0.0));
    let enter = (-half_slope - root) / speed_squared;
    if discriminant >= 0.0 && enter <= 1.0 && root >= half_slope {
        return Approach(max(enter, 0.0), true);
    }
    return Approach(clamp(-half_slope / speed_squared, 0.0, 1.0), false);
}

// Returns the fraction of the step at which the pair touches, or `NEVER`.
fn result_of(first: Moving, second: Moving) -> f32 {
    var found = Approach(1.0, false);
    for (var i = 0u; i < MOST_ALTERNATIONS; i++) {
        let before = found.fraction;
        let now1 = spheres_at(first, before);
        let now2 = spheres_at(second, before);
        let nearest = nearest_spheres(now1, now2);
        let trace1 = trace_of(first, now1, nearest.first.xyz, IS_SLAB1);
        let trace2 = trace_of(second, now2, nearest.second.xyz, IS_SLAB2);
        let radii = nearest.first.w + nearest.second.w;
        found = approach(trace2.start - trace1.start, trace2.motion - trace1.motion, radii);
        if abs(found.fraction - before) < 1.0e-5 {
            break;
        }
    }
    return select(NEVER, found.fraction, found.touches && found.fraction > 0.0);
}
