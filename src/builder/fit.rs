//! Medial meshes of a triangle mesh with a limited number of spheres or a limited error.

use std::{iter::once, ops::ControlFlow};

use bevy::prelude::{Reflect, ReflectDefault};

use super::{
    BuildError, BuildOptions, Built, DEFAULT_SEED, Level, MedialLevels, SideLimits, TriangleMesh,
    build::{coarser, finest, finest_share},
    check::{check, check_solid, within},
    convex,
    optimise::{Judge, Search},
    progress::between,
    sides::keep,
    solid::Solid,
};
use crate::medial_axis::MAX_SPHERES;

/// Default number of spheres.
const DEFAULT_SPHERES: usize = 60;

/// Smallest number of spheres tried for a limited error, and default of the largest number.
const TRIED: [usize; 2] = [8, 512];

/// Default of the largest error, in percent of the diagonal.
const ERROR_LIMIT: f32 = 6.0;

/// Options of a fit.
#[derive(Clone, Copy, Debug, PartialEq, Reflect)]
#[cfg_attr(feature = "serialize", derive(serde::Serialize, serde::Deserialize), serde(default))]
#[reflect(Default, Clone, PartialEq)]
pub struct FitOptions {
    /// Largest number of spheres of the finest level. `None`: 60, or as many as `max_error`, the mass properties or `error_limit` require, up to 512.
    pub spheres: Option<usize>,
    /// Largest error of the finest level in either direction, in percent of the mesh's diagonal. The smallest number of spheres of 8, 16, 32, ... that
    /// reaches it is used; if none does, the number with the smallest error.
    pub max_error: Option<f32>,
    /// Error of the finest level in percent of the diagonal above which the build fails. Default: 6 %.
    pub error_limit: f32,
    /// Limits of all levels on either side of the surface, which dense samples verify. Radii are corrected until they are kept, more spheres are tried
    /// otherwise, and then the build fails. Coarser levels that cannot keep them are left out. The mass properties of such shapes may differ from the mesh's,
    /// but bodies use those of the mesh.
    pub sides: SideLimits,
    /// True: builds all levels of detail, down to one sphere per component. False: builds the finest level only.
    pub levels: bool,
    /// Number of searches for each level, each from different samples; the best result is used. `None`: one or two for the finest level, depending on the
    /// size of the mesh, with a shorter search below 100 triangles per sphere. Coarser levels have up to four, the coarser the more.
    pub searches: Option<usize>,
    /// Seed of the samples. The same seed gives the same result.
    pub seed: u64,
}

impl Default for FitOptions {
    fn default() -> Self {
        Self {
            spheres: None,
            max_error: None,
            error_limit: ERROR_LIMIT,
            sides: SideLimits::default(),
            levels: false,
            searches: None,
            seed: DEFAULT_SEED,
        }
    }
}

/// Builds medial meshes of a solid, with their two-sided errors relative to the surface that bounds it: the mesh
/// [with its holes closed](TriangleMesh::with_holes_closed), without repeated triangles, sheets, and surfaces that other pieces hide.
///
/// Volume, centre of mass and inertia of the finest level are within 10 % of those of the solid. The centre of mass is relative to the radius of gyration.
///
/// `progress` is called with the completed part of the work, from 0 to 1, and may cancel the build. It starts again at 0 for each trial of a number of spheres.
///
/// # Errors
/// The errors of [`build`](super::build()), and those of a finest level whose mass properties or error exceed their limits with every number of spheres.
pub fn fit(
    mesh: &TriangleMesh,
    options: &FitOptions,
    progress: &(dyn Fn(f32) -> ControlFlow<()> + Sync),
) -> Result<MedialLevels, BuildError> {
    let solid = Solid::new(mesh)?;
    check_solid(&solid)?;
    let levels = exact(&solid, options).map_or_else(|| searched(mesh, &solid, options, progress), Ok)?;
    Ok(MedialLevels { levels: useful(levels), mass: solid.mass, sides: options.sides })
}

/// The levels of a solid that needs no search. `None` for other solids, and if these levels do not satisfy the options.
fn exact(solid: &Solid, options: &FitOptions) -> Option<Vec<Level>> {
    let most = if options.max_error.is_some() { TRIED[1] } else { DEFAULT_SPHERES };
    let finest = f64::from(options.max_error.unwrap_or(f32::INFINITY)) / 100.0;
    let levels = convex::exact(solid, options.spheres.unwrap_or(most), finest)?;
    let levels = levels.into_iter().take(if options.levels { 2 } else { 1 });
    let mut levels = levels.map(|level| kept(solid, level, options.sides));
    let first = levels.next()?.ok()?;
    check(solid, &first, options.error_limit).ok()?;
    // If the other level has as many spheres, both are the same.
    let spheres = first.axis.spheres().len();
    let others = levels.flatten().filter(|level| level.axis.spheres().len() < spheres);
    Some(once(first).chain(others).collect())
}

