//! Pictures of models: the triangle mesh, its medial mesh, and the distance between them as colour.
//!
//! ```text
//! cargo run --release --example medial_pictures [NAME ...]
//! ```
//!
//! Reads `assets/models/NAME.obj` and `.ma`, and writes `docs/images/medial_NAME.png`. Needs a graphics adapter (a software
//! adapter is enough), but no display.

mod common;

use std::{env, error::Error, fs, path::Path};

use bevy::{
    camera::ScalingMode,
    core_pipeline::tonemapping::{DebandDither, Tonemapping},
    light::GlobalAmbientLight,
    prelude::*,
};
use bevy_medial::{
    builder::{TriangleMesh, load, measure, vertex_errors},
    geometry::{self, Primitive},
    medial_axis::{MedialAxis, ma, triangulate},
};
use common::studio::Studio;

/// Size of a picture, in pixels.
const SIZE: UVec2 = UVec2::new(1200, 400);
/// Max size of a model, in widths of a panel.
const FRAME: Vec2 = Vec2::new(0.86, 0.8);
/// Height of models above the middle, in widths of a panel. Leaves space for captions.
const RAISED: f32 = 0.06;
/// Models that are shown if none is named.
const NAMES: [&str; 4] = ["bear", "deer", "spider", "dinosaur"];

/// Marks an entity of the current picture. It is despawned after the picture.
#[derive(Component)]
struct Shown;

fn main() -> Result<(), Box<dyn Error>> {
    let mut names: Vec<String> = env::args().skip(1).collect();
    if names.is_empty() {
        names = NAMES.map(String::from).into();
    }
    let mut studio = studio();
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    for name in names {
        let path = root.join("assets/models").join(&name);
        let mesh = load::load(&path.with_extension("obj"))?;
        let (axis, _) = ma::parse(&fs::read(path.with_extension("ma"))?)?.into_medial_axis()?;
        show(studio.app.world_mut(), &mesh, &axis);
        let file = root.join(format!("docs/images/medial_{name}.png"));
        // New meshes and text take a frame or two to reach the renderer.
        (0..5).for_each(|_| studio.app.update());
        studio.take(&file)?;
        studio.wait_for(&file)?;
        println!("{}: {} KiB", file.display(), fs::metadata(&file)?.len().div_ceil(1024));
        let world = studio.app.world_mut();
        let shown: Vec<Entity> = world.query_filtered::<Entity, With<Shown>>().iter(world).collect();
        for entity in shown {
            world.despawn(entity);
        }
    }
    Ok(())
}

/// An app with a camera and light.
fn studio() -> Studio {
    Studio::new(SIZE, |app, target| {
        app.insert_resource(ClearColor(Color::WHITE))
            .insert_resource(GlobalAmbientLight { brightness: 450.0, ..default() });
        // A panel is 1 m wide.
        let scaling_mode = ScalingMode::FixedHorizontal { viewport_width: 3.0 };
        app.world_mut().spawn((
            Camera3d::default(),
            IsDefaultUiCamera,
            // Colors as in the legend, and no dithering, because its noise makes large files.
            (Tonemapping::None, DebandDither::Disabled),
            target,
            Projection::Orthographic(OrthographicProjection { scaling_mode, ..OrthographicProjection::default_3d() }),
            Transform::from_xyz(0.0, 0.0, 5.0),
        ));
        app.world_mut().spawn((
            DirectionalLight { illuminance: 5500.0, ..default() },
            Transform::from_xyz(-1.5, 4.0, 4.0).looking_at(Vec3::ZERO, Vec3::Y),
        ));
    })
}

