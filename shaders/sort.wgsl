// Pass 2: sorts the keys (bitonic sort). Each block is sorted in the memory of a workgroup.

const BLOCK: u32 = 512u;

// A merge step between keys of different blocks.
struct Exchange {
    // Length of the sequences that this merge makes, in keys.
    size: u32,
    // Distance of the keys that are compared, in keys.
    distance: u32,
}

@group(0) @binding(0) var<storage, read_write> keys: array<vec2u>;
@group(0) @binding(1) var<uniform> exchange: Exchange;

var<workgroup> block: array<vec2u, BLOCK>;

fn is_greater(a: vec2u, b: vec2u) -> bool {
    return a.x > b.x || (a.x == b.x && a.y > b.y);
}

fn load(start: u32, thread: u32) {
    for (var i = thread; i < BLOCK; i += BLOCK / 2u) {
        block[i] = vec2u(0xffffffffu);
        if start + i < arrayLength(&keys) {
            block[i] = keys[start + i];
        }
    }
    workgroupBarrier();
}

fn store(start: u32, thread: u32) {
    for (var i = thread; i < BLOCK; i += BLOCK / 2u) {
        if start + i < arrayLength(&keys) {
            keys[start + i] = block[i];
        }
    }
}

// Returns the index of the first of the two keys that a thread compares.
fn first_of(thread: u32, distance: u32) -> u32 {
    return 2u * thread - (thread & (distance - 1u));
}

// Merges within the block, beginning with the largest distance.
fn merge(start: u32, thread: u32, size: u32, farthest: u32) {
    for (var distance = farthest; distance > 0u; distance /= 2u) {
        let i = first_of(thread, distance);
        let a = block[i];
        let b = block[i + distance];
        let ascending = ((start + i) & size) == 0u;
        if is_greater(a, b) == ascending {
            block[i] = b;
            block[i + distance] = a;
        }
        workgroupBarrier();
    }
}

// Sorts each block.
@compute @workgroup_size(256)
fn sort_blocks(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) thread: u32) {
    let start = group.x * BLOCK;
    load(start, thread);
    for (var size = 2u; size <= BLOCK; size *= 2u) {
        merge(start, thread, size, size / 2u);
    }
    store(start, thread);
}

// One step between keys of different blocks.
@compute @workgroup_size(256)
fn sort_far(@builtin(global_invocation_id) id: vec3u) {
    let i = first_of(id.x, exchange.distance);
    if i + exchange.distance >= arrayLength(&keys) {
        return;
    }
    let a = keys[i];
    let b = keys[i + exchange.distance];
    if is_greater(a, b) == ((i & exchange.size) == 0u) {
        keys[i] = b;
        keys[i + exchange.distance] = a;
    }
}

// All remaining steps within the blocks.
@compute @workgroup_size(256)
fn sort_near(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) thread: u32) {
    let start = group.x * BLOCK;
    load(start, thread);
    merge(start, thread, exchange.size, BLOCK / 2u);
    store(start, thread);
}
