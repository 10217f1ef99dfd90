// A chord of a pair's motion, which pass 5 writes and later passes read. Lengths are in metres.

struct Chord {
    // Poses of both sides at the ends of the chord. They are relative to the first body's position at the start of the step, or, if the second side
    // is static, in its frame.
    start1: Pose,
    end1: Pose,
    start2: Pose,
    end2: Pose,
    // Half extents of the static's box.
    half: vec3f,
    // Primitives that come within this distance of each other may have contacts.
    reach: f32,
    // Index of the pair.
    pair: u32,
    // Indices of the shapes; the second one may be `BOX_SHAPE`.
    shape1: u32,
    shape2: u32,
    // Factors on the lengths of the shapes.
    scale1: f32,
    scale2: f32,
    // Primitives that come within this distance of each other may touch.
    touch: f32,
    // Start and length of the chord, as fractions of the step.
    begin: f32,
    length: f32,
}

// Place of a shape in the buffers of all shapes.
struct Shape {
    // Index of its first sphere.
    spheres: u32,
    // Index of its first primitive.
    primitives: u32,
    // Number of its primitives.
    primitive_count: u32,
    // Index of the first node of the hierarchy over its primitives.
    nodes: u32,
    // Number of nodes in that hierarchy.
    node_count: u32,
}

// Kinds of primitives, in their first number. For a slab that number is an index.
const SPHERE: i32 = -2;
const CONE: i32 = -1;

// A primitive of the generalized medial mesh (paper, section 4.2).
struct Primitive {
    // `SPHERE` or `CONE`, or the first sphere of a slab.
    a: i32,
    // The sphere, the first sphere of a cone, or the second of a slab.
    b: i32,
    // The second sphere of a cone, or the third of a slab.
    c: i32,
}

// Returns the indices of the spheres of a primitive. A sphere has three equal indices, and the last two of a cone are equal.
fn sphere_indices(primitive: Primitive) -> vec3u {
    if primitive.a == SPHERE {
        return vec3u(u32(primitive.b));
    }
    return vec3u(u32(select(primitive.a, primitive.b, primitive.a == CONE)), u32(select(primitive.b, primitive.c, primitive.a == CONE)), u32(primitive.c));
}

fn is_slab(primitive: Primitive) -> bool {
    return primitive.a >= 0;
}

// Two primitives of a chord's pair that may meet.
struct Candidate {
    // Index of the chord.
    chord: u32,
    // Primitive of the first side, as an index within its shape.
    first: u32,
    // Primitive of the second side, as an index within its shape; 0 for a box.
    second: u32,
}
