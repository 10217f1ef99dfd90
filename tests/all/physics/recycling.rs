//! Pairs that hardly move keep their contacts from step to step. Nothing else changes.

use bevy::tasks::ComputeTaskPool;
use bevy_medial::{
    constants::LINEAR_SLOP,
    geometry::{Obb, Pose3, Sweep},
    medial_axis::MedialAxis,
    pipeline::{
        Body, Displacement, Pair, PairFilter, Shape, Solid, StaticBody, Statics, StepInput, StepOutput, Workspace, step,
    },
};
use glam::{Quat, Vec3};

use crate::{common::Random, random_steps::random_step};

/// A room whose bodies mostly move by less than [`LINEAR_SLOP`] per step.
struct Room {
    random: Random,
    input: StepInput,
    statics: Statics,
    workspace: Workspace,
}

impl Room {
    fn new(seed: u64) -> Self {
        let mut random = Random(seed);
        let (mut input, statics) = random_step(&mut random, 12, 6, 1.5, Vec3::ZERO);
        (input.prediction, input.stop_at_impact) = (0.02, true);
        for (id, body) in (0..).zip(&mut input.bodies) {
            (body.id, body.order, body.active, body.stops) = (Some(id), id as u32, true, true);
            body.sweep = Sweep::at_rest(body.sweep.start);
        }
        let bodies = (100..).zip(statics.bodies().iter().cloned());
        let bodies = bodies.map(|(id, body)| StaticBody { id: Some(id), order: id as u32, ..body }).collect();
        Self { random, input, statics: Statics::new(bodies), workspace: Workspace::default() }
    }

    /// Moves the bodies, teleports some, and changes the scale or the shape of some.
    fn advance(&mut self, last: &StepOutput) {
        let Self { random, input, .. } = self;
        for i in 0..input.bodies.len() {
            let other = input.bodies[random.below(input.bodies.len())].solid.clone();
            let body = &mut input.bodies[i];
            let mut start = last.stop_of(i as u32).map_or(body.sweep.end, |stop| stop.pose);
            match random.below(200) {
                0 => start.translation += random.in_ball(),
                1 => body.solid = other,
                2 => body.solid = rescaled(&body.solid, [0.8, 1.25][random.below(2)]),
                3 => body.active = !body.active,
                _ => {}
            }
            let size = if random.below(20) == 0 { 0.05 } else { 1.0e-4 };
            let rotation = Quat::from_scaled_axis(random.in_ball() * size) * start.rotation;
            let end = Pose3::from_parts(start.translation + random.in_ball() * size, rotation.normalize());
            body.sweep = Sweep::between(start, end, Vec3::ZERO, Vec3::ZERO);
            if !body.active {
                body.sweep = Sweep::at_rest(start);
            }
            body.next_displacement =
                Some(Displacement { translation: Vec3::splat(1.0e-4), rotation: Vec3::ZERO, radius: 1.0, fall: 0.0 });
        }
    }

    fn step(&mut self) -> [StepOutput; 2] {
        let pool = ComputeTaskPool::get_or_init(Default::default);
        let mut output = StepOutput::default();
        self.workspace.step(&self.input, &self.statics, |_, _| PairFilter::Stopping, pool, &mut output);
        [output, step(&self.input, &self.statics, pool)]
    }
}

fn rescaled(solid: &Solid, factor: f32) -> Solid {
    let shape = solid.medial().expect("random bodies are medial");
    Solid::Medial(Shape { axis: shape.axis.clone(), scale: (shape.scale * factor).clamp(0.3, 2.0) })
}

/// The smallest distance of a pair's contacts, in metres.
fn distance(output: &StepOutput, pair: &Pair) -> f32 {
    let manifolds = output.manifolds[pair.manifolds.clone()].iter();
    manifolds.map(|manifold| manifold.contacts()[0].distance).fold(f32::INFINITY, f32::min)
}

/// Counts of a comparison with steps that search all contacts.
#[derive(Debug, Default)]
struct Comparison {
    pair_steps: usize,
    /// Candidate primitive pairs of the search for impacts: with a cache, and without one.
    candidates: [usize; 2],
    /// Pairs in touch in both steps.
    touching: usize,
    /// Those with other bits, which have recycled contacts.
    recycled: usize,
    /// Pairs in touch in one of both steps only.
    different: usize,
    /// Differences of distances, in metres.
    errors: Vec<f32>,
}

impl Comparison {
    fn add(&mut self, [recycling, searching]: &[StepOutput; 2]) {
        assert_eq!(recycling.stops, searching.stops);
        let impacts = |output: &StepOutput| -> Vec<_> {
            output.pairs.iter().filter_map(|pair| Some((pair.first, pair.second, pair.impact?))).collect()
        };
        assert_eq!(impacts(recycling), impacts(searching));
        self.pair_steps += recycling.counts.body_pairs;
        self.candidates[0] += recycling.counts.candidates;
        self.candidates[1] += searching.counts.candidates;
        for pair in &searching.pairs {
            let other = recycling.pairs.iter().find(|other| [other.first, other.second] == [pair.first, pair.second]);
            let expected = distance(searching, pair);
            let found = other.map_or(f32::INFINITY, |other| distance(recycling, other));
            if expected.min(found) > LINEAR_SLOP {
                continue;
            }
            let error = (found - expected).abs();
            if (expected <= LINEAR_SLOP) == (found <= LINEAR_SLOP) {
                self.touching += 1;
                self.recycled += usize::from(error > 0.0);
            } else {
                self.different += 1;
            }
            self.errors.push(error);
        }
    }
}

