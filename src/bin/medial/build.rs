use std::{
    fs,
    ops::{ControlFlow, RangeInclusive},
    path::{Path, PathBuf},
};

use bevy_medial::{
    builder::{DEFAULT_SEED, FitOptions, Level, MedialLevels, MeshReport, SideLimits, TriangleMesh, fit},
    medial_axis::MAX_SPHERES,
};
use indicatif::{ProgressBar, ProgressStyle};

use super::{
    Outcome,
    files::{self, at, check_output, is_levels, load_mesh, load_skinned_mesh},
    rows::{Row, json},
};

#[derive(clap::Args)]
pub struct Args {
    /// The triangle mesh.
    pub mesh: PathBuf,
    /// Where to write the medial mesh: OUT.ma for the finest level as text, OUT.medial for all levels of detail with their errors. With --per-mesh: a folder.
    #[arg(short, long, value_name = "OUT")]
    pub output: PathBuf,
    /// Largest number of spheres of the finest level.
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = whole(1..=MAX_SPHERES as u64))]
    spheres: Option<u64>,
    /// Largest error of the finest level, in either direction, in percent of the mesh's diagonal.
    #[arg(long, value_name = "PERCENT", allow_negative_numbers = true, value_parser = percent)]
    max_error: Option<f32>,
    /// Error of the finest level above which the build fails.
    #[arg(long, value_name = "PERCENT", default_value_t = FitOptions::default().error_limit, allow_negative_numbers = true, value_parser = percent)]
    error_limit: f32,
    /// Let the medial mesh protrude from the triangle mesh by at most this part of the diagonal. Dense samples verify it.
    #[arg(long, value_name = "PERCENT", allow_negative_numbers = true, value_parser = percent)]
    inside: Option<f32>,
    /// Let the triangle mesh protrude from the medial mesh by at most this part of the diagonal. Dense samples verify it.
    #[arg(long, value_name = "PERCENT", allow_negative_numbers = true, value_parser = percent)]
    enclose: Option<f32>,
    /// Bind the medial mesh to the joints of a skinned glTF file, which is read in its bind pose. The output must be OUT.medial.
    #[arg(long)]
    skin: bool,
    /// Build the meshes of a glTF scene one by one, and write them to the folder OUT as NAME.medial, with all levels of detail. Nodes with the mark
    /// `-noshape` are left out.
    #[arg(long, conflicts_with_all = ["skin", "levels"])]
    pub per_mesh: bool,
    /// With --per-mesh: only nodes with this name, or with a mesh of this name. `*` stands for any text. May be repeated.
    #[arg(long, value_name = "NAME", requires = "per_mesh")]
    pub only: Vec<String>,
    /// With --per-mesh: leave out nodes with this name, or with a mesh of this name. May be repeated.
    #[arg(long, value_name = "NAME", requires = "per_mesh")]
    pub skip: Vec<String>,
    /// Also write all levels of detail with their errors beside the finest level: OUT.medial.
    #[arg(long)]
    levels: bool,
    /// Number of searches for each level; the best result is used. More searches give a better result and take longer. Default: one or two for the
    /// finest level (shorter ones with fewer than 100 triangles per sphere), up to four for levels of few spheres.
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = whole(1..=u64::from(u32::MAX)))]
    searches: Option<u64>,
    /// The same seed gives the same result.
    #[arg(long, default_value_t = DEFAULT_SEED, allow_negative_numbers = true, value_parser = whole(0..=u64::MAX))]
    seed: u64,
    /// Print a JSON object per line for each level. Lengths are in metres, errors in percent.
    #[arg(long)]
    json: bool,
}

fn percent(text: &str) -> Result<f32, String> {
    let value = text.parse().ok().filter(|value: &f32| value.is_finite() && *value > 0.0);
    value.ok_or_else(|| "it is not a positive number".into())
}

/// A parser of whole numbers in a range.
fn whole(range: RangeInclusive<u64>) -> impl Fn(&str) -> Result<u64, String> + Clone + Send + Sync + 'static {
    move |text| {
        let number = text.parse().ok().filter(|number| range.contains(number));
        number.ok_or_else(|| format!("it is not a whole number from {} to {}", range.start(), range.end()))
    }
}

/// The files of a build.
struct Outputs<'a> {
    /// The finest level, as text.
    finest: Option<&'a Path>,
    levels: Option<PathBuf>,
}

