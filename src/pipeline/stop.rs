//! Which bodies stop within the step, and when: impacts in the order of time.
//!
//! At an impact both bodies stop, unless little of their way goes into each other: then they slide on without that. So does a ball that
//! rolls: the solver keeps up the place where it touched, which turns away, and the ball sinks. A body whose turning alone takes it into the
//! other stops.
//!
//! A body that has stopped is no longer where others were swept against it, so their impacts with it
//! are found anew, from that instant on, with the one at rest: an impact that its stop prevents is none, and one that it causes is
//! found.
//!
//! A body that does not stop, a kinematic one, carries along what it hits: the next step finds the two in touch, and the one is pushed. What
//! is carried takes along what it hits in turn, and goes on as far as whatever pushes it next does, until something does not give way. A body goes
//! through a few states and pushes at most, so this ends.
//!
//! What is left of the step is lost to a body that stops. Bodies that part after an impact lose one step at most each time they meet. Thin ones
//! that tumble along each other at high speed stop again and again, wherever their overlap has grown by a slop: they come through it with
//! the right momentum, and late.

use std::{cmp::Ordering, collections::BinaryHeap, time::Duration};

use arrayvec::ArrayVec;
use bevy::tasks::TaskPool;
use glam::{Quat, Vec3};

use super::{
    Body, Impact, Scratch, Side, Statics, StepInput,
    assemblies::Assemblies,
    first_impact::{ImpactResult, Question, first_impact},
    islands::Islands,
    motion::PairMotion,
    narrow_phase::are_in_touch,
    pairs::{BodyPair, PairsOf},
    parallel::{self, Scratches},
};
use crate::{
    constants::{LANDING, LEAST_FREE, MAX_PUSHES, MAX_SLIDES, RENEWED_SLOP},
    geometry::{Pose3, Sweep},
};

/// What becomes of each body whose motion ends before the step does.
#[derive(Debug, Default)]
pub(super) struct Stops {
    courses: Vec<Course>,
    /// Of each body the number of its course, or [`NONE`].
    of: Vec<u32>,
}

const NONE: u32 = u32::MAX;

/// The motion of a body from an impact on.
#[derive(Clone, Copy, Debug)]
struct Course {
    /// When it begins, as a fraction of the step.
    from: f32,
    /// The rest of the step.
    sweep: Sweep,
    state: State,
    /// How often it has slid, and how far from its own way, in metres.
    slides: u32,
    slid: f32,
    /// How often it has been pushed.
    pushes: u32,
}

/// What has happened to a body. It goes from one state to a later one only.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
enum State {
    Free,
    /// It goes on along what it touches.
    Sliding,
    /// It stays where it is.
    Stopped,
    /// It goes along with another that pushes it.
    Carried,
    /// It was carried against what does not give way, and stays there.
    Wedged,
}

impl Stops {
    /// No body has stopped.
    fn reset(&mut self, bodies: usize) {
        self.courses.clear();
        self.of.clear();
        self.of.resize(bodies, NONE);
    }

    fn course(&self, body: u32) -> Option<&Course> {
        // Those that have none lie beyond the end of all.
        self.courses.get(self.of[body as usize] as usize)
    }

    fn set(&mut self, body: u32, course: Course) {
        let of = &mut self.of[body as usize];
        match self.courses.get_mut(*of as usize) {
            Some(known) => *known = course,
            None => {
                *of = self.courses.len() as u32;
                self.courses.push(course);
            }
        }
    }

    fn state(&self, body: u32) -> State {
        self.course(body).map_or(State::Free, |course| course.state)
    }

    fn pushes(&self, body: u32) -> u32 {
        self.course(body).map_or(0, |course| course.pushes)
    }

    /// How far a body has slid from its own way, in metres.
    fn slid(&self, body: u32) -> f32 {
        self.course(body).map_or(0.0, |course| course.slid)
    }

    /// The course of a body that leaves its way from a fraction on.
    fn slide(&self, input: &StepInput, body: u32, fraction: f32, way: Vec3) -> Course {
        let (slides, slid) = self.course(body).map_or((0, 0.0), |course| (course.slides, course.slid));
        let way = input.bodies[body as usize].free_way(way);
        let sweep = moved_on(&self.sweep_from(input, body, fraction), -way);
        Course {
            from: fraction,
            sweep,
            state: State::Sliding,
            slides: slides + 1,
            slid: slid + way.length(),
            pushes: 0,
        }
    }

