// What the passes of a step share.

// Marks statics among the sides of pairs.
const STATIC: u32 = 0x80000000u;
// Marks the second side of pairs whose primitives the CPU finds.
const UNKNOWN: u32 = 0x40000000u;

struct Params {
    bodies: u32,
    // The least power of two that is no less.
    leaves: u32,
    static_nodes: u32,
    // Contacts are wanted up to this distance.
    prediction: f32,
    // Space as the bodies' order divides it: least corner, and cells per metre.
    low: vec3f,
    max_pairs: u32,
    cells: vec3f,
    max_chords: u32,
    max_candidates: u32,
    max_survivors: u32,
    // Distance at which bodies are in touch.
    touch: f32,
}

// Where counters stop: more than there is ever room for, and far enough from the end of their range for all that is added meanwhile.
const MANY: u32 = 0x80000000u;

// How many there are of each. They count on where a buffer is full.
struct Counters {
    pairs: atomic<u32>,
    chords: atomic<u32>,
    candidates: atomic<u32>,
    survivors: atomic<u32>,
}

// Two sides that may meet: indices of bodies, or of statics with `STATIC`. The first is medial.
struct Pair {
    first: u32,
    second: u32,
}

// What a body sweeps, as a medial cone.
struct Swept {
    // Bounding sphere at the start of the step, as large as what the body may reach.
    sphere: vec4f,
    motion: vec3f,
}

// Of the tree over the bodies.
struct TreeNode {
    low: vec3f,
    // Of a leaf.
    body: u32,
    high: vec3f,
}

// Of a hierarchy that the CPU has built, in depth-first order.
struct BvhNode {
    low: vec3f,
    // The node that follows the subtree; of a leaf its item, with `LEAF`.
    link: u32,
    high: vec3f,
}

const LEAF: u32 = 0x80000000u;
