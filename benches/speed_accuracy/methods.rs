//! The methods: their shapes for the models, and their queries for the first touch.

use std::time::{Duration, Instant};

use bevy_medial::{
    builder::{Deviation, measure},
    constants::INTERVAL_PATH,
    geometry::{Placement, Sphere, Sweep},
    medial_axis::{MedialAxis, packed::PackedMedialMesh},
    pipeline::{Body, Culling, Hull, Shape, first_touch},
    query::{Moving, TimeOfImpactStatus, alternating},
};
use bevy_medial_compare::{
    baselines::{
        Kind,
        pair::{TreePair, tree_pair},
    },
    hulls::hull_error,
};
use bevy_rapier3d::parry::{
    query::{NonlinearRigidMotion, cast_shapes_nonlinear},
    shape::{ConvexPolyhedron, SharedShape},
    transformation::vhacd::VHACDParameters,
};
use glam::Vec3;

use crate::{models::Model, spheres};

/// Rotation of both bodies together, in radians, in a part of a motion that is culled by a baseline.
const PART_TURN: f32 = 0.5;

/// The answer of a query: the fraction of the step, and the unit normal from the first to the second body.
#[derive(Clone, Copy, Debug)]
pub struct Answer {
    pub fraction: f32,
    pub normal: Vec3,
}

/// A kind of method: a curve of the charts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// Medial meshes and hybrid culling.
    Medial,
    /// The same shapes, culled by trees of bounding volumes.
    Bvh(Kind),
    /// The same shapes, with the published scheme for the time of impact.
    Alternating,
    /// Spheres alone, by this library.
    Spheres,
    /// Convex decomposition, by parry's nonlinear shape cast.
    Decomposition,
    /// One convex hull.
    Hull,
    /// The triangle mesh itself.
    TriMesh,
}

impl Method {
    /// All methods.
    pub const ALL: [Self; 9] = [
        Self::Medial,
        Self::Bvh(Kind::Obb),
        Self::Bvh(Kind::Sphere),
        Self::Bvh(Kind::Aabb),
        Self::Alternating,
        Self::Spheres,
        Self::Decomposition,
        Self::Hull,
        Self::TriMesh,
    ];

    /// The name in charts and tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Medial => "medial mesh",
            Self::Bvh(Kind::Obb) => "medial mesh, BVH of OBBs",
            Self::Bvh(Kind::Sphere) => "medial mesh, BVH of spheres",
            Self::Bvh(Kind::Aabb) => "medial mesh, BVH of AABBs",
            Self::Bvh(Kind::Medial) => "medial mesh, BVH of medial primitives",
            Self::Alternating => "medial mesh, alternating TOI",
            Self::Spheres => "spheres only",
            Self::Decomposition => "convex decomposition",
            Self::Hull => "convex hull",
            Self::TriMesh => "triangle mesh",
        }
    }
}

/// Resolutions and concavities of the decompositions. The second pair is the default of VHACD.
pub const DECOMPOSITIONS: [(u32, f32); 4] = [(32, 0.03), (64, 0.01), (128, 0.005), (256, 0.002)];

/// The shape of a model in a method.
#[derive(Clone)]
pub struct Prepared {
    pub body: Stand,
    /// Number of primitives, hulls or triangles.
    pub parts: usize,
    /// Distance from the exact mesh to the shape, in percent of the diagonal.
    pub error: Deviation,
    /// Bytes of its vertices, spheres and index lists. Hierarchies are not included for any method.
    pub bytes: usize,
    pub preparation: Duration,
}

/// A shape of this library, or of parry.
#[derive(Clone)]
pub enum Stand {
    Medial(Shape),
    Parry(SharedShape),
}

/// Number of resolutions of a method.
pub fn resolutions(method: Method, model: &Model, sphere_counts: &[usize], decompositions: usize) -> usize {
    match method {
        Method::Medial | Method::Bvh(_) | Method::Alternating => model.medial.len(),
        Method::Spheres => sphere_counts.len(),
        Method::Decomposition => decompositions,
        Method::Hull | Method::TriMesh => 1,
    }
}

