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

use std::{
    cmp::Ordering,
    collections::{BTreeMap, BinaryHeap, HashMap},
};

use bevy::tasks::TaskPool;
use glam::{Quat, Vec3};

use super::{
    Impact, Side, Statics, StepInput,
    broad_phase::BodyPair,
    first_impact::{ImpactResult, first_impact},
    islands::Islands,
    motion::PairMotion,
    moving_boxes::BodyBoxes,
    narrow_phase::are_in_touch,
    parallel,
};
use crate::{
    constants::{LANDING, MAX_PUSHES, MAX_SLIDES, RENEWED_SLOP},
    geometry::{Pose3, Sweep},
};

/// What becomes of each body whose motion ends before the step does.
pub(super) struct Stops(Vec<Option<Course>>);

/// The motion of a body from an impact on.
#[derive(Clone, Copy)]
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
#[derive(Clone, Copy, PartialEq, PartialOrd)]
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
    /// True if the body does not end the step where its motion would take it.
    pub fn is_stopped(&self, body: u32) -> bool {
        self.0[body as usize].is_some()
    }

    fn state(&self, body: u32) -> State {
        self.0[body as usize].map_or(State::Free, |course| course.state)
    }

    fn pushes(&self, body: u32) -> u32 {
        self.0[body as usize].map_or(0, |course| course.pushes)
    }

    /// How far a body has slid from its own way, in metres.
    fn slid(&self, body: u32) -> f32 {
        self.0[body as usize].map_or(0.0, |course| course.slid)
    }

    /// The course of a body that leaves its way from a fraction on.
    fn slide(&self, input: &StepInput, body: u32, fraction: f32, way: Vec3) -> Course {
        let (slides, slid) = self.0[body as usize].map_or((0, 0.0), |course| (course.slides, course.slid));
        let rest = self.sweep_from(input, body, fraction);
        let sweep = moved_on(&rest, -way);
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
        self.0[body as usize].map_or(input.bodies[body as usize].sweep.end, |course| course.sweep.end)
    }

    /// The bodies that end elsewhere, and the fractions at which they left their way for good: 1 for those that slide.
    pub fn iter(&self) -> impl Iterator<Item = (u32, f32)> + '_ {
        (0..).zip(&self.0).filter_map(|(body, course)| {
            let course = course.as_ref()?;
            Some((body, if course.state == State::Sliding { 1.0 } else { course.from }))
        })
    }

    /// Between which times of its own motion a body is from a fraction on, but for what it has slid. None if it has left it.
    fn times(&self, side: Side, fraction: f32) -> Option<[f32; 2]> {
        match side.body().and_then(|body| self.0[body as usize]) {
            None | Some(Course { state: State::Free | State::Sliding, .. }) => Some([fraction, 1.0]),
            Some(Course { state: State::Stopped, from, .. }) => Some([from; 2]),
            Some(_) => None,
        }
    }

    /// The motion of a body from a fraction on.
    fn sweep_from(&self, input: &StepInput, body: u32, fraction: f32) -> Sweep {
        match &self.0[body as usize] {
            Some(course) if fraction > course.from => {
                course.sweep.rest_from((fraction - course.from) / (1.0 - course.from))
            }
            Some(course) => course.sweep,
            None => input.bodies[body as usize].sweep.rest_from(fraction),
        }
    }
}

/// A pair's impact in the queue, outdated if the pair has another by now.
#[derive(Clone, Copy, PartialEq)]
struct Event {
    fraction: f32,
    pair: usize,
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
        other.fraction.total_cmp(&self.fraction).then(other.pair.cmp(&self.pair))
    }
}

/// Stops bodies; `results` then holds the impacts that have happened.
///
/// Of each island an impact is taken at a time, and what all of these change is searched on the pool's threads.
pub(super) fn run(
    input: &StepInput,
    statics: &Statics,
    pairs: &[BodyPair],
    boxes: &BodyBoxes,
    results: &mut [ImpactResult],
    pool: &TaskPool,
) -> Stops {
    let stops = Stops(vec![None; input.bodies.len()]);
    let is_event = |pair: usize| pairs[pair].stops && results[pair].impact.is_some();
    if !(0..pairs.len()).any(is_event) {
        return stops;
    }
    let mut pairs_of: Vec<Vec<usize>> = vec![Vec::new(); input.bodies.len()];
    for (i, pair) in pairs.iter().enumerate() {
        pair.bodies().for_each(|body| pairs_of[body as usize].push(i));
    }
    let mut assembled: HashMap<u64, Vec<u32>> = HashMap::new();
    for (index, body) in (0..).zip(&input.bodies) {
        if let Some(assembly) = body.assembly {
            assembled.entry(assembly).or_default().push(index);
        }
    }
    let islands = Islands::new(input, pairs, boxes, results, &assembled, pool);
    let next = results.iter().map(|result| result.impact).collect();
    let happened = vec![false; pairs.len()];
    let mut run = Run { input, statics, pairs, results, stops, pairs_of, assembled, islands, next, happened };
    let mut queues = run.queues();
    loop {
        let mut searches: Vec<(usize, Event)> = Vec::new();
        let mut is_over = true;
        for (island, queue) in queues.iter_mut().enumerate() {
            let Some((event, impact)) = run.earliest(queue) else { continue };
            is_over = false;
            // Never 1, when all is over.
            let fraction = event.fraction.min(1.0f32.next_down());
            let affected = run.meet(event.pair, impact, fraction);
            searches.extend(affected.into_iter().map(|pair| (island, Event { fraction, pair })));
        }
        if is_over {
            return run.stops;
        }
        let found = parallel::map(pool, &searches, 8, |_, &(_, Event { fraction, pair })| {
            impact_from(input, statics, (&pairs[pair], boxes), &run.stops, fraction, &run.results[pair])
        });
        for ((island, Event { pair, .. }), found) in searches.into_iter().zip(found) {
            queues[island].extend(run.take(pair, found));
        }
    }
}

