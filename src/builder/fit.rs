//! Medial meshes of a triangle mesh by what they may cost or how exact they have to be.

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

/// Spheres where nothing is said.
const DEFAULT_SPHERES: usize = 60;

/// Fewest spheres with which an error is tried, and most where no number is given.
const TRIED: [usize; 2] = [8, 512];

/// What to make of a triangle mesh.
#[derive(Clone, Copy, Debug, PartialEq, Reflect)]
#[cfg_attr(feature = "serialize", derive(serde::Serialize, serde::Deserialize))]
#[reflect(Default, Clone, PartialEq)]
pub struct FitOptions {
    /// Most spheres of the finest level. `None`: 60, or as many as the error takes, up to 512.
    pub spheres: Option<usize>,
    /// Greatest error of the finest level, either way, in percent of the mesh's diagonal. The fewest spheres of 8, 16, 32, ... that
    /// reach it are taken; if none do, the most.
    pub max_error: Option<f32>,
    /// All levels of detail, down to one sphere a component; else the finest alone.
    pub levels: bool,
    /// How often each level is sought from other samples, of which the best is taken. `None`: the finest once or twice, as time allows, and less
    /// thoroughly where there are fewer than 100 triangles for each sphere; others the more often the coarser they are, up to four times.
    pub searches: Option<usize>,
    /// The same seed gives the same result.
    pub seed: u64,
}

impl Default for FitOptions {
    fn default() -> Self {
        Self { spheres: None, max_error: None, levels: false, searches: None, seed: DEFAULT_SEED }
    }
}

/// Medial meshes of a solid with their two-sided errors, those to the mesh [with its holes closed](TriangleMesh::with_holes_closed).
///
/// `progress` is told the part of the work that is done, from 0 to 1, and may break it off. It starts anew with each trial of an error.
///
/// # Errors
/// As for [`build`](super::build()).
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
                    // If half of them do nothing, more do no more.
                    Ok(found) if spheres == most || found.1.error.max() <= error || found.0.balls() < spheres / 2 => {
                        break found;
                    }
                    Ok(_) => {}
                    // Each component takes one.
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

/// The finest level, and those that are better than any coarser one.
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
            // The finest stays.
            (&[2.0, 1.0, 3.0], &[2.0, 1.0, 3.0]),
            (&[2.0, 9.0, 8.0, 1.0], &[2.0, 1.0]),
        ];
        for (errors, expected) in cases {
            assert_eq!(kept(errors), expected, "{errors:?}");
        }
    }
}
