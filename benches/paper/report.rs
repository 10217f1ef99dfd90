//! The page, its tables and charts.

use std::{error::Error, fmt::Write, fs, path::Path};

use bevy_medial_compare::{
    charts::{Curve, over_frames},
    culling::Figures,
    paper::{conic, slabs},
    tables::{csv, today, write},
};
use serde::Serialize;

use crate::{
    ModelRow,
    hierarchies::{DISTANCES, HierarchyRow},
    scenes::{CULLS, Frame, SceneResult},
    techniques::TECHNIQUES,
};

/// Names of the methods, in the order of [`mean_ms`].
const METHODS: [&str; 9] = [
    "hybrid",
    "trees of oriented boxes",
    "trees of spheres",
    "trees of aligned boxes",
    "trees of medial primitives",
    "no culling of primitives",
    "flat, alternating",
    "flat, advancement",
    "flat, in lanes",
];

/// The time of a method in a frame, in milliseconds. `None` if it did not run.
fn time(frame: &Frame, method: usize) -> Option<f64> {
    match method {
        0 => Some(frame.cullings[0][0].total_ms()),
        _ if method <= CULLS.len() => Some(frame.cullings[method - 1][1].total_ms()),
        _ => {
            let step = &frame.flat.as_ref()?[method - 1 - CULLS.len()];
            Some(step.culling_ms + step.detection_ms)
        }
    }
}

/// The frames of a mean.
#[derive(Clone, Copy)]
enum Over {
    Awake,
    Active,
}

impl Over {
    fn frames(self, result: &SceneResult) -> impl Iterator<Item = &Frame> + Clone {
        result.frames.iter().filter(move |frame| match self {
            Over::Awake => frame.is_awake,
            Over::Active => frame.is_active,
        })
    }

    /// The mean time of a method over the frames in which it ran, in milliseconds.
    fn mean_ms(self, result: &SceneResult, method: usize) -> f64 {
        let (count, sum) = self.frames(result).filter_map(|frame| time(frame, method)).fold((0, 0.0), add);
        sum / f64::from(count)
    }

    /// The ratio of the times of a method and of the hybrid, over the frames in which both ran.
    fn ratio(self, result: &SceneResult, method: usize) -> f64 {
        let both = self.frames(result).filter_map(|frame| {
            // Beside each tree the hybrid ran in turns with it.
            let beside = frame.cullings.get(method.wrapping_sub(1)).unwrap_or(&frame.cullings[0])[0];
            Some((time(frame, method)?, beside.total_ms()))
        });
        let (own, hybrid) = both.fold((0.0, 0.0), |sums, times| (sums.0 + times.0, sums.1 + times.1));
        own / hybrid
    }
}

fn add((count, sum): (u32, f64), value: f64) -> (u32, f64) {
    (count + 1, sum + value)
}

/// First touches of the alternation that differ from those of the advancement, over all body pairs and frames.
#[derive(Clone, Copy, Default)]
struct Faults {
    touches: usize,
    missed: usize,
    late: usize,
    false_positives: usize,
}

/// Fraction of a frame by which a touch may be late.
const LATE: f32 = 1e-3;

fn faults(result: &SceneResult) -> Faults {
    let mut faults = Faults::default();
    for [alternating, advancement, _] in result.frames.iter().filter_map(|frame| frame.flat.as_ref()) {
        for (&(_, found), &(_, truth)) in alternating.first_touches.iter().zip(&advancement.first_touches) {
            // The alternation ignores overlaps at the start.
            if truth == 0.0 {
                continue;
            }
            faults.touches += usize::from(truth < 1.0);
            faults.missed += usize::from(truth < 1.0 && found == 1.0);
            faults.late += usize::from(found < 1.0 && found > truth + LATE);
            faults.false_positives += usize::from(truth == 1.0 && found < 1.0);
        }
    }
    faults
}

/// A paragraph for the terminal.
pub fn summary(result: &SceneResult) -> String {
    let mut text = format!(
        "{}: {} bodies, budget {:.2} %, {} primitive pairs, {} active frames",
        result.scene.name,
        result.bodies,
        result.budget,
        result.pairs,
        result.frames.iter().filter(|frame| frame.is_active).count()
    );
    for (method, name) in METHODS.iter().enumerate() {
        // Writing to a string cannot fail.
        let _ = write!(
            text,
            "\n  {name:26} awake {:9.3} ms, {:7.2} times the hybrid; active {:9.3} ms, {:7.2} times",
            Over::Awake.mean_ms(result, method),
            Over::Awake.ratio(result, method),
            Over::Active.mean_ms(result, method),
            Over::Active.ratio(result, method)
        );
    }
    text
}

