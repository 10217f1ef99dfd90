//! The debug view: enabled layers are drawn, disabled layers are not, and no lines are left behind.

use std::any::TypeId;

use bevy::{gizmos::GizmoHandles, prelude::*};
use bevy_medial::{
    medial_axis::MedialAxis,
    plugin::{MedialDebugPlugin, MedialGizmo, MedialGizmos},
    prelude::*,
    scenes::{Scene, SceneEntity},
};
use bevy_rapier3d::prelude::Velocity;

use crate::common::{self, *};

fn app() -> App {
    let mut app = common::app();
    MedialDebugPlugin { enabled: false }.build(&mut app);
    app
}

fn set(app: &mut App, change: impl FnOnce(&mut GizmoConfig, &mut MedialGizmos)) {
    let mut store = app.world_mut().resource_mut::<GizmoConfigStore>();
    let (group, layers) = store.config_mut::<MedialGizmos>();
    change(group, layers);
}

/// The retained lines of each entity: number of corners, and asset.
fn outlines(app: &mut App) -> Vec<(Entity, usize, AssetId<GizmoAsset>)> {
    let mut query = app.world_mut().query::<(&ChildOf, &Gizmo)>();
    let world = app.world();
    let lines = world.resource::<Assets<GizmoAsset>>();
    let corners = |gizmo: &Gizmo| {
        let buffer = lines.get(&gizmo.handle).unwrap().buffer();
        buffer.list_positions.len() + buffer.strip_positions.len()
    };
    query.iter(world).map(|(parent, gizmo)| (parent.0, corners(gizmo), gizmo.handle.id())).collect()
}

/// Corners of the lines that are drawn for one frame only, each with its colour.
fn lines(app: &mut App) -> Vec<(Vec3, LinearRgba)> {
    app.update();
    let world = app.world();
    let handles = world.resource::<GizmoHandles>().handles();
    let Some(Some(handle)) = handles.get(&TypeId::of::<MedialGizmos>()) else { return Vec::new() };
    let buffer = world.resource::<Assets<GizmoAsset>>().get(handle).unwrap().buffer();
    let list = buffer.list_positions.iter().zip(&buffer.list_colors);
    let strips = buffer.strip_positions.iter().zip(&buffer.strip_colors);
    // Corners that are not finite separate strips.
    list.chain(strips).filter(|(place, _)| place.is_finite()).map(|(place, color)| (*place, *color)).collect()
}

/// Number of corners of these lines.
fn drawn(app: &mut App) -> usize {
    lines(app).len()
}

/// The scene `rods` after bodies have hit the rods.
fn rods() -> App {
    let mut app = app();
    Scene::by_name("rods").unwrap().spawn(app.world_mut(), models(), 1);
    run(&mut app, 60);
    app
}

#[test]
fn each_shape_is_drawn_once_while_its_layer_is_on() {
    let mut app = app();
    let bear = mesh(&mut app, model("bear"));
    let spawn = |app: &mut App, mesh: &MedialMesh, x: f32| {
        app.world_mut().spawn((mesh.clone(), Transform::from_xyz(x, 0.0, 0.0))).id()
    };
    let bears: Vec<Entity> = (0..5).map(|i| spawn(&mut app, &bear, i as f32 * 3.0)).collect();
    let ring = mesh(&mut app, MedialAxis::torus(1.0, 0.2, 8).unwrap());
    let ring = spawn(&mut app, &ring, 20.0);
    run(&mut app, 3);
    assert_eq!(outlines(&mut app), []);

    set(&mut app, |group, _| group.enabled = true);
    run(&mut app, 2);
    let on = outlines(&mut app);
    assert_eq!(on.len(), 6);
    let asset_of = |on: &[(Entity, usize, AssetId<GizmoAsset>)], entity| on.iter().find(|o| o.0 == entity).unwrap().2;
    assert!(bears.iter().all(|&bear| asset_of(&on, bear) == asset_of(&on, bears[0])), "bears share their lines");
    assert_ne!(asset_of(&on, ring), asset_of(&on, bears[0]));

    // One layer less gives fewer lines.
    set(&mut app, |_, layers| layers.spheres.enabled = false);
    run(&mut app, 2);
    let fewer = outlines(&mut app);
    let corners = |list: &[(Entity, usize, AssetId<GizmoAsset>)]| list.iter().map(|o| o.1).sum::<usize>();
    assert!(corners(&fewer) > 0 && corners(&fewer) < corners(&on), "{} of {}", corners(&fewer), corners(&on));

    // One bear is hidden. Another has a colour of its own and is shown even if the group is disabled.
    app.world_mut().entity_mut(bears[0]).insert(MedialGizmo { enabled: false, color: None });
    app.world_mut().entity_mut(bears[1]).insert(MedialGizmo { color: Some(Color::WHITE), ..default() });
    run(&mut app, 2);
    let some = outlines(&mut app);
    assert_eq!(some.len(), 5);
    assert_ne!(asset_of(&some, bears[1]), asset_of(&some, bears[2]));
    set(&mut app, |group, _| group.enabled = false);
    run(&mut app, 2);
    let one = outlines(&mut app);
    assert_eq!((one.len(), one[0].0), (1, bears[1]));
    let white = app.world().resource::<Assets<GizmoAsset>>().get(one[0].2).unwrap().buffer().strip_colors[0];
    assert_eq!(white, LinearRgba::WHITE);

    app.world_mut().despawn(bears[1]);
    run(&mut app, 3);
    assert_eq!(outlines(&mut app), []);
    assert_eq!(app.world().resource::<Assets<GizmoAsset>>().len(), 0, "unused lines must be removed");
}

