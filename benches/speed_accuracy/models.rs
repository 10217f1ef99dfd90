//! The models: their exact meshes, and medial meshes of many sizes.

use std::{
    ops::ControlFlow,
    path::Path,
    time::{Duration, Instant},
};

use bevy_medial::{
    builder::{BuildOptions, Deviation, TriangleMesh, build, load::load, measure},
    medial_axis::MedialAxis,
};
use glam::Vec3;

use crate::truth::ExactMesh;

/// A model.
pub struct Model {
    pub name: String,
    pub mesh: TriangleMesh,
    pub exact: ExactMesh,
    pub center_of_mass: Vec3,
    /// Diagonal of the bounding box, in metres.
    pub diagonal: f32,
    /// Distance from the centre of mass to the farthest point, in metres.
    pub radius: f32,
    /// Medial meshes of the model, the coarsest first.
    pub medial: Vec<Medial>,
}

/// A medial mesh of a model.
pub struct Medial {
    pub axis: MedialAxis,
    /// Distance from the mesh to the medial mesh, in percent of the diagonal.
    pub error: Deviation,
    pub preparation: Duration,
}

impl Model {
    /// Reads a mesh, and fits a medial mesh to it for each number of spheres.
    ///
    /// # Errors
    /// If the mesh cannot be read or has no medial mesh.
    pub fn load(path: &Path, name: String, spheres: &[usize]) -> Result<Self, String> {
        let mesh = load(path).map_err(|error| error.to_string())?;
        let fit = |&spheres: &usize| {
            let clock = Instant::now();
            let options = BuildOptions { spheres, ..Default::default() };
            let built = build(&mesh, &options, &|_| ControlFlow::Continue(()))
                .map_err(|error| format!("{}: {error}", path.display()))?;
            let preparation = clock.elapsed();
            Ok(Medial { error: measure(&mesh, &built.axis).mesh_to_envelope, axis: built.axis, preparation })
        };
        let medial = spheres.iter().map(fit).collect::<Result<Vec<_>, String>>()?;
        let finest = medial.last().ok_or("no number of spheres was given")?;
        let center_of_mass = finest.axis.mass().center_of_mass;
        let far = |point: &Vec3| point.distance(center_of_mass);
        Ok(Self {
            exact: ExactMesh::new(&mesh),
            diagonal: mesh.diagonal(),
            radius: mesh.positions.iter().map(far).fold(0.0, f32::max),
            name,
            mesh,
            center_of_mass,
            medial,
        })
    }
}
