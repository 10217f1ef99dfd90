//! Medial meshes of a triangle mesh with a limited number of spheres or a limited error.

use std::ops::ControlFlow;

use bevy::prelude::{Reflect, ReflectDefault};

use super::{
    BuildError, BuildOptions, Built, DEFAULT_SEED, Level, MedialLevels, TriangleMesh,
    build::{coarser, finest, finest_share},
    judge::Judge,
    measure,
    progress::between,
    search::Search,
    solid::Solid,
};
use crate::medial_axis::MAX_SPHERES;

/// Default number of spheres.
const DEFAULT_SPHERES: usize = 60;

/// Smallest number of spheres tried for a limited error, and default of the largest number.
const TRIED: [usize; 2] = [8, 512];

/// Options of a fit.
#[derive(Clone, Copy, Debug, PartialEq, Reflect)]
#[cfg_attr(feature = "serialize", derive(serde::Serialize, serde::Deserialize))]
#[reflect(Default, Clone, PartialEq)]
pub struct FitOptions {
    /// Largest number of spheres of the finest level. `None`: 60, or with `max_error` as many as it requires, up to 512.
    pub spheres: Option<usize>,
    /// Largest error of the finest level in either direction, in percent of the mesh's diagonal. The smallest number of spheres of 8, 16, 32, ... that
    /// reaches it is used; if none does, the largest number.
    pub max_error: Option<f32>,
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
        Self { spheres: None, max_error: None, levels: false, searches: None, seed: DEFAULT_SEED }
    }
}

/// Builds medial meshes of a solid, with their two-sided errors relative to the mesh [with its holes closed](TriangleMesh::with_holes_closed).
///
/// `progress` is called with the completed part of the work, from 0 to 1, and may cancel the build. With a limited error it starts again at 0 for each trial.
///
/// # Errors
/// The errors of [`build`](super::build()).
pub fn fit(
    mesh: &TriangleMesh,
    options: &FitOptions,
    progress: &(dyn Fn(f32) -> ControlFlow<()> + Sync),
) -> Result<MedialLevels, BuildError> {
    let with = |spheres: usize| BuildOptions {
        spheres,
        searches: options.searches,
        seed: options.seed,
        ..BuildOptions::default()
    };
    let solid = Solid::new(mesh)?;
    let judge = Judge::new(&solid, options.seed);
    let level = |built: Built| Level { error: measure(&solid.mesh, &built.axis), axis: built.axis };
    let share = |spheres: usize| if options.levels { finest_share(mesh, &with(spheres)) } else { 1.0 };
    let trial = |spheres: usize| -> Result<(Search, Level), BuildError> {
        let search = finest(&judge, mesh, &with(spheres), &between(progress, 0.0, share(spheres)))?;
        let level = level(search.built(&solid)?);
        Ok((search, level))
    };
    let (search, first) = match options.max_error {
        None => trial(options.spheres.unwrap_or(DEFAULT_SPHERES))?,
        Some(error) => {
            let most = options.spheres.unwrap_or(TRIED[1]).min(MAX_SPHERES);
            let mut spheres = TRIED[0].min(most);
            loop {
                match trial(spheres) {
                    // If fewer than half of the spheres are used, more spheres do not reduce the error.
                    Ok(found) if spheres == most || found.1.error.max() <= error || found.0.balls() < spheres / 2 => {
                        break found;
                    }
                    Ok(_) => {}
                    // Each component needs a sphere, so the next number may be large enough.
                    Err(BuildError::TooFewSpheres { .. }) if spheres < most => {}
                    Err(error) => return Err(error),
                }
                spheres = spheres.saturating_mul(2).min(most);
            }
        }
    };
    let mut levels = vec![first];
    if options.levels {
        let spheres = search.spheres();
        let progress = between(progress, share(spheres), 1.0);
        levels.extend(coarser(&judge, mesh, &with(spheres), search, level, &progress)?);
    }
    Ok(MedialLevels { levels: useful(levels) })
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
mod tests {
    use super::*;
    use crate::{
        builder::{Deviation, TwoSidedError},
        medial_axis::MedialAxis,
    };

    #[test]
    fn a_level_no_better_than_a_coarser_one_is_left_out() {
        let kept = |errors: &[f32]| {
            let level = |&max: &f32| Level {
                axis: MedialAxis::torus(1.0, 0.2, 8).unwrap(),
                error: TwoSidedError { mesh_to_envelope: Deviation { max, mean: 0.1 }, ..TwoSidedError::default() },
            };
            let levels: Vec<Level> = errors.iter().map(level).collect();
            useful(levels).iter().map(|level| level.error.max()).collect::<Vec<_>>()
        };
        let cases: [(&[f32], &[f32]); 6] = [
            (&[], &[]),
            (&[3.0], &[3.0]),
            (&[1.0, 2.0, 4.0], &[1.0, 2.0, 4.0]),
            (&[1.0, 5.0, 4.0, 4.0, 7.0], &[1.0, 4.0, 7.0]),
            // The finest level is always kept.
            (&[2.0, 1.0, 3.0], &[2.0, 1.0, 3.0]),
            (&[2.0, 9.0, 8.0, 1.0], &[2.0, 1.0]),
        ];
        for (errors, expected) in cases {
            assert_eq!(kept(errors), expected, "{errors:?}");
        }
    }
}
