use std::time::Duration;

use bevy::{
    diagnostic::{Diagnostic, DiagnosticPath, Diagnostics, RegisterDiagnostic},
    prelude::*,
};

use super::{MedialLevel, MedialStep};
use crate::medial_axis::MedialAxis;

/// Paths of the measurements in the `DiagnosticsStore`, one measurement per step.
pub mod paths {
    use bevy::diagnostic::DiagnosticPath;

    /// Time to record the poses of bodies before rapier's step and to gather the input after it, in milliseconds.
    #[cfg(feature = "rapier")]
    pub const SNAPSHOT: DiagnosticPath = DiagnosticPath::const_new("medial/snapshot_ms");
    /// Time to move bodies to their stops and to pass the manifolds to rapier, in milliseconds.
    #[cfg(feature = "rapier")]
    pub const MOVE: DiagnosticPath = DiagnosticPath::const_new("medial/move_ms");
    /// Time of the broad phase, in milliseconds.
    pub const BROAD: DiagnosticPath = DiagnosticPath::const_new("medial/broad_ms");
    /// Time of the mid phase, in milliseconds.
    pub const MID: DiagnosticPath = DiagnosticPath::const_new("medial/mid_ms");
    /// Time of the narrow phase, which finds the first impacts, in milliseconds.
    pub const NARROW: DiagnosticPath = DiagnosticPath::const_new("medial/narrow_ms");
    /// Time to stop bodies at impacts, in milliseconds.
    pub const STOP: DiagnosticPath = DiagnosticPath::const_new("medial/stop_ms");
    /// Time to find and reduce contacts, in milliseconds.
    pub const CONTACT_SEARCH: DiagnosticPath = DiagnosticPath::const_new("medial/contact_search_ms");
    /// Number of bodies.
    pub const BODIES: DiagnosticPath = DiagnosticPath::const_new("medial/bodies");
    /// Number of body pairs after the broad phase.
    pub const BODY_PAIRS: DiagnosticPath = DiagnosticPath::const_new("medial/body_pairs");
    /// Number of primitive pairs after the mid phase.
    pub const CANDIDATES: DiagnosticPath = DiagnosticPath::const_new("medial/candidates");
    /// Number of time of impact queries.
    pub const TOI_TESTS: DiagnosticPath = DiagnosticPath::const_new("medial/toi_tests");
    /// Number of contact points.
    pub const CONTACTS: DiagnosticPath = DiagnosticPath::const_new("medial/contacts");
    /// Number of time of impact queries that reached the iteration limit. Their results are conservative.
    pub const UNRESOLVED: DiagnosticPath = DiagnosticPath::const_new("medial/unresolved");
    /// Times of the passes of [`GpuCulling`](crate::gpu::GpuCulling) on the GPU, in milliseconds.
    #[cfg(feature = "gpu")]
    pub const GPU: [DiagnosticPath; 7] = [
        DiagnosticPath::const_new("medial/gpu/place_ms"),
        DiagnosticPath::const_new("medial/gpu/sort_ms"),
        DiagnosticPath::const_new("medial/gpu/tree_ms"),
        DiagnosticPath::const_new("medial/gpu/broad_ms"),
        DiagnosticPath::const_new("medial/gpu/chords_ms"),
        DiagnosticPath::const_new("medial/gpu/mid_ms"),
        DiagnosticPath::const_new("medial/gpu/narrow_ms"),
    ];
    /// Delay of the GPU's answer that the step used, in steps; 0 if the step waited for the answer.
    #[cfg(feature = "gpu")]
    pub const GPU_LATENCY: DiagnosticPath = DiagnosticPath::const_new("medial/gpu/latency_steps");
    /// Number of bodies that were culled on the CPU in such a step, because they were not at their predicted place.
    #[cfg(feature = "gpu")]
    pub const GPU_DEPARTED: DiagnosticPath = DiagnosticPath::const_new("medial/gpu/departed_bodies");
    /// Number of bodies that stopped at an impact or were pushed by a kinematic body.
    pub const STOPPED: DiagnosticPath = DiagnosticPath::const_new("medial/stopped");
    /// Number of entities, moving or not, at each level of detail, the finest first. The last number includes all coarser levels.
    pub const LEVELS: [DiagnosticPath; 8] = [
        DiagnosticPath::const_new("medial/level_0"),
        DiagnosticPath::const_new("medial/level_1"),
        DiagnosticPath::const_new("medial/level_2"),
        DiagnosticPath::const_new("medial/level_3"),
        DiagnosticPath::const_new("medial/level_4"),
        DiagnosticPath::const_new("medial/level_5"),
        DiagnosticPath::const_new("medial/level_6"),
        DiagnosticPath::const_new("medial/level_7"),
    ];
    /// Main memory of all loaded medial meshes with their levels of detail, in bytes.
    pub const SHAPE_MEMORY: DiagnosticPath = DiagnosticPath::const_new("medial/shape_memory");
}

