// Distance of two hulls, with witness points and normal, or depth of their overlap. Counterpart: src/query/separation.rs.

struct Separation {
    // Distance of the surfaces in metres, negative for an overlap.
    distance: f32,
    // Unit direction from the first to the second.
    normal: vec3f,
    // Index of the nearest pair of features.
    feature: u32,
    // Point of the first surface, in metres. The point of the second surface is `distance` metres away along the normal.
    point1: vec3f,
    // Error of the distance due to rounding of the normal, in metres.
    loss: f32,
}

// State of the search: `lower <= distance <= upper`.
struct Best {
    // Smallest distance of the features tested so far, in metres.
    upper: f32,
    // Largest gap along the directions tested so far, in metres.
    lower: f32,
    // Direction of that gap, a unit vector.
    normal: vec3f,
    // Index of the pair of features with the smallest distance.
    feature: u32,
    // Nearest spheres of that pair of features.
    spheres: SpherePair,
}

fn separation(first: ptr<function, Hull>, second: ptr<function, Hull>, hint: u32) -> Separation {
    let rounding = CONTACT_ROUNDING * (extent(first) + extent(second));
    let sphere1 = (*first).spheres[0];
    var best = Best(MAX, -MAX, vec3f(0.0, 1.0, 0.0), 0u, SpherePair(sphere1, sphere1));
    let count = features(first, second);
    for (var turn = 0u; turn < count; turn++) {
        // The hinted feature first, then the others in order.
        let k = select(select(turn, turn - 1u, turn <= hint), hint, turn == 0u);
        let spheres = feature(first, second, k);
        let apart = spheres.second.xyz - spheres.first.xyz;
        let length = length(apart);
        let upper = length - spheres.first.w - spheres.second.w;
        if upper < best.upper {
            best.upper = upper;
            best.feature = k;
            best.spheres = spheres;
            if length > 0.0 {
                // Gaps between distant sides are no more accurate than this. The gaps of other features could seem larger, so they are discarded.
                let far = DISTANCE_ROUNDING * length;
                if far > rounding {
                    best.lower = -MAX;
                }
                look_along(&best, apart / length, first, second);
                if best.lower >= upper - max(rounding, far) {
                    return witness(&best);
                }
            }
        }
    }
    var apart = best.spheres.second.xyz - best.spheres.first.xyz;
    if all(apart == vec3f(0.0)) {
        apart = origin_of(second) - origin_of(first);
    }
    let length = length(apart);
    look_along(&best, select(vec3f(0.0, 1.0, 0.0), apart / length, length > 0.0), first, second);
    look_along_normals(&best, first, second, apart);
    // Centres of separate sides do not cross.
    if best.lower > 0.0 || best.lower >= best.upper - 2.0 * rounding {
        return witness(&best);
    }
    return crossing(&best);
}

// Also tests the features' own directions, which rounding does not tilt.
fn refined(first: ptr<function, Hull>, second: ptr<function, Hull>, found: Separation) -> Separation {
    let sphere1 = (*first).spheres[0];
    var best = Best(MAX, found.distance, found.normal, found.feature, SpherePair(sphere1, sphere1));
    look_along_normals(&best, first, second, found.normal);
    return Separation(best.lower, best.normal, found.feature, found.point1, 0.0);
}

fn look_along(best: ptr<function, Best>, normal: vec3f, first: ptr<function, Hull>, second: ptr<function, Hull>) {
    let lower = low(second, normal) - high(first, normal);
    if lower > (*best).lower {
        (*best).lower = lower;
        (*best).normal = normal;
    }
}

fn witness(best: ptr<function, Best>) -> Separation {
    let sphere1 = (*best).spheres.first;
    let normal = (*best).normal;
    let loss = (*best).upper - (*best).lower;
    return Separation((*best).lower, normal, (*best).feature, sphere1.xyz + normal * sphere1.w, loss);
}