#[derive(Serialize)]
struct FrameRow {
    scene: &'static str,
    frame: usize,
    method: &'static str,
    ms: f64,
    body_pairs: f64,
    primitive_pairs: f64,
    active: bool,
}

fn frame_rows(result: &SceneResult) -> impl Iterator<Item = FrameRow> {
    result.frames.iter().enumerate().flat_map(move |(number, frame)| {
        (0..METHODS.len()).filter_map(move |method| {
            let (body_pairs, primitive_pairs) = match method {
                0 => left(&frame.cullings[0][0]),
                _ if method <= CULLS.len() => left(&frame.cullings[method - 1][1]),
                _ => {
                    let step = &frame.flat.as_ref()?[method - 1 - CULLS.len()];
                    (step.first_touches.len() as f64, step.primitive_pairs as f64)
                }
            };
            let (scene, name) = (result.scene.name, METHODS[method]);
            let (ms, active) = (time(frame, method)?, frame.is_active);
            Some(FrameRow { scene, frame: number, method: name, ms, body_pairs, primitive_pairs, active })
        })
    })
}

fn left(figures: &Figures) -> (f64, f64) {
    (figures.body_pairs, figures.candidates)
}

/// Writes the page and its files to a folder.
///
/// # Errors
/// If a file cannot be written or a chart cannot be drawn; the message names it.
pub fn write_all(
    folder: &Path,
    [machine, command]: [&str; 2],
    models: &[ModelRow],
    criteria: &(slabs::Verdicts, conic::Verdicts),
    rows: &[HierarchyRow],
    results: &[SceneResult],
) -> Result<(), String> {
    fs::create_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    write(&folder.join("frames.csv"), &csv(results.iter().flat_map(frame_rows)))?;
    for result in results {
        let path = folder.join(result.scene.name).with_extension("svg");
        let chart = chart(result).map_err(|error| format!("{}: {error}", path.display()))?;
        write(&path, &chart)?;
    }
    write(&folder.join("README.md"), &page([machine, command], models, criteria, rows, results))
}

/// Figure 8 for the stairs, figure 10 for the other scenes: times over the frames, with the means of the paper as dashes.
fn chart(result: &SceneResult) -> Result<String, Box<dyn Error>> {
    let curve = |name, method: usize, level: Option<f64>| {
        let points =
            result.frames.iter().enumerate().filter_map(|(number, frame)| Some((number as f64, time(frame, method)?)));
        Curve { name, points: points.collect(), level }
    };
    let level = |method: usize| result.scene.paper_ms.map(|ms| ms[method]);
    let mut curves = vec![curve("hybrid", 0, level(0))];
    match result.scene.paper_ms {
        Some(_) => curves.extend([curve("oriented boxes", 1, level(1)), curve("spheres", 2, level(2))]),
        None => curves.push(curve("no culling of primitives", CULLS.len(), None)),
    }
    curves.push(curve("paper's method", CULLS.len() + 1, None));
    over_frames(&format!("{}: collision per frame", result.scene.name), "ms, one CPU core", &curves)
}

const HEAD: &str = "\
# The paper, reproduced

This page sets the tables and figures of *Efficient Collision Detection using Hybrid Medial Axis Transform and BVH for Rigid Body Simulation* beside those of this crate, so that you can
check what is reproduced, what is surpassed and what is not. The command below makes the page, its CSV and its charts in one run, on one CPU core.
";

const SCENES: &str = "
## Scenes

Scenes have the names and the contents of the paper's, with this project's models. Bodies have the level of detail with which the number of primitive pairs is nearest to the paper's.
In each frame the same input is run with every method. *Trees* have as many leaves as there are primitives and the bound of their motion at each node (`benches/src/baselines`). *No culling of
primitives* tests all primitive pairs of the body pairs that the hybrid leaves. All these methods give the same impacts and contacts, and their times include contacts. The *flat* methods
are the paper's: cone against cone and cone against box for bodies, then the time of impact of all primitive pairs of the remaining body pairs, by the published alternation, by this crate's conservative advancement, and by
the same in SIMD lanes. They find no contacts, and run in every fifth frame.

In *awake* frames a body does not sleep. *Active* frames have at least 30 % of the max number of touching pairs and 3 % of the max kinetic energy. In the charts, dashes are the averages in
the paper.

The paper names 66,300 primitive pairs for the tori, which is 51 times 50 times 26. All pairs of two tori with 26 cones each are 861,900.
";

