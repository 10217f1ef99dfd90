use std::{fmt::Write, path::Path};

use bevy_medial::{
    builder::{MedialLevels, MeshReport, load::MeshFormat},
    geometry::{Aabb, Primitive},
};

use super::{Outcome, at, load_mesh, read_file};

pub fn of(path: &Path) -> Outcome {
    if MeshFormat::of(path).is_some() {
        mesh(path)
    } else if has_levels(path) {
        levels(path)
    } else {
        medial(path)
    }
}

/// Returns true if the name is that of a file of levels.
pub fn has_levels(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("medial"))
}

fn levels(path: &Path) -> Outcome {
    let levels = MedialLevels::load(path).map_err(|error| error.to_string())?.levels;
    let mut text = format!("{}: {} levels, finest first\n", path.display(), levels.len());
    for (number, level) in levels.iter().enumerate() {
        let [_, cones, slabs] = kinds(level.axis.primitives());
        let spheres = level.axis.spheres().len();
        let _ = writeln!(text, "level {number}: {spheres} spheres, {cones} cones, {slabs} slabs; {}", level.error);
    }
    Ok(text)
}

fn mesh(path: &Path) -> Outcome {
    let mesh = load_mesh(path)?;
    let Aabb { min, max } = mesh.aabb();
    Ok(format!("{}: a triangle mesh\nbounds: {min} to {max} m\n{}\n", path.display(), MeshReport::new(&mesh)))
}

fn medial(path: &Path) -> Outcome {
    let file = read_file(path)?;
    let mut text = format!("{}: a medial mesh\n", path.display());
    let counts = [file.spheres.len(), file.edges.len(), file.faces.len()];
    let _ = writeln!(text, "in the file: {} spheres, {} edges, {} faces", counts[0], counts[1], counts[2]);
    let (axis, report) = file.into_medial_axis().map_err(|error| at(path, error))?;
    let [spheres, cones, slabs] = kinds(axis.primitives());
    let _ = writeln!(text, "clean-up: {report}");
    let _ = writeln!(text, "clean: {} spheres; {spheres} single, {cones} cones, {slabs} slabs", axis.spheres().len());
    let Aabb { min, max } = axis.aabb();
    let _ = writeln!(text, "bounds: {min} to {max} m, diagonal {} m", max.distance(min));
    let mean = axis.spheres().iter().map(|s| f64::from(s.radius)).sum::<f64>() / axis.spheres().len() as f64;
    let greatest = axis.spheres().iter().map(|s| s.radius).fold(0.0, f32::max);
    let _ = writeln!(text, "radii: {} to {greatest} m, mean {} m", axis.min_radius(), mean as f32);
    let mass = axis.mass();
    let [x, y, z] = [mass.inertia.x_axis, mass.inertia.y_axis, mass.inertia.z_axis];
    let _ = writeln!(text, "volume: {} m^3, centre of mass: {} m", mass.volume, mass.center_of_mass);
    let _ = writeln!(text, "inertia at unit density: {x} {y} {z} m^5");
    Ok(text)
}

/// Returns the numbers of sphere, cone and slab primitives.
pub fn kinds(primitives: &[Primitive]) -> [usize; 3] {
    primitives.iter().fold([0; 3], |mut counts, primitive| {
        counts[primitive.indices().len() - 1] += 1;
        counts
    })
}
