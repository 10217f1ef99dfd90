// Types that the passes of a step share. Lengths are in metres.

// Flag of statics among the sides of pairs.
const STATIC: u32 = 0x80000000u;
// Flag of the second side of pairs whose primitives the CPU finds.
const UNKNOWN: u32 = 0x40000000u;

struct Params {
    // Number of bodies.
    bodies: u32,
    // Number of leaves of the tree over the bodies: the smallest power of two that is not less than the number of bodies.
    leaves: u32,
    // Number of nodes of the hierarchy over the statics.
    static_nodes: u32,
    // Distance up to which contacts are needed.
    prediction: f32,
    // Lower corner of the grid that defines the order of bodies, in the world.
    low: vec3f,
    // Capacity of the buffer of pairs, in elements.
    max_pairs: u32,
    // Cells of that grid per metre, along each axis.
    cells: vec3f,
    // Capacities of the buffers of chords and survivors, in elements.
    max_chords: u32,
    max_survivors: u32,
    // Distance at which bodies are in touch.
    touch: f32,
    // 1 if all primitives of a pair are candidates, otherwise 0.
    is_flat: u32,
    // Largest number of workgroups for the primitives of a shape.
    tiles: u32,
    // Index of the first candidate of each kind of primitive pairs, and the capacity of their buffer, in elements.
    candidates: array<vec4u, 2>,
}

// Number of kinds of primitive pairs.
const KINDS: u32 = 5u;

// Value at which counters stop. It exceeds every capacity, and is far enough from the largest value for all increments in the meantime.
const MANY: u32 = 0x80000000u;

// Number of elements in each buffer. Counters continue to count when a buffer is full.
struct Counters {
    // Body pairs.
    pairs: atomic<u32>,
    // Chords of their motions.
    chords: atomic<u32>,
    // Primitive pairs that the mid phase leaves, by kind.
    candidates: array<atomic<u32>, KINDS>,
    // Primitive pairs that the narrow phase leaves.
    survivors: atomic<u32>,
}

// Two sides that may meet. The first one is medial.
struct Pair {
    // Index of a body.
    first: u32,
    // Index of a body, or of a static with `STATIC`, and perhaps `UNKNOWN`.
    second: u32,
    // Number of chords of its motion.
    chords: u32,
}

// The medial cone that the bounding sphere of a body sweeps.
struct Swept {
    // Sphere `x y z radius` at the start of the step, in the world, enlarged by the body's margin.
    sphere: vec4f,
    // Displacement of its centre over the step.
    motion: vec3f,
}

// Node of the tree over the bodies.
struct TreeNode {
    // Lower corner of its box, in the world.
    low: vec3f,
    // Index of the body, for a leaf.
    body: u32,
    // Upper corner of its box, in the world.
    high: vec3f,
}

// Node of a hierarchy that the CPU has built, in depth-first order.
struct BvhNode {
    // Lower corner of its box, in the world for statics, in the shape's frame for primitives.
    low: vec3f,
    // Index of the node after the subtree. For a leaf: index of its item, with `LEAF`.
    link: u32,
    // Upper corner of its box.
    high: vec3f,
}

const LEAF: u32 = 0x80000000u;
