// Closed forms for the sphere of a primitive that is nearest to a point, or to a sphere of another primitive. Counterpart: src/query/nearest.rs.

// Distance of a point to a sphere's surface, in metres.
fn gap(point: vec3f, sphere: vec4f) -> f32 {
    return distance(sphere.xyz, point) - sphere.w;
}

// The interpolated sphere between `a` (`t = 0`) and `b` (`t = 1`).
fn between_spheres(a: vec4f, b: vec4f, t: f32) -> vec4f {
    return a * (1.0 - t) + b * t;
}

// The sphere of the medial cone `a`-`b` that is nearest to a point: the foot of the perpendicular on the axis, shifted towards the
// larger end by the slope of the mantle.
fn on_cone(point: vec3f, a: vec4f, b: vec4f) -> vec4f {
    let axis = b.xyz - a.xyz;
    let growth = b.w - a.w;
    let length_squared = dot(axis, axis);
    let mantle_squared = length_squared - growth * growth;
    if mantle_squared <= 0.0 {
        if growth > 0.0 {
            return b;
        }
        return a;
    }
    let to_point = point - a.xyz;
    let foot = dot(to_point, axis) / length_squared;
    let height = length(to_point - axis * foot);
    let t = foot + height * growth / (sqrt(length_squared) * sqrt(mantle_squared));
    return between_spheres(a, b, clamp(t, 0.0, 1.0));
}

// The sphere of the medial slab that is nearest to a point.
fn on_slab(point: vec3f, hull: ptr<function, Hull>) -> vec4f {
    let a = (*hull).spheres[0];
    let e2 = (*hull).spheres[1] - a;
    let e3 = (*hull).spheres[2] - a;
    let normal = cross(e2.xyz, e3.xyz);
    let d22 = dot(e2.xyz, e2.xyz);
    let d23 = dot(e2.xyz, e3.xyz);
    let d33 = dot(e3.xyz, e3.xyz);
    let det = dot(normal, normal);
    var facing = vec3<bool>(true);
    var is_inside = false;
    var inside = a;
    if det > 0.0 {
        // The in-plane gradient of the radius is g2 e2 + g3 e3.
        let g2 = (e2.w * d33 - e3.w * d23) / det;
        let g3 = (e3.w * d22 - e2.w * d23) / det;
        let slope_squared = e2.w * g2 + e3.w * g3;
        if slope_squared < 1.0 {
            let to_point = point - a.xyz;
            let p2 = dot(to_point, e2.xyz);
            let p3 = dot(to_point, e3.xyz);
            let shift = abs(dot(to_point, normal)) / sqrt(det * (1.0 - slope_squared));
            let w2 = (p2 * d33 - p3 * d23) / det + shift * g2;
            let w3 = (p3 * d22 - p2 * d23) / det + shift * g3;
            let outside = vec3f(1.0 - w2 - w3, w2, w3) < vec3f(0.0);
            is_inside = !any(outside);
            inside = a + e2 * w2 + e3 * w3;
            if det >= ILL_CONDITIONED * d22 * d33 {
                if is_inside {
                    return inside;
                }
                facing = outside;
            }
        }
    }
    // The nearest sphere on edges opposite to vertices with a negative weight, or on all edges if the face is degenerate or ill-conditioned.
    var best = inside;
    var least = select(MAX, gap(point, inside), is_inside);
    for (var vertex = 0u; vertex < 3u; vertex++) {
        if facing[vertex] {
            let sphere = on_cone(point, (*hull).spheres[(vertex + 1u) % 3u], (*hull).spheres[(vertex + 2u) % 3u]);
            let distance = gap(point, sphere);
            if distance < least {
                least = distance;
                best = sphere;
            }
        }
    }
    return best;
}

