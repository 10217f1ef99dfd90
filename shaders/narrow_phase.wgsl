// Pass 7, narrow phase: keeps the candidates that come within the reach of their chord at some time. One invocation for each candidate. Counterpart:
// src/query/rigid.rs.

// Two primitives that meet.
struct Survivor {
    // Index of the pair.
    pair: u32,
    // Primitive of the first side, as an index within its shape.
    first: u32,
    // Primitive of the second side, as an index within its shape; 0 for a box.
    second: u32,
}

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
    let primitive = primitives[shape.primitives + index];
    var found: Moving;
    found.hull.count = sphere_count(primitive);
    for (var i = 0u; i < found.hull.count; i++) {
        let sphere = spheres[shape.spheres + sphere_index(primitive, i)] * scale;
        let first = point_at(start, sphere.xyz);
        found.hull.spheres[i] = vec4f(first, sphere.w);
        found.motion[i] = point_at(end, sphere.xyz) - first;
    }
    return found;
}

@compute @workgroup_size(64)
fn narrow_phase(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let index = id.y * (groups.x * 64u) + id.x;
    if index >= min(atomicLoad(&counters.candidates), params.max_candidates) {
        return;
    }
    let candidate = candidates[index];
    let chord = chords_in[candidate.chord];
    let first = moving(shapes[chord.shape1], candidate.first, chord.scale1, chord.start1, chord.end1);
    var second: Moving;
    if chord.shape2 == BOX_SHAPE {
        second.hull.count = BOX;
        second.hull.spheres[0] = vec4f(chord.half, 0.0);
    } else {
        second = moving(shapes[chord.shape2], candidate.second, chord.scale2, chord.start2, chord.end2);
    }
    if time_of_impact(first, second, chord.reach).status == SEPARATED {
        return;
    }
    let survivor = atomicAdd(&counters.survivors, 1u);
    if survivor < params.max_survivors {
        survivors[survivor] = Survivor(chord.pair, candidate.first, candidate.second);
    }
}