#[test]
fn a_body_is_drawn_at_its_collision_level() {
    let mut app = app();
    let axis = models().iter().find(|model| model.name == "bear").unwrap().axis.clone();
    assert!(axis.coarser().len() > 1);
    let body = spawn_body(&mut app, axis, Transform::default());
    set(&mut app, |group, layers| {
        group.enabled = true;
        layers.color_by_level = true;
    });
    let mut seen = Vec::new();
    for percent in [0.0, 4.0, 100.0] {
        app.world_mut().entity_mut(body).insert(MedialBudget::Percent(percent));
        run(&mut app, 3);
        let outlines = outlines(&mut app);
        assert_eq!(outlines.len(), 1);
        let level = app.world().get::<MedialLevel>(body).unwrap().0;
        let lines = app.world().resource::<Assets<GizmoAsset>>().get(outlines[0].2).unwrap().buffer();
        seen.push((level, outlines[0].1, lines.strip_colors[0].to_f32_array()));
    }
    for pair in seen.windows(2) {
        assert!(pair[0].0 < pair[1].0 && pair[0].1 > pair[1].1 && pair[0].2 != pair[1].2, "{seen:?}");
    }
}

/// The layers that show data of a step, with their colours.
fn layers_of_steps() -> Vec<(&'static str, LinearRgba)> {
    let shapes = ["spheres", "cones", "slabs"];
    let mut layers = MedialGizmos::default();
    let layers = layers.layers_mut().map(|(name, layer)| (name, layer.color.to_linear()));
    layers.into_iter().filter(|(name, _)| !shapes.contains(name)).collect()
}

/// Turns off all layers except the one with this name, if it exists.
fn show_only(app: &mut App, name: &str) {
    set(app, |group, layers| {
        group.enabled = true;
        layers.layers_mut().into_iter().for_each(|(other, layer)| layer.enabled = other == name);
    });
}

/// Colours of the first frame that draws any line. Candidates are available only from the next step on, and not every step has impacts.
fn first_colors(app: &mut App) -> Option<Vec<LinearRgba>> {
    let lines = (0..120).map(|_| lines(app)).find(|lines| !lines.is_empty())?;
    Some(lines.into_iter().map(|(_, color)| color).collect())
}

#[test]
fn each_layer_of_a_step_adds_and_removes_its_lines() {
    let mut app = rods();
    assert_eq!(drawn(&mut app), 0, "the group is off");
    show_only(&mut app, "nothing");
    assert_eq!(drawn(&mut app), 0, "every layer is off");
    for (name, color) in layers_of_steps() {
        show_only(&mut app, name);
        let colors = first_colors(&mut app).unwrap_or_else(|| panic!("{name} draws nothing"));
        assert!(colors.iter().all(|other| *other == color), "{name}: {colors:?}");
        show_only(&mut app, "nothing");
        assert_eq!(drawn(&mut app), 0, "lines of {name} are left");
    }
    let step = app.world().resource::<MedialStep>();
    assert!(step.output.candidates.is_empty() || !step.input.report_candidates);
}

#[test]
fn entities_can_be_coloured_or_hidden_in_every_layer() {
    // The hierarchy belongs to no entity.
    for (name, _) in layers_of_steps().into_iter().filter(|(name, _)| *name != "hierarchy") {
        let mut app = rods();
        show_only(&mut app, name);
        let mut with = |gizmo| {
            let world = app.world_mut();
            let entities: Vec<Entity> = world.query_filtered::<Entity, With<SceneEntity>>().iter(world).collect();
            for entity in entities {
                world.entity_mut(entity).insert(gizmo);
            }
            first_colors(&mut app)
        };
        let colors = with(MedialGizmo { enabled: true, color: Some(Color::WHITE) });
        let colors = colors.unwrap_or_else(|| panic!("{name} draws nothing"));
        assert!(colors.iter().all(|color| *color == LinearRgba::WHITE), "{name}: {colors:?}");
        assert_eq!(with(MedialGizmo { enabled: false, color: None }), None, "{name}");
    }
}