// The spheres of two medial cones, one of each, that are nearest to each other.
fn between_cones(cone1: SpherePair, cone2: SpherePair) -> SpherePair {
    let u = cone1.second - cone1.first;
    let v = cone2.second - cone2.first;
    let alpha = u.w;
    let beta = v.w;
    let offset = cone1.first.xyz - cone2.first.xyz;
    let normal = cross(u.xyz, v.xyz);
    let uu = dot(u.xyz, u.xyz);
    let uv = dot(u.xyz, v.xyz);
    let vv = dot(v.xyz, v.xyz);
    let det = dot(normal, normal);
    var facing = vec4<bool>(true);
    var best = SpherePair(cone1.first, cone2.first);
    var least = MAX;
    if det > 1.0e-12 * uu * vv {
        let x = (alpha * vv + beta * uv) / det;
        let y = -(beta * uu + alpha * uv) / det;
        let slope_squared = x * alpha - y * beta;
        if slope_squared < 1.0 {
            let distance = abs(dot(offset, normal)) / sqrt(det * (1.0 - slope_squared));
            let p = distance * alpha - dot(offset, u.xyz);
            let q = -distance * beta - dot(offset, v.xyz);
            let s = (p * vv - q * uv) / det;
            let t = (p * uv - q * uu) / det;
            let outside = vec4f(s, 1.0 - s, t, 1.0 - t) < vec4f(0.0);
            if !any(outside) {
                best.first = between_spheres(cone1.first, cone1.second, s);
                best.second = between_spheres(cone2.first, cone2.second, t);
                least = gap(best.first.xyz, best.second) - best.first.w;
            }
            if det > ILL_CONDITIONED * uu * vv {
                if !any(outside) {
                    return best;
                }
                facing = outside;
            }
        }
    }
    // Each end of the first axis against the second cone, then each end of the second axis against the first cone.
    for (var side = 0u; side < 4u; side++) {
        if facing[side] {
            var end = cone1;
            var cone = cone2;
            if side >= 2u {
                end = cone2;
                cone = cone1;
            }
            let sphere = select(end.first, end.second, (side & 1u) == 1u);
            let other = on_cone(sphere.xyz, cone.first, cone.second);
            let distance = gap(sphere.xyz, other) - sphere.w;
            if distance < least {
                least = distance;
                best.first = select(sphere, other, side >= 2u);
                best.second = select(other, sphere, side >= 2u);
            }
        }
    }
    return best;
}

// Derivative of the distance between a cone's sphere and the box along the axis.
fn cone_to_cuboid_slope(point: vec3f, axis: vec3f, growth: f32, half: vec3f) -> f32 {
    let outside = point - clamp(point, -half, half);
    let length = length(outside);
    if length > 0.0 {
        return dot(outside, axis) / length - growth;
    }
    return -growth;
}

// The sphere of a medial cone that is nearest to the box, and the box's point nearest to its centre.
fn cone_to_cuboid(cone: SpherePair, half: vec3f) -> SpherePair {
    let a = cone.first;
    let axis = cone.second.xyz - a.xyz;
    let growth = cone.second.w - a.w;
    var low = 0.0;
    var high = 1.0;
    for (var k = 0u; k < 3u; k++) {
        if axis[k] == 0.0 {
            continue;
        }
        for (var side = -1.0; side < 2.0; side += 2.0) {
            let t = (side * half[k] - a[k]) / axis[k];
            if t > low && t < high {
                if cone_to_cuboid_slope(a.xyz + axis * t, axis, growth, half) < 0.0 {
                    low = t;
                } else {
                    high = t;
                }
            }
        }
    }
    // Between `low` and `high` the same coordinates are outside of the box. Their part of the distance is that to a point in a subspace.
    let middle = a.xyz + axis * ((low + high) * 0.5);
    let clamped = clamp(middle, -half, half);
    let outside = select(vec3f(0.0), vec3f(1.0), middle != clamped);
    let direction = axis * outside;
    let start = (a.xyz - clamped) * outside;
    let length_squared = dot(direction, direction);
    let mantle_squared = length_squared - growth * growth;
    var t = select(low, high, growth > 0.0);
    if mantle_squared > 0.0 {
        let foot = -dot(start, direction) / length_squared;
        let height = length(start + direction * foot);
        t = clamp(foot + height * growth / (sqrt(length_squared) * sqrt(mantle_squared)), low, high);
    }
    let sphere = between_spheres(a, cone.second, t);
    return SpherePair(sphere, vec4f(clamp(sphere.xyz, -half, half), 0.0));
}
