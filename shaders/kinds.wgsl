// Kinds of primitive pairs, which have shaders of their own, and the place of their candidates.

// The sides may be in either order.
const CONE_CONE: u32 = 0u;
const CONE_SLAB: u32 = 1u;
const SLAB_SLAB: u32 = 2u;
const CONE_BOX: u32 = 3u;
const SLAB_BOX: u32 = 4u;

// Returns the kind of two primitives from their numbers of slabs.
fn kind_of(slabs: u32, is_box: bool) -> u32 {
    return slabs + select(0u, CONE_BOX, is_box);
}

// Index of the first candidate of a kind.
fn first_candidate(kind: u32) -> u32 {
    return params.candidates[kind / 4u][kind % 4u];
}

// Capacity for the candidates of a kind.
fn max_candidates(kind: u32) -> u32 {
    return first_candidate(kind + 1u) - first_candidate(kind);
}