// The centres cross. The points are on both sides of the crossing.
fn crossing(best: ptr<function, Best>) -> Separation {
    let middle = ((*best).spheres.first.xyz + (*best).spheres.second.xyz) * 0.5;
    let normal = (*best).normal;
    return Separation((*best).lower, normal, (*best).feature, middle - normal * (0.5 * (*best).lower), 0.0);
}

// Number of spheres of either side that are tested against the whole other side. The cones of an edge cover its ends.
fn vertex_features(n: u32, m: u32) -> vec2u {
    if n == 1u {
        return vec2u(1u, 0u);
    }
    return vec2u(select(0u, n, m == 3u), select(0u, m, m == 1u || n == 3u));
}

// Number of feature pairs.
fn features(first: ptr<function, Hull>, second: ptr<function, Hull>) -> u32 {
    let n = (*first).count;
    let m = (*second).count;
    if m == BOX {
        return select(1u, 5u, n == 3u);
    }
    let vertices = vertex_features(n, m);
    return vertices.x + vertices.y + edges(n) * edges(m);
}

// Returns the nearest spheres of the `k`-th pair of features. One pair of them is nearest of all unless the centres cross.
fn feature(first: ptr<function, Hull>, second: ptr<function, Hull>, k: u32) -> SpherePair {
    let n = (*first).count;
    let m = (*second).count;
    // A sphere, or a corner of the box, and the side against which it is tested.
    var sphere: vec4f;
    var hull = *first;
    var is_first = false;
    if m == BOX {
        let half = (*second).spheres[0].xyz;
        if n == 1u {
            sphere = (*first).spheres[0];
            return SpherePair(sphere, vec4f(clamp(sphere.xyz, -half, half), 0.0));
        }
        if k < edges(n) {
            return cone_to_cuboid(edge(first, k), half);
        }
        // A face of the slab touches a corner of the box.
        let faces = face_normals((*first).spheres[0], (*first).spheres[1], (*first).spheres[2]);
        if faces.exist {
            let inwards = select(vec3f(-1.0), vec3f(1.0), select(faces.back, faces.front, k == 3u) < vec3f(0.0));
            sphere = vec4f(half * inwards, 0.0);
        }
    } else {
        let vertices = vertex_features(n, m);
        if k >= vertices.x + vertices.y {
            let pair = k - vertices.x - vertices.y;
            return between_cones(edge(first, pair / edges(m)), edge(second, pair % edges(m)));
        }
        is_first = k < vertices.x;
        if is_first {
            sphere = (*first).spheres[k];
            hull = *second;
        } else {
            sphere = (*second).spheres[k - vertices.x];
        }
    }
    let other = nearest(sphere.xyz, &hull);
    if is_first {
        return SpherePair(sphere, other);
    }
    return SpherePair(other, sphere);
}

// Returns the sphere of a primitive that is nearest to a point.
fn nearest(point: vec3f, hull: ptr<function, Hull>) -> vec4f {
    switch (*hull).count {
        case 1u: {
            return (*hull).spheres[0];
        }
        case 2u: {
            return on_cone(point, (*hull).spheres[0], (*hull).spheres[1]);
        }
        default: {
            return on_slab(point, hull);
        }
    }
}

// Two unit directions.
struct Normals {
    front: vec3f,
    back: vec3f,
    // False if there are no such directions.
    exist: bool,
}

// Returns the two unit vectors with the part `part`, which differ in the sign of their component along `across`, at a right angle to it.
fn unit_normals(across: vec3f, part: vec3f) -> Normals {
    let height_squared = 1.0 - dot(part, part);
    let length_squared = dot(across, across);
    if !(height_squared >= 0.0 && length_squared > 0.0) {
        return Normals(vec3f(0.0), vec3f(0.0), false);
    }
    let height = across * sqrt(height_squared / length_squared);
    return Normals(part + height, part - height, true);
}