/// Makes the shape of a model in a method.
///
/// # Errors
/// If the shape cannot be made.
pub fn prepare(method: Method, model: &Model, resolution: usize, sphere_counts: &[usize]) -> Result<Prepared, String> {
    let clock = Instant::now();
    let mesh = &model.mesh;
    let bad = |error: &dyn std::fmt::Display| format!("{}: {error}", model.name);
    let medial = |axis: &MedialAxis, error: Deviation, preparation: Duration| {
        let packed = PackedMedialMesh::new(axis);
        Prepared {
            parts: axis.primitives().len(),
            error,
            bytes: 16 * packed.spheres.len() + 12 * packed.primitives.len(),
            body: Stand::Medial(Shape::new(axis.clone())),
            preparation,
        }
    };
    let corners = 12 * mesh.positions.len() + 12 * mesh.triangles.len();
    match method {
        Method::Medial | Method::Bvh(_) | Method::Alternating => {
            let level = &model.medial[resolution];
            Ok(medial(&level.axis, level.error, level.preparation))
        }
        Method::Spheres => {
            let axis = spheres::inscribed(model, sphere_counts[resolution]).map_err(|error| bad(&error))?;
            let preparation = clock.elapsed();
            Ok(medial(&axis, measure(mesh, &axis).mesh_to_envelope, preparation))
        }
        Method::Decomposition | Method::Hull => {
            let shape = if method == Method::Hull {
                SharedShape::convex_hull(&mesh.positions).ok_or_else(|| bad(&"it has no convex hull"))?
            } else {
                let (resolution, concavity) = DECOMPOSITIONS[resolution];
                let parameters = VHACDParameters { resolution, concavity, ..Default::default() };
                SharedShape::convex_decomposition_with_params(&mesh.positions, &mesh.triangles, &parameters)
            };
            let preparation = clock.elapsed();
            let hulls: Vec<&ConvexPolyhedron> = match shape.as_compound() {
                Some(compound) => {
                    compound.shapes().iter().filter_map(|(_, part)| part.as_convex_polyhedron()).collect()
                }
                None => shape.as_convex_polyhedron().into_iter().collect(),
            };
            // Vertices, and the triangles of the hull: 2 n - 4 for n vertices.
            let bytes =
                hulls.iter().map(|hull| 12 * hull.points().len() + 12 * (2 * hull.points().len()).saturating_sub(4));
            Ok(Prepared {
                parts: hulls.len(),
                error: hull_error(mesh, &hulls),
                bytes: bytes.sum(),
                preparation,
                body: Stand::Parry(shape),
            })
        }
        Method::TriMesh => {
            let shape =
                SharedShape::trimesh(mesh.positions.clone(), mesh.triangles.clone()).map_err(|error| bad(&error))?;
            Ok(Prepared {
                body: Stand::Parry(shape),
                parts: mesh.triangles.len(),
                error: Deviation { max: 0.0, mean: 0.0 },
                bytes: corners,
                preparation: clock.elapsed(),
            })
        }
    }
}

/// A method with its shapes of two models.
pub struct Asked {
    method: Method,
    bodies: [Stand; 2],
    trees: Option<Box<dyn TreePair>>,
}

impl Asked {
    /// A method with the shapes of the first and of the second model.
    pub fn new(method: Method, bodies: [Stand; 2]) -> Self {
        let kind = match method {
            Method::Bvh(kind) => Some(kind),
            Method::Alternating => Some(Kind::Sphere),
            _ => None,
        };
        let trees = match (&bodies, kind) {
            ([Stand::Medial(first), Stand::Medial(second)], Some(kind)) => Some(tree_pair(kind, [first, second])),
            _ => None,
        };
        Self { method, bodies, trees }
    }

