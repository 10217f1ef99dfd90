//! Development only: bodies, engines and measures that the benchmarks, comparisons and tests of `bevy_medial` share.
//!
//! | module | contents |
//! |---|---|
//! | [`body`] | bodies as plain data |
//! | [`engines`] | one adapter per engine: this crate, rapier, avian |
//! | [`demo`] | the demo scenes as bodies |
//! | [`stand_in`], [`hulls`] | convex decompositions of models, and their errors |
//! | [`measure`], [`overlap`], [`activity`] | the run of a scene in an engine: times, overlaps, losses |
//! | [`culling`], [`baselines`] | culling by trees of bounding volumes, compared with the hybrid culling |
//! | [`stability`] | situations in which collision methods fail |
//! | [`characters`] | animated characters: the cost of a step, bullets, a crowd of bodies |
//! | [`pairs`] | moving primitives, and files of moving pairs |
//! | [`convex`] | minimisation by plain search |
//! | [`paper`] | the rules and the method of the paper |
//! | [`renderer`] | an app with a renderer and without a window |
//! | [`tables`], [`outcome`] | CSV, machine, date; exit codes |
//! | [`charts`], [`figures`] | curves and bars as SVG; the charts of the reports |
//!
//! The feature `peers` adds avian and the dependencies of the programs in this folder. The tests of `bevy_medial` do not need it.

pub mod activity;
pub mod baselines;
pub mod body;
pub mod characters;
pub mod charts;
pub mod convex;
pub mod culling;
pub mod demo;
pub mod engines;
pub mod figures;
pub mod hulls;
pub mod measure;
pub mod outcome;
pub mod overlap;
pub mod pairs;
pub mod paper;
pub mod renderer;
pub mod stability;
pub mod stand_in;
pub mod tables;