    /// Where a body is at the end of the step.
    pub fn final_pose(&self, input: &StepInput, body: u32) -> Pose3 {
        self.course(body).map_or(input.bodies[body as usize].sweep.end, |course| course.sweep.end)
    }

    /// The fraction at which a body has left its way for good: 1 for one that has not, or slides on.
    pub fn left(&self, body: u32) -> f32 {
        self.course(body).filter(|course| course.state != State::Sliding).map_or(1.0, |course| course.from)
    }

    /// True if a body leaves its way.
    pub fn leaves_way(&self, body: u32) -> bool {
        self.course(body).is_some()
    }

    /// From when on a pair is to be searched again, as a fraction of the step, if its bodies leave their ways before the impact that was found on those.
    fn leaves(&self, pair: &BodyPair, impact: Option<Impact>) -> Option<f32> {
        let from = pair.bodies().filter_map(|body| self.course(body)).map(|course| course.from);
        let [first, last] = from.fold([f32::INFINITY, 0.0], |[first, last], from| [from.min(first), from.max(last)]);
        (first < fraction_of(impact) && first <= last).then_some(last)
    }

    /// The bodies that end elsewhere, and the fractions at which they left their way for good.
    pub fn iter(&self) -> impl Iterator<Item = (u32, f32)> + '_ {
        (0..self.of.len() as u32).filter(|&body| self.leaves_way(body)).map(|body| (body, self.left(body)))
    }

    /// Between which times of its own motion a body is from a fraction on, but for what it has slid. None if it has left it.
    fn times(&self, side: Side, fraction: f32) -> Option<[f32; 2]> {
        match side.body().and_then(|body| self.course(body)) {
            None | Some(Course { state: State::Free | State::Sliding, .. }) => Some([fraction, 1.0]),
            Some(Course { state: State::Stopped, from, .. }) => Some([*from; 2]),
            Some(_) => None,
        }
    }

    /// The motion of a body from a fraction on.
    fn sweep_from(&self, input: &StepInput, body: u32, fraction: f32) -> Sweep {
        match self.course(body) {
            Some(course) if fraction > course.from => {
                course.sweep.rest_from((fraction - course.from) / (1.0 - course.from))
            }
            Some(course) => course.sweep,
            None => input.bodies[body as usize].sweep.rest_from(fraction),
        }
    }
}

/// A pair's impact in the queue, outdated if the pair has another by now.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Event {
    impact: Impact,
    pair: usize,
}

impl Event {
    /// When the bodies leave their ways: never at 1, when all is over.
    fn fraction(&self) -> f32 {
        self.impact.fraction.min(1.0f32.next_down())
    }
}

/// What an event of a round makes of a body.
#[derive(Clone, Copy, Debug)]
struct Outcome {
    event: usize,
    body: u32,
    course: Course,
}

/// A pair that is to be searched again from a fraction on, and its island's queue.
#[derive(Clone, Copy, Debug)]
struct Search {
    queue: usize,
    pair: usize,
    fraction: f32,
}

impl Eq for Event {}