    /// The first touch of the two shapes along their sweeps.
    pub fn first_touch(&mut self, sweeps: &[Sweep; 2]) -> Option<Answer> {
        let [first, second] = match &self.bodies {
            [Stand::Medial(first), Stand::Medial(second)] => [first, second],
            [Stand::Parry(first), Stand::Parry(second)] => return cast([first, second], sweeps),
            _ => return None,
        };
        let bodies = |sweeps: &[Sweep; 2]| [Body::new(first.clone(), sweeps[0]), Body::new(second.clone(), sweeps[1])];
        let Some(trees) = &mut self.trees else {
            let impact = first_touch(bodies(sweeps), Culling::Hybrid, None)?;
            return Some(Answer { fraction: impact.fraction, normal: impact.normal });
        };
        let mut candidates = |sweeps: &[Sweep; 2]| {
            trees.refit(sweeps);
            trees.between().0
        };
        if self.method == Method::Alternating {
            return first_of_alternating([first, second], sweeps, &candidates(sweeps));
        }
        // In short parts, a body turns little and few primitives are near each other.
        let turn = sweeps[0].rotation.length() + sweeps[1].rotation.length();
        let path = sweeps[0].translation.distance(sweeps[1].translation);
        let size = first.bounding_sphere().radius.min(second.bounding_sphere().radius);
        let parts = ((turn / PART_TURN).max(path / (INTERVAL_PATH * size)).ceil() as usize).max(1);
        (0..parts).find_map(|part| {
            let times = [part, part + 1].map(|i| i as f32 / parts as f32);
            let sweeps = if parts > 1 { sweeps.map(|sweep| sweep.part(times)) } else { *sweeps };
            let impact = first_touch(bodies(&sweeps), Culling::Hybrid, Some(&candidates(&sweeps)))?;
            Some(Answer { fraction: (part as f32 + impact.fraction) / parts as f32, normal: impact.normal })
        })
    }
}

/// Parry's nonlinear shape cast. The step is one second long.
fn cast(shapes: [&SharedShape; 2], sweeps: &[Sweep; 2]) -> Option<Answer> {
    let motions = sweeps
        .map(|sweep| NonlinearRigidMotion::new(sweep.start, sweep.local_center, sweep.translation, sweep.rotation));
    let hit = cast_shapes_nonlinear(&motions[0], &**shapes[0], &motions[1], &**shapes[1], 0.0, 1.0, true).ok()??;
    let normal = sweeps[0].pose_at(hit.time_of_impact).rotation * hit.normal1;
    Some(Answer { fraction: hit.time_of_impact, normal })
}

/// The earliest answer of the published scheme over all pairs. In this scheme, the spheres of primitives move on lines.
fn first_of_alternating(shapes: [&Shape; 2], sweeps: &[Sweep; 2], pairs: &[[u32; 2]]) -> Option<Answer> {
    let mut best: Option<Answer> = None;
    let ends = sweeps.map(|sweep| [Placement::from(sweep.start), Placement::from(sweep.end)]);
    for &[i, j] in pairs {
        let placed = |side: usize, index: u32| ends[side].map(|placement| shapes[side].hull(index).placed(&placement));
        let ([start1, end1], [start2, end2]) = (placed(0, i), placed(1, j));
        let toi = match (start1, end1) {
            (Hull::Sphere(a), Hull::Sphere(b)) => against(&moving(a, b), start2, end2),
            (Hull::Cone(a), Hull::Cone(b)) => against(&moving(a, b), start2, end2),
            (Hull::Slab(a), Hull::Slab(b)) => against(&moving(a, b), start2, end2),
            _ => None,
        };
        best = toi.filter(|toi| best.is_none_or(|best| toi.fraction < best.fraction)).or(best);
    }
    best
}

fn moving<const N: usize>(start: [Sphere; N], end: [Sphere; N]) -> Moving<N> {
    Moving { start, motion: std::array::from_fn(|i| end[i].center - start[i].center) }
}

fn against<const N: usize>(first: &Moving<N>, start: Hull, end: Hull) -> Option<Answer> {
    let toi = match (start, end) {
        (Hull::Sphere(a), Hull::Sphere(b)) => alternating(first, &moving(a, b)),
        (Hull::Cone(a), Hull::Cone(b)) => alternating(first, &moving(a, b)),
        (Hull::Slab(a), Hull::Slab(b)) => alternating(first, &moving(a, b)),
        _ => return None,
    };
    (toi.status == TimeOfImpactStatus::Hit).then_some(Answer { fraction: toi.fraction, normal: toi.contact.normal })
}