/// Where a step is.
struct Run<'a> {
    input: &'a StepInput,
    statics: &'a Statics,
    pairs: &'a [BodyPair],
    /// Of each pair the first impact, those that are prevented aside.
    results: &'a mut [ImpactResult],
    stops: Stops,
    pairs_of: Vec<Vec<usize>>,
    assembled: HashMap<u64, Vec<u32>>,
    islands: Islands,
    /// The next impact of each pair.
    next: Vec<Option<Impact>>,
    happened: Vec<bool>,
}

impl Run<'_> {
    /// The bodies that a body is joined with, itself among them.
    fn joined_with(&self, body: u32) -> Vec<u32> {
        match self.input.bodies[body as usize].assembly {
            Some(assembly) => self.assembled[&assembly].clone(),
            None => vec![body],
        }
    }

    /// The impacts of each island, in the order of time.
    fn queues(&self) -> Vec<BinaryHeap<Event>> {
        let mut queues: BTreeMap<u32, BinaryHeap<Event>> = BTreeMap::new();
        for (pair, impact) in self.next.iter().enumerate().filter(|(pair, _)| self.pairs[*pair].stops) {
            let body = self.pairs[pair].bodies().find(|&body| self.input.is_stopping(body));
            if let (Some(impact), Some(body)) = (impact, body.or_else(|| self.pairs[pair].bodies().next())) {
                queues.entry(self.islands.of(body)).or_default().push(Event { fraction: impact.fraction, pair });
            }
        }
        queues.into_values().collect()
    }

    /// The earliest impact of an island that is not outdated.
    fn earliest(&mut self, queue: &mut BinaryHeap<Event>) -> Option<(Event, Impact)> {
        std::iter::from_fn(|| queue.pop()).find_map(|event| {
            let impact = self.next[event.pair].take_if(|impact| impact.fraction == event.fraction)?;
            Some((event, impact))
        })
    }

    /// Takes in what a search has found for a pair; its impact, if there is one.
    fn take(&mut self, pair: usize, found: ImpactResult) -> Option<Event> {
        self.results[pair].toi_tests += found.toi_tests;
        self.results[pair].unresolved += found.unresolved;
        self.next[pair] = found.impact;
        if !self.happened[pair] {
            self.results[pair].impact = found.impact;
        }
        found.impact.map(|impact| Event { fraction: impact.fraction, pair })
    }

    /// Lets an impact happen. The pairs that are to be searched again from there.
    fn meet(&mut self, pair: usize, impact: Impact, fraction: f32) -> Vec<usize> {
        self.happened[pair] = true;
        let mut courses = self.slides_on(pair, &impact, fraction);
        let stands = courses.is_empty();
        if stands {
            courses = self.stops_at(pair, &impact, fraction);
        }
        for &(body, course) in &courses {
            self.stops.0[body as usize] = Some(course);
        }
        let mut affected: Vec<usize> =
            courses.iter().flat_map(|(body, _)| &self.pairs_of[*body as usize]).copied().collect();
        affected.retain(|&other| (other != pair || !stands) && self.islands.may_meet(other));
        affected.sort_unstable();
        affected.dedup();
        affected
    }

    /// The courses of the bodies of a pair that slide on along each other. None, if they have to stop.
    fn slides_on(&self, pair: usize, impact: &Impact, fraction: f32) -> Vec<(u32, Course)> {
        let mut courses: Vec<(u32, Course)> = Vec::new();
        for (body, way) in slides(self.input, &self.stops, &self.pairs[pair], &self.results[pair], impact, fraction) {
            let course = |body| (body, self.stops.slide(self.input, body, fraction, way));
            courses.extend(self.joined_with(body).into_iter().map(course));
        }
        // What has met stays in touch, or the next step would know of no contact.
        let parted = courses.iter().flat_map(|(body, _)| &self.pairs_of[*body as usize]).any(|&other| {
            let end = |body| match courses.iter().find(|(other, _)| *other == body) {
                Some((_, course)) => course.sweep.end,
                None => self.stops.final_pose(self.input, body),
            };
            let met = self.results[other].impact.filter(|_| self.happened[other]);
            met.is_some_and(|met| !are_in_touch(self.input, self.statics, &self.pairs[other], &met, end))
        });
        if parted { Vec::new() } else { courses }
    }

    /// The courses of the bodies of a pair that stop at each other, or push.
    fn stops_at(&self, pair: usize, impact: &Impact, fraction: f32) -> Vec<(u32, Course)> {
        let (input, stops) = (self.input, &self.stops);
        let BodyPair { first, second, .. } = self.pairs[pair];
        let mut courses = Vec::new();
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
            for body in self.joined_with(body) {
                let now = stops.sweep_from(input, body, fraction);
                let sweep = match (state, &push) {
                    // What pushes it already goes on to do so.
                    (State::Carried, Some(_)) if before == State::Carried => {
                        moved_on(&now, away * (into - own).max(0.0))
                    }
                    (State::Carried, Some(push)) => carried(&now, push, away),
                    _ => Sweep::at_rest(now.start),
                };
                let pushes = pushes + u32::from(state == State::Carried);
                let slid = stops.slid(body);
                courses.push((body, Course { from: fraction, sweep, state, slides: 0, slid, pushes }));
            }
        }
        courses
    }
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
) -> Vec<(u32, Vec3)> {
    let mut ways = [Vec3::ZERO; 2];
    let mut slides = Vec::new();
    for ((side, way), into) in [pair.first, pair.second].into_iter().zip(&mut ways).zip([impact.normal, -impact.normal])
    {
        let Some(body) = side.body() else { continue };
        if !input.is_stopping(body) || stops.state(body) > State::Stopped {
            return Vec::new();
        }
        let sweep = stops.sweep_from(input, body, fraction);
        *way = way_at(&sweep, impact.point);
        slides.push((body, into * sweep.translation.dot(into).max(0.0)));
    }
    let slip = ways[0] - ways[1];
    let all: f32 = slides.iter().map(|(_, way)| way.length()).sum();
    let part = if all > 0.0 { (slip.dot(impact.normal) / all).clamp(0.0, 1.0) } else { 0.0 };
    slides.iter_mut().for_each(|(_, way)| *way *= part);
    slides.retain(|(_, way)| *way != Vec3::ZERO);
    let slide_way = input.slide_way();
    let slow = ways.into_iter().chain([slip]).any(|way| way.length() <= slide_way);
    let most = slide_way.min(if in_touch { f32::INFINITY } else { LANDING * slop });
    let may = slides.iter().all(|&(body, way)| {
        let (slides, slid) = stops.0[body as usize].map_or((0, 0.0), |course| (course.slides, course.slid));
        slides < MAX_SLIDES && slid + way.length() <= most
    });
    if slow && may { slides } else { Vec::new() }
}