impl PartialOrd for Event {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Event {
    /// The greatest is the earliest, of those the first pair.
    fn cmp(&self, other: &Self) -> Ordering {
        other.impact.fraction.total_cmp(&self.impact.fraction).then(other.pair.cmp(&self.pair))
    }
}

/// What is kept from step to step, so that nothing has to be allocated anew.
#[derive(Debug, Default)]
pub(super) struct Buffers {
    stops: Stops,
    pairs_of: PairsOf,
    assemblies: Assemblies,
    islands: Islands,
    /// When the next impact of each pair is, as a fraction of the step; infinite if there is none.
    next: Vec<f32>,
    happened: Vec<bool>,
    /// Of each island that has an impact.
    queues: Vec<BinaryHeap<Event>>,
    /// The impacts of a round, each with its island's queue, and what they lead to.
    events: Vec<(usize, Event)>,
    outcomes: Vec<Outcome>,
    affected: Vec<usize>,
    searches: Vec<Search>,
    found: Vec<ImpactResult>,
}

/// Stops bodies; `results` then holds the impacts that have happened.
///
/// Of each island an impact is taken at a time; what these do to its bodies, and what that changes, is found on the pool's threads.
pub(super) fn run<'b>(
    input: &StepInput,
    statics: &Statics,
    pairs: &[BodyPair],
    results: &mut [ImpactResult],
    buffers: &'b mut Buffers,
    tasks: &Scratches<Scratch>,
    pool: &TaskPool,
) -> &'b Stops {
    let Buffers {
        stops,
        pairs_of,
        assemblies,
        islands,
        next,
        happened,
        queues,
        events,
        outcomes,
        affected,
        searches,
        found,
    } = buffers;
    stops.reset(input.bodies.len());
    let is_event = |pair: usize| pairs[pair].stops && results[pair].impact.is_some();
    if !(0..pairs.len()).any(is_event) {
        return stops;
    }
    pairs_of.set(input.bodies.len(), pairs);
    assemblies.set(input);
    islands.set(input, statics, pairs, results, assemblies, tasks, pool);
    next.clear();
    next.extend(results.iter().map(|result| fraction_of(result.impact)));
    happened.clear();
    happened.resize(pairs.len(), false);
    let mut run = Run { input, statics, pairs, results, stops, pairs_of, assemblies, next, happened };
    run.fill(queues, events, islands);
    loop {
        events.clear();
        for (island, queue) in queues.iter_mut().enumerate() {
            events.extend(run.earliest(queue).map(|event| (island, event)));
        }
        if events.is_empty() {
            break;
        }
        run.meet(events, outcomes, tasks, pool);
        searches.clear();
        for outcomes in outcomes.chunk_by(|a, b| a.event == b.event) {
            let (queue, event) = events[outcomes[0].event];
            run.leave(&event, outcomes, affected);
            let again = affected.iter().filter(|&&pair| islands.may_meet(pair));
            searches.extend(again.map(|&pair| Search { queue, pair, fraction: event.fraction() }));
        }
        run.search(searches, found, tasks, pool);
        for (&Search { queue, pair, .. }, found) in searches.iter().zip(found.drain(..)) {
            queues[queue].extend(run.take(pair, found.impact));
        }
    }
    // Whom nothing stops at has not been looked at again.
    searches.clear();
    searches.extend((0..pairs.len()).filter_map(|pair| {
        let fraction = run.stops.leaves(&pairs[pair], run.results[pair].impact).filter(|_| !pairs[pair].stops)?;
        Some(Search { queue: 0, pair, fraction })
    }));
    run.search(searches, found, tasks, pool);
    for (&Search { pair, .. }, found) in searches.iter().zip(found.drain(..)) {
        run.results[pair].impact = found.impact;
    }
    stops
}

/// Where a step is.
struct Run<'a> {
    input: &'a StepInput,
    statics: &'a Statics,
    pairs: &'a [BodyPair],
    /// Of each pair the first impact, those that are prevented aside.
    results: &'a mut [ImpactResult],
    stops: &'a mut Stops,
    pairs_of: &'a PairsOf,
    assemblies: &'a Assemblies,
    next: &'a mut [f32],
    happened: &'a mut [bool],
}