fn page(
    [machine, command]: [&str; 2],
    models: &[ModelRow],
    criteria: &(slabs::Verdicts, conic::Verdicts),
    rows: &[HierarchyRow],
    results: &[SceneResult],
) -> String {
    let mut text = format!("{HEAD}\nMachine: {machine}. Date: {}. Command: `{command}`.\n{SCENES}", today());
    // Writing to a string cannot fail.
    for result in results {
        let _ = scene(&mut text, result);
    }
    let _ = averages(&mut text, results);
    let _ = hierarchies(&mut text, rows);
    let _ = table_1(&mut text, models);
    let _ = criteria_section(&mut text, criteria);
    text += "\n## Techniques\n\n| section | technique | code | difference | test |\n|---|---|---|---|---|\n";
    for row in &TECHNIQUES {
        let _ = writeln!(text, "| {} | {} | {} | {} | {} |", row.section, row.name, row.code, row.difference, row.test);
    }
    text
}

fn scene(text: &mut String, result: &SceneResult) -> std::fmt::Result {
    let name = result.scene.name;
    let busiest = result.frames.iter().map(|frame| frame.cullings[0][0].candidates).fold(0.0, f64::max);
    let flat = result.frames.iter().filter_map(|frame| Some(frame.flat.as_ref()?[0].primitive_pairs)).max();
    writeln!(
        text,
        "\n### {name} (figure {})\n\n![{name}]({name}.svg)\n\n{} bodies at a budget of {:.2} %: {} primitive pairs, {} in the paper. At most {busiest:.0} are left by the hybrid culling in \
         a frame, and {} by the culling of bodies alone.\n",
        result.scene.figure,
        result.bodies,
        result.budget,
        result.pairs,
        result.scene.pairs,
        flat.unwrap_or(0)
    )?;
    writeln!(
        text,
        "| method | awake frames, ms | over hybrid | active frames, ms | over hybrid |\n|---|---|---|---|---|"
    )?;
    for (method, name) in METHODS.iter().enumerate() {
        let [awake, active] = [Over::Awake, Over::Active]
            .map(|over| format!("{:.3} | {:.2}", over.mean_ms(result, method), over.ratio(result, method)));
        writeln!(text, "| {name} | {awake} | {active} |")?;
    }
    let Faults { touches, missed, late, false_positives } = faults(result);
    writeln!(
        text,
        "\nOf {touches} first touches of body pairs, the alternation misses {missed}, reports {late} late by more than {LATE} of a frame, and reports {false_positives} that do not exist."
    )
}

fn averages(text: &mut String, results: &[SceneResult]) -> std::fmt::Result {
    *text += "\n## Averages beside the paper's\n\n\
        The paper's times are those of an RTX 2060S, ours are means of awake frames on one CPU core, with contacts. Each ratio is that of the column before it to the hybrid. The paper's \
        margins over trees are not reproduced: the baselines here are faster than the paper's, and while many bodies touch, most of the time goes to impacts and contacts, which are the \
        same for all. Trees of aligned boxes are not in the paper. [Times on a GPU](../back-ends.md#figures) have a page of their own.\n\n\
        | scene | | hybrid, ms | oriented boxes, ms | ratio | spheres, ms | ratio | aligned boxes, ms | ratio |\n|---|---|---|---|---|---|---|---|---|\n";
    for result in results {
        let name = result.scene.name;
        if let Some([hybrid, boxes, spheres]) = result.scene.paper_ms {
            let (box_ratio, sphere_ratio) = (boxes / hybrid, spheres / hybrid);
            writeln!(
                text,
                "| {name} | paper | {hybrid} | {boxes} | {box_ratio:.2} | {spheres} | {sphere_ratio:.2} | | |"
            )?;
        }
        let ms = |method| Over::Awake.mean_ms(result, method);
        writeln!(
            text,
            "| {name} | here | {:.3} | {:.3} | {:.2} | {:.3} | {:.2} | {:.3} | {:.2} |",
            ms(0),
            ms(1),
            Over::Awake.ratio(result, 1),
            ms(2),
            Over::Awake.ratio(result, 2),
            ms(3),
            Over::Awake.ratio(result, 3)
        )?;
    }
    *text += "\nFigure 9 names 0.15 ms for culling and 6.78 ms for detection, figure 10 names 6.48 ms for both.\n";
    Ok(())
}

