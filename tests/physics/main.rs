//! Medial bodies in an app: they fall, rest, stop, and tell what they touch; and the pipeline behind it keeps its promises.
//!
//! One binary, so that Bevy is linked once. Everything is seeded, nothing depends on the clock.

#[path = "../../benches/baselines/mod.rs"]
mod baselines;
mod builds;
mod bullets;
mod casts;
mod colliders;
mod common;
mod culling;
mod determinism;
mod entities;
mod filters;
mod first_touch;
mod flights;
mod gizmos;
mod impacts;
mod interplay;
mod joined;
mod levels;
mod life;
mod log;
mod messages;
mod observers;
mod picking;
mod probes;
mod projectile;
mod pushing;
mod quarantine;
mod queries;
mod random_steps;
#[path = "../kernels/reference.rs"]
#[allow(dead_code)]
mod reference;
mod rolling;
mod routes;
mod scaled;
mod scenes;
mod seams;
mod settling;
mod solver;
mod spins;
mod statics;
mod true_motion;
mod walks;
mod workspaces;
mod worlds;