#[test]
fn a_stopped_body_is_drawn_at_its_stop() {
    let mut app = app();
    set(&mut app, |group, layers| {
        group.enabled = true;
        layers.layers_mut().into_iter().for_each(|(name, layer)| layer.enabled = name == "stops");
    });
    let scale = 0.5;
    let place = Transform::from_xyz(0.0, 1.0, 0.0).with_scale(Vec3::splat(scale));
    let fast = Velocity { linear: Vec3::NEG_Y * 100.0, angular: Vec3::ZERO };
    let body = spawn_flying(&mut app, model("bear"), place, fast);
    spawn_ground(&mut app);
    let there = (0..10).find(|_| {
        app.update();
        !app.world().resource::<MedialStep>().output.stops.is_empty()
    });
    assert!(there.is_some(), "the body does not stop");
    let step = app.world().resource::<MedialStep>();
    let stop = step.output.stops[0];
    assert_eq!(step.infos[stop.body as usize].entity, body);
    let [(places, color)] = &stop_outlines(&mut app)[..] else { panic!("one outline") };
    assert_eq!(*color, MedialGizmos::default().stops.color.to_linear());
    for sphere in model("bear").spheres().iter().map(|sphere| sphere.scaled(scale)) {
        let center = stop.pose.transform_point(sphere.center);
        let on_it = |place: &&Vec3| (place.distance(center) - sphere.radius).abs() < 1e-5;
        // Each sphere is drawn as three circles.
        assert!(places.iter().filter(on_it).count() >= 48, "a sphere is missing at {center}");
    }
    // Further stops: in a colour of its own, hidden, and by default. Without stops no lines are drawn.
    let mut again = |gizmo| {
        let mut body = app.world_mut().entity_mut(body);
        body.insert((gizmo, place, fast));
        (0..10).find_map(|_| {
            app.update();
            let stops = !app.world().resource::<MedialStep>().output.stops.is_empty();
            stops.then(|| stop_outlines(&mut app))
        })
    };
    let own = again(MedialGizmo { color: Some(Color::WHITE), ..default() }).expect("a stop");
    assert_eq!(own.iter().map(|(_, color)| *color).collect::<Vec<_>>(), [LinearRgba::WHITE]);
    assert!(again(MedialGizmo { enabled: false, color: None }).expect("a stop").is_empty());
    assert_eq!(again(MedialGizmo::default()).expect("a stop").len(), 1);
    app.world_mut().despawn(body);
    run(&mut app, 3);
    assert!(stop_outlines(&mut app).is_empty());
    assert_eq!(app.world().resource::<Assets<GizmoAsset>>().len(), 0, "unused lines must be removed");
}

/// The shapes drawn at the poses where bodies have stopped: corners in the world frame, and the colour of the first corner.
fn stop_outlines(app: &mut App) -> Vec<(Vec<Vec3>, LinearRgba)> {
    let mut query = app.world_mut().query_filtered::<(&Gizmo, &GlobalTransform), Without<ChildOf>>();
    let world = app.world();
    let lines = world.resource::<Assets<GizmoAsset>>();
    let corners = |(gizmo, transform): (&Gizmo, &GlobalTransform)| {
        let buffer = lines.get(&gizmo.handle).unwrap().buffer();
        let places = buffer.strip_positions.iter().map(|place| transform.transform_point(*place)).collect();
        (places, buffer.strip_colors[0])
    };
    query.iter(world).map(corners).collect()
}

#[test]
fn reported_candidates_equal_the_count_of_the_step() {
    let mut app = rods();
    set(&mut app, |group, layers| {
        group.enabled = true;
        layers.candidates.enabled = true;
    });
    let mut most = 0;
    for _ in 0..60 {
        app.update();
        let step = app.world().resource::<MedialStep>();
        if !step.input.report_candidates {
            continue;
        }
        let reported: usize = step.output.candidates.iter().map(|pair| pair.primitives.indices().count()).sum();
        if reported > 0 {
            assert_eq!(reported, step.output.counts.candidates);
        }
        most = most.max(reported);
    }
    assert!(most > 10, "{most} candidates");
}
