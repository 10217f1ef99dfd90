// The bound of a pair in a list. Lengths are in metres.

// Returns a lower bound of the time of the first touch, as a fraction of the step, or `NEVER`.
fn result_of(first: Moving, second: Moving) -> f32 {
    // Allowance for rounding: a few times the rounding error of coordinates as large as these.
    let size = max(size_of(first), size_of(second));
    let touch = 4.0 * CONTACT_ROUNDING * size;
    return bound(first, second, touch, touch, false).touch;
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
