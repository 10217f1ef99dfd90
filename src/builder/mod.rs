//! From a triangle mesh to a medial mesh.
mod clusters;
mod connect;
mod descent;
mod envelope;
mod exchange;
mod mesh;
mod parallel;
mod refine;
mod samples;
mod solid;
mod tree;

use thiserror::Error;

use crate::{
    geometry::Sphere,
    medial_axis::{CleanupReport, MedialAxis, MedialAxisError},
};

pub use mesh::TriangleMesh;

/// What to build.
#[derive(Clone, Debug)]
pub struct BuildOptions {
    /// Number of spheres.
    pub spheres: usize,
    /// Seed of the surface samples.
    pub seed: u64,
}

/// Why a mesh has no medial mesh.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum BuildError {
    /// No triangle.
    #[error("no triangle with an area")]
    Empty,
    /// Index.
    #[error("triangle {triangle} refers to vertex {index}, which does not exist")]
    IndexOutOfRange {
        /// Triangle.
        triangle: usize,
        /// Vertex.
        index: u32,
    },
    /// NaN.
    #[error("vertex {vertex} is not finite")]
    NotFinite {
        /// Vertex.
        vertex: u32,
    },
    /// Sheets.
    #[error("no volume")]
    NoVolume,
    /// Asset.
    #[error(transparent)]
    Asset(#[from] MedialAxisError),
}

/// Builds.
pub fn build(mesh: &TriangleMesh, options: &BuildOptions) -> Result<(MedialAxis, CleanupReport), BuildError> {
    let t0 = std::time::Instant::now();
    let lap = |name: &str| {
        let stat = std::fs::read_to_string("/proc/self/stat").unwrap();
        let f: Vec<f64> = stat.rsplit(')').next().unwrap().split_whitespace().skip(11).take(2).map(|x| x.parse().unwrap()).collect();
        eprintln!("{:7.3} cpu {:5.2} {name}", t0.elapsed().as_secs_f64(), (f[0] + f[1]) / 100.0);
    };
    let solid = solid::Solid::new(mesh)?;
    lap("solid");
    let samples = samples::Samples::new(&solid, 4000, 1000, options.seed);
    lap("samples");
    let medial = parallel::map(samples.len(), 32, |i| {
        (i % 2 == 0 && samples.normals[i] != glam::DVec3::ZERO)
            .then(|| samples::medial_ball(&solid, samples.points.positions[i], samples.normals[i]))
    });
    lap("medial balls");
    let clusters = clusters::cluster(&samples, &medial, options.spheres * 13 / 10, solid.part_count);
    if clusters.balls.is_empty() {
        return Err(BuildError::NoVolume);
    }
    lap("clusters");
    let touching = connect::touching(&samples, &clusters.labels);
    lap("touching");
    eprintln!("{} touching pairs, triples {}", touching.len(), connect::candidates(&touching).len() - touching.len());
    let mut complex = envelope::Complex { balls: clusters.balls.clone(), ..Default::default() };
    let n = options.spheres;
    let cycles = touching.len().saturating_sub(complex.balls.len());
    let plan = refine::Plan {
        spheres: n,
        extra_edges: std::env::var("XE").map_or(cycles * n * 35 / (100 * complex.balls.len()), |v| v.parse().unwrap()),
        faces: std::env::var("XF").map_or(cycles * n * 35 / (100 * complex.balls.len()), |v| v.parse().unwrap()),
        rounds: std::env::var("XR").map_or(8, |v| v.parse().unwrap()),
        steps: 8,
        spacing: 0.02,
    };
    let limits = connect::Limits { edges: complex.balls.len() + plan.extra_edges, faces: plan.faces };
    connect::connect(&mut complex, &clusters.parts, &touching, &samples, limits, &refine::target(&solid, &samples, descent::Penalty::new(1e-5), plan.spacing));
    lap("connect");
    let mut ball_parts = clusters.parts.clone();
    refine::refine(&mut complex, &mut ball_parts, &solid, &samples, &plan);
    lap("refine");
    let samples = samples::Samples::new(&solid, 10000, 5000, options.seed);
    let d = std::env::var("XD").map_or(12, |v| v.parse().unwrap());
    let target = refine::target_for(&complex, &solid, &samples, 0.012);
    let penalty = target.penalty;
    let cost = descent::descend(&mut complex, &target, d);
    lap(&format!("descent {cost:e}"));
    {
        let st = refine::State::new(&complex, &target);
        let mut worst: std::collections::BTreeMap<u32, (f64, f64, glam::DVec3)> = Default::default();
        for a in &st.anchors {
            let e = a.error(&st.envelope).abs();
            let w = worst.entry(a.primitive).or_insert((0.0, 0.0, glam::DVec3::ZERO));
            w.1 += a.weight * penalty.of(e);
            if e > w.0 { w.0 = e; w.2 = a.target; }
        }
        let inward: f64 = st.hits.iter().zip(&samples.weights).map(|(h, w)| w * penalty.of(h.distance)).sum();
        let outward: f64 = worst.values().map(|w| w.1).sum();
        eprintln!("inward {inward:.3e} outward {outward:.3e} inmax {:.4} mean {:.5}", st.hits.iter().map(|h| h.distance.abs()).fold(0.0, f64::max), st.hits.iter().zip(&samples.weights).map(|(h, w)| w * h.distance.abs()).sum::<f64>());
        let mut w: Vec<_> = worst.into_iter().collect();
        w.sort_by(|a, b| b.1.0.total_cmp(&a.1.0));
        for (p, (e, s, t)) in w.iter().take(6) {
            let prim = &st.envelope.primitives[*p as usize];
            eprintln!("  {:.4} sum {s:.2e} {prim:?} at {t:.3} balls {:?}", e, prim.indices().iter().map(|&i| { let b = complex.balls[i as usize]; format!("{:.3} r {:.3} part {}", b.center, b.radius, ball_parts[i as usize]) }).collect::<Vec<_>>());
        }
        eprintln!("parts {}", solid.part_count);
    }
    let spheres = complex
        .balls
        .iter()
        .map(|b| Sphere::new((b.center * solid.diagonal + solid.origin).as_vec3(), (b.radius * solid.diagonal) as f32))
        .collect();
    Ok(MedialAxis::from_lists(spheres, &complex.edges, &complex.faces)?)
}
