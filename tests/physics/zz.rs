use crate::common::*;
use bevy::prelude::*;
use bevy_medial::prelude::*;
#[test]
fn debug_scale() {
    let mut app = app();
    spawn_ground(&mut app);
    let body = spawn_body(&mut app, model("torus"), Transform::from_xyz(0.0, 0.5, 0.0));
    run(&mut app, 400);
    for scale in [2.0, 0.5, 1.0] {
        app.world_mut().get_mut::<Transform>(body).unwrap().scale = Vec3::splat(scale);
        for i in 0..600 {
            app.update();
            let b = rigid(&mut app, body);
            if i < 12 || i % 100 == 99 {
                let step = app.world().resource::<MedialStep>();
                let deepest = step.output.manifolds.iter().map(|m| m.contacts()[0].distance).fold(9.0, f32::min);
                println!(
                    "{scale} {i} y {} v {} w {} asleep {} mass {} pairs {} d {deepest} stops {:?}",
                    b.translation().y,
                    b.linvel().y,
                    b.angvel(),
                    b.is_sleeping(),
                    b.mass(),
                    step.output.pairs.len(),
                    step.output.stops
                );
            }
        }
    }
}
