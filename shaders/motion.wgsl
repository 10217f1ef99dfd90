// Poses and rigid motions. As src/geometry/sweep.rs and src/pipeline/motion.rs.

// Rotation as a unit quaternion `x y z w`, then translation.
struct Pose {
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

// The rotation by a vector, axis times angle. Sine and cosine of WGSL are too coarse; the sign of a quaternion does not matter.
fn rotation_by(vector: vec3f) -> vec4f {
    let angle = length(vector);
    if angle == 0.0 {
        return vec4f(0.0, 0.0, 0.0, 1.0);
    }
    // Half the angle, less as many half turns as leave at most a quarter. The first part of pi has few digits: the product is exact.
    let half_turns = round(0.5 * angle * 0.31830987);
    let x = (0.5 * angle - half_turns * 3.140625) - half_turns * 9.6765359e-4;
    let s = x * x;
    let sine = x * (1.0 + s * (-1.6666667e-1 + s * (8.3333333e-3 + s * (-1.9841270e-4 + s * (2.7557319e-6 - s * 2.5052108e-8)))));
    let cosine = 1.0
        + s * (-0.5 + s * (4.1666667e-2 + s * (-1.3888889e-3 + s * (2.4801587e-5 + s * (-2.7557319e-7 + s * 2.0876757e-9)))));
    return vec4f(vector * (sine / angle), cosine);
}

// No shape that the GPU knows: the CPU finds its primitives.
const OTHER_SHAPE: u32 = 0xffffffffu;
// A plain box.
const BOX_SHAPE: u32 = 0xfffffffeu;
const NO_OWNER: vec2u = vec2u(0xffffffffu);

struct Body {
    // At the start of the step.
    position: vec3f,
    shape: u32,
    rotation: vec4f,
    // Displacement of the centre of mass over the step.
    translation: vec3f,
    // Factor on the lengths of the shape.
    scale: f32,
    // Rotation over the step, axis times angle.
    turn: vec3f,
    // Distance from the centre of mass to the farthest point that turns with the body.
    arm: f32,
    // Centre of mass in the body's frame.
    local_center: vec3f,
    // How far outside of its bounding sphere it may meet something.
    margin: f32,
    // Bounding sphere in the body's frame.
    bound: vec4f,
    memberships: u32,
    collides_with: u32,
    // The rigid body that it is a shape of, or `NO_OWNER`.
    owner: vec2u,
    world: u32,
    // 1 if it is awake and moves.
    is_active: u32,
    // How far it may leave its way.
    slack: f32,
}

struct Static {
    // Middle of its box.
    center: vec3f,
    shape: u32,
    rotation: vec4f,
    // Half the size of its box, without rounding.
    half: vec3f,
    rounding: f32,
    // Origin of its shape.
    position: vec3f,
    // Factor on the lengths of the shape.
    scale: f32,
    // Radius of its bounding sphere.
    radius: f32,
    memberships: u32,
    collides_with: u32,
    world: u32,
    owner: vec2u,
}

// Where a body is at a fraction of the step, relative to a place of the world.
fn pose_at(body: Body, fraction: f32, origin: vec3f) -> Pose {
    let start = (body.position - origin) + rotate(body.rotation, body.local_center);
    let rotation = normalize(times(rotation_by(body.turn * fraction), body.rotation));
    return Pose(rotation, start + body.translation * fraction - rotate(rotation, body.local_center));
}

// How far a point at the distance `radius` from the centre of mass strays from the chord of its arc at most, if the step is split into so
// many equal parts.
fn sagitta(body: Body, radius: f32, chords: u32) -> f32 {
    let quarter_angle = min(length(body.turn) / (4.0 * f32(chords)), 1.0);
    return 2.0 * radius * quarter_angle * quarter_angle;
}

// Into how many chords to split the step so that no point strays from its chord by more than `tolerance`: a power of two.
fn chords(body: Body, tolerance: f32) -> u32 {
    var count = 1u;
    while count < MAX_CHORDS && sagitta(body, body.arm, count) > tolerance {
        count *= 2u;
    }
    return count;
}

// Longest way of any point of the body over the step.
fn way(body: Body) -> f32 {
    return length(body.translation) + length(body.turn) * body.arm;
}
