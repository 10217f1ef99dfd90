// A chord of a pair's motion, as pass 5 writes it and later ones read it.

struct Chord {
    // Where both sides are at its ends, relative to the first body's place at the start of the step; facing a box, in the box's frame.
    start1: Pose,
    end1: Pose,
    start2: Pose,
    end2: Pose,
    // Half the size of the box.
    half: vec3f,
    // Primitives that come as near to each other may meet.
    reach: f32,
    pair: u32,
    shape1: u32,
    shape2: u32,
    scale1: f32,
    scale2: f32,
}

// A shape's place in the buffers of all shapes.
struct Shape {
    spheres: u32,
    primitives: u32,
    primitive_count: u32,
    nodes: u32,
    node_count: u32,
}

// What tells the kinds of primitives by their first number; of a slab it is an index.
const SPHERE: i32 = -2;
const CONE: i32 = -1;

// As the generalized medial mesh has them (paper, section 4.2).
struct Primitive {
    a: i32,
    b: i32,
    c: i32,
}

fn sphere_count(primitive: Primitive) -> u32 {
    return select(select(3u, 2u, primitive.a == CONE), 1u, primitive.a == SPHERE);
}

// The `i`-th sphere of a primitive.
fn sphere_index(primitive: Primitive, i: u32) -> u32 {
    if i == 0u {
        return u32(select(primitive.a, primitive.b, primitive.a < 0));
    }
    if i == 1u {
        return u32(select(primitive.b, primitive.c, primitive.a < 0));
    }
    return u32(primitive.c);
}

// Primitives of a chord's pair that may meet.
struct Candidate {
    chord: u32,
    first: u32,
    second: u32,
}