// Returns the outward directions in which three spheres reach equally far: the normals of a slab's faces.
fn face_normals(a: vec4f, b: vec4f, c: vec4f) -> Normals {
    let u = b - a;
    let v = c - a;
    let normal = cross(u.xyz, v.xyz);
    let det = dot(normal, normal);
    if !(det > 0.0) {
        return Normals(vec3f(0.0), vec3f(0.0), false);
    }
    // Outward: n . u = -growth, so that `n . center + radius` is the same for all spheres.
    return unit_normals(normal, -(cross(v.xyz, normal) * u.w + cross(normal, u.xyz) * v.w) / det);
}

// Returns the same for a cone: the normals of its mantle nearest to `towards` and to the opposite direction.
fn mantle_normals(cone: SpherePair, towards: vec3f) -> Normals {
    let u = cone.second - cone.first;
    let length_squared = dot(u.xyz, u.xyz);
    if !(length_squared > 0.0) {
        return Normals(vec3f(0.0), vec3f(0.0), false);
    }
    var across = towards - u.xyz * (dot(towards, u.xyz) / length_squared);
    if dot(across, across) < 1.0e-2 * dot(towards, towards) {
        // For a vector almost along the axis, the first subtraction leaves little except rounding errors.
        across -= u.xyz * (dot(across, u.xyz) / length_squared);
    }
    if dot(across, across) <= 1.0e-12 * dot(towards, towards) {
        let flat = abs(u.z) < abs(u.x);
        across = select(vec3f(0.0, -u.z, u.y), vec3f(-u.y, u.x, 0.0), flat);
    }
    return unit_normals(across, -u.xyz * (u.w / length_squared));
}

// Returns the two directions, from first to second, that are normal to the mantles of both cones. `u` and `v`: axis and growth of the radius.
fn edge_normals(u: vec4f, v: vec4f) -> Normals {
    let normal = cross(u.xyz, v.xyz);
    let det = dot(normal, normal);
    if !(det > 0.0) {
        return Normals(vec3f(0.0), vec3f(0.0), false);
    }
    return unit_normals(normal, (cross(v.xyz, normal) * -u.w + cross(normal, u.xyz) * v.w) / det);
}

// Tests the unit directions of the features themselves, and the opposite ones. They stay accurate where centres meet, and the best one gives the
// depth of a deep overlap. They are the normals of a primitive's faces, those of its edges' mantles towards `apart` and away from it, the axes of a
// box, and the normals of pairs of edges.
fn look_along_normals(
    best: ptr<function, Best>,
    first: ptr<function, Hull>,
    second: ptr<function, Hull>,
    apart: vec3f,
) {
    let is_box = (*second).count == BOX;
    let edges1 = edges((*first).count);
    let edges2 = select(edges((*second).count), 3u, is_box);
    let own1 = 1u + edges1;
    let own = own1 + 1u + edges2;
    for (var i = 0u; i < own + edges1 * edges2; i++) {
        var normals = Normals(vec3f(0.0), vec3f(0.0), false);
        if i >= own {
            let edge1 = edge(first, (i - own) / edges2);
            let j = (i - own) % edges2;
            var axis = vec4f(0.0);
            if is_box {
                axis[j] = 1.0;
            } else {
                let edge2 = edge(second, j);
                axis = edge2.second - edge2.first;
            }
            normals = edge_normals(edge1.second - edge1.first, axis);
        } else if i >= own1 && is_box {
            if i > own1 {
                normals.front[i - own1 - 1u] = 1.0;
                normals.back = -normals.front;
                normals.exist = true;
            }
        } else {
            var hull = *first;
            var k = i;
            if i >= own1 {
                hull = *second;
                k = i - own1;
            }
            if k > 0u {
                normals = mantle_normals(edge(&hull, k - 1u), apart);
            } else if hull.count == 3u {
                normals = face_normals(hull.spheres[0], hull.spheres[1], hull.spheres[2]);
            }
            if i >= own1 {
                normals.front = -normals.front;
                normals.back = -normals.back;
            }
        }
        for (var side = 0u; normals.exist && side < 2u; side++) {
            look_along(best, select(normals.front, normals.back, side == 1u), first, second);
        }
    }
}
