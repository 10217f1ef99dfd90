// Between the passes: computes the number of workgroups of the next ones. No dimension has more than 65535.

// Invocations in a workgroup of passes with one invocation for each chord or candidate.
const WORKGROUP: u32 = 64u;

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read_write> counters: Counters;
// Numbers of workgroups along three dimensions, for each of: placing chords, mid phase, narrow phase of each kind of primitive pairs.
@group(0) @binding(2) var<storage, read_write> groups: array<u32, 3u * (2u + KINDS)>;

fn need(pass_index: u32, count: u32, depth: u32) {
    groups[3u * pass_index] = min(count, 65535u);
    groups[3u * pass_index + 1u] = (count + 65534u) / 65535u;
    groups[3u * pass_index + 2u] = depth;
}

@compute @workgroup_size(1)
fn dispatch() {
    let chords = min(atomicLoad(&counters.chords), params.max_chords);
    need(0u, (chords + WORKGROUP - 1u) / WORKGROUP, 1u);
    need(1u, chords, params.tiles);
    for (var kind = 0u; kind < KINDS; kind++) {
        let candidates = min(atomicLoad(&counters.candidates[kind]), max_candidates(kind));
        need(2u + kind, (candidates + WORKGROUP - 1u) / WORKGROUP, 1u);
    }
}
