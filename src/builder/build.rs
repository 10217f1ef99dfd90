//! Entry points of a build: the stages in order.

use std::iter::{once, successors};

use super::{
    BuildError, BuildOptions, Built, TriangleMesh,
    optimise::{Judge, Search, is_quick},
    parallel,
    progress::{Progress, Shares, between},
    solid::Solid,
};
use crate::{medial_axis::MAX_SPHERES, random::Random};

/// Triangles per sphere above which a build may take the time of two searches.
const TRIANGLES_FOR_TWO: usize = 165;

/// Default number of searches for the finest level. Each starts from different samples, because the result varies with them.
fn searches(triangles: usize, spheres: usize) -> usize {
    if is_quick(triangles, spheres) {
        return sought(spheres).max(1);
    }
    if triangles / TRIANGLES_FOR_TWO >= spheres { 2 } else { 1 }
}

/// Defaults for the searches of a coarser level, in addition to the one that starts from the level before, and of low-poly meshes: total number of spheres
/// of all searches, and largest number of searches. With fewer spheres, results vary more and searches are faster.
const SOUGHT: [usize; 2] = [48, 4];

/// Number of searches within these limits.
fn sought(spheres: usize) -> usize {
    (SOUGHT[0] / spheres).min(SOUGHT[1])
}

/// Number of searches for the finest level.
fn finest_searches(mesh: &TriangleMesh, options: &BuildOptions) -> usize {
    options.searches.unwrap_or_else(|| searches(mesh.triangles.len(), options.spheres.max(1))).max(1)
}

/// Number of searches from samples for another level of a chain.
fn level_searches(options: &BuildOptions, spheres: usize) -> usize {
    options.searches.unwrap_or_else(|| sought(spheres))
}

/// The options for another level of a chain. They set the number of searches explicitly, so that no search is hurried: a hurried shape is not judged and
/// could not be compared.
fn level_options(options: &BuildOptions, spheres: usize) -> BuildOptions {
    let share = |limit: usize| limit.saturating_mul(spheres) / options.spheres.max(1);
    let (edges, faces) = (options.edges.map(share), options.faces.map(share));
    BuildOptions { spheres, edges, faces, searches: Some(level_searches(options, spheres)), ..*options }
}

/// Builds a medial mesh of a solid.
///
/// `progress` is called with the completed part of the work, from 0 to 1, on any of the working threads, and may cancel the build.
///
/// # Errors
/// If the mesh has no area or encloses no volume, if a vertex is not finite or missing, if there are more components than
/// spheres, or if `progress` breaks.
pub fn build(mesh: &TriangleMesh, options: &BuildOptions, progress: &Progress) -> Result<Built, BuildError> {
    let solid = Solid::new(mesh)?;
    let judge = Judge::new(&solid, options.seed);
    finest(&judge, mesh, options, progress)?.built(&solid)
}

/// Ratio of the numbers of spheres of a level and of the level before: about the fourth root of a half.
const STEP: [usize; 2] = [17, 20];

/// The numbers of spheres of a chain.
fn chain(spheres: usize, least: usize) -> impl Iterator<Item = usize> {
    successors(Some(spheres), move |&before| (before > least).then(|| (before * STEP[0] / STEP[1]).max(least)))
}

/// Builds a chain of medial meshes, each with at most 0.85 times as many spheres as the one before, down to one sphere per component.
///
/// `progress` covers the whole chain.
///
/// # Errors
/// The errors of [`build`].
pub fn build_levels(
    mesh: &TriangleMesh,
    options: &BuildOptions,
    progress: &Progress,
) -> Result<Vec<Built>, BuildError> {
    let solid = Solid::new(mesh)?;
    let judge = Judge::new(&solid, options.seed);
    let share = finest_share(mesh, options);
    let search = finest(&judge, mesh, options, &between(progress, 0.0, share))?;
    let first = search.built(&solid)?;
    let others = coarser(&judge, mesh, options, search, |level| level, &between(progress, share, 1.0))?;
    Ok(once(first).chain(others).collect())
}

/// The finest level's part of the work on a chain.
pub(super) fn finest_share(mesh: &TriangleMesh, options: &BuildOptions) -> f32 {
    let spheres = options.spheres.clamp(1, MAX_SPHERES);
    let finest = spheres * finest_searches(mesh, options);
    let others: usize = chain(spheres, 1).skip(1).map(|spheres| work(options, spheres)).sum();
    finest as f32 / (finest + others) as f32
}

