//! Every tolerance and limit: unit, reason, effect of a change.

use glam::Vec3;

/// Rounding allowance of the f32 kernels, per metre of a pair's extent: gaps below it count as contact.
///
/// A gap is a sum of a few products of coordinates of the pair's size, each rounded to 6e-8 of it. Smaller, and pairs
/// that overlap by a hair at the start are missed; larger, and grazing hits come early.
pub const CONTACT_ROUNDING: f32 = 3.0e-6;

/// The same once the pair is on its way, when coordinates are relative to the place of contact. Twice the rounding that is left: a graze
/// of depth `d` comes early by as much as it takes to sink by this, which grows as `d` shrinks.
pub const TOUCH_ROUNDING: f32 = 7.0e-7;

/// The same of a distance itself, per metre of it: far apart, a gap along a direction is no more exact. Smaller, and directions of other features than
/// the nearest are taken.
pub const DISTANCE_ROUNDING: f32 = 2.0 * f32::EPSILON;

/// How near to the distance looked for, per metre of the extent, a search makes sure of its normal: the distance along one that rounding has tilted is
/// too small, and would end it early. Larger, and more looks cost twice.
pub const NEAR_TOUCH: f32 = 4.0 * CONTACT_ROUNDING;

/// How much, per metre of the extent, a tilted normal may take from the distance there: less than what counts as touching.
pub const TILT_ROUNDING: f32 = 0.5 * TOUCH_ROUNDING;

/// Shortest trial step of the time of impact, in extents travelled by the fastest vertex: grazing hits are early by less.
pub const TIME_TOLERANCE: f32 = 2.0e-5;

/// Squared sine of the angle between two edges below which a closed form inside is not trusted alone: the boundary is searched too.
pub const ILL_CONDITIONED: f32 = 1.0e-3;

/// Rounds of conservative advancement before the search takes trial steps. Most pairs are done by then; those that graze or slide come near by
/// ever smaller steps.
pub const MAX_ADVANCES: u32 = 6;

/// The first trial step, in steps of the last advance. Too long, and it is shortened at the cost of a round.
pub const FIRST_TRIAL: f32 = 16.0;

/// A trial step is no shorter than so many of [`TIME_TOLERANCE`], unless a longer one was in vain.
pub const SHORTEST_TRIAL: f32 = 4.0;

/// [`MAX_ADVANCES`] where many pairs are searched side by side, and a round costs less.
pub const MAX_LANE_ADVANCES: f32 = 20.0;

/// The square of a direction's length, in square metres, below which it leads nowhere: products of so small numbers are lost.
pub const LEAST_SQUARE: f32 = 1.0e-30;

/// Rounds after which the search gives up and says so.
pub const MAX_ROUNDS: u32 = 1024;

/// Greatest number of chords for a turning body's step. At 1024 ten turns stray by 0.05 % of the radius. Fewer, and bodies that an impact
/// has set spinning stop too early in every step.
pub const MAX_CHORDS: u32 = 1024;

/// Primitive pairs of a step from which on a GPU is tried. Fewer are culled on the CPU in less than a millisecond: little more than a call of a GPU
/// takes in which there is nothing to do. From there on both are timed. Lower, and small scenes have slow steps for the trial's sake; higher, and
/// steps are left to the CPU in which a GPU is faster.
pub const LEAST_GPU_PAIRS: usize = 1 << 18;

/// How many steps the GPU looks ahead, where nobody waits for it: its answer is there two or three steps later. More, and bodies have left their way.
pub const LOOK_AHEAD_STEPS: u32 = 4;

/// How far a body may have left its way by then, per metre of its bounding radius, besides the prediction distance. Larger, and more primitive
/// pairs are looked at; smaller, and more bodies are culled once more on the CPU.
pub const LOOK_AHEAD_SLACK: f32 = 0.1;

/// The same as [`CHORD_TOLERANCE`] where pairs are only culled. Smaller, and there are more chords of spinning bodies to look at; larger, and more
/// primitives are left that do not meet.
pub const CULLING_CHORD_TOLERANCE: f32 = 1.0e-2;

