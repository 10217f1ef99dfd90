// Pass 6, mid phase: finds the primitives of a pair whose moving boxes meet along a chord. Each chord has workgroups for the primitives of its first
// side. Each invocation traverses the hierarchy of the second side for one of them. Counterpart: src/pipeline/sweep/mid_phase.rs.

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> shapes: array<Shape>;
@group(0) @binding(2) var<storage, read> spheres: array<vec4f>;
@group(0) @binding(3) var<storage, read> primitives: array<Primitive>;
// Nodes of the hierarchies over the shapes' primitives, without scale.
@group(0) @binding(4) var<storage, read> nodes: array<BvhNode>;
@group(0) @binding(5) var<storage, read> chords_in: array<Chord>;
@group(0) @binding(6) var<storage, read_write> counters: Counters;
@group(0) @binding(7) var<storage, read_write> candidates: array<Candidate>;

// A box whose sides move at a constant speed from a start to an end.
struct MovingBox {
    // Corners at the start of the chord, in metres.
    start_low: vec3f,
    start_high: vec3f,
    // Corners at the end of the chord, in metres.
    end_low: vec3f,
    end_high: vec3f,
}

// Returns true if the boxes come within `reach` metres of each other along all axes at the same time.
fn meets(a: MovingBox, b: MovingBox, reach: f32) -> bool {
    var first_time = 0.0;
    var last_time = 1.0;
    for (var side = 0u; side < 2u; side++) {
        let start = select(a.start_high - b.start_low, b.start_high - a.start_low, side == 0u) + reach;
        let end = select(a.end_high - b.end_low, b.end_high - a.end_low, side == 0u) + reach;
        for (var axis = 0u; axis < 3u; axis++) {
            if start[axis] < 0.0 && end[axis] < 0.0 {
                return false;
            }
            if start[axis] < 0.0 {
                first_time = max(first_time, start[axis] / (start[axis] - end[axis]));
            } else if end[axis] < 0.0 {
                last_time = min(last_time, start[axis] / (start[axis] - end[axis]));
            }
        }
    }
    return first_time <= last_time + 1.0e-6;
}

fn primitive_box(chord: u32, shape: Shape, index: u32) -> MovingBox {
    let primitive = primitives[shape.primitives + index];
    let start = chords_in[chord].start1;
    let end = chords_in[chord].end1;
    let scale = chords_in[chord].scale1;
    var found = MovingBox(vec3f(MAX), vec3f(-MAX), vec3f(MAX), vec3f(-MAX));
    let indices = shape.spheres + sphere_indices(primitive);
    for (var i = 0u; i < 3u; i++) {
        let sphere = spheres[indices[i]] * scale;
        let first = point_at(start, sphere.xyz);
        let last = point_at(end, sphere.xyz);
        found.start_low = min(found.start_low, first - sphere.w);
        found.start_high = max(found.start_high, first + sphere.w);
        found.end_low = min(found.end_low, last - sphere.w);
        found.end_high = max(found.end_high, last + sphere.w);
    }
    return found;
}

// Returns the matrix of a rotation.
fn matrix(q: vec4f) -> mat3x3f {
    return mat3x3f(
        rotate(q, vec3f(1.0, 0.0, 0.0)),
        rotate(q, vec3f(0.0, 1.0, 0.0)),
        rotate(q, vec3f(0.0, 0.0, 1.0)),
    );
}

fn slabs(shape: Shape, index: u32) -> u32 {
    return select(0u, 1u, is_slab(primitives[shape.primitives + index]));
}

fn add(kind: u32, chord: u32, first: u32, second: u32) {
    let candidate = atomicAdd(&counters.candidates[kind], 1u);
    if candidate < max_candidates(kind) {
        candidates[first_candidate(kind) + candidate] = Candidate(chord, first, second);
    } else if candidate >= MANY {
        atomicStore(&counters.candidates[kind], MANY);
    }
}

@compute @workgroup_size(64)
fn mid_phase(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let chord = group.y * groups.x + group.x;
    if chord >= min(atomicLoad(&counters.chords), params.max_chords) {
        return;
    }
    let reach = chords_in[chord].reach;
    let shape1 = shapes[chords_in[chord].shape1];
    let i = group.z * 64u + thread;
    if i >= shape1.primitive_count {
        return;
    }
    let is_flat = params.is_flat != 0u;
    let own = primitive_box(chord, shape1, i);
    let own_slabs = slabs(shape1, i);
    let second = chords_in[chord].shape2;
    if second == BOX_SHAPE {
        let half = chords_in[chord].half;
        if is_flat || meets(own, MovingBox(-half, half, -half, half), reach) {
            add(kind_of(own_slabs, true), chord, i, 0u);
        }
        return;
    }
    let shape2 = shapes[second];
    let scale = chords_in[chord].scale2;
    let start = chords_in[chord].start2;
    let end = chords_in[chord].end2;
    let start_turn = matrix(start.rotation);
    let end_turn = matrix(end.rotation);
    let start_size = mat3x3f(abs(start_turn[0]), abs(start_turn[1]), abs(start_turn[2]));
    let end_size = mat3x3f(abs(end_turn[0]), abs(end_turn[1]), abs(end_turn[2]));
    for (var n = 0u; n < shape2.node_count;) {
        let node = nodes[shape2.nodes + n];
        let center = (node.low + node.high) * (0.5 * scale);
        let half = (node.high - node.low) * (0.5 * scale);
        let first = start_turn * center + start.translation;
        let first_half = start_size * half;
        let last = end_turn * center + end.translation;
        let last_half = end_size * half;
        let other = MovingBox(first - first_half, first + first_half, last - last_half, last + last_half);
        let is_leaf = (node.link & LEAF) != 0u;
        let is_near = is_flat || meets(own, other, reach);
        if is_near && is_leaf {
            let item = node.link & ~LEAF;
            add(kind_of(own_slabs + slabs(shape2, item), false), chord, i, item);
        }
        n = select(node.link, n + 1u, is_near || is_leaf);
    }
}
