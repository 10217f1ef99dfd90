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

    fn write(&self, name: &str, content: &str) {
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
    folder.write("fine.obj.meta", &meta);
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

#[test]
fn a_mesh_that_cannot_be_built_does_not_load() {
    let folder = Folder::new("refused");
    folder.write("flat.medial.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    folder.write("wedge.medial.obj", WEDGE);
    let mut app = app(&folder.0, true);
    assert!(loaded(&mut app, "flat.medial.obj").is_err());
    assert!(loaded(&mut app, "wedge.medial.obj").is_ok());
}