/// The same as [`MAX_CHORDS`] where pairs are only culled: what they stray farther widens what is looked at.
pub const MAX_CULLING_CHORDS: u32 = 128;

/// Greatest number of chords along which many primitives are looked at at once. Along more, the look takes longer than what it saves.
pub const MAX_PARTING_CHORDS: usize = 16;

/// How many primitives are looked at one by one. Fewer, and looking at all at once takes longer than what it saves.
pub const FEW_PRIMITIVES: usize = 8;

/// Angle in radians through which the bodies of a pair turn, together, before their step is searched in parts of that length: within each of
/// them only few primitives are near each other.
pub const PART_ANGLE: f32 = 0.5;

/// The same for their way, per metre of the smaller body's bounding radius, where there are more than [`PART_PRIMITIVES`] pairs of primitives. With 0.25 what
/// has four hundred primitives takes a sixth longer, with 0.125 what has a hundred or two.
pub const PART_WAY: f32 = 0.18;

/// Pairs of primitives up to which looking at all of a long way at once takes no longer.
pub const PART_PRIMITIVES: usize = 256;

/// Greatest number of such parts.
pub const MAX_STEP_PARTS: usize = 256;

/// Sine of the angle from the axis that a body spins about to that which its poses tell, from which on these are not believed. Larger, and
/// a rod of a metre is looked for a millimetre and more beside its way; smaller, and rounding counts as well.
pub const AXIS_ASTRAY: f32 = 2.0e-3;

/// Largest deviation of a chord from the arc it stands for, per metre of the body's bounding radius.
pub const CHORD_TOLERANCE: f32 = 1.0e-3;

/// Cosine of the angle up to which the contact of a sphere counts as part of its primitive's flat or straight contact (25 degrees).
pub const VERTEX_NORMAL_COSINE: f32 = 0.9;

/// Least sine of the angle at which edges cross in a point: of those closer to parallel the ends tell as much.
pub const CROSSING_SINE: f32 = 0.1;

/// Least distance of such a point from the ends of both edges, in lengths of the shorter one.
pub const CROSSING_END: f32 = 0.02;

/// Cosine of the angle up to which contacts share a manifold (5 degrees): rapier solves one normal per manifold.
pub const MANIFOLD_NORMAL_COSINE: f32 = 0.996;

/// Greatest number of manifolds of a body pair. A body wedged between many others still has one or two per neighbour.
pub const MAX_MANIFOLDS: usize = 8;

/// Contacts nearer to each other than this are one. In length units, as all lengths here that no shape tells: metres, unless rapier is told another
/// unit (`IntegrationParameters::length_unit`).
pub const DUPLICATE_CONTACT: f32 = 1.0e-3;

/// Distance in length units at which two bodies begin to touch, for messages. Rapier lets resting bodies overlap by about as much.
pub const TOUCH_DISTANCE: f32 = 1.0e-3;

/// How much farther than bodies go in a step the solver is told of contacts, in prediction distances: it accelerates them, and so does gravity. Larger,
/// and more contacts are found that carry nothing; smaller, and bodies stop for one step at what it was not told of.
pub const REST_REACH: f32 = 0.2;

/// The core of a primitive has radii that are smaller by this part, or by [`CORE_DEPTH`] if that is less. While cores are apart, the direction
/// between them separates the primitives, so the solver pushes to the right side. Larger, and the solver sees thin primitives past each other.
pub const CORE_FRACTION: f32 = 0.3;

/// How much smaller the core of a body is by default, per metre of its bounding radius. Larger, and bodies that collide overlap more; smaller, and
/// more of them stop within the step.
pub const CORE_DEPTH: f32 = 0.0075;

/// The unit of small lengths, in length units: rapier's solver leaves this overlap at resting contacts.
pub const LINEAR_SLOP: f32 = 1.0e-3;

/// The most that [`LINEAR_SLOP`] may be for small bodies, per metre of the smaller one's bounding radius.
pub const SLOP_OF_SIZE: f32 = 0.02;

/// Overlap up to which the solver handles a contact that it has already had, per metre of the smaller body's bounding radius. At least ten
/// [`LINEAR_SLOP`]: a ball that rolls at 10 m/s sinks by 8 mm. Larger, and bodies in piles overlap more; smaller, and piles and hoppers stop in step after step.
pub const KNOWN_OVERLAP: f32 = 0.02;

