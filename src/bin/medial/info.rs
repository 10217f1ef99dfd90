use std::{fmt::Write, path::Path};

use bevy_medial::{
    builder::{MedialLevels, MeshReport, TriangleMesh},
    geometry::Aabb,
    medial_axis::{CleanupReport, MedialAxis, ma::MaFile},
};
use serde::Serialize;

use super::{
    Outcome,
    build::stated,
    files::{Content, at},
    rows::{Row, json, kinds},
};

pub fn of(path: &Path, as_json: bool) -> Outcome {
    match Content::read(path)? {
        Content::Mesh(mesh) => Ok(of_mesh(path, &mesh, as_json)),
        Content::Levels(chain) => Ok(of_levels(path, &chain, as_json)),
        Content::Medial(file) => of_medial(path, file, as_json),
    }
}

fn of_levels(path: &Path, chain: &MedialLevels, as_json: bool) -> String {
    let levels = &chain.levels;
    let rows = levels.iter().enumerate().map(|(number, level)| Row::new(path, Some(number), &level.axis, &level.error));
    if as_json {
        return rows.map(|row| json(&row)).collect();
    }
    let joints = levels.first().and_then(|level| level.axis.skin()).map(|skin| skin.joints().len());
    let joints = joints.map_or(String::new(), |joints| format!(", bound to {joints} joints"));
    let mut text = format!("{}: {} levels, finest first{joints}\n", path.display(), levels.len());
    if let Some(mass) = chain.mass {
        let _ = writeln!(text, "solid: volume {} m^3, centre of mass {} m", mass.volume, mass.center_of_mass);
    }
    text.push_str(&stated(&chain.sides));
    for (Row { spheres, cones, slabs, .. }, (number, level)) in rows.zip(levels.iter().enumerate()) {
        let _ = writeln!(text, "level {number}: {spheres} spheres, {cones} cones, {slabs} slabs; {}", level.error);
    }
    text
}

/// A triangle mesh in JSON. Lengths are in metres.
#[derive(Serialize)]
struct Surface {
    file: String,
    triangles: usize,
    vertices: usize,
    pieces: usize,
    min: [f32; 3],
    max: [f32; 3],
    diagonal: f32,
    closed: bool,
    /// In cubic metres. `None` if the surface is not closed.
    volume: Option<f64>,
    flaws: Vec<String>,
}

fn of_mesh(path: &Path, mesh: &TriangleMesh, as_json: bool) -> String {
    let (Aabb { min, max }, report) = (mesh.aabb(), MeshReport::new(mesh));
    if as_json {
        return json(&Surface {
            file: path.display().to_string(),
            triangles: report.triangles,
            vertices: report.vertices,
            pieces: report.components,
            min: min.to_array(),
            max: max.to_array(),
            diagonal: report.diagonal,
            closed: report.is_closed(),
            volume: Some(report.volume).filter(|_| report.is_closed()),
            flaws: report.flaws(),
        });
    }
    format!("{}: a triangle mesh\nbounds: {min} to {max} m\n{report}\n", path.display())
}

/// A clean medial mesh in JSON. Lengths are in metres, the density is 1.
#[derive(Serialize)]
struct Medial {
    file: String,
    spheres: usize,
    /// Spheres that are in no cone and no slab.
    single: usize,
    cones: usize,
    slabs: usize,
    min: [f32; 3],
    max: [f32; 3],
    smallest_radius: f32,
    largest_radius: f32,
    mean_radius: f32,
    volume: f32,
    centre_of_mass: [f32; 3],
    inertia: [[f32; 3]; 3],
}

impl Medial {
    fn new(path: &Path, axis: &MedialAxis) -> Self {
        let ([single, cones, slabs], mass, Aabb { min, max }) = (kinds(axis.primitives()), axis.mass(), axis.aabb());
        let radii = axis.spheres().iter().map(|sphere| sphere.radius);
        Self {
            file: path.display().to_string(),
            spheres: axis.spheres().len(),
            single,
            cones,
            slabs,
            min: min.to_array(),
            max: max.to_array(),
            smallest_radius: axis.min_radius(),
            largest_radius: radii.clone().fold(0.0, f32::max),
            mean_radius: (radii.map(f64::from).sum::<f64>() / axis.spheres().len() as f64) as f32,
            volume: mass.volume,
            centre_of_mass: mass.center_of_mass.to_array(),
            inertia: mass.inertia.to_cols_array_2d(),
        }
    }
}

fn of_medial(path: &Path, file: MaFile, as_json: bool) -> Outcome {
    let counts = [file.spheres.len(), file.edges.len(), file.faces.len()];
    let (axis, report) = file.into_medial_axis().map_err(|error| at(path, error))?;
    let medial = Medial::new(path, &axis);
    Ok(if as_json { json(&medial) } else { described(&medial, &axis, counts, &report) })
}

fn described(medial: &Medial, axis: &MedialAxis, counts: [usize; 3], report: &CleanupReport) -> String {
    let Medial { file, spheres, single, cones, slabs, smallest_radius, largest_radius, mean_radius, .. } = medial;
    let mut text = format!("{file}: a medial mesh\n");
    let _ = writeln!(text, "in the file: {} spheres, {} edges, {} faces", counts[0], counts[1], counts[2]);
    let _ = writeln!(text, "clean-up: {report}");
    let _ = writeln!(text, "clean: {spheres} spheres; {single} single, {cones} cones, {slabs} slabs");
    let (Aabb { min, max }, mass) = (axis.aabb(), axis.mass());
    let _ = writeln!(text, "bounds: {min} to {max} m, diagonal {} m", max.distance(min));
    let _ = writeln!(text, "radii: {smallest_radius} to {largest_radius} m, mean {mean_radius} m");
    let _ = writeln!(text, "volume: {} m^3, centre of mass: {} m", mass.volume, mass.center_of_mass);
    let [x, y, z] = [mass.inertia.x_axis, mass.inertia.y_axis, mass.inertia.z_axis];
    let _ = writeln!(text, "inertia at unit density: {x} {y} {z} m^5");
    text
}
