//! The text of the page.

use std::fmt::Write;

use bevy_medial_compare::{
    paper::{conic, slabs},
    tables::today,
};

use crate::{
    Findings, ModelRow,
    chains::{ChainRow, LINKS},
    device::DeviceRow,
    hierarchies::{DISTANCES, HierarchyRow},
    scenes::SceneResult,
    techniques::TECHNIQUES,
    times::{Faults, LATE, METHODS, Over, faults},
};

const HEAD: &str = "\
# The paper, reproduced

This page sets the tables and figures of *Efficient Collision Detection using Hybrid Medial Axis Transform and BVH for Rigid Body Simulation* beside those of this crate, so that you can
check which results this crate reproduces or surpasses, and which margins it does not reach. The command below makes the page, its CSV and its charts in one run, on one CPU core.
";

const SCENES: &str = "
## Scenes

Scenes have the names and the contents of the paper's, with this project's models. Bodies have the level of detail with which the number of primitive pairs is nearest to the paper's.
In each frame the same input is run with every method. *Trees* have as many leaves as there are primitives and the bound of their motion at each node (`benches/src/baselines`). *No culling of
primitives* tests all primitive pairs of the body pairs that the hybrid leaves. All these methods give the same impacts and contacts, and their times include contacts. The *flat* methods
are the paper's: cone against cone and cone against box for bodies, then the time of impact of all primitive pairs of the remaining body pairs, by the published alternation, by this crate's conservative advancement, and by
the same in SIMD lanes. They find no contacts, and run in every fifth frame.

In *awake* frames a body does not sleep. *Active* frames have at least 30 % of the max number of touching pairs and 3 % of the max kinetic energy. In the charts, dashes are the averages in
the paper. `frames.csv` has the times of all frames.
";

const RATIOS: &str = "
Mean time of the hybrid in awake and in active frames, and times of the other methods over those of the hybrid:
";

/// The page as Markdown.
pub fn page([machine, command]: [&str; 2], findings: &Findings) -> String {
    let Findings { models, criteria, hierarchies, chains, scenes, device } = findings;
    let mut text = format!("{HEAD}\nMachine: {machine}. Date: {}. Command: `{command}`.\n{SCENES}", today());
    // Writing to a string cannot fail.
    let _ = scene_section(&mut text, scenes);
    let _ = ratios(&mut text, scenes);
    let _ = averages(&mut text, scenes);
    let _ = device_section(&mut text, device.as_ref());
    let _ = hierarchy_section(&mut text, hierarchies);
    let _ = chain_section(&mut text, chains);
    let _ = table_1(&mut text, models);
    let _ = criteria_section(&mut text, criteria);
    text += "\n## Techniques\n\n| section | technique | code | difference | test |\n|---|---|---|---|---|\n";
    for row in &TECHNIQUES {
        let _ = writeln!(text, "| {} | {} | {} | {} | {} |", row.section, row.name, row.code, row.difference, row.test);
    }
    text
}

fn scene_section(text: &mut String, results: &[SceneResult]) -> std::fmt::Result {
    for result in results {
        let name = result.scene.name;
        writeln!(text, "\n![{name}]({name}.svg)")?;
    }
    writeln!(
        text,
        "\n*Left* is the max number of primitive pairs in a frame after the hybrid culling, and after the culling of bodies alone. The last column counts the first touches of body pairs, then those\n\
         that the alternation misses, those that it reports late by more than {LATE} of a frame, and its false positives. The paper names 66,300 pairs for the tori, which is 51 times 50 times 26.\n\
         All pairs of two tori with 26 cones each are 861,900.\n\n\
         | scene | figures | bodies | budget, % | primitive pairs | in the paper | left | first touches |\n|---|---|---|---|---|---|---|---|"
    )?;
    for result in results {
        let scene = result.scene;
        let busiest = result.frames.iter().map(|frame| frame.cullings[0][0].candidates).fold(0.0, f64::max);
        let flat = result.frames.iter().filter_map(|frame| Some(frame.flat.as_ref()?[0].primitive_pairs)).max();
        let Faults { touches, missed, late, false_positives } = faults(result);
        writeln!(
            text,
            "| {} | {} | {} | {:.2} | {} | {} | {busiest:.0}, {} | {touches}: {missed}, {late}, {false_positives} |",
            scene.name,
            scene.figure,
            result.bodies,
            result.budget,
            result.pairs,
            scene.pairs,
            flat.unwrap_or(0)
        )?;
    }
    Ok(())
}

