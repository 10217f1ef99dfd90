use std::path::Path;

use bevy_medial::{
    builder::{Deviation, TwoSidedError},
    geometry::Primitive,
    medial_axis::MedialAxis,
};
use serde::Serialize;

/// A medial mesh and its error, as an object in JSON. Lengths are in metres.
#[derive(Serialize)]
pub struct Row {
    pub file: String,
    /// Number of the level in a file of levels. The finest is 0.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub level: Option<usize>,
    pub spheres: usize,
    pub cones: usize,
    pub slabs: usize,
    /// Number of joints of its skin.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub joints: Option<usize>,
    /// Diagonal of the bounding box of the triangle mesh.
    diagonal: f32,
    pub mesh_to_envelope: Percent,
    pub envelope_to_mesh: Percent,
}

/// Distances in percent of the diagonal.
#[derive(Serialize)]
pub struct Percent {
    pub max: f32,
    pub mean: f32,
}

impl Row {
    pub fn new(file: &Path, level: Option<usize>, axis: &MedialAxis, error: &TwoSidedError) -> Self {
        let [_, cones, slabs] = kinds(axis.primitives());
        let percent = |Deviation { max, mean }| Percent { max, mean };
        Self {
            file: file.display().to_string(),
            level,
            spheres: axis.spheres().len(),
            cones,
            slabs,
            joints: axis.skin().map(|skin| skin.joints().len()),
            diagonal: error.diagonal,
            mesh_to_envelope: percent(error.mesh_to_envelope),
            envelope_to_mesh: percent(error.envelope_to_mesh),
        }
    }

    /// The file, and the number of the level.
    pub fn name(&self) -> String {
        self.level.map_or_else(|| self.file.clone(), |level| format!("{} level {level}", self.file))
    }
}

/// Returns the numbers of sphere, cone and slab primitives.
pub fn kinds(primitives: &[Primitive]) -> [usize; 3] {
    primitives.iter().fold([0; 3], |mut counts, primitive| {
        counts[primitive.indices().len() - 1] += 1;
        counts
    })
}

/// One line of JSON. Numbers that are not finite are `null`.
pub fn json(object: &impl Serialize) -> String {
    // Text and numbers in memory cannot fail.
    serde_json::to_string(object).unwrap_or_default() + "\n"
}