/// Draws a model in three panels.
fn show(world: &mut World, mesh: &TriangleMesh, axis: &MedialAxis) {
    let solid = mesh.to_bevy();
    let faceted = solid.clone().with_duplicated_vertices().with_computed_flat_normals();
    let errors = vertex_errors(mesh, axis);
    let most = errors.iter().fold(0.0, |most: f32, error| most.max(error.abs()));
    let shades: Vec<[f32; 4]> =
        errors.iter().map(|error| shade(error.abs() / most).to_linear().to_f32_array()).collect();
    let colored = solid.with_computed_area_weighted_normals().with_inserted_attribute(Mesh::ATTRIBUTE_COLOR, shades);
    // Spheres are drawn 1 % larger, so that they cover their part of the envelope.
    let balls: Vec<_> = axis.spheres().iter().map(|s| geometry::Sphere::new(s.center, 1.01 * s.radius)).collect();
    let each: Vec<_> = (0..balls.len() as u32).map(|i| Primitive::Sphere([i])).collect();

    let rotation = Quat::from_rotation_x(0.35) * Quat::from_rotation_y(-0.65);
    let turned = mesh.positions.iter().map(|p| rotation * p);
    let (min, max) = turned.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(min, max), p| (min.min(p), max.max(p)));
    let scale = (FRAME / (max - min).xy()).min_element();
    let middle = Vec3::Y * RAISED - (min + max) * (0.5 * scale);
    for (panel, mesh, color) in [
        (-1.0, faceted, Color::srgb(0.66, 0.66, 0.7)),
        (0.0, drawn(axis.spheres(), axis.primitives()), Color::srgb(0.35, 0.6, 0.9)),
        (0.0, drawn(&balls, &each), Color::srgb(0.95, 0.55, 0.2)),
        (1.0, colored, Color::WHITE),
    ] {
        let mesh = world.resource_mut::<Assets<Mesh>>().add(mesh);
        let material = StandardMaterial { base_color: color, perceptual_roughness: 0.7, ..default() };
        let material = world.resource_mut::<Assets<StandardMaterial>>().add(material);
        let translation = middle + Vec3::X * panel;
        let place = Transform { translation, rotation, scale: Vec3::splat(scale) };
        world.spawn((Shown, Mesh3d(mesh), MeshMaterial3d(material), place));
    }
    let captions = captions(mesh, axis, most);
    world.spawn((Shown, captions));
}

/// The captions below the panels. `most` is the largest error of a vertex, in percent of the diagonal.
fn captions(mesh: &TriangleMesh, axis: &MedialAxis, most: f32) -> impl Bundle {
    let mut kinds = [0; 3];
    axis.primitives().iter().for_each(|primitive| kinds[primitive.indices().len() - 1] += 1);
    let mean = measure(mesh, axis).mesh_to_envelope.mean;
    let text = |text: String| (Text::new(text), TextFont::from_font_size(15.0), TextColor(Color::BLACK));
    let stops = (0..=16).map(|part| ColorStop::auto(shade(part as f32 / 16.0))).collect();
    let bar = Node { width: px(150), height: px(12), ..default() };
    let legend = (
        Node { column_gap: px(8), align_items: AlignItems::Center, ..default() },
        children![
            text("0".into()),
            (bar, BackgroundGradient::from(LinearGradient::to_right(stops))),
            text(format!("{most:.2}")),
        ],
    );
    let panel = Node {
        width: percent(100.0 / 3.0),
        flex_direction: FlexDirection::Column,
        align_items: AlignItems::Center,
        justify_content: JustifyContent::End,
        row_gap: px(4),
        ..default()
    };
    let row = Node { width: percent(100), position_type: PositionType::Absolute, bottom: px(10), ..default() };
    (
        row,
        children![
            (panel.clone(), children![text(format!("{} triangles", mesh.triangles.len()))]),
            (
                panel.clone(),
                children![text(format!("{} spheres, {} cones, {} slabs", axis.spheres().len(), kinds[1], kinds[2]))]
            ),
            (panel, children![legend, text(format!("error in % of the diagonal, mean {mean:.2}"))]),
        ],
    )
}

/// The envelope of primitives.
fn drawn(spheres: &[geometry::Sphere], primitives: &[Primitive]) -> Mesh {
    triangulate(spheres, primitives, 48).into()
}

/// The colour of an error. `error` is relative to the largest error, from 0 to 1.
fn shade(error: f32) -> Color {
    let [r, g, b] = colorous::VIRIDIS.eval_continuous(f64::from(error)).as_array();
    Color::srgb_u8(r, g, b)
}
