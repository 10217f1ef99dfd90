// Between the passes: computes the number of workgroups of the next ones. No dimension has more than 65535.

// Invocations in a workgroup of passes with one invocation for each chord or candidate.
const WORKGROUP: u32 = 64u;

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read_write> counters: Counters;
// Numbers of workgroups along three dimensions, for each of: placing chords, mid phase, narrow phase.
@group(0) @binding(2) var<storage, read_write> groups: array<u32, 9>;

fn need(pass_index: u32, count: u32) {
    let x = min(count, 65535u);
    groups[3u * pass_index] = x;
    groups[3u * pass_index + 1u] = (count + 65534u) / 65535u;
    groups[3u * pass_index + 2u] = 1u;
}

@compute @workgroup_size(1)
fn dispatch() {
    let chords = min(atomicLoad(&counters.chords), params.max_chords);
    let candidates = min(atomicLoad(&counters.candidates), params.max_candidates);
    need(0u, (chords + WORKGROUP - 1u) / WORKGROUP);
    need(1u, chords);
    need(2u, (candidates + WORKGROUP - 1u) / WORKGROUP);
}
