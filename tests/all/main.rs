//! All tests of the public interface, except those of the program `medial`.
//!
//! The tests share one binary, so Bevy is linked once. All random numbers are seeded, and no test depends on the clock.

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
