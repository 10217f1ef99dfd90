// Pass 7, narrow phase: keeps the candidates that come within the reach of their chord, with bounds. One invocation for each candidate. Each shader
// handles the candidates of the kind `KIND`.

// Two primitives that may meet.
struct Survivor {
    // Index of the pair.
    pair: u32,
    // Primitive of the first side, as an index within its shape.
    first: u32,
    // Primitive of the second side, as an index within its shape; 0 for a box. With `NEAR_AT_END` if they may be within the reach at the end of the step.
    second: u32,
    // Lower bound of the time of the first touch, as a fraction of the step, or `NEVER`.
    touch: f32,
}

const NEAR_AT_END: u32 = 0x80000000u;

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> shapes: array<Shape>;
@group(0) @binding(2) var<storage, read> spheres: array<vec4f>;
@group(0) @binding(3) var<storage, read> primitives: array<Primitive>;
@group(0) @binding(4) var<storage, read> chords_in: array<Chord>;
@group(0) @binding(5) var<storage, read> candidates: array<Candidate>;
@group(0) @binding(6) var<storage, read_write> counters: Counters;
@group(0) @binding(7) var<storage, read_write> survivors: array<Survivor>;

// Returns the motion of a primitive along a chord.
fn moving(shape: Shape, index: u32, scale: f32, start: Pose, end: Pose) -> Moving {
    let at = shape.spheres + sphere_indices(primitives[shape.primitives + index]);
    let a = spheres[at.x] * scale;
    let b = spheres[at.y] * scale;
    let c = spheres[at.z] * scale;
    let first = Spheres(
        vec4f(point_at(start, a.xyz), a.w),
        vec4f(point_at(start, b.xyz), b.w),
        vec4f(point_at(start, c.xyz), c.w),
    );
    return Moving(
        first,
        point_at(end, a.xyz) - first.a.xyz,
        point_at(end, b.xyz) - first.b.xyz,
        point_at(end, c.xyz) - first.c.xyz,
    );
}

@compute @workgroup_size(64)
fn narrow_phase(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let index = id.y * (groups.x * 64u) + id.x;
    if index >= min(atomicLoad(&counters.candidates[KIND]), max_candidates(KIND)) {
        return;
    }
    let candidate = candidates[first_candidate(KIND) + index];
    let chord = chords_in[candidate.chord];
    var first = moving(shapes[chord.shape1], candidate.first, chord.scale1, chord.start1, chord.end1);
    var second: Moving;
    if IS_BOX {
        second.start.a = vec4f(chord.half, 0.0);
    } else {
        second = moving(shapes[chord.shape2], candidate.second, chord.scale2, chord.start2, chord.end2);
        // The slab is the second side. The bounds do not depend on the order.
        if IS_SLAB2 && !IS_SLAB1 && is_slab(primitives[shapes[chord.shape1].primitives + candidate.first]) {
            let other = first;
            first = second;
            second = other;
        }
    }
    let is_last = chord.begin + chord.length >= 1.0;
    let found = bound(first, second, chord.reach, chord.touch, is_last);
    if !found.is_near {
        return;
    }
    let survivor = atomicAdd(&counters.survivors, 1u);
    if survivor >= params.max_survivors {
        return;
    }
    // Rounded down.
    let touch = select((chord.begin + chord.length * found.touch) * (1.0 - 1.0e-6), NEVER, found.touch > 1.0);
    let flag = select(0u, NEAR_AT_END, found.is_near_at_end);
    survivors[survivor] = Survivor(chord.pair, candidate.first, candidate.second | flag, touch);
}