impl Run<'_> {
    /// Puts the impacts of each island into a queue of its own, in the order of time. `events`: room to work in.
    fn fill(&self, queues: &mut Vec<BinaryHeap<Event>>, events: &mut Vec<(usize, Event)>, islands: &Islands) {
        events.clear();
        for (pair, result) in self.results.iter().enumerate().filter(|(pair, _)| self.pairs[*pair].stops) {
            let body = self.pairs[pair].bodies().find(|&body| self.input.is_stopping(body));
            if let (Some(impact), Some(body)) = (result.impact, body.or_else(|| self.pairs[pair].bodies().next())) {
                events.push((islands.of(body) as usize, Event { impact, pair }));
            }
        }
        events.sort_unstable_by_key(|(island, _)| *island);
        queues.iter_mut().for_each(BinaryHeap::clear);
        for (i, events) in events.chunk_by(|a, b| a.0 == b.0).enumerate() {
            if queues.len() <= i {
                queues.push(BinaryHeap::new());
            }
            queues[i].extend(events.iter().map(|(_, event)| *event));
        }
    }

    /// The earliest impact of an island that is not outdated.
    fn earliest(&self, queue: &mut BinaryHeap<Event>) -> Option<Event> {
        std::iter::from_fn(|| queue.pop()).find(|event| self.next[event.pair] == event.impact.fraction)
    }

    /// The first impacts of pairs from fractions on, with their bodies on the courses that they have by now.
    fn search(&self, searches: &[Search], found: &mut Vec<ImpactResult>, tasks: &Scratches<Scratch>, pool: &TaskPool) {
        let Self { input, statics, pairs, results, stops, .. } = self;
        parallel::map(pool, tasks, searches, 4, found, |scratch, _, &Search { pair, fraction, .. }| {
            impact_from(input, statics, &pairs[pair], stops, fraction, &results[pair], scratch)
        });
    }

    /// Takes in what a search has found for a pair; its impact, if there is one.
    fn take(&mut self, pair: usize, found: Option<Impact>) -> Option<Event> {
        self.next[pair] = fraction_of(found);
        if !self.happened[pair] {
            self.results[pair].impact = found;
        }
        found.map(|impact| Event { impact, pair })
    }

    /// Lets an impact of each island happen, and finds what becomes of the bodies, to which those of other islands are nothing.
    fn meet(
        &mut self,
        events: &[(usize, Event)],
        outcomes: &mut Vec<Outcome>,
        tasks: &Scratches<Scratch>,
        pool: &TaskPool,
    ) {
        for (_, event) in events {
            self.next[event.pair] = f32::INFINITY;
            self.happened[event.pair] = true;
        }
        let run = &*self;
        outcomes.clear();
        parallel::gather(pool, tasks, events, 4, outcomes, |scratch, number, (_, event), outcomes| {
            if !run.slide_on(number, event, outcomes, scratch) {
                run.stop_at(number, event, outcomes);
            }
        });
    }

    /// Puts bodies on the courses that an impact has led to. `affected` becomes the pairs that are to be searched again from there.
    fn leave(&mut self, event: &Event, outcomes: &[Outcome], affected: &mut Vec<usize>) {
        outcomes.iter().for_each(|outcome| self.stops.set(outcome.body, outcome.course));
        let slides = outcomes.iter().any(|outcome| outcome.course.state == State::Sliding);
        affected.clear();
        affected.extend(outcomes.iter().flat_map(|outcome| self.pairs_of.of(outcome.body)));
        affected.retain(|&pair| pair != event.pair || slides);
        affected.sort_unstable();
        affected.dedup();
    }

    /// Adds the courses of the bodies of a pair that slide on along each other. False, if they have to stop.
    fn slide_on(&self, number: usize, event: &Event, outcomes: &mut Vec<Outcome>, scratch: &mut Scratch) -> bool {
        let (pair, fraction, begin) = (event.pair, event.fraction(), outcomes.len());
        let slides = slides(self.input, self.stops, &self.pairs[pair], &self.results[pair], &event.impact, fraction);
        for (body, way) in slides {
            let outcome =
                |body| Outcome { event: number, body, course: self.stops.slide(self.input, body, fraction, way) };
            outcomes.extend(self.assemblies.of(self.input, body).map(outcome));
        }
        let slid = &outcomes[begin..];
        // What has met stays in touch, or the next step would know of no contact.
        let end = |body| match slid.iter().find(|outcome| outcome.body == body) {
            Some(outcome) => outcome.course.sweep.end,
            None => self.stops.final_pose(self.input, body),
        };
        let parted = slid.iter().flat_map(|outcome| self.pairs_of.of(outcome.body)).any(|other| {
            let met = self.results[other].impact.filter(|_| self.happened[other]);
            met.is_some_and(|met| !are_in_touch(self.input, self.statics, &self.pairs[other], &met, end, scratch))
        });
        if parted {
            outcomes.truncate(begin);
        }
        outcomes.len() > begin
    }

    /// Adds the courses of the bodies of a pair that stop at each other, or push.
    fn stop_at(&self, number: usize, event: &Event, outcomes: &mut Vec<Outcome>) {
        let (input, stops, impact, fraction) = (self.input, &*self.stops, &event.impact, event.fraction());
        let BodyPair { first, second, .. } = self.pairs[event.pair];
        for (side, other, away) in [(first, second, -impact.normal), (second, first, impact.normal)] {
            let Some(body) = side.body().filter(|&body| input.is_stopping(body)) else { continue };
            let other = other.body();
            let push = other
                .filter(|&other| !input.is_stopping(other) || stops.state(other) == State::Carried)
                .map(|pusher| stops.sweep_from(input, pusher, fraction));
            // How far the pusher goes on this way, and the body.
            let way = |sweep: &Sweep| way_at(sweep, impact.point).dot(away);
            let [into, own] = [push.as_ref().map_or(0.0, way), way(&stops.sweep_from(input, body, fraction))];
            let (before, pushes) = (stops.state(body), stops.pushes(body));
            let state = match (before, &push) {
                (State::Free | State::Sliding | State::Stopped, Some(_)) => State::Carried,
                (State::Free | State::Sliding, None) => State::Stopped,
                (State::Carried, Some(_)) if into >= -own && pushes < MAX_PUSHES => State::Carried,
                // It goes on if the other gives way.
                (State::Carried, Some(_)) if into < -own && other.is_some_and(|other| input.is_stopping(other)) => {
                    continue;
                }
                (State::Carried, None) if other.is_some_and(|other| stops.state(other) < State::Carried) => continue,
                (State::Carried, _) => State::Wedged,
                _ => continue,
            };
            for body in self.assemblies.of(input, body) {
                let of = &input.bodies[body as usize];
                let now = stops.sweep_from(input, body, fraction);
                let sweep = match (state, &push) {
                    // What pushes it already goes on to do so.
                    (State::Carried, Some(_)) if before == State::Carried => {
                        moved_on(&now, of.free_way(away * (into - own).max(0.0)))
                    }
                    (State::Carried, Some(push)) => carried(of, &now, push, away),
                    _ => Sweep::at_rest(now.start),
                };
                let pushes = pushes + u32::from(state == State::Carried);
                let slid = stops.slid(body);
                let course = Course { from: fraction, sweep, state, slides: 0, slid, pushes };
                outcomes.push(Outcome { event: number, body, course });
            }
        }
    }
}

