// The nearest spheres so far.
struct Nearest {
    // Difference of their centres, from the first side to the second.
    apart: vec3f,
    // Distance of their surfaces.
    distance: f32,
}

const FAR: Nearest = Nearest(vec3f(0.0, 1.0, 0.0), MAX);

fn nearer(best: Nearest, first: vec4f, second: vec4f) -> Nearest {
    let apart = second.xyz - first.xyz;
    let distance = length(apart) - first.w - second.w;
    if distance < best.distance {
        return Nearest(apart, distance);
    }
    return best;
}