/// The first impact of a pair from a fraction on. `before`: of the whole step, were no body to stop.
fn impact_from(
    input: &StepInput,
    statics: &Statics,
    (pair, boxes): (&BodyPair, &BodyBoxes),
    stops: &Stops,
    fraction: f32,
    before: &ImpactResult,
) -> ImpactResult {
    let mut motions = PairMotion::all(input, statics, pair, |body| stops.sweep_from(input, body, fraction));
    // Overlaps have grown since the start of the step already.
    motions.iter_mut().for_each(|motion| motion.slop *= RENEWED_SLOP);
    // On a shorter way none grows by that, whatever the others do.
    motions.retain(|motion| motion.way() > motion.slop);
    let boxes = [pair.first, pair.second].map(|side| boxes.between(side, stops.times(side, fraction)?));
    let slack = pair.bodies().map(|body| stops.slid(body)).sum();
    let mut found = first_impact(input.culling, motions, None, boxes, slack, before.normal);
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

/// What is left of the step for a body that another pushes in a direction: it goes along as if it were part of the other. Where that one
/// rather slides past, as a platform does under what falls on it, only with what of its way is a push.
fn carried(body: &Sweep, pusher: &Sweep, direction: Vec3) -> Sweep {
    let center = pusher.start.transform_point(pusher.local_center);
    let turn = Quat::from_scaled_axis(pusher.rotation);
    let push = pusher.translation.dot(direction).max(0.0);
    let slides = push < 0.5 * pusher.translation.length();
    let way = if slides { direction * push } else { pusher.translation };
    let place = |point: Vec3| center + turn * (point - center) + way;
    let end = Pose3::from_parts(place(body.start.translation), (turn * body.start.rotation).normalize());
    Sweep::between(body.start, end, body.local_center, pusher.rotation)
}