/// When an impact is, as a fraction of the step; never, if there is none.
fn fraction_of(impact: Option<Impact>) -> f32 {
    impact.map_or(f32::INFINITY, |impact| impact.fraction)
}

/// The bodies of a pair that slide on along each other, and by what they leave their way. None of them, if they have to stop.
///
/// Each loses the part of its own translation that goes into the other, as far as they approach at all. One of them has to stand, or both
/// to roll: of two that fly past each other, one may stop at a third, and the other would be gone.
fn slides(
    input: &StepInput,
    stops: &Stops,
    pair: &BodyPair,
    &ImpactResult { slop, in_touch, .. }: &ImpactResult,
    impact: &Impact,
    fraction: f32,
) -> ArrayVec<(u32, Vec3), 2> {
    let mut ways = [Vec3::ZERO; 2];
    let mut slides = ArrayVec::new();
    // What is joined would leave its way together, and be no farther apart.
    let [assembly1, assembly2] =
        [pair.first, pair.second].map(|side| side.body().and_then(|body| input.bodies[body as usize].assembly));
    if assembly1.is_some() && assembly1 == assembly2 {
        return slides;
    }
    for ((side, way), into) in [pair.first, pair.second].into_iter().zip(&mut ways).zip([impact.normal, -impact.normal])
    {
        let Some(body) = side.body() else { continue };
        if !input.is_stopping(body) || stops.state(body) > State::Stopped {
            return ArrayVec::new();
        }
        let sweep = stops.sweep_from(input, body, fraction);
        *way = way_at(&sweep, impact.point);
        let ahead = sweep.translation.dot(into).max(0.0);
        // Along the axes that it can go, as far as takes off as much, unless it can hardly give way.
        let free = input.bodies[body as usize].free_way(into);
        let gives = if free == into { 1.0 } else { free.length_squared() };
        slides.push((body, free * if gives > LEAST_FREE { ahead / gives } else { 0.0 }));
    }
    let slip = ways[0] - ways[1];
    let all: f32 = slides.iter().map(|(_, way)| way.dot(impact.normal).abs()).sum();
    let part = if all > 0.0 { (slip.dot(impact.normal) / all).clamp(0.0, 1.0) } else { 0.0 };
    slides.iter_mut().for_each(|(_, way)| *way *= part);
    slides.retain(|(_, way)| *way != Vec3::ZERO);
    let slide_way = input.slide_way();
    let slow = ways.into_iter().chain([slip]).any(|way| way.length() <= slide_way);
    let most = slide_way.min(if in_touch { f32::INFINITY } else { LANDING * slop });
    let may = slides.iter().all(|&(body, way)| {
        let (slides, slid) = stops.course(body).map_or((0, 0.0), |course| (course.slides, course.slid));
        slides < MAX_SLIDES && slid + way.length() <= most
    });
    if slow && may { slides } else { ArrayVec::new() }
}

