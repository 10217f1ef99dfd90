// Pass 5: computes the poses of the bodies of each pair at both ends of each of its chords. Counterpart: src/query/rigid.rs.

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> bodies: array<Body>;
@group(0) @binding(2) var<storage, read> statics: array<Static>;
@group(0) @binding(3) var<storage, read_write> counters: Counters;
@group(0) @binding(4) var<storage, read> pairs: array<Pair>;
@group(0) @binding(5) var<storage, read> pair_chords: array<vec3u>;
@group(0) @binding(6) var<storage, read_write> chords_out: array<Chord>;

// Returns a pose in the frame of a static. The pose is relative to the origin of that frame.
fn seen_from(wall: Static, pose: Pose) -> Pose {
    let turn = reversed(wall.rotation);
    return Pose(times(turn, pose.rotation), rotate(turn, pose.translation));
}

@compute @workgroup_size(64)
fn place_chords(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let index = id.y * (groups.x * 64u) + id.x;
    if index >= min(atomicLoad(&counters.chords), params.max_chords) {
        return;
    }
    let pair = pairs[pair_chords[index].x];
    let count = pair_chords[index].z;
    let start = f32(pair_chords[index].y) / f32(count);
    let end = f32(pair_chords[index].y + 1u) / f32(count);

    let body1 = bodies[pair.first];
    var chord: Chord;
    chord.pair = pair_chords[index].x;
    chord.shape1 = body1.shape;
    chord.scale1 = body1.scale;
    chord.scale2 = 1.0;
    var strays = body1.slack + sagitta(body1, body1.arm, count);
    var size = body1.bound.w;
    var smaller = size;
    var path_lengths = path_length(body1);
    if (pair.second & STATIC) != 0u {
        let wall = statics[pair.second & ~STATIC];
        let is_box = wall.shape == BOX_SHAPE;
        let origin = select(wall.position, wall.center, is_box);
        chord.start1 = seen_from(wall, pose_at(body1, start, origin));
        chord.end1 = seen_from(wall, pose_at(body1, end, origin));
        chord.start2 = Pose(vec4f(0.0, 0.0, 0.0, 1.0), vec3f(0.0));
        chord.end2 = chord.start2;
        chord.half = wall.half;
        chord.shape2 = wall.shape;
        chord.scale2 = wall.scale;
        strays += wall.rounding;
        size += wall.radius;
        smaller = min(smaller, wall.radius);
    } else {
        let body2 = bodies[pair.second];
        chord.start1 = pose_at(body1, start, body1.position);
        chord.end1 = pose_at(body1, end, body1.position);
        chord.start2 = pose_at(body2, start, body1.position);
        chord.end2 = pose_at(body2, end, body1.position);
        chord.shape2 = body2.shape;
        chord.scale2 = body2.scale;
        strays += body2.slack + sagitta(body2, body2.arm, count);
        size += body2.bound.w;
        smaller = min(smaller, body2.bound.w);
        path_lengths += path_length(body2);
    }
    // Allowance for rounding: a few times the rounding error of coordinates as large as these.
    let rounding = CONTACT_ROUNDING * (4.0 * size + path_lengths + length(chord.start1.translation) + length(chord.start2.translation));
    // Deviation of both sides from the CPU's own chords, along which it searches.
    let stray = 2.0 * FINE_CHORD_TOLERANCE * smaller;
    chord.reach = max(params.prediction, max(params.touch, stray) + stray) + strays + rounding;
    chords_out[index] = chord;
}
