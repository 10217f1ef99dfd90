//! Piles of tori, for up to a minute.

use bevy_medial::random::Random;
use glam::Vec3;

use super::{Hazard, ensure};
use crate::{
    body::{Body, Form, Setup},
    stability::{judge::World, methods::Method},
};

const FEW: &str = "12 tori fall in a heap. No torus sinks into the floor or leaves it. From 12 s to 20 s, no torus drifts by 1 % of its size or moves at \
    0.1 m/s. At the end no overlap is deeper than twice the allowed depth";
const MANY: &str = "The same with 51 tori, from 30 s to 60 s";

pub const HAZARDS: &[Hazard] = &[
    Hazard { name: "12 tori for 20 s", criterion: FEW, seeds: [1, 2], run: |m, s| pile(m, s, 12, [12.0, 8.0]) },
    Hazard { name: "51 tori for 60 s", criterion: MANY, seeds: [0, 1], run: |m, s| pile(m, s, 51, [30.0, 30.0]) },
];

fn pile(method: &Method, seed: u64, count: usize, [settle, watch]: [f32; 2]) -> Result<(), String> {
    let mut random = Random(seed);
    let mut world = World::new(method, Setup::default())?;
    world.add_floor()?;
    for i in 0..count {
        let (layer, rest) = (i / 9, i % 9);
        let place = Vec3::new((rest % 3) as f32 - 1.0, 0.0, (rest / 3) as f32 - 1.0) * 0.7;
        let center = place + Vec3::Y * (0.6 + 0.7 * layer as f32) + random.in_ball() * 0.05;
        let torus = Body::dynamic(Form::torus(0.24, 0.06)).at(center).turned(random.rotation());
        world.add(torus.damped())?;
    }
    for _ in 0..settle.round() as u32 {
        world.run(1.0)?;
        for body in world.dynamic() {
            let center = world.center(body);
            let inside = center.y > 0.0 && center.x.abs().max(center.z.abs()) < 10.0;
            ensure(inside, || format!("escaped: a torus is lost after {:.0} s", world.time))?;
        }
    }
    let start: Vec<Vec3> = world.dynamic().into_iter().map(|body| world.center(body)).collect();
    let mut fastest = 0.0f32;
    for _ in 0..(watch * 60.0).round() as u32 {
        world.step(1)?;
        fastest = world.dynamic().into_iter().map(|body| world.state(body).linear.length()).fold(fastest, f32::max);
    }
    let drifts = world.dynamic().into_iter().zip(start).map(|(body, start)| world.center(body).distance(start) / 0.6);
    let drift = drifts.fold(0.0, f32::max);
    ensure(drift < 0.01, || format!("drift: a torus drifts by {:.1} % of its size in {watch:.0} s", 100.0 * drift))?;
    ensure(fastest < 0.1, || format!("jitter: a torus moves at {fastest:.2} m/s"))?;
    world.check_overlaps(2.0)
}