fn compare(seeds: u64, steps: u32) -> Comparison {
    let mut comparison = Comparison::default();
    for seed in 0..seeds {
        let mut room = Room::new(seed);
        let mut outputs = room.step();
        for _ in 0..steps {
            room.advance(&outputs[0]);
            outputs = room.step();
            comparison.add(&outputs);
        }
    }
    comparison.errors.sort_by(f32::total_cmp);
    comparison
}

fn check(seeds: u64, steps: u32, pair_steps: usize) {
    let result = compare(seeds, steps);
    let Comparison { touching, recycled, different, ref errors, .. } = result;
    let at = |part: f32| errors[((errors.len() - 1) as f32 * part) as usize];
    println!(
        "{} pair-steps, {touching} touching, {recycled} recycled, {different} different; errors {:?} m",
        result.pair_steps,
        [0.5, 0.99, 0.999, 1.0].map(at)
    );
    assert!(result.pair_steps >= pair_steps && 4 * recycled > touching);
    let [cached, all] = result.candidates;
    assert!(cached < all, "no pair is skipped because of its gap");
    assert!(1000 * different <= touching);
    assert!(at(0.99) < 0.3 * LINEAR_SLOP && at(1.0) < LINEAR_SLOP);
}

#[test]
fn recycled_contacts_agree_with_searched_contacts() {
    check(4, 150, 5_000);
}

#[test]
#[ignore = "exhaustive"]
fn exhaustive_recycled_contacts_agree_with_searched_contacts() {
    check(40, 300, 100_000);
}

/// Moves one of two touching balls. Returns true if their contact keeps its point on the first ball. `displacement` in metres.
fn is_recycled(displacement: f32) -> bool {
    let pool = ComputeTaskPool::get_or_init(Default::default);
    let ball = MedialAxis::sphere(0.5).unwrap();
    let mut bodies = [0.0, 0.999].map(|x| {
        let pose = Pose3::from_translation(Vec3::X * x);
        Body { id: Some(x.to_bits().into()), ..Body::new(Shape::new(ball.clone()), Sweep::at_rest(pose)) }
    });
    let mut workspace = Workspace::default();
    let mut point = |bodies: &[Body; 2]| {
        let mut output = StepOutput::default();
        let input = StepInput { bodies: bodies.to_vec(), prediction: 0.02, ..Default::default() };
        workspace.step(&input, &Statics::default(), |_, _| PairFilter::Stopping, pool, &mut output);
        output.manifolds[0].contacts()[0].point1
    };
    let before = point(&bodies);
    let pose = Pose3::from_translation(Vec3::new(0.999, displacement, 0.0));
    bodies[1].sweep = Sweep::at_rest(pose);
    point(&bodies) == before
}

#[test]
fn only_pairs_that_hardly_move_keep_their_contacts() {
    assert!(is_recycled(0.0) && is_recycled(0.9 * LINEAR_SLOP));
    assert!(!is_recycled(1.1 * LINEAR_SLOP));
}

/// A ball that rolls on a plate by less than the tolerance: its contact is recycled, and the normal does not turn with the ball.
#[test]
fn recycled_normals_do_not_turn_with_a_rolling_ball() {
    let pool = ComputeTaskPool::get_or_init(Default::default);
    let ball = Shape::new(MedialAxis::sphere(0.1).unwrap());
    let plate = Obb { pose: Pose3::IDENTITY, half_extents: Vec3::new(5.0, 0.5, 5.0) };
    let statics = Statics::new(vec![StaticBody { id: Some(2), ..StaticBody::solid_box(plate) }]);
    let mut workspace = Workspace::default();
    let mut kept = 0;
    let mut first = None;
    for step in 0..10 {
        let rolled = 1.0e-4 * step as f32;
        let rotation = Quat::from_rotation_z(-rolled / 0.1);
        let pose = Pose3::from_parts(Vec3::new(rolled, 0.5995, 0.0), rotation);
        let body = Body { id: Some(1), ..Body::new(ball.clone(), Sweep::at_rest(pose)) };
        let input = StepInput { bodies: vec![body], prediction: 0.02, ..Default::default() };
        let mut output = StepOutput::default();
        workspace.step(&input, &statics, |_, _| PairFilter::Stopping, pool, &mut output);
        let contact = output.manifolds[0].contacts()[0];
        kept += usize::from(first == Some(contact.point1));
        first.get_or_insert(contact.point1);
        let normal = rotation * output.manifolds[0].normal1;
        assert!(normal.distance(Vec3::NEG_Y) < 1.0e-6, "{normal} after {rolled} m");
        assert!((contact.distance + 5.0e-4).abs() < 1.0e-5, "{} m after {rolled} m", contact.distance);
    }
    assert!(kept >= 3, "kept in {kept} steps");
}
