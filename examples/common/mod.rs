//! Parts that several examples share. No example uses all of them.
#![allow(dead_code)]

pub mod button;
pub mod display;
pub mod dress;
pub mod movie;
pub mod slider;
pub mod stage;
pub mod studio;