/// A level that keeps limits.
fn kept(solid: &Solid, level: Level, sides: SideLimits) -> Result<Level, BuildError> {
    if sides == SideLimits::default() {
        return Ok(level);
    }
    let spheres = level.axis.spheres().len();
    let axis = keep(solid, &level.axis, sides).map_err(|[out, gap]| BuildError::Sides { spheres, out, gap })?;
    Ok(Level { error: solid.measure(&axis), axis })
}

/// The levels that searches find.
fn searched(
    mesh: &TriangleMesh,
    solid: &Solid,
    options: &FitOptions,
    progress: &(dyn Fn(f32) -> ControlFlow<()> + Sync),
) -> Result<Vec<Level>, BuildError> {
    let with = |spheres: usize| BuildOptions {
        spheres,
        searches: options.searches,
        seed: options.seed,
        ..BuildOptions::default()
    };
    let judge = Judge::new(solid, options.seed);
    let level = |built: Built| Level { error: solid.measure(&built.axis), axis: built.axis };
    let share = |spheres: usize| if options.levels { finest_share(mesh, &with(spheres)) } else { 1.0 };
    let examine = |search: Search| -> Result<Trial, BuildError> {
        let free = level(search.built(solid)?);
        let found = check(solid, &free, f32::INFINITY).and_then(|()| kept(solid, free.clone(), options.sides));
        let (level, flaw) = match found {
            Ok(level) => {
                let flaw = within(&level, options.error_limit).err();
                (level, flaw)
            }
            Err(flaw) => (free, Some(flaw)),
        };
        Ok(Trial { search, level, flaw })
    };
    let trial = |spheres: usize| -> Result<Trial, BuildError> {
        let fitted = examine(finest(&judge, mesh, &with(spheres), &between(progress, 0.0, share(spheres)))?)?;
        if fitted.flaw.is_none() {
            return Ok(fitted);
        }
        let inscribed = examine(fitted.search.inscribed(&judge))?;
        Ok(if inscribed.flaw.is_none() { inscribed } else { fitted })
    };
    let Trial { search, level: first, flaw } = best_trial(options, trial)?;
    if let Some(flaw) = flaw {
        return Err(flaw);
    }
    let mut levels = vec![first];
    if options.levels {
        let spheres = search.spheres();
        let progress = between(progress, share(spheres), 1.0);
        let coarser = coarser(&judge, mesh, &with(spheres), search, level, &progress)?;
        levels.extend(coarser.into_iter().filter_map(|level| kept(solid, level, options.sides).ok()));
    }
    Ok(levels)
}

/// A finest level with one number of spheres.
struct Trial {
    search: Search,
    level: Level,
    /// Limit that the level exceeds.
    flaw: Option<BuildError>,
}

/// Tries larger and larger numbers of spheres until one satisfies the options, and returns the best trial.
fn best_trial(options: &FitOptions, trial: impl Fn(usize) -> Result<Trial, BuildError>) -> Result<Trial, BuildError> {
    let most = options.spheres.unwrap_or(TRIED[1]).min(MAX_SPHERES);
    let first = if options.max_error.is_some() { TRIED[0] } else { options.spheres.unwrap_or(DEFAULT_SPHERES) };
    let enough = options.max_error.unwrap_or(f32::INFINITY);
    let mut spheres = first.min(most);
    let mut best: Option<Trial> = None;
    loop {
        match trial(spheres) {
            Ok(found) => {
                let rank = |trial: &Trial| (trial.flaw.is_some(), trial.level.error.max());
                let is_enough = found.flaw.is_none() && found.level.error.max() <= enough;
                // If fewer than half of the spheres are used, more spheres do not reduce the error.
                let is_last = is_enough || spheres == most || found.search.balls() < spheres / 2;
                best = Some(best.take().filter(|best| rank(best) <= rank(&found)).unwrap_or(found));
                if is_last && let Some(best) = best.take() {
                    return Ok(best);
                }
            }
            // Each component needs a sphere, so the next number may be large enough.
            Err(BuildError::TooFewSpheres { .. }) if spheres < most => {}
            Err(error) => return best.filter(|_| error != BuildError::Cancelled).ok_or(error),
        }
        spheres = spheres.saturating_mul(2).min(most);
    }
}

/// The finest level, and the levels with a smaller error than every coarser level.
fn useful(levels: Vec<Level>) -> Vec<Level> {
    let mut kept: Vec<Level> = vec![];
    for (number, level) in levels.into_iter().enumerate().rev() {
        if number == 0 || kept.last().is_none_or(|coarser| level.error.max() < coarser.error.max()) {
            kept.push(level);
        }
    }
    kept.reverse();
    kept
}

#[cfg(test)]
mod tests;
