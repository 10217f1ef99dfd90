// Pass 4, broad phase: finds the bodies that may touch within the step. Counterpart: src/pipeline/broad.
//
// The bounding sphere of a moving body sweeps a medial cone, or a chain of cones along a curved path. Two bodies are a pair if their cones meet (paper,
// section 4). A body and a static are a pair if a single cone meets the static's box (section 4.1).

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> bodies: array<Body>;
@group(0) @binding(2) var<storage, read> swept: array<Swept>;
@group(0) @binding(3) var<storage, read> nodes: array<TreeNode>;
@group(0) @binding(4) var<storage, read> statics: array<Static>;
@group(0) @binding(5) var<storage, read> static_nodes: array<BvhNode>;
@group(0) @binding(6) var<storage, read_write> counters: Counters;
@group(0) @binding(7) var<storage, read_write> pairs: array<Pair>;
// Chords of pairs: index of the pair, index of the chord in the pair, number of chords.
@group(0) @binding(8) var<storage, read_write> pair_chords: array<vec3u>;

fn overlap(low1: vec3f, high1: vec3f, low2: vec3f, high2: vec3f) -> bool {
    return all(low1 <= high2) && all(low2 <= high1);
}

fn groups_meet(memberships1: u32, with1: u32, memberships2: u32, with2: u32) -> bool {
    return (memberships1 & with2) != 0u && (memberships2 & with1) != 0u;
}

fn are_strangers(rigid_body1: vec2u, rigid_body2: vec2u) -> bool {
    return all(rigid_body1 == NO_RIGID_BODY) || any(rigid_body1 != rigid_body2);
}

// Returns the distance of the centre of a body's bounding sphere from its centre of mass.
fn bound_arm(body: Body) -> f32 {
    return distance(body.bound.xyz, body.local_center);
}

// Returns the number of cones in the chain along the path of a body's bounding sphere: as many as it takes for a small sagitta.
fn links(body: Body) -> u32 {
    var count = 1u;
    while count < MAX_LINKS && sagitta(body, bound_arm(body), count) > CHORD_TOLERANCE * body.bound.w {
        count *= 2u;
    }
    return count;
}

// Returns a cone of the chain of a body, relative to `origin`, a point near it. The radius of a single cone includes its sagitta and a margin.
fn link(index: u32, body: Body, number: u32, count: u32, origin: vec3f) -> Edge {
    let sphere = swept[index].sphere;
    let start = sphere.xyz - origin;
    if count == 1u {
        return edge(vec4f(start, sphere.w), vec4f(start + swept[index].motion, sphere.w));
    }
    let arm = bound_arm(body);
    let radius = sphere.w - sagitta(body, arm, 1u) + sagitta(body, arm, count);
    let first = point_at(pose_at(body, f32(number) / f32(count), origin), body.bound.xyz);
    let last = point_at(pose_at(body, f32(number + 1u) / f32(count), origin), body.bound.xyz);
    return edge(vec4f(first, radius), vec4f(last, radius));
}

// Maximum of `n . x` over a cone.
fn high(cone: Edge, n: vec3f) -> f32 {
    return dot(cone.start.xyz, n) + cone.start.w + max(dot(cone.axis.xyz, n) + cone.axis.w, 0.0);
}

fn add(first: u32, second: u32, chords: u32) {
    let pair = atomicAdd(&counters.pairs, 1u);
    if pair >= params.max_pairs {
        if pair >= MANY {
            atomicStore(&counters.pairs, MANY);
        }
        return;
    }
    pairs[pair] = Pair(first, second, chords);
    let start = atomicAdd(&counters.chords, chords);
    if start >= MANY {
        atomicStore(&counters.chords, MANY);
    }
    for (var i = 0u; i < chords && start + i < params.max_chords; i++) {
        pair_chords[start + i] = vec3u(pair, i, chords);
    }
}

// Returns true if the chains of cones of two bodies meet. The bodies need not be at the same place of their paths at the same time, so each link is tested
// against each other one.
fn chains_meet(index1: u32, index2: u32, body1: Body, body2: Body, links1: u32, links2: u32) -> bool {
    let origin = swept[index1].sphere.xyz;
    for (var i = 0u; i < links1 * links2; i++) {
        let cone1 = link(index1, body1, i / links2, links1, origin);
        let cone2 = link(index2, body2, i % links2, links2, origin);
        let n = unit(between_edges(FAR, cone1, cone2).apart);
        if -high(cone2, -n) - high(cone1, n) <= 0.0 {
            return true;
        }
    }
    return false;
}