const TIMES: [DiagnosticPath; 5] = [paths::BROAD, paths::MID, paths::NARROW, paths::STOP, paths::CONTACT_SEARCH];
#[cfg(feature = "rapier")]
const TIMES_AROUND: [DiagnosticPath; 2] = [paths::SNAPSHOT, paths::MOVE];
const COUNTS: [DiagnosticPath; 7] = [
    paths::BODIES,
    paths::BODY_PAIRS,
    paths::CANDIDATES,
    paths::TOI_TESTS,
    paths::CONTACTS,
    paths::UNRESOLVED,
    paths::STOPPED,
];

pub(super) fn register(app: &mut App) {
    #[cfg(feature = "rapier")]
    for path in TIMES_AROUND {
        app.register_diagnostic(Diagnostic::new(path).with_suffix("ms"));
    }
    for path in TIMES {
        app.register_diagnostic(Diagnostic::new(path).with_suffix("ms"));
    }
    for path in COUNTS.into_iter().chain(paths::LEVELS) {
        app.register_diagnostic(Diagnostic::new(path));
    }
    app.register_diagnostic(Diagnostic::new(paths::SHAPE_MEMORY).with_suffix("bytes"));
    #[cfg(feature = "gpu")]
    {
        paths::GPU.into_iter().for_each(|path| {
            app.register_diagnostic(Diagnostic::new(path).with_suffix("ms"));
        });
        for path in [paths::GPU_LATENCY, paths::GPU_DEPARTED] {
            app.register_diagnostic(Diagnostic::new(path));
        }
    }
}

pub(super) fn measure(
    step: Res<MedialStep>,
    entities: Query<&MedialLevel>,
    axes: Res<Assets<MedialAxis>>,
    mut diagnostics: Diagnostics,
    mut last: Local<u64>,
) {
    // There is no new step while physics is paused, or in a frame between two steps.
    if std::mem::replace(&mut *last, step.number) == step.number {
        return;
    }
    let (times, counts) = (&step.output.times, &step.output.counts);
    let milliseconds = |duration: Duration| duration.as_secs_f64() * 1e3;
    for (path, time) in TIMES.iter().zip([times.broad, times.mid, times.narrow, times.stop, times.contacts]) {
        diagnostics.add_measurement(path, || milliseconds(time));
    }
    #[cfg(feature = "rapier")]
    for (path, time) in TIMES_AROUND.iter().zip([step.snapshot_time, step.move_time]) {
        diagnostics.add_measurement(path, || milliseconds(time));
    }
    let counts = [
        counts.bodies,
        counts.body_pairs,
        counts.candidates,
        counts.toi_tests,
        counts.contacts,
        counts.unresolved,
        step.output.stops.len(),
    ];
    for (path, count) in COUNTS.iter().zip(counts) {
        diagnostics.add_measurement(path, || count as f64);
    }
    let mut levels = paths::LEVELS.map(|path| (path, 0u32));
    for MedialLevel(level) in &entities {
        levels[(*level).min(levels.len() - 1)].1 += 1;
    }
    for (path, count) in &levels {
        diagnostics.add_measurement(path, || (*count).into());
    }
    diagnostics.add_measurement(&paths::SHAPE_MEMORY, || axes.iter().map(|(_, axis)| axis.memory() as f64).sum());
    #[cfg(feature = "gpu")]
    if let Some(steps) = step.gpu_latency {
        for (path, (_, time)) in paths::GPU.iter().zip(step.gpu_times()) {
            diagnostics.add_measurement(path, || milliseconds(*time));
        }
        diagnostics.add_measurement(&paths::GPU_LATENCY, || steps.into());
        diagnostics.add_measurement(&paths::GPU_DEPARTED, || step.gpu_departed as f64);
    }
}
