// Poses and rigid motions. Counterparts: src/geometry/sweep.rs and src/pipeline/sweep/motion.rs. Lengths are in metres.

// A pose: a rotation, then a translation.
struct Pose {
    // Unit quaternion `x y z w`.
    rotation: vec4f,
    translation: vec3f,
}

fn rotate(q: vec4f, v: vec3f) -> vec3f {
    let t = 2.0 * cross(q.xyz, v);
    return v + q.w * t + cross(q.xyz, t);
}

fn reversed(q: vec4f) -> vec4f {
    return vec4f(-q.xyz, q.w);
}

fn times(a: vec4f, b: vec4f) -> vec4f {
    return vec4f(a.w * b.xyz + b.w * a.xyz + cross(a.xyz, b.xyz), a.w * b.w - dot(a.xyz, b.xyz));
}

fn point_at(pose: Pose, point: vec3f) -> vec3f {
    return rotate(pose.rotation, point) + pose.translation;
}

// Returns the rotation by a vector, axis times angle in radians. Sine and cosine of WGSL are not accurate enough. The sign of a quaternion does not matter.
fn rotation_by(vector: vec3f) -> vec4f {
    let angle = length(vector);
    if angle == 0.0 {
        return vec4f(0.0, 0.0, 0.0, 1.0);
    }
    // Half of the angle, reduced by half turns to at most a quarter turn. The first part of pi has few digits, so the product is exact.
    let half_turns = round(0.5 * angle * 0.31830987);
    let x = (0.5 * angle - half_turns * 3.140625) - half_turns * 9.6765359e-4;
    let s = x * x;
    let sine = x * (1.0 + s * (-1.6666667e-1 + s * (8.3333333e-3 + s * (-1.9841270e-4 + s * (2.7557319e-6 - s * 2.5052108e-8)))));
    let cosine = 1.0
        + s * (-0.5 + s * (4.1666667e-2 + s * (-1.3888889e-3 + s * (2.4801587e-5 + s * (-2.7557319e-7 + s * 2.0876757e-9)))));
    return vec4f(vector * (sine / angle), cosine);
}

// Shape of a collider that the GPU cannot represent: the CPU finds its primitives.
const OTHER_SHAPE: u32 = 0xffffffffu;
// Shape of a box with its middle at the centre of the bounding sphere.
const BOX_SHAPE: u32 = 0xfffffffeu;
// Flag of shapes whose spheres move within the step.
const DEFORMING: u32 = 0x40000000u;
// Value of `rigid_body` for a body with a single shape.
const NO_RIGID_BODY: vec2u = vec2u(0xffffffffu);

// A body and its motion. Vectors are in the world unless a comment names another frame.
struct Body {
    // Origin of its frame at the start of the step.
    position: vec3f,
    // Index of its shape, perhaps with `DEFORMING`, or `BOX_SHAPE` or `OTHER_SHAPE`.
    shape: u32,
    // Unit quaternion of its frame at the start of the step.
    rotation: vec4f,
    // Displacement of the centre of mass over the step.
    translation: vec3f,
    // Factor on the lengths of the shape.
    scale: f32,
    // Rotation over the step, axis times angle in radians.
    turn: vec3f,
    // Distance from the centre of mass to the farthest sphere centre, or to the farthest point of a collider that is not medial.
    arm: f32,
    // Centre of mass in the body's frame.
    local_center: vec3f,
    // Distance from its bounding sphere within which it may meet others, with `slack`.
    margin: f32,
    // Bounding sphere `x y z radius` in the body's frame.
    bound: vec4f,
    // Collision groups of the body.
    memberships: u32,
    // Collision groups that it collides with.
    collides_with: u32,
    // The rigid body to which the shape belongs, or `NO_RIGID_BODY`.
    rigid_body: vec2u,
    // Index of the physics world. Bodies of different worlds do not meet.
    world: u32,
    // 1 if it is awake and moves, otherwise 0.
    is_active: u32,
    // Largest deviation from its path.
    slack: f32,
    // Radius of the rounded edges of a box.
    rounding: f32,
    // Half extents of a box, without rounding.
    half: vec3f,
}

// A static body. Vectors are in the world.
struct Static {
    // Middle of its box.
    center: vec3f,
    // Index of its shape, `BOX_SHAPE` or `OTHER_SHAPE`.
    shape: u32,
    // Unit quaternion of its box and of its frame.
    rotation: vec4f,
    // Half extents of its box, without rounding.
    half: vec3f,
    // Radius of the rounded edges of a plain box.
    rounding: f32,
    // Origin of its frame.
    position: vec3f,
    // Factor on the lengths of the shape.
    scale: f32,
    // Radius of its bounding sphere.
    radius: f32,
    // Collision groups of the static.
    memberships: u32,
    // Collision groups that it collides with.
    collides_with: u32,
    // Index of the physics world.
    world: u32,
    // The rigid body to which the shape belongs, or `NO_RIGID_BODY`.
    rigid_body: vec2u,
}

// Returns true for the shape of a medial mesh whose spheres move with their body. The first one of two bodies has such a shape.
fn is_medial(shape: u32) -> bool {
    return shape < DEFORMING;
}

// Returns the pose of a body at a fraction of the step, relative to `origin`, a point in the world.
fn pose_at(body: Body, fraction: f32, origin: vec3f) -> Pose {
    let start = (body.position - origin) + rotate(body.rotation, body.local_center);
    let rotation = normalize(times(rotation_by(body.turn * fraction), body.rotation));
    return Pose(rotation, start + body.translation * fraction - rotate(rotation, body.local_center));
}

// Returns the largest deviation of a point from the chord of its arc, if the step is split into `chords` equal parts. `radius`: distance of the point
// from the centre of mass.
fn sagitta(body: Body, radius: f32, chords: u32) -> f32 {
    let quarter_angle = min(length(body.turn) / (4.0 * f32(chords)), 1.0);
    return 2.0 * radius * quarter_angle * quarter_angle;
}

// Returns the number of chords, a power of two, with which no point deviates from its chord by more than `tolerance`, or `MAX_CHORDS`.
fn chords(body: Body, tolerance: f32) -> u32 {
    var count = 1u;
    while count < MAX_CHORDS && sagitta(body, body.arm, count) > tolerance {
        count *= 2u;
    }
    return count;
}

// Returns the largest deviation of a point of the first body from its chord, relative to the second, if the step is split into `chords` equal parts.
//
// The kernels need boxes at rest, so the first body is seen from the frame of a box. Under the acceleration `a` in that frame, a point deviates from
// the chord of a time `t` by at most `a t^2 / 8`. Counterpart: `Chord::in_frame_of_second` in src/query/rigid.rs.
fn deviation(first: Body, second: Body, chords: u32) -> f32 {
    if second.shape != BOX_SHAPE {
        return sagitta(first, first.arm, chords) + sagitta(second, second.arm, chords);
    }
    let turn1 = length(first.turn);
    let turn2 = length(second.turn);
    let speed = distance(first.translation, second.translation);
    let center1 = (first.position - second.position) + rotate(first.rotation, first.local_center);
    let apart = distance(center1, rotate(second.rotation, second.local_center)) + speed + first.arm;
    let acceleration = turn1 * turn1 * first.arm + 2.0 * turn2 * (speed + turn1 * first.arm) + turn2 * turn2 * apart;
    return acceleration / (8.0 * f32(chords) * f32(chords));
}

// Returns the longest path of any point of the body over the step, or more.
fn path_length(body: Body) -> f32 {
    return length(body.translation) + length(body.turn) * body.arm;
}