fn ratios(text: &mut String, results: &[SceneResult]) -> std::fmt::Result {
    *text += RATIOS;
    write!(text, "\n| method |")?;
    results.iter().try_for_each(|result| write!(text, " {} |", result.scene.name))?;
    writeln!(text, "\n|---|{}", "---|".repeat(results.len()))?;
    for (method, name) in METHODS.iter().enumerate() {
        write!(text, "| {name}{} |", if method == 0 { ", ms" } else { "" })?;
        for result in results {
            let [awake, active] = [Over::Awake, Over::Active].map(|over| match method {
                0 => format!("{:.3}", over.mean_ms(result, method)),
                _ => format!("{:.2}", over.ratio(result, method)),
            });
            write!(text, " {awake}, {active} |")?;
        }
        writeln!(text)?;
    }
    Ok(())
}

fn averages(text: &mut String, results: &[SceneResult]) -> std::fmt::Result {
    *text += "\n## Averages beside the paper's\n\n\
        The paper's times are those of an RTX 2060S, ours are means of awake frames on one CPU core, with contacts. Each ratio is that of the column before it to the hybrid. The paper's \
        margins over trees are not reproduced: the baselines here are faster than the paper's, and while many bodies touch, most of the time goes to impacts and contacts, which are the \
        same for all. Trees of aligned boxes are not in the paper. [Times on a GPU](../gpu.md#figures) have a page of their own.\n\n\
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
    Ok(())
}

fn device_section(text: &mut String, device: Option<&(String, Vec<DeviceRow>)>) -> std::fmt::Result {
    *text += "\n## The flat method on a GPU\n\n";
    let Some((name, rows)) = device else {
        *text += "No adapter was at hand.\n";
        return Ok(());
    };
    write!(
        text,
        "Adapter: {name}. llvmpipe is a software adapter, which here shares one CPU core with the program. The table shows, for each scene, the frame with most primitive pairs after the culling of bodies. The flat mode of this crate culls the bodies, and finds a bound for each pair. The published alternation gets the pairs as a list from the CPU. A call includes upload, wait and readback.\n\n\
         | scene | frame | method | primitive pairs | call, ms | on the device, ms |\n|---|---|---|---|---|---|\n"
    )?;
    for DeviceRow { scene, frame, method, pairs, call_ms, device_ms } in rows {
        let on_device = device_ms.map_or_else(String::new, |ms| format!("{ms:.2}"));
        writeln!(text, "| {scene} | {frame} | {method} | {pairs} | {call_ms:.1} | {on_device} |")?;
    }
    Ok(())
}

fn hierarchy_section(text: &mut String, rows: &[HierarchyRow]) -> std::fmt::Result {
    *text += "\n## Hierarchies\n\n\
        The paper suggests a hierarchy of the medial axis for culling between bodies. Here it is beside trees of other volumes: a leaf is a primitive, and an inner node is a medial cone around \
        the primitives below it.\n\
        All pairs of the models of Table 1 stand at a distance of a part of the sum of their bounding radii, move by up to a tenth of the smaller radius and turn by up to 0.1 radians.\n\
        *Update* is the time for both trees, once per step. The columns of distances have the tested node pairs, the candidates, and the time of a search in us. The hybrid has no trees to \
        update, and does not count node pairs.\n\n\
        | volume | update, us | build, ms | bytes of a primitive |";
    DISTANCES.iter().try_for_each(|distance| write!(text, " distance {distance} |"))?;
    writeln!(text, "\n|---|---|---|---|{}", "---|".repeat(DISTANCES.len()))?;
    let number =
        |value: Option<f64>, digits: usize| value.map_or_else(String::new, |value| format!("{value:.digits$}"));
    let volumes = rows.len() / DISTANCES.len();
    for (i, row) in rows.iter().take(volumes).enumerate() {
        let [update, build, bytes] = [number(row.update_us, 1), number(row.build_ms, 2), number(row.bytes, 0)];
        write!(text, "| {} | {update} | {build} | {bytes} |", row.volume)?;
        for row in rows.iter().skip(i).step_by(volumes) {
            let tests = row.tests.map_or_else(String::new, |tests| format!("{tests:.0}, "));
            write!(text, " {tests}{:.1}, {:.1} |", row.candidates, row.search_us)?;
        }
        writeln!(text)?;
    }
    *text += "\nA cone fits the primitives below it better than a box of the world, but its test takes many times as long, so trees of aligned boxes are faster everywhere. Both have \
        the same leaves in the end. The hybrid keeps its trees of boxes.\n";
    Ok(())
}

