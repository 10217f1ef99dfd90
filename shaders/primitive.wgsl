// Medial primitives and boxes. Counterpart: src/query/separation.rs. Lengths are in metres.

// `count` of a hull that is a box. Only the second side of a pair may be a box.
const BOX: u32 = 0u;

// The convex hull of one to three spheres, or a box around the origin.
struct Hull {
    // Spheres `x y z radius`. For a box the first entry is its half extents.
    spheres: array<vec4f, 3>,
    // Number of spheres, or `BOX`.
    count: u32,
}

// Minimum of `n . x` over the hull.
fn low(hull: ptr<function, Hull>, n: vec3f) -> f32 {
    let first = (*hull).spheres[0];
    if (*hull).count == BOX {
        return -dot(first.xyz, abs(n));
    }
    var least = dot(first.xyz, n) - first.w;
    for (var i = 1u; i < (*hull).count; i++) {
        let sphere = (*hull).spheres[i];
        least = min(least, dot(sphere.xyz, n) - sphere.w);
    }
    return least;
}

// Maximum of `n . x` over a hull of spheres.
fn high(hull: ptr<function, Hull>, n: vec3f) -> f32 {
    var greatest = dot((*hull).spheres[0].xyz, n) + (*hull).spheres[0].w;
    for (var i = 1u; i < (*hull).count; i++) {
        let sphere = (*hull).spheres[i];
        greatest = max(greatest, dot(sphere.xyz, n) + sphere.w);
    }
    return greatest;
}

// Returns approximately the largest distance of a point of the hull from its first centre, or from the middle of the box.
fn extent(hull: ptr<function, Hull>) -> f32 {
    let first = (*hull).spheres[0];
    if (*hull).count == BOX {
        return max(first.x, max(first.y, first.z));
    }
    var spread = 0.0;
    var radius = first.w;
    for (var i = 1u; i < (*hull).count; i++) {
        let sphere = (*hull).spheres[i];
        spread = max(spread, distance(sphere.xyz, first.xyz));
        radius = max(radius, sphere.w);
    }
    return spread + radius;
}

// Returns a point inside of the hull.
fn origin_of(hull: ptr<function, Hull>) -> vec3f {
    if (*hull).count == BOX {
        return vec3f(0.0);
    }
    var sum = vec3f(0.0);
    for (var i = 0u; i < (*hull).count; i++) {
        sum += (*hull).spheres[i].xyz;
    }
    return sum / f32((*hull).count);
}

// Number of edges of a primitive.
fn edges(count: u32) -> u32 {
    return select(select(0u, 1u, count == 2u), 3u, count == 3u);
}

// A sphere of each side, or both ends of an edge.
struct SpherePair {
    first: vec4f,
    second: vec4f,
}

// Returns the `k`-th edge of a primitive.
fn edge(hull: ptr<function, Hull>, k: u32) -> SpherePair {
    return SpherePair((*hull).spheres[k], (*hull).spheres[(k + 1u) % (*hull).count]);
}
