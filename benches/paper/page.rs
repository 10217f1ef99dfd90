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
the paper.

The paper names 66,300 primitive pairs for the tori, which is 51 times 50 times 26. All pairs of two tori with 26 cones each are 861,900.
";

/// The page as Markdown.
pub fn page([machine, command]: [&str; 2], findings: &Findings) -> String {
    let Findings { models, criteria, hierarchies, chains, scenes, device } = findings;
    let mut text = format!("{HEAD}\nMachine: {machine}. Date: {}. Command: `{command}`.\n{SCENES}", today());
    // Writing to a string cannot fail.
    for result in scenes {
        let _ = scene(&mut text, result);
    }
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
    *text += "\nFigure 9 names 0.15 ms for culling and 6.78 ms for detection, figure 10 names 6.48 ms for both.\n";
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
        "Adapter: {name}. llvmpipe is a software adapter, which here shares one CPU core with the program. The table shows, for each scene, the frame with most primitive pairs after the culling of bodies. This crate's flat mode finds the bounds of all of them. A call includes upload, wait and readback.\n\n\
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

fn chain_section(text: &mut String, rows: &[ChainRow]) -> std::fmt::Result {
    *text += "\n## Chains of cones\n\n\
        The paper approximates a curved path by a chain of cones. This table counts the body pairs that chains of one to eight links leave, over the first 100 steps of each scene and for \
        bodies in flight that spin. Each link is as wide as its part of the rotation requires. A *look-ahead* of 4 steps is that of the pipelined culling on the GPU.\n\n";
    write!(text, "| bodies | look-ahead |")?;
    LINKS.iter().try_for_each(|links| write!(text, " {links} |"))?;
    writeln!(text, "\n|---|---|{}", "---|".repeat(LINKS.len()))?;
    for ChainRow { name, look_ahead, pairs } in rows {
        write!(text, "| {name} | {look_ahead} |")?;
        pairs.iter().try_for_each(|pairs| write!(text, " {pairs} |"))?;
        writeln!(text)?;
    }
    *text += "\nThe centre of the bounding sphere lies near the centre of mass, so its path hardly bends: in the scenes one cone leaves almost the same pairs. Bodies that spin fast gain \
        over several steps. The broad phase tests one cone for each body first, and chains of up to eight links for the pairs that are left and turn that far.\n";
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
         | gradient of the radius, one or two cones (this crate) | {} | {} | {:.1e} |\n\
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
