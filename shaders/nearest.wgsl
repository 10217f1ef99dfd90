// Nearest spheres of medial cones and boxes, for directions along which they are apart. Counterpart: src/query/nearest.rs. Lengths are in metres.

// A medial cone, with numbers for its nearest sphere to a point.
struct Edge {
    // First sphere `x y z radius`.
    start: vec4f,
    // Difference of the second sphere and the first.
    axis: vec4f,
    // Reciprocal of the squared length of the axis; 0 if one sphere contains the other.
    inverse: f32,
    // Shift of the nearest sphere along the axis, per metre of the point's distance from the axis. It is positive if the radius grows.
    slope: f32,
    // Index of the larger sphere if one contains the other, otherwise 0.
    larger: f32,
}

fn edge(a: vec4f, b: vec4f) -> Edge {
    let axis = b - a;
    let length_squared = dot(axis.xyz, axis.xyz);
    let mantle_squared = length_squared - axis.w * axis.w;
    if !(mantle_squared > 0.0) {
        return Edge(a, axis, 0.0, 0.0, select(0.0, 1.0, axis.w > 0.0));
    }
    let slope = axis.w * inverseSqrt(length_squared) * inverseSqrt(mantle_squared);
    return Edge(a, axis, 1.0 / length_squared, slope, 0.0);
}

// Returns the sphere of a cone at a fraction of its axis, or at the end if the fraction is outside of 0 to 1.
fn sphere_at(cone: Edge, fraction: f32) -> vec4f {
    return cone.start + cone.axis * clamp(fraction, 0.0, 1.0);
}

// Returns the sphere of a cone that is nearest to a point: the foot of the perpendicular on the axis, shifted by the slope.
fn on_edge(point: vec3f, cone: Edge) -> vec4f {
    let to_point = point - cone.start.xyz;
    let foot = dot(to_point, cone.axis.xyz) * cone.inverse;
    let height = length(to_point - cone.axis.xyz * foot);
    return sphere_at(cone, foot + height * cone.slope + cone.larger);
}

// Returns the unit vector along a vector, or any for a vector of length 0.
fn unit(v: vec3f) -> vec3f {
    let length = length(v);
    return select(vec3f(0.0, 1.0, 0.0), v / length, length > 0.0);
}

// Returns the fractions along two cones of the spheres with which they cross. Without a crossing they are 0.
fn crossing(cone1: Edge, cone2: Edge) -> vec2f {
    let u = cone1.axis;
    let v = cone2.axis;
    let offset = cone1.start.xyz - cone2.start.xyz;
    let normal = cross(u.xyz, v.xyz);
    let uu = dot(u.xyz, u.xyz);
    let uv = dot(u.xyz, v.xyz);
    let vv = dot(v.xyz, v.xyz);
    let det = dot(normal, normal);
    let x = u.w * vv + v.w * uv;
    let y = -(v.w * uu + u.w * uv);
    let slope_squared = (x * u.w - y * v.w) / det;
    // Parallel axes do not cross.
    if !(det > 1.0e-12 * uu * vv && slope_squared < 1.0) {
        return vec2f(0.0);
    }
    let distance = abs(dot(offset, normal)) / sqrt(det * (1.0 - slope_squared));
    let p = distance * u.w - dot(offset, u.xyz);
    let q = -distance * v.w - dot(offset, v.xyz);
    return vec2f(p * vv - q * uv, p * uv - q * uu) / det;
}

// Tests the spheres of two cones where they cross, and the ends of each cone against the other one.
fn between_edges(given: Nearest, cone1: Edge, cone2: Edge) -> Nearest {
    let at = crossing(cone1, cone2);
    let end1 = cone1.start + cone1.axis;
    let end2 = cone2.start + cone2.axis;
    var best = nearer(given, sphere_at(cone1, at.x), sphere_at(cone2, at.y));
    best = nearer(best, cone1.start, on_edge(cone1.start.xyz, cone2));
    best = nearer(best, end1, on_edge(end1.xyz, cone2));
    best = nearer(best, on_edge(cone2.start.xyz, cone1), cone2.start);
    return nearer(best, on_edge(end2.xyz, cone1), end2);
}

// Keeps the part of a range of fractions that contains the sphere nearest to the box around the origin. The fraction divides the range.
fn halved(range: vec2f, fraction: f32, cone: Edge, half: vec3f) -> vec2f {
    if !(fraction > range.x && fraction < range.y) {
        return range;
    }
    let point = cone.start.xyz + cone.axis.xyz * fraction;
    let outside = point - clamp(point, -half, half);
    // Derivative of the distance between the sphere and the box along the axis, times the distance of its centre.
    let rise = dot(outside, cone.axis.xyz) - cone.axis.w * length(outside);
    if rise < 0.0 || (all(outside == vec3f(0.0)) && cone.axis.w > 0.0) {
        return vec2f(fraction, range.y);
    }
    return vec2f(range.x, fraction);
}

// Tests the sphere of a cone that is nearest to the box `[-half, half]`.
fn edge_to_box(best: Nearest, cone: Edge, half: vec3f) -> Nearest {
    let a = cone.start.xyz;
    let axis = cone.axis.xyz;
    // Fractions at which the axis crosses the planes of the faces. A coordinate that does not change crosses none.
    let inverse = select(1.0 / axis, vec3f(0.0), axis == vec3f(0.0));
    let t1 = (-half - a) * inverse;
    let t2 = (half - a) * inverse;
    var range = vec2f(0.0, 1.0);
    range = halved(range, t1.x, cone, half);
    range = halved(range, t2.x, cone, half);
    range = halved(range, t1.y, cone, half);
    range = halved(range, t2.y, cone, half);
    range = halved(range, t1.z, cone, half);
    range = halved(range, t2.z, cone, half);
    // In this range the same coordinates are outside of the box. Their part of the distance is that to a point in a subspace.
    let middle = a + axis * ((range.x + range.y) * 0.5);
    let clamped = clamp(middle, -half, half);
    let outside = select(vec3f(0.0), vec3f(1.0), middle != clamped);
    let part = edge(vec4f((a - clamped) * outside, 0.0), vec4f((a + axis - clamped) * outside, cone.axis.w));
    let foot = -dot(part.start.xyz, part.axis.xyz) * part.inverse;
    let height = length(part.start.xyz + part.axis.xyz * foot);
    let sphere = sphere_at(cone, clamp(foot + height * part.slope + part.larger, range.x, range.y));
    return nearer(best, sphere, vec4f(clamp(sphere.xyz, -half, half), 0.0));
}
