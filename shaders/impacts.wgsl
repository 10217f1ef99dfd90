// Times of impact of a list of moving pairs: one invocation for each pair. Lengths are in metres.

struct Pair {
    first: Moving,
    second: Moving,
}

// Counterpart of `TimeOfImpact` in src/query/time_of_impact.rs.
struct Result {
    // Unit normal from the first side to the second.
    normal: vec3f,
    // Distance along the normal, negative for an overlap.
    distance: f32,
    // Point of the first surface.
    point1: vec3f,
    // Time as a fraction of the step.
    fraction: f32,
    // One of the constants of time_of_impact.wgsl.
    status: u32,
    // Number of iterations.
    rounds: u32,
    // Index of the nearest pair of features.
    feature: u32,
}

@group(0) @binding(0) var<storage, read> pairs: array<Pair>;
@group(0) @binding(1) var<storage, read_write> results: array<Result>;

@compute @workgroup_size(64)
fn impacts(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= arrayLength(&pairs) {
        return;
    }
    let found = time_of_impact(pairs[id.x].first, pairs[id.x].second, 0.0);
    let contact = found.separation;
    results[id.x] = Result(
        contact.normal,
        contact.distance,
        contact.point1,
        found.fraction,
        found.status,
        found.rounds,
        contact.feature,
    );
}