fn chain_section(text: &mut String, rows: &[ChainRow]) -> std::fmt::Result {
    *text += "\n## Chains of cones\n\n\
        The paper approximates a curved path by a chain of cones. This table counts the body pairs that chains of one to eight links leave, over the first 100 steps of each scene and for \
        bodies in flight that spin: over one step, and over the four steps of the pipelined culling on the GPU. Each link is as wide as its part of the rotation requires. The last columns are \
        milliseconds to test all body pairs over the four steps, link by link.\n\n";
    write!(text, "| bodies |")?;
    LINKS.iter().try_for_each(|links| write!(text, " {links} |"))?;
    writeln!(text, " 1: ms | 8: ms |\n|---|{}", "---|".repeat(LINKS.len() + 2))?;
    for rows in rows.chunk_by(|a, b| a.name == b.name) {
        write!(text, "| {} |", rows[0].name)?;
        for links in 0..LINKS.len() {
            let pairs: Vec<String> = rows.iter().map(|row| row.pairs[links].to_string()).collect();
            write!(text, " {} |", pairs.join(", "))?;
        }
        let times = rows.last().map_or([0.0; LINKS.len()], |row| row.times_ms);
        writeln!(text, " {:.2} | {:.2} |", times[0], times[LINKS.len() - 1])?;
    }
    *text += "\nThe centre of the bounding sphere lies near the centre of mass, so its path hardly bends: in the scenes one cone leaves almost the same pairs. Bodies that spin fast gain \
        over several steps. The broad phase tests one cone for each body first, and chains of up to eight links for the pairs that are left and turn that far.\n";
    Ok(())
}

fn table_1(text: &mut String, models: &[ModelRow]) -> std::fmt::Result {
    *text += "\n## Table 1: models\n\n\
        Models have the names of the paper's, but are this project's own. Each is shown at the level of detail with about as many primitives. *Error* is the largest distance from the mesh to the \
        medial mesh, as in the paper. *Two-sided error* is the larger one of both directions. All errors are in percent of the diagonal.\n\n\
        | model | paper: triangles | cones | slabs | error | here: triangles | cones | slabs | error | two-sided error |\n|---|---|---|---|---|---|---|---|---|---|\n";
    for row in models {
        let [triangles, cones, slabs] = row.paper;
        write!(text, "| {} | {triangles} | {cones} | {slabs} | {:.2} |", row.name, row.paper_error)?;
        let ([triangles, cones, slabs], error) = (row.ours, &row.error);
        let (one, both) = (error.mesh_to_envelope.max, error.max());
        writeln!(text, " {triangles} | {cones} | {slabs} | {one:.2} | {both:.2} |")?;
    }
    Ok(())
}

fn criteria_section(text: &mut String, (slabs, conic): &(slabs::Verdicts, conic::Verdicts)) -> std::fmt::Result {
    writeln!(
        text,
        "\n## The criteria on random input\n\n\
         - **Degenerate slabs (section 3.2).** {} slabs, {} of them degenerate: random spheres, radii near the limit, a sphere that bulges out of the cone of two others or lies in it, and {} triangles \
         of radius 0. Coordinates are from -1 to 1. *Wrong* means wrong by more than rounding (1e-6), and a *loss* is how far the slab protrudes from its result.\n\
         - This crate (gradient of the radius, one or two cones): {} wrong verdicts, and {} results that lose volume, by up to {:.1e}.\n\
         - The paper (two circles on the largest sphere, the cone of the two larger spheres): {} wrong verdicts, all of them triangles, and {} results that lose volume, by up to {:.2}.\n\
         - **Cone and box (section 4.1).** {} pairs, {} of them overlapping, {} of them spheres.\n\
         - Overlaps missed or invented: {} by the exact min (this crate), and {} by the conic on all 81 faces of the tesseract. The conic on the edges of the tesseract and the centre of an ellipsoid \
         (words of the paper) misses {} and invents {}.\n\
         - The conic was an ellipsoid in four dimensions in {} cases. It never is: its quadratic form is the square of a vector of three coordinates, minus the square of a radius.",
        slabs.slabs,
        slabs.degenerate,
        slabs.triangles,
        slabs.ours_wrong,
        slabs.ours_lossy,
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