fn hierarchies(text: &mut String, rows: &[HierarchyRow]) -> std::fmt::Result {
    *text += "\n## Hierarchies\n\n\
        The paper suggests a hierarchy of the medial axis for culling between bodies. Here it is beside trees of other volumes: a leaf is a primitive, and an inner node is a medial cone around \
        the primitives below it. All pairs of the models of Table 1 stand at a distance of the sum of their bounding radii times the first column, move by up to a tenth of the smaller radius and turn by up to 0.1 radians. \
        The hybrid has no trees to update: it bounds the relative motion of a pair. *Update* is the time for both trees, once per step; *search* is that of a pair.\n\n\
        | distance | volume | node pairs tested | candidates | update, us | search, us | build, ms | bytes of a primitive |\n|---|---|---|---|---|---|---|---|\n";
    for (distance, rows) in DISTANCES.iter().zip(rows.chunks(rows.len().div_ceil(DISTANCES.len()).max(1))) {
        for row in rows {
            let number =
                |value: Option<f64>, digits: usize| value.map_or_else(String::new, |value| format!("{value:.digits$}"));
            writeln!(
                text,
                "| {distance} | {} | {} | {:.1} | {} | {:.1} | {} | {} |",
                row.volume,
                number(row.tests, 0),
                row.candidates,
                number(row.update_us, 1),
                row.search_us,
                number(row.build_ms, 2),
                number(row.bytes, 0)
            )?;
        }
    }
    *text += "\nA cone fits the primitives below it better than a box of the world, but its test takes many times as long, so trees of aligned boxes are faster everywhere. Both have \
        the same leaves in the end. The hybrid keeps its trees of boxes.\n";
    Ok(())
}

fn table_1(text: &mut String, models: &[ModelRow]) -> std::fmt::Result {
    *text += "\n## Table 1: models\n\n\
        Models have the names of the paper's, but are this project's own. Each is shown at the level of detail with about as many primitives. *Error* is the largest distance from the mesh to the \
        medial mesh, as in the paper. *Two-sided error* is the larger one of both directions. All errors are in percent of the diagonal.\n\n\
        | model | | triangles | cones | slabs | error | two-sided error |\n|---|---|---|---|---|---|---|\n";
    for row in models {
        let [triangles, cones, slabs] = row.paper;
        writeln!(text, "| {} | paper | {triangles} | {cones} | {slabs} | {:.2} | |", row.name, row.paper_error)?;
        let ([triangles, cones, slabs], error) = (row.ours, &row.error);
        let (one, both) = (error.mesh_to_envelope.max, error.max());
        writeln!(text, "| {} | here | {triangles} | {cones} | {slabs} | {one:.2} | {both:.2} |", row.name)?;
    }
    Ok(())
}

fn criteria_section(text: &mut String, (slabs, conic): &(slabs::Verdicts, conic::Verdicts)) -> std::fmt::Result {
    writeln!(
        text,
        "\n## The criteria on random input\n\n\
         **Degenerate slabs (section 3.2).** {} slabs, {} of them degenerate: random spheres, radii near the limit, a sphere that bulges out of the cone of two others or lies in it, and {} triangles \
         of radius 0. *Wrong* means wrong by more than rounding (1e-6).\n\n\
         | rule | wrong verdicts | results that lose volume | largest loss |\n|---|---|---|---|\n\
         | gradient of the radius, one or two cones (this crate) | {} | 0 | {:.1e} |\n\
         | two circles on the largest sphere, the cone of the two larger spheres (paper) | {}, all of them triangles | {} | {:.2} |\n\n\
         The largest loss is how far the slab protrudes from its result. Coordinates are from -1 to 1.\n\n\
         **Cone and box (section 4.1).** {} pairs, {} of them overlapping, {} of them spheres.\n\n\
         | rule | overlaps missed or invented |\n|---|---|\n\
         | exact min (this crate) | {} |\n\
         | the conic on all 81 faces of the tesseract | {} |\n\
         | the conic on the edges of the tesseract, and the centre of an ellipsoid (words of the paper) | {} missed, {} invented |\n\n\
         The conic was an ellipsoid in four dimensions in {} cases. It never is: its quadratic form is the square of a vector of three coordinates, minus the square of a radius.",
        slabs.slabs,
        slabs.degenerate,
        slabs.triangles,
        slabs.ours_wrong,
        slabs.ours_max_loss,
        slabs.circles_wrong + slabs.circles_wrong_on_triangles,
        slabs.cone_wrong,
        slabs.cone_max_loss,
        conic.pairs,
        conic.overlapping,
        conic.spheres,
        conic.ours_wrong,
        conic.faces_wrong,
        conic.edges_missed,
        conic.edges_false,
        conic.ellipsoids,
    )
}