/// Contacts within this many length units of the deepest, or of half of its depth, carry the body: they go to the solver before those farther off.
pub const CARRYING_DEPTH: f32 = 2.0e-3;

/// How much farther out a contact has to be to come before one that is deeper, per metre of depth, down to [`TOUCH_DISTANCE`]. Larger, and rounding chooses
/// among contacts of a body at rest; smaller, and one that is deeper may be left out.
pub const DEPTH_WEIGHT: f32 = 50.0;

/// How many length units deeper than those that lie farther out a contact has to be to come into the place of one of them. Smaller, and a pile loses
/// one support for another from step to step.
pub const DEEPER: f32 = 2.0e-3;

/// Contacts nearer to each other than this part of what they span carry a body as one.
pub const CLOSE_CONTACT: f32 = 0.1;

/// An axis that is none of a shape's own, as a rule: of contacts that mirror each other one is farther out across it.
pub const OBLIQUE_AXIS: Vec3 = Vec3::new(0.48, 0.6, 0.64);

/// How often a body may be pushed on within a step before it is wedged. Fewer, and those in a row before a fast plate end up behind it; more, and
/// those between two plates take longer.
pub const MAX_PUSHES: u32 = 16;

/// Distance in metres up to which contacts are reported without rapier, whose own setting counts otherwise.
pub const DEFAULT_PREDICTION: f32 = 0.02;

/// Rounds of the search for the nearest point of a shape's surface from inside. Few are needed but where surfaces meet at a sharp angle.
pub const WAY_OUT_ROUNDS: usize = 32;

/// Rounds of each round's own search, for the nearest point beyond planes.
pub const NEAREST_BEYOND_ROUNDS: usize = 1000;

/// What the search must gain in a round to go on, per metre of the shape's bounding radius.
pub const WAY_OUT_ACCURACY: f32 = 1.0e-6;

/// How far bodies in contact may move relative to each other within a substep of the solver, per metre of the smaller one's bounding
/// radius. Larger, and fast impacts transfer too little or too much; smaller, and they cost more.
pub const SUBSTEP_WAY: f32 = 0.1;

/// Greatest number of substeps.
pub const MAX_SUBSTEPS: usize = 1000;

/// Largest coordinate of a place, a velocity or an angular velocity, in SI units, that a body may have and be simulated: fourth powers, of which
/// distances of cones and slabs are made, are finite up to here.
pub const MAX_MAGNITUDE: f32 = 1.0e9;

/// Scales that went through a rotation are the same but for this, relatively.
pub const SCALE_ROUNDING: f32 = 1.0e-4;

/// Largest number of contacts of a pair that the reduction looks at. Larger, and fine shapes that lie on each other cost more; smaller, and what is
/// covered by what is told less well.
pub const MANY_CONTACTS: usize = 96;

/// Cells to the extent of a pair's contacts, each way, into which they are sorted first where there are more; then half as many, until there are
/// no more. A power of two.
pub const THIN_CELLS: f32 = 32.0;

/// Steps of a normal's coordinates that tell contacts of a cell apart: about 15 degrees each.
pub const THIN_NORMALS: f32 = 4.0;

/// How far around a contact, in length units, the surfaces of other parts are looked at: several times what rapier lets bodies overlap.
pub const SEAM_REACH: f32 = 4.0e-3;

/// Height in length units up to which a part that goes on from another one makes no step.
pub const FLUSH: f32 = 1.0e-4;

/// How far from a sphere, in its radii, nearest points may be that have been found on it, but for rounding.
pub const SAME_SPHERE: f32 = 1.0e-4;

/// Distance in length units up to which contacts are at the same place, but for rounding.
pub const SAME_PLACE: f32 = 1.0e-5;

/// Cosine of the angle up to which contacts push the same way (a quarter of a degree).
pub const SEAM_COSINE: f32 = 1.0 - 1.0e-5;

/// The golden section: steps of that part of a turn, or of a list, fill it evenly however many they are.
pub const GOLDEN_TURN: f64 = 0.381_966_011_250_105_1;
