// Pass 5: computes the poses of the bodies of each pair at both ends of each of its chords. Counterpart: src/query/rigid.rs.

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> bodies: array<Body>;
@group(0) @binding(2) var<storage, read> statics: array<Static>;
@group(0) @binding(3) var<storage, read_write> counters: Counters;
@group(0) @binding(4) var<storage, read> pairs: array<Pair>;
@group(0) @binding(5) var<storage, read> pair_chords: array<vec3u>;
@group(0) @binding(6) var<storage, read_write> chords_out: array<Chord>;

// Returns a pose as seen from a frame.
fn seen_from(frame: Pose, pose: Pose) -> Pose {
    let turn = reversed(frame.rotation);
    return Pose(times(turn, pose.rotation), rotate(turn, pose.translation - frame.translation));
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
    chord.start2 = Pose(vec4f(0.0, 0.0, 0.0, 1.0), vec3f(0.0));
    chord.end2 = chord.start2;
    // Deviations of points from the chord, and from the shortest chord of the CPU.
    var strays = body1.slack;
    var fine_strays = 0.0;
    var size = body1.bound.w;
    var smaller = size;
    var path_lengths = path_length(body1);
    // Distances from the origin of the world.
    var far = length(body1.position);
    if (pair.second & STATIC) != 0u {
        let wall = statics[pair.second & ~STATIC];
        let origin = select(wall.position, wall.center, wall.shape == BOX_SHAPE);
        let frame = Pose(wall.rotation, vec3f(0.0));
        chord.start1 = seen_from(frame, pose_at(body1, start, origin));
        chord.end1 = seen_from(frame, pose_at(body1, end, origin));
        chord.half = wall.half;
        chord.shape2 = wall.shape;
        chord.scale2 = wall.scale;
        strays += sagitta(body1, body1.arm, count) + wall.rounding;
        fine_strays = sagitta(body1, body1.arm, MAX_ITERATIONS);
        size += wall.radius;
        far += length(wall.position);
        smaller = min(smaller, wall.radius);
    } else {
        let body2 = bodies[pair.second];
        chord.start1 = pose_at(body1, start, body1.position);
        chord.end1 = pose_at(body1, end, body1.position);
        let start2 = pose_at(body2, start, body1.position);
        let end2 = pose_at(body2, end, body1.position);
        if body2.shape == BOX_SHAPE {
            chord.start1 = seen_from(start2, chord.start1);
            chord.end1 = seen_from(end2, chord.end1);
            chord.start1.translation -= body2.bound.xyz;
            chord.end1.translation -= body2.bound.xyz;
            chord.half = body2.half;
        } else {
            chord.start2 = start2;
            chord.end2 = end2;
        }
        chord.shape2 = select(body2.shape & ~DEFORMING, BOX_SHAPE, body2.shape == BOX_SHAPE);
        chord.scale2 = body2.scale;
        strays += body2.slack + deviation(body1, body2, count) + body2.rounding;
        fine_strays = deviation(body1, body2, MAX_ITERATIONS);
        size += body2.bound.w;
        far += length(body2.position);
        smaller = min(smaller, body2.bound.w);
        path_lengths += path_length(body2);
    }
    // Allowance for rounding: a few times the rounding error of coordinates as large as these.
    let near = 4.0 * size + path_lengths + length(chord.start1.translation) + length(chord.start2.translation);
    // The CPU ends the step at poses that are rounded in the world.
    let rounding = CONTACT_ROUNDING * near + 4.0 * EPSILON * far;
    // The CPU searches along chords of its own and enlarges the first side by their deviation. Impacts are early by at most twice that deviation.
    let fine = max(FINE_CHORD_TOLERANCE * smaller, fine_strays);
    chord.touch = fine + max(params.touch, fine) + strays + rounding;
    chord.reach = max(params.prediction + strays + rounding, chord.touch);
    chord.begin = start;
    chord.length = 1.0 / f32(count);
    chords_out[index] = chord;
}