/// The first impact of a pair from a fraction on. `before`: of the whole step, were no body to stop.
fn impact_from(
    input: &StepInput,
    statics: &Statics,
    pair: &BodyPair,
    stops: &Stops,
    fraction: f32,
    before: &ImpactResult,
    scratch: &mut Scratch,
) -> ImpactResult {
    let mut motions = PairMotion::all(input, statics, pair, |body| stops.sweep_from(input, body, fraction));
    // Overlaps have grown since the start of the step already.
    motions.iter_mut().for_each(|motion| motion.slop *= RENEWED_SLOP);
    // On a shorter way none grows by that, whatever the others do.
    motions.retain(|motion| motion.way() > motion.slop);
    let times = [pair.first, pair.second].map(|side| stops.times(side, fraction));
    let slack = pair.bodies().map(|body| stops.slid(body)).sum();
    // What was apart at the start the solver may not know, wherever it has come to by now.
    let near = if before.in_touch { before.near } else { 0.0 };
    let question = Question { input, statics, pair, known: None, times, slack, near, normal: before.normal };
    // What searches from impacts on take is not told apart.
    let mut found = first_impact(&question, motions, scratch, || Duration::ZERO);
    if let Some(impact) = &mut found.impact {
        impact.fraction = fraction + (1.0 - fraction) * impact.fraction;
    }
    found
}

/// How far a place that moves along with a body would go, did it go straight on.
fn way_at(sweep: &Sweep, point: Vec3) -> Vec3 {
    let arm = point - sweep.start.transform_point(sweep.local_center);
    sweep.translation + sweep.rotation.cross(arm)
}

/// The same motion, and farther by so much.
fn moved_on(sweep: &Sweep, way: Vec3) -> Sweep {
    let end = Pose3::from_parts(sweep.end.translation + way, sweep.end.rotation);
    Sweep { end, translation: sweep.translation + way, ..*sweep }
}

/// What is left of the step for a body that another pushes in a direction: it goes along as if it were part of the other, as far as its locked axes
/// let it. Where that one rather slides past, as a platform does under what falls on it, only with what of its way is a push.
fn carried(of: &Body, body: &Sweep, pusher: &Sweep, direction: Vec3) -> Sweep {
    let center = pusher.start.transform_point(pusher.local_center);
    let turn = Quat::from_scaled_axis(pusher.rotation);
    let push = pusher.translation.dot(direction).max(0.0);
    let slides = push < 0.5 * pusher.translation.length();
    let way = if slides { direction * push } else { pusher.translation };
    let own = body.start.transform_point(body.local_center);
    let moved = own + of.free_way(center + turn * (own - center) + way - own);
    let own_turn = of.free_turn(pusher.rotation);
    let rotation = (Quat::from_scaled_axis(own_turn) * body.start.rotation).normalize();
    let end = Pose3::from_parts(moved - rotation * body.local_center, rotation);
    Sweep::between(body.start, end, body.local_center, own_turn)
}
