use bevy::prelude::*;
use crate::common::*;
use bevy_medial::prelude::*;
use bevy_medial::medial_axis::MedialAxis;
use bevy_rapier3d::prelude::*;
#[test]
fn debug_shape() {
    for (mi, m) in models().iter().enumerate() { for seed in 0..2 {
        let mut app = app();
        let floor = mesh(&mut app, MedialAxis::rounded_box(Vec3::new(5.0, 1.0, 5.0), 0.1).unwrap());
        app.world_mut().spawn((RigidBody::Fixed, floor, StaticObb::default(), Transform::from_xyz(0.0, -1.0, 0.0)));
        let mut random = Random(mi as u64 + 100 * seed);
        let bound = m.axis.bounding_sphere();
        let at = Transform::from_xyz(0.0, bound.radius + bound.center.length() + 0.1, 0.0).with_rotation(random.rotation());
        let body = spawn_body(&mut app, m.axis.clone(), at);
        app.world_mut().entity_mut(body).insert(Damping { linear_damping: 0.1, angular_damping: 1.0 });
        let mut asleep_at = None;
        let mut w = 0f32;
        let mut stops = 0;
        for i in 0..1500 {
            app.update();
            let b = rigid(&mut app, body);
            if i > 1200 { w = w.max(b.angvel().length()); }
            if b.is_sleeping() && asleep_at.is_none() { asleep_at = Some(i); break; }
            let step = app.world().resource::<MedialStep>();
            stops += step.output.stops.len();
            if m.name != "armadillo" && i > 1200 && i < 1230 {
                for mf in &step.output.manifolds { for c in mf.contacts() { println!("   {i} n {:.4} p1 {:.4} d {:.5} {} {}", step.output.stops.len(), step.input.bodies[0].sweep.end.transform_point(c.point1), c.distance, c.primitive1, c.primitive2); } }
                println!("  v {:.4} w {:.4} ", b.linvel(), b.angvel());
            }
        }
        println!("{} {seed} asleep_at {asleep_at:?} late spin {w} stops {stops}", m.name);
    }}
}
