//! Medial meshes that the asset processor builds.

use std::{
    fs,
    ops::ControlFlow,
    path::{Path, PathBuf},
    time::Duration,
};

use bevy::{
    asset::{AssetMode, LoadState},
    prelude::*,
};
use bevy_medial::{
    builder::{FitOptions, TriangleMesh, fit, load},
    medial_axis::MedialAxis,
    plugin::MedialProcessPlugin,
};

/// A folder that is removed at the end.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("medial_{name}_{}", std::process::id()));
        fs::create_dir_all(path.join("assets")).unwrap();
        Self(path)
    }

    fn write(&self, name: &str, content: impl AsRef<[u8]>) {
        fs::write(self.0.join("assets").join(name), content).unwrap();
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

fn app(folder: &Path, process: bool) -> App {
    let mut app = App::new();
    let path = |name: &str| folder.join(name).to_str().unwrap().to_string();
    let assets = AssetPlugin {
        mode: AssetMode::Processed,
        file_path: path("assets"),
        processed_file_path: path("imported"),
        use_asset_processor_override: Some(process),
        ..default()
    };
    app.add_plugins((MinimalPlugins, assets, MedialProcessPlugin));
    app
}

/// Runs the app until an asset is loaded, and returns it; or the error.
fn loaded(app: &mut App, name: &str) -> Result<MedialAxis, String> {
    let server = app.world().resource::<AssetServer>().clone();
    let handle: Handle<MedialAxis> = server.load(name.to_string());
    for _ in 0..60_000 {
        app.update();
        match server.load_state(&handle) {
            LoadState::Loaded => {
                return Ok(app.world().resource::<Assets<MedialAxis>>().get(&handle).unwrap().clone());
            }
            LoadState::Failed(error) => return Err(error.to_string()),
            _ => std::thread::sleep(Duration::from_millis(2)),
        }
    }
    panic!("{name} did not load");
}

/// A prism over a triangle.
const WEDGE: &str = "v 0 0 0\nv 2 0 0\nv 0 0 1\nv 0 1 0\nv 2 1 0\nv 0 1 1\n\
    f 1 2 3\nf 4 6 5\nf 1 4 5 2\nf 2 5 6 3\nf 3 6 4 1\n";

fn direct(mesh: &TriangleMesh, options: FitOptions) -> MedialAxis {
    let options = FitOptions { levels: true, ..options };
    fit(mesh, &options, &|_| ControlFlow::Continue(())).unwrap().into_medial_axis().unwrap()
}

fn assert_same(found: &MedialAxis, expected: &MedialAxis) {
    assert_eq!(found.spheres(), expected.spheres());
    assert_eq!(found.primitives(), expected.primitives());
    let levels = [found, expected].map(|axis| axis.coarser().iter().map(|level| level.1).collect::<Vec<_>>());
    assert_eq!(levels[0], levels[1]);
}

#[test]
fn processed_meshes_load_as_if_built_directly() {
    let folder = Folder::new("processing");
    folder.write("wedge.medial.obj", WEDGE);
    folder.write("fine.obj", WEDGE);
    let settings = "(max_error: Some(0.1))";
    let meta =
        format!(r#"(meta_format_version: "1.0", asset: Process(processor: "MedialProcess", settings: {settings}))"#);
    folder.write("fine.obj.meta", meta);
    let mesh = load::load(&folder.0.join("assets/fine.obj")).unwrap();
    let by_default = direct(&mesh, FitOptions::default());
    let by_meta = direct(&mesh, FitOptions { max_error: Some(0.1), ..FitOptions::default() });
    assert_ne!(by_meta.spheres(), by_default.spheres());
    // Built on the first run, and read on the next one without the processor and without the sources.
    for process in [true, false] {
        let mut app = app(&folder.0, process);
        assert_same(&loaded(&mut app, "wedge.medial.obj").unwrap(), &by_default);
        assert_same(&loaded(&mut app, "fine.obj").unwrap(), &by_meta);
        if process {
            fs::remove_dir_all(folder.0.join("assets")).unwrap();
            fs::create_dir_all(folder.0.join("assets")).unwrap();
        }
    }
}

/// A file with triangles. `corners` has three points for each.
fn file(format: &str, corners: &[Vec3]) -> Vec<u8> {
    let lines = |start: &str, points: &[Vec3]| -> String {
        points.iter().map(|p| format!("{start}{} {} {}\n", p.x, p.y, p.z)).collect()
    };
    let count = corners.len();
    match format {
        "stl" => {
            let facet =
                |points| format!("facet normal 0 0 0\nouter loop\n{}endloop\nendfacet\n", lines("vertex ", points));
            format!("solid\n{}endsolid\n", corners.chunks(3).map(facet).collect::<String>()).into()
        }
        "ply" => {
            let faces: String = (0..count).step_by(3).map(|i| format!("3 {i} {} {}\n", i + 1, i + 2)).collect();
            let vertices = format!("element vertex {count}\nproperty float x\nproperty float y\nproperty float z\n");
            let header = format!("{vertices}element face {}\nproperty list uchar int vertex_indices\n", count / 3);
            format!("ply\nformat ascii 1.0\n{header}end_header\n{}{faces}", lines("", corners)).into()
        }
        _ => {
            let buffer: Vec<u8> = corners.iter().flat_map(|p| p.to_array()).flat_map(f32::to_le_bytes).collect();
            let view = format!(r#""byteLength": {}"#, buffer.len());
            let document = format!(
                r#"{{"asset": {{"version": "2.0"}}, "scene": 0, "scenes": [{{"nodes": [0]}}], "nodes": [{{"mesh": 0}}],
                "meshes": [{{"primitives": [{{"attributes": {{"POSITION": 0}}}}]}}], "buffers": [{{{view}}}],
                "bufferViews": [{{"buffer": 0, {view}}}], "accessors": [{{"bufferView": 0, "componentType": 5126,
                "count": {count}, "type": "VEC3", "min": [0, 0, 0], "max": [2, 1, 1]}}]}}"#
            );
            let mut document = document.into_bytes();
            document.resize(document.len().next_multiple_of(4), b' ');
            let length = |bytes: usize| (bytes as u32).to_le_bytes();
            let whole = length(12 + 8 + document.len() + 8 + buffer.len());
            let header = [&b"glTF"[..], &length(2), &whole, &length(document.len()), b"JSON"].concat();
            [header, document, length(buffer.len()).to_vec(), b"BIN\0".to_vec(), buffer].concat()
        }
    }
}

#[test]
fn meshes_of_all_formats_are_processed() {
    let folder = Folder::new("formats");
    folder.write("wedge.obj", WEDGE);
    let wedge = load::load(&folder.0.join("assets/wedge.obj")).unwrap();
    let corners: Vec<Vec3> = wedge.triangles.iter().flatten().map(|&i| wedge.positions[i as usize]).collect();
    let names = ["glb", "ply", "stl"].map(|format| {
        let name = format!("wedge.medial.{format}");
        folder.write(&name, file(format, &corners));
        name
    });
    let mut app = app(&folder.0, true);
    for name in names {
        let axis = loaded(&mut app, &name).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert_same(&axis, &direct(&load::load(&folder.0.join("assets").join(&name)).unwrap(), FitOptions::default()));
        assert!((axis.mass().volume - 1.0).abs() < 1e-3, "{name}: {}", axis.mass().volume);
    }
}

#[test]
fn a_mesh_that_cannot_be_built_does_not_load() {
    let folder = Folder::new("refused");
    folder.write("flat.medial.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    folder.write("wedge.medial.obj", WEDGE);
    let mut app = app(&folder.0, true);
    assert!(loaded(&mut app, "flat.medial.obj").is_err());
    assert!(loaded(&mut app, "wedge.medial.obj").is_ok());
}
