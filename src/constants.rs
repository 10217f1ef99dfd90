//! Tolerances and limits that shape results and costs, with unit, reason and the effect of a change.

use std::time::Duration;

/// Rounding allowance of the f32 kernels, per metre of a pair's extent. Gaps below it count as contact.
///
/// A gap is a sum of a few products of coordinates, which are as large as the pair. Each product has a relative rounding error of 6e-8. With a
/// smaller value, pairs with a tiny overlap at the start are missed; with a larger one, grazing hits are reported early.
pub const CONTACT_ROUNDING: f32 = 3.0e-6;

/// [`CONTACT_ROUNDING`] after the start of the step, when coordinates are relative to the place of contact. It is twice the remaining rounding error.
/// A graze of depth `d` is reported early by the time in which the pair closes this gap. That time grows as `d` shrinks.
pub const TOUCH_ROUNDING: f32 = 7.0e-7;

/// Shortest trial step of the time of impact, as the displacement of the fastest vertex in extents. Grazing hits are reported early by less than this step.
pub const TIME_TOLERANCE: f32 = 2.0e-5;

/// Squared sine of the angle between two edges. Below it, a closed-form solution inside is not accurate enough, so the boundary is searched too.
pub const ILL_CONDITIONED: f32 = 1.0e-3;

/// Iterations of conservative advancement before the search takes trial steps. Most pairs are done by then. Pairs that graze or slide approach each
/// other by ever smaller steps. In a batch, a pair leaves its lane after three times as many. A search for bounds on the GPU ends after twice as many.
pub const MAX_ADVANCES: u32 = 6;

/// Length of the first trial step, as a multiple of the last advance, and smallest length of a step after a successful one, as a multiple of
/// [`TIME_TOLERANCE`]. A step that is too long is shortened, which costs an iteration.
pub const FIRST_TRIAL: f32 = 16.0;

/// Iterations after which a search stops: for a time of impact, with the iteration limit as its result; for the nearest point beyond planes, without a result;
/// for the nearest point of the surface from inside, with the best one so far. A step has at most as many intervals in a search for impacts, and as many
/// substeps in the solver. With fewer intervals, ten turns in a step deviate from their path by more than 0.05 % of the radius, and bodies that an impact
/// has set spinning stop too early in every step.
pub const MAX_ITERATIONS: u32 = 1024;

/// Smallest advance of a bound of the time of impact, as a fraction of a chord. A shorter one ends the search. With a smaller value, bounds are closer to
/// the time of impact; with a larger one, the GPU needs fewer iterations.
pub const SHORTEST_ADVANCE: f32 = 1.0 / 256.0;

/// Shortest collision time of a step on the CPU for which a GPU is tried: twice the time of a call of a GPU without work. With a smaller value, trials slow
/// down steps of small scenes; with a larger one, steps stay on the CPU although a GPU is faster.
pub const LEAST_GPU_TIME: Duration = Duration::from_millis(1);

/// Number of steps that the GPU looks ahead in pipelined mode. Its answer arrives two or three steps later. With more steps, bodies have left their
/// predicted path by then.
pub const LOOK_AHEAD_STEPS: u32 = 4;

/// Largest deviation of a body from its predicted path, per metre of its bounding radius, in addition to the prediction distance. With a larger
/// value, more primitive pairs are tested; with a smaller one, more bodies are culled again on the CPU.
pub const LOOK_AHEAD_SLACK: f32 = 0.1;

/// Largest number of cones in the chain along a curved path in the broad phase. With a smaller value, more pairs of spinning bodies are left; with a larger
/// one, more cones are tested.
pub const MAX_LINKS: u32 = 8;

/// [`CHORD_TOLERANCE`] for culling on the GPU, and for chains of cones. With a smaller value, spinning bodies have more chords to test; with a larger one,
/// culling leaves more primitives that do not meet.
pub const CULLING_CHORD_TOLERANCE: f32 = 1.0e-2;

/// Largest number of chords per step for culling on the GPU. The deviation that exceeds the tolerance enlarges the search distance.
pub const MAX_CULLING_CHORDS: u32 = 128;

/// Number of primitive pairs up to which each pair is tested by itself. With fewer pairs, a test of all along one direction takes longer than it saves.
pub const FEW_PRIMITIVES: usize = 8;

/// Largest relative displacement in an interval of a search for impacts, per metre of the smaller body's bounding radius. It applies to body pairs with
/// more than [`MANY_PRIMITIVES`] primitive pairs: few of them are near each other in a short interval, and the intervals after an impact are skipped.
pub const INTERVAL_PATH: f32 = 0.36;

/// Number of primitive pairs up to which a search of the whole displacement takes no longer than a search of its intervals.
pub const MANY_PRIMITIVES: usize = 256;

/// Sine of the angle between a body's spin axis and the rotation axis that follows from its poses. Above it, that rotation axis is not used. With a
/// larger value, a rod of one metre is searched a millimetre or more beside its path; with a smaller one, rounding reaches the limit.
pub const AXIS_ASTRAY: f32 = 2.0e-3;

/// Largest deviation of points from the chords of their paths, summed over both bodies, per metre of the smaller body's bounding radius.
pub const CHORD_TOLERANCE: f32 = 1.0e-3;

/// Cosine of the largest angle (25 degrees) at which the contact of a sphere belongs to the flat or straight contact of its primitive.
pub const VERTEX_NORMAL_COSINE: f32 = 0.9;

/// Smallest sine of the angle between edges whose crossing is a contact. For edges closer to parallel, contacts at their ends are sufficient.
pub const CROSSING_SINE: f32 = 0.1;

