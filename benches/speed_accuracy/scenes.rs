//! The demo scenes at several budgets, and in rapier with convex pieces: times of a step, and errors of the shapes.

use std::path::Path;

use bevy_medial::{
    builder::{self, Deviation},
    prelude::MedialBudget,
    scenes::{Model, Scene},
};
use bevy_medial_compare::{
    demo::{Demo, SceneModel},
    engines::{Ccd, Engine, Medial, Rapier, Variant},
    measure::{self, Plan, ShapeFigures},
    overlap::Surfaces,
    stand_in::{Kind, Shapes, stand_ins, worst},
};
use serde::Serialize;

/// The run of a scene with one kind of shapes.
#[derive(Clone, Debug, Serialize)]
pub struct SceneRow {
    pub scene: &'static str,
    pub method: &'static str,
    /// Budget in percent; 0 is the finest level. `None` for rapier.
    pub budget_percent: Option<f32>,
    /// Max distance from the mesh to the shape over all models, in percent of the diagonal.
    pub surface_error_percent: f32,
    /// Medians over active steps, in milliseconds.
    pub collision_ms: f64,
    pub step_ms: f64,
    /// Deepest overlap of the exact meshes, in percent of the smaller body's size.
    pub overlap_max_percent: f32,
    pub lost: usize,
}

/// The names of this crate's shapes and of rapier's in charts.
pub const METHODS: [&str; 2] = ["medial meshes", "convex pieces"];

/// Runs a scene at each budget, and with each kind of convex pieces.
///
/// # Errors
/// If a model cannot be read or a shape cannot be made.
pub fn rows(
    name: &str,
    models: &[Model],
    folder: &Path,
    (budgets, kinds): (&[f32], &[Kind]),
    plan: Plan,
) -> Result<Vec<SceneRow>, String> {
    const DT: f32 = 1.0 / 60.0;
    let scene = Scene::by_name(name).ok_or_else(|| format!("there is no scene `{name}`"))?;
    let demo = Demo::new(scene, models, folder, DT)?;
    let surfaces = Surfaces::new(&demo)?;
    let plan = Plan { steps: plan.steps.min(scene.steps as usize), ..plan };
    let run = |method, budget_percent, error: Deviation, make: &dyn Fn() -> Result<Box<dyn Engine>, String>| {
        let figures = ShapeFigures { parts: 0.0, error };
        let row = measure::run((scene.name, method), &demo, &surfaces, figures, make, plan)?;
        Ok::<_, String>(SceneRow {
            scene: scene.name,
            method,
            budget_percent,
            surface_error_percent: error.max,
            collision_ms: row.collision_active_ms,
            step_ms: row.step_active_ms,
            overlap_max_percent: row.overlap_max_percent,
            lost: row.lost,
        })
    };
    let mut rows = Vec::new();
    for &percent in budgets {
        let budget = MedialBudget::Percent(percent);
        let error = |model: &SceneModel| {
            builder::measure(&model.mesh, model.axis.level(budget.level(&model.axis, 1.0))).mesh_to_envelope
        };
        let error = worst(demo.models.iter().map(error));
        rows.push(run(METHODS[0], Some(percent), error, &|| {
            demo.fill(Medial::new(demo.setup, Variant::Cpu).with_budget(budget), &[])
        })?);
    }
    let mut shapes = Shapes::default();
    for &kind in kinds {
        let made = shapes.of_demo(kind, &demo);
        let error = worst(made.iter().map(|shape| shape.error));
        let parts = stand_ins(&made);
        rows.push(run(METHODS[1], None, error, &|| demo.fill(Rapier::new(demo.setup, Ccd::Default), &parts))?);
    }
    Ok(rows)
}
