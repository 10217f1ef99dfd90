// Pass 1: computes the bounding sphere of each body and its displacement, and a key that orders bodies along a space-filling curve. The spheres are
// those of src/pipeline/broad/swept_sphere.rs.

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> bodies: array<Body>;
@group(0) @binding(2) var<storage, read_write> swept: array<Swept>;
@group(0) @binding(3) var<storage, read_write> keys: array<vec2u>;

// Inserts two zero bits after each of the lower ten bits.
fn spread(x: u32) -> u32 {
    var v = x & 0x3ffu;
    v = (v | (v << 16u)) & 0x030000ffu;
    v = (v | (v << 8u)) & 0x0300f00fu;
    v = (v | (v << 4u)) & 0x030c30c3u;
    return (v | (v << 2u)) & 0x09249249u;
}

@compute @workgroup_size(64)
fn place(@builtin(global_invocation_id) id: vec3u) {
    let index = id.x;
    if index >= params.leaves {
        return;
    }
    if index >= params.bodies {
        keys[index] = vec2u(0xffffffffu);
        return;
    }
    let body = bodies[index];
    let center = body.bound.xyz;
    let start = body.position + rotate(body.rotation, center);
    let end = point_at(pose_at(body, 1.0, vec3f(0.0)), center);
    let radius = body.bound.w + sagitta(body, distance(center, body.local_center), 1u) + body.margin;
    // Allowance for rounding.
    let slack = CONTACT_ROUNDING * (radius + path_length(body) + length(start));
    swept[index] = Swept(vec4f(start, radius + slack), end - start);
    let cell = vec3u(clamp((0.5 * (start + end) - params.low) * params.cells, vec3f(0.0), vec3f(1023.0)));
    keys[index] = vec2u(spread(cell.x) | (spread(cell.y) << 1u) | (spread(cell.z) << 2u), index);
}
