//! All tests that need the crate from outside, except those of the program `medial`.
//!
//! One binary, so that Bevy is linked once. Everything is seeded, and nothing depends on the clock.

#[macro_use]
mod pairs;
mod builder;
mod common;
mod flights;
mod gpu;
mod kernels;
mod log;
mod physics;
mod random_steps;
mod reference;
mod score;
mod stability;
mod true_motion;
