// A list of moving pairs of one kind: one invocation for each pair. Another file defines `result_of`. Lengths are in metres.

struct Pair {
    first: Moving,
    second: Moving,
}

@group(0) @binding(0) var<storage, read> pairs: array<Pair>;
// The result of each pair: a fraction of the step, or `NEVER`.
@group(0) @binding(1) var<storage, read_write> results: array<f32>;

@compute @workgroup_size(64)
fn pairs_of_kind(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let index = id.y * (groups.x * 64u) + id.x;
    if index < arrayLength(&pairs) {
        results[index] = result_of(pairs[index].first, pairs[index].second);
    }
}
