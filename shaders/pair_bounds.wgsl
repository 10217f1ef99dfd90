// Bounds of a list of moving pairs of one kind: one invocation for each pair. Lengths are in metres.

struct Pair {
    first: Moving,
    second: Moving,
}

@group(0) @binding(0) var<storage, read> pairs: array<Pair>;
// Lower bound of the time of the first touch of each pair, as a fraction of the step, or `NEVER`.
@group(0) @binding(1) var<storage, read_write> bounds: array<f32>;

@compute @workgroup_size(64)
fn pair_bounds(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let index = id.y * (groups.x * 64u) + id.x;
    if index >= arrayLength(&pairs) {
        return;
    }
    let first = pairs[index].first;
    let second = pairs[index].second;
    // Allowance for rounding: a few times the rounding error of coordinates as large as these.
    let size = max(size_of(first), size_of(second));
    let touch = 4.0 * CONTACT_ROUNDING * size;
    bounds[index] = bound(first, second, touch, touch, false).touch;
}

// Returns an upper bound of the coordinates of a side during its motion.
fn size_of(side: Moving) -> f32 {
    let start = max(max_of(abs(side.start.a)), max(max_of(abs(side.start.b)), max_of(abs(side.start.c))));
    let motion = max(abs(side.motion_a), max(abs(side.motion_b), abs(side.motion_c)));
    return start + max(motion.x, max(motion.y, motion.z));
}

fn max_of(v: vec4f) -> f32 {
    return max(max(v.x, v.y), max(v.z, v.w));
}
