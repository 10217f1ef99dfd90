// Pass 3: builds a complete binary tree of boxes around the swept spheres, over the sorted bodies. The children of node `i` are `2 i` and `2 i + 1`,
// the root is 1, and the leaves follow the inner nodes.

const BLOCK: u32 = 256u;

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> swept: array<Swept>;
@group(0) @binding(2) var<storage, read> keys: array<vec2u>;
@group(0) @binding(3) var<storage, read_write> nodes: array<TreeNode>;

fn leaf(body: u32) -> TreeNode {
    if body >= params.bodies {
        return TreeNode(vec3f(MAX), body, vec3f(-MAX));
    }
    let sphere = swept[body].sphere;
    let motion = swept[body].motion;
    let low = min(sphere.xyz, sphere.xyz + motion) - sphere.w;
    return TreeNode(low, body, max(sphere.xyz, sphere.xyz + motion) + sphere.w);
}

fn join(index: u32) {
    let a = nodes[2u * index];
    let b = nodes[2u * index + 1u];
    nodes[index] = TreeNode(min(a.low, b.low), 0u, max(a.high, b.high));
}

// Builds the leaves, and all nodes above a block of leaves.
@compute @workgroup_size(256)
fn tree_bottom(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) thread: u32) {
    let first = group.x * BLOCK + thread;
    if first < params.leaves {
        nodes[params.leaves + first] = leaf(keys[first].y);
    }
    var width = min(BLOCK, params.leaves) / 2u;
    for (var level = params.leaves / 2u; width > 0u; level /= 2u) {
        storageBarrier();
        if thread < width {
            join(level + group.x * width + thread);
        }
        width /= 2u;
    }
}

// Builds the nodes above the blocks, in one workgroup.
@compute @workgroup_size(256)
fn tree_top(@builtin(local_invocation_index) thread: u32) {
    for (var level = params.leaves / (2u * BLOCK); level > 0u; level /= 2u) {
        for (var i = thread; i < level; i += BLOCK) {
            join(level + i);
        }
        storageBarrier();
    }
}