fn between(a: u32, b: u32) {
    let lesser = min(a, b);
    let greater = max(a, b);
    let body1 = bodies[lesser];
    let body2 = bodies[greater];
    let one_medial = is_medial(body1.shape) || is_medial(body2.shape);
    let one_active = body1.is_active != 0u || body2.is_active != 0u;
    let strangers = are_strangers(body1.rigid_body, body2.rigid_body);
    if !(one_medial && one_active && strangers && body1.world == body2.world) {
        return;
    }
    if !groups_meet(body1.memberships, body1.collides_with, body2.memberships, body2.collides_with) {
        return;
    }
    if !chains_meet(lesser, greater, body1, body2, 1u, 1u) {
        return;
    }
    let links1 = links(body1);
    let links2 = links(body2);
    if links1 * links2 > 1u && !chains_meet(lesser, greater, body1, body2, links1, links2) {
        return;
    }
    // The first side is medial.
    if is_medial(body1.shape) {
        add_bodies(lesser, greater, body1, body2);
    } else {
        add_bodies(greater, lesser, body2, body1);
    }
}

fn add_bodies(first: u32, second: u32, body1: Body, body2: Body) {
    if body2.shape == OTHER_SHAPE {
        add(first, second | UNKNOWN, 0u);
        return;
    }
    let tolerance = CHORD_TOLERANCE * min(body1.bound.w, body2.bound.w);
    var count = 1u;
    while count < MAX_CHORDS && deviation(body1, body2, count) > tolerance {
        count *= 2u;
    }
    add(first, second, count);
}

fn with_static(index: u32, item: u32) {
    let body = bodies[index];
    let wall = statics[item];
    let one_medial = is_medial(body.shape) || is_medial(wall.shape);
    let strangers = are_strangers(body.rigid_body, wall.rigid_body);
    if !(one_medial && body.is_active != 0u && strangers && body.world == wall.world) {
        return;
    }
    if !groups_meet(body.memberships, body.collides_with, wall.memberships, wall.collides_with) {
        return;
    }
    let start = swept[index].sphere;
    let turn = reversed(wall.rotation);
    let sphere = vec4f(rotate(turn, start.xyz - wall.center), start.w);
    let swept_cone = edge(sphere, sphere + vec4f(rotate(turn, swept[index].motion), 0.0));
    let n = unit(edge_to_box(FAR, swept_cone, wall.half).apart);
    let gap = -dot(wall.half, abs(n)) - high(swept_cone, n);
    let rounding = wall.rounding + CONTACT_ROUNDING * (length(wall.half) + length(sphere.xyz));
    if gap > 0.5 * params.prediction + rounding {
        return;
    }
    if !is_medial(body.shape) || wall.shape == OTHER_SHAPE {
        add(index, item | STATIC | UNKNOWN, 0u);
    } else {
        add(index, item | STATIC, chords(body, CHORD_TOLERANCE * min(body.bound.w, wall.radius)));
    }
}

@compute @workgroup_size(64)
fn broad_phase(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= params.leaves {
        return;
    }
    let own = params.leaves + id.x;
    let index = nodes[own].body;
    if index >= params.bodies {
        return;
    }
    let low = nodes[own].low;
    let high = nodes[own].high;

    // Tests only later leaves, so that each pair is tested once.
    let depth = firstLeadingBit(params.leaves);
    var node = 1u;
    while node != 0u {
        let below = depth - firstLeadingBit(node);
        let last = ((node + 1u) << below) - 1u;
        if last > own && overlap(low, high, nodes[node].low, nodes[node].high) {
            if below > 0u {
                node *= 2u;
                continue;
            }
            between(index, nodes[node].body);
        }
        // Continues with the node after the subtree.
        node >>= firstTrailingBit(~node);
        if node != 0u {
            node += 1u;
        }
    }

    // The margin of the sphere contains half of the prediction distance already.
    let reach = vec3f(0.5 * params.prediction);
    for (var i = 0u; i < params.static_nodes;) {
        let link = static_nodes[i].link;
        let is_leaf = (link & LEAF) != 0u;
        let meets = overlap(low - reach, high + reach, static_nodes[i].low, static_nodes[i].high);
        if meets && is_leaf {
            with_static(index, link & ~LEAF);
        }
        i = select(link, i + 1u, meets || is_leaf);
    }
}
