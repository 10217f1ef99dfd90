// Times of impact of a list of moving pairs: one invocation each.

struct Pair {
    first: Moving,
    second: Moving,
}

struct Result {
    normal: vec3f,
    distance: f32,
    point1: vec3f,
    fraction: f32,
    status: u32,
    rounds: u32,
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