/// Cosine of the largest angle between contact normals in one manifold (5 degrees). Rapier solves one normal per manifold.
pub const MANIFOLD_NORMAL_COSINE: f32 = 0.996;

/// Largest number of manifolds of a body pair. A body that is wedged between many others still has one or two manifolds per neighbour.
pub const MAX_MANIFOLDS: usize = 8;

/// Unit of small lengths, in length units: metres, unless rapier has another unit (`IntegrationParameters::length_unit`). It is the overlap that
/// rapier's solver leaves at resting contacts.
///
/// Bodies within this distance touch. Contacts nearer to each other count as one. A pair that has moved by less keeps its contacts; that is at most a
/// quarter of the reach of slow pairs, so bodies touch nowhere that the search has not reached. With a larger value, piles cost less; with a smaller
/// one, distances of contacts at rest are more accurate.
pub const LINEAR_SLOP: f32 = 1.0e-3;

/// Margin of the contact search beyond the displacement of a pair in a step, in prediction distances. It allows for accelerations by the solver and
/// by gravity. With a larger value, more contacts are found that carry no load; with a smaller one, bodies stop for one step at surfaces without a
/// contact in the solver.
pub const REST_MARGIN: f32 = 0.2;

/// Margin of the lists of near primitives that are kept between steps, per metre of the smaller body's bounding radius. With a larger value, lists are
/// longer; with a smaller one, they are made more often, and fewer pairs have one.
pub const NEAR_MARGIN: f32 = 0.05;

/// Largest number of primitive pairs in a list that is kept between steps: 12 bytes each. Two meshes that lie in each other are searched in each step.
pub const MAX_NEAR_PAIRS: usize = 1024;

/// Relative difference between the radii of a primitive and of its core, unless [`CORE_DEPTH`] is less. While cores are apart, the direction between
/// them separates the primitives, so the solver pushes to the correct side. With a larger value, thin primitives may have passed each other before
/// the solver sees them.
pub const CORE_FRACTION: f32 = 0.3;

/// Default depth of a body's core below its surface, per metre of the smaller body's bounding radius. With a larger value, colliding bodies overlap
/// more; with a smaller one, more of them stop within the step.
pub const CORE_DEPTH: f32 = 0.0075;

/// Overlap up to which the solver handles contacts of bodies that are already in touch, per metre of the smaller body's bounding radius. The overlap
/// is at least twelve [`LINEAR_SLOP`], because a ball that rolls at 10 m/s sinks by 8 mm. It is also at least the displacement by gravity in a step, so
/// that bodies can tip over in long steps. With a larger value, bodies in piles overlap more; with a smaller one, bodies in piles and hoppers stop
/// in step after step. It also limits the slop of small bodies.
pub const KNOWN_OVERLAP: f32 = 0.024;

/// Weight of depth when the outermost contacts are chosen: metres farther out that equal one metre of depth. Depth beyond [`LINEAR_SLOP`] does not
/// count. With a larger value, rounding chooses among the contacts of a body at rest; with a smaller one, a deeper contact may be left out.
pub const DEPTH_WEIGHT: f32 = 50.0;

/// Contacts nearer to each other than this fraction of the extent of all contacts carry a body as one contact.
pub const CLOSE_CONTACT: f32 = 0.1;

/// Number of pushes of a body within a step before the body is wedged. With fewer pushes, bodies in a row before a fast plate end up behind the
/// plate; with more, bodies between two plates take longer.
pub const MAX_PUSHES: u32 = 16;

/// Largest relative displacement of bodies in contact within a substep of the solver, per metre of the smaller body's bounding radius. With a larger
/// value, fast impacts transfer too little or too much momentum; with a smaller one, they cost more time.
pub const SUBSTEP_DISPLACEMENT: f32 = 0.1;

/// Largest coordinate of a position, velocity or angular velocity of a simulated body, in SI units. The distances of cones and slabs contain fourth
/// powers, which are finite up to this limit.
pub const MAX_MAGNITUDE: f32 = 1.0e9;

/// Largest rotation of a joint between two poses that spheres reach on lines, in radians. Between the poses of longer rotations the joint is posed in between.
/// With a larger value, limbs cut corners within a step; with a smaller one, fast animations cost more time. Lines stray from the arc of a sphere by less than
/// a hundredth of its distance from the axis.
pub const MAX_JOINT_TURN: f32 = 0.25;

/// Largest displacement of a sphere of a skinned shape within a step that is swept, in bounding radii of the shape. A longer displacement is a jump, such as
/// one to another place of the level.
pub const TELEPORT: f32 = 2.0;

/// Relative difference up to which two lengths or scales count as equal. Scales that went through a rotation, and distances of points on a sphere from
/// its centre, differ by less because of rounding.
pub const SAME_LENGTH: f32 = 1.0e-4;

/// Largest number of contacts of a pair that the reduction processes. With a larger value, fine shapes that lie on each other cost more; with a
/// smaller one, covered contacts are detected less reliably.
pub const MANY_CONTACTS: usize = 96;

/// Number of cells per axis over the extent of a pair's contacts, if there are more than [`MANY_CONTACTS`]. One contact per cell and direction is
/// kept. The number is halved until few enough contacts are left. A power of two.
pub const CLUSTER_CELLS: f32 = 32.0;

/// Resolution of a normal's coordinates that distinguishes contacts in one cell, in steps per unit: about 15 degrees each.
pub const CLUSTER_NORMALS: f32 = 4.0;

/// Cosine of the largest angle between the normals of contacts that push in the same direction (a quarter of a degree).
pub const SAME_NORMAL_COSINE: f32 = 1.0 - 1.0e-5;