impl<'a> Outputs<'a> {
    /// Checks the paths before the work.
    fn new(args: &'a Args) -> Result<Self, String> {
        let outputs = if is_levels(&args.output) {
            Self { finest: None, levels: Some(args.output.clone()) }
        } else {
            Self { finest: Some(&args.output), levels: args.levels.then(|| beside(&args.output)) }
        };
        if args.skin
            && let Some(finest) = outputs.finest
        {
            let named = finest.with_extension("medial");
            return Err(at(finest, format!("a .ma file has no joints; name it {}", named.display())));
        }
        for output in outputs.finest.into_iter().chain(outputs.levels.as_deref()) {
            check_output(output)?;
            if is_same(output, &args.mesh) {
                return Err(at(output, "it is the triangle mesh; name another file"));
            }
        }
        if let (Some(finest), Some(levels)) = (outputs.finest, &outputs.levels)
            && is_same(finest, levels)
        {
            return Err(at(levels, "it is the same file as the finest level; name another file"));
        }
        Ok(outputs)
    }

    /// Writes all files or none.
    fn write(self, chain: &MedialLevels) -> Result<(), String> {
        let finest = self.finest.zip(chain.levels.first());
        let text = |level: &Level| [stated(&chain.sides).into_bytes(), files::text(&level.axis)].concat();
        let finest = finest.map(|(path, level)| (path.to_owned(), text(level)));
        let levels = self.levels.map(|path| (path, chain.to_bytes()));
        files::write(&finest.into_iter().chain(levels).collect::<Vec<_>>())
    }
}

/// The limits of the sides, as comments of a `.ma` file.
pub fn stated(sides: &SideLimits) -> String {
    let line = |(limit, what): (Option<f32>, &str)| limit.map(|limit| format!("# {what} {limit} % of the diagonal\n"));
    let limits = [(sides.inside, "protrudes from the mesh by at most"), (sides.enclose, "covers the mesh up to")];
    limits.into_iter().filter_map(line).collect()
}

/// Returns true if both paths lead to one existing file.
fn is_same(a: &Path, b: &Path) -> bool {
    fs::canonicalize(a).is_ok_and(|a| fs::canonicalize(b).is_ok_and(|b| a == b))
}

/// Returns the path of the file with all levels.
fn beside(output: &Path) -> PathBuf {
    if output.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("ma")) {
        output.with_extension("medial")
    } else {
        // Another extension is a part of the name.
        let mut name = output.as_os_str().to_owned();
        name.push(".medial");
        name.into()
    }
}

pub fn run(args: &Args) -> Outcome {
    let skinned = if args.skin { Some(load_skinned_mesh(&args.mesh)?) } else { None };
    let mesh = skinned.as_ref().map_or_else(|| load_mesh(&args.mesh), |skinned| Ok(skinned.mesh().clone()))?;
    let outputs = Outputs::new(args)?;
    // Printed first, because a flaw may explain why the build fails.
    for flaw in MeshReport::new(&mesh).flaws() {
        eprintln!("warning: {}", at(&args.mesh, flaw));
    }
    let mut chain = fitted(args, &mesh, outputs.levels.is_some()).map_err(|error| at(&args.mesh, error))?;
    if let Some(skinned) = &skinned {
        chain = chain.bound(skinned).map_err(|error| at(&args.mesh, error))?;
    }
    if let (Some(finest), Some(asked)) = (chain.levels.first(), args.max_error)
        && finest.error.max() > asked
    {
        eprintln!("warning: {}", at(&args.mesh, format!("the error is more than {asked} %; allow more spheres")));
    }
    outputs.write(&chain)?;
    Ok(described(args, &args.output, &chain))
}

/// A line for each level of a file.
pub fn described(args: &Args, output: &Path, chain: &MedialLevels) -> String {
    let name = if args.per_mesh { format!("{} ", output.display()) } else { String::new() };
    let line = |(number, Level { axis, error }): (usize, &Level)| match args.json {
        true => json(&Row::new(output, Some(number), axis, error)),
        false => format!("{name}level {number}: {} spheres, {error}\n", axis.spheres().len()),
    };
    chain.levels.iter().enumerate().map(line).collect()
}

/// Fits the levels and shows the progress.
pub fn fitted(args: &Args, mesh: &TriangleMesh, levels: bool) -> Result<MedialLevels, String> {
    let bar = ProgressBar::new(1000);
    if let Ok(style) = ProgressStyle::with_template("{elapsed_precise} {wide_bar} {percent} %") {
        bar.set_style(style);
    }
    // The casts are lossless on targets of 32 bits and more.
    let options = FitOptions {
        spheres: args.spheres.map(|spheres| spheres as usize),
        max_error: args.max_error,
        error_limit: args.error_limit,
        sides: SideLimits { inside: args.inside, enclose: args.enclose },
        levels,
        searches: args.searches.map(|searches| searches as usize),
        seed: args.seed,
    };
    let chain = fit(mesh, &options, &|fraction| {
        bar.set_position((fraction * 1000.0) as u64);
        ControlFlow::Continue(())
    });
    bar.finish_and_clear();
    chain.map_err(|error| error.to_string())
}