/// Estimated work of a coarser level: the time of a search is about proportional to its number of spheres.
fn work(options: &BuildOptions, spheres: usize) -> usize {
    spheres * (1 + level_searches(options, spheres))
}

/// Builds the coarser levels of a chain from its finest one. `finish` is called with each level when it is complete.
pub(super) fn coarser<T>(
    judge: &Judge,
    mesh: &TriangleMesh,
    options: &BuildOptions,
    mut search: Search,
    finish: impl Fn(Built) -> T,
    progress: &Progress,
) -> Result<Vec<T>, BuildError> {
    let counts = chain(search.spheres(), search.full_components()).skip(1);
    let counts: Vec<usize> = counts.filter(|&spheres| spheres < search.balls()).collect();
    let whole: usize = counts.iter().map(|&spheres| work(options, spheres)).sum();
    let (mut levels, mut done) = (Vec::new(), 0);
    for spheres in counts {
        let options = level_options(options, spheres);
        let starts: Vec<Start> =
            once(Start::Finer(Box::new(search))).chain(seeds(&options, level_searches(&options, spheres))).collect();
        let [from, to] = [done, done + work(&options, spheres)].map(|done| done as f32 / whole as f32);
        done += work(&options, spheres);
        search = best(judge, mesh, &options, &starts, &between(progress, from, to))?;
        levels.push(finish(search.built(judge.solid)?));
    }
    if progress(1.0).is_break() { Err(BuildError::Cancelled) } else { Ok(levels) }
}

/// Start of a search.
enum Start {
    /// Samples with this seed.
    Seed(u64),
    /// A shape with more spheres.
    Finer(Box<Search>),
}

fn seeds(options: &BuildOptions, count: usize) -> impl Iterator<Item = Start> {
    successors(Some(options.seed), |&seed| Some(Random(seed).bits())).map(Start::Seed).take(count)
}

/// The best result of several searches from samples.
pub(super) fn finest(
    judge: &Judge,
    mesh: &TriangleMesh,
    options: &BuildOptions,
    progress: &Progress,
) -> Result<Search, BuildError> {
    let starts: Vec<Start> = seeds(options, finest_searches(mesh, options)).collect();
    best(judge, mesh, options, &starts, progress)
}

/// The best result of several parallel searches. It does not depend on the number of threads.
fn best(
    judge: &Judge,
    mesh: &TriangleMesh,
    options: &BuildOptions,
    starts: &[Start],
    progress: &Progress,
) -> Result<Search, BuildError> {
    let shares = Shares::new(starts.len(), progress);
    let searched = parallel::map(starts.len(), 1, |i| {
        let progress = |part: f32| shares.report(i, part);
        let mut search = match &starts[i] {
            Start::Seed(seed) => Search::new(judge.solid, options, mesh.triangles.len(), *seed, &progress)?,
            Start::Finer(search) => search.coarser(options.spheres),
        };
        search.refine(judge, &progress)?;
        Ok(search)
    });
    if shares.broken() {
        return Err(BuildError::Cancelled);
    }
    let better = |a: Result<Search, BuildError>, b: Result<Search, BuildError>| match (&a, &b) {
        (Ok(first), Ok(second)) if second.verdict.error() < first.verdict.error() => b,
        (Err(_), Ok(_)) => b,
        _ => a,
    };
    searched.into_iter().reduce(better).unwrap_or(Err(BuildError::Empty))
}

#[cfg(test)]
mod tests {
    use super::{super::optimise::is_hurried, *};

    #[test]
    fn compared_builds_are_not_shortened() {
        let mut hurried = 0;
        for triangles in (0..200_000).step_by(500) {
            for spheres in 1..600 {
                if is_hurried(triangles, spheres) {
                    assert_eq!(searches(triangles, spheres), 1, "{triangles} triangles, {spheres} spheres");
                    hurried += 1;
                }
            }
        }
        assert!(hurried > 0);
        for (spheres, sought) in [(30, 1), (12, 4), (50, 0)] {
            assert_eq!(level_options(&BuildOptions::default(), spheres).searches, Some(sought));
        }
    }
}
