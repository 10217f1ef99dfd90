//! Scene queries.
//!
//! Rapier's own queries see medial shapes as compounds of convex primitives, and [`MedialQueries`] asks the same questions with this crate's
//! kernels. All take the same filters.
//!
//! | query | through rapier's own API | through [`MedialQueries`] |
//! |---|---|---|
//! | `cast_ray`, `cast_ray_and_get_normal`, `intersect_ray`, picking | exact | the same |
//! | `project_point`, `intersect_point` | exact; from inside, see below | the same |
//! | `intersect_shape` | as good as parry's iterative distance | exact |
//! | `cast_shape` | sees every hit; time and witness points of some are off by up to a quarter of the shape's size | exact |
//! | `KinematicCharacterController`, `move_shape` | by `cast_shape` as above | |
//! | `contact_pair`, `intersection_pair`, events | the simulation's, exact | |
//! | `cast_shape_nonlinear` of rapier's `QueryPipeline` | as `cast_shape` | finds no medial shape |
//! | what a body is about to hit, turning as it goes | | `first_impact`, exact |
//!
//! Picking is `MedialPickingPlugin` of the feature `picking`, which hits medial bodies and static boxes, or `bevy_rapier3d`'s own back end, its feature
//! `picking-backend`, which asks `intersect_ray` for each pointer and hits all colliders.
//!
//! *Exact*: but for rounding, within a ten-thousandth of the shape's size. `move_shape` takes a `RapierQueryPipelineMut`: made with a
//! [`MedialDispatcher`](super::MedialDispatcher) chained to parry's own, its casts are exact as well.
//!
//! A ray that starts inside and is not `solid` hits where it leaves the union of all primitives. A point that is projected from inside goes to
//! a place of the union's surface from which every near one is farther.
//!
//! Colliders are where rapier's last step has left them: a body that has stopped at its impact takes its collider along in the next step.
//!
//! # Foreign views
//!
//! Parry knows no medial shape, so what draws, prints or scales a collider sees a compound too: of cylinders, one along the longest edge of
//! each primitive. Rapier's debug render draws these, `{:?}` of a `Collider` prints that it is a compound, and `Collider::set_scale` makes a
//! compound of them, which is a medial shape no more. The scale of a medial body is that of its `Transform`; a `ColliderScale` beside it counts
//! for nothing.
//!
//! A compound cannot be nested, so `Collider::compound` panics when given the collider of a medial mesh, as it does for a triangle mesh.

use bevy::prelude::*;
use bevy_rapier3d::{
    plugin::context::{
        RapierQueryPipeline,
        systemparams::{RapierContext, RapierContextMut},
    },
    prelude::QueryFilter,
    rapier::{
        dynamics::RigidBodySet,
        geometry::{Collider as RapierCollider, ColliderHandle},
    },
};

use super::detect::{collider_pose, solid};
use crate::{
    geometry::Sweep,
    pipeline::{Body, Culling, Impact, first_touch},
};

/// Rapier's scene queries by the simulation's own dispatcher, which knows medial shapes.
///
/// ```no_run
/// # use bevy::prelude::*;
/// # use bevy_medial::prelude::*;
/// # use bevy_rapier3d::{parry::{query::ShapeCastOptions, shape::Ball}, prelude::*};
/// fn look_ahead(rapier: ReadRapierContext) -> Result {
///     let options = ShapeCastOptions::with_max_time_of_impact(10.0);
///     let hit = rapier.single()?.with_medial_queries(QueryFilter::only_dynamic(), |queries| {
///         queries.cast_shape(Vec3::ZERO, Quat::IDENTITY, Vec3::X, &Ball::new(0.5), options)
///     });
///     if let Some((entity, hit)) = hit {
///         info!("{entity} is {} m ahead", hit.time_of_impact);
///     }
///     Ok(())
/// }
/// ```
pub trait MedialQueries {
    /// Calls `ask` with the queries of what passes the filter: as rapier's `with_query_pipeline`, which knows parry's shapes only.
    fn with_medial_queries<T>(&self, filter: QueryFilter, ask: impl FnOnce(RapierQueryPipeline) -> T) -> T;

    /// What a medial body is about to hit within some seconds, if it and all others go on at the velocities that they have, turning as they go:
    /// no force acts, nothing gives way, and no spin tumbles. The collider's entity, and the impact, whose fraction is one of that time.
    ///
    /// `entity`: the one with the [`MedialMesh`](crate::plugin::MedialMesh). Other shapes of its rigid body are not in its way, and the filter
    /// tells what else is not; its collision groups are not asked. What it is in touch with already counts if an overlap would grow. None if
    /// there is nothing, or if the entity has no medial collider. Looks at all colliders once.
    fn first_impact(&self, entity: Entity, seconds: f32, filter: QueryFilter) -> Option<(Entity, Impact)> {
        self.with_medial_queries(filter, |queries| first_impact(&queries, entity, seconds))
    }
}

impl MedialQueries for RapierContext<'_> {
    fn with_medial_queries<T>(&self, filter: QueryFilter, ask: impl FnOnce(RapierQueryPipeline) -> T) -> T {
        let dispatcher = self.simulation.narrow_phase.query_dispatcher();
        let broad_phase = &self.simulation.broad_phase;
        RapierQueryPipeline::new_scoped(broad_phase, self.colliders, self.rigidbody_set, &filter, dispatcher, ask)
    }
}

impl MedialQueries for RapierContextMut<'_> {
    fn with_medial_queries<T>(&self, filter: QueryFilter, ask: impl FnOnce(RapierQueryPipeline) -> T) -> T {
        let dispatcher = self.simulation.narrow_phase.query_dispatcher();
        let broad_phase = &self.simulation.broad_phase;
        RapierQueryPipeline::new_scoped(broad_phase, &self.colliders, &self.rigidbody_set, &filter, dispatcher, ask)
    }
}

fn first_impact(queries: &RapierQueryPipeline, entity: Entity, seconds: f32) -> Option<(Entity, Impact)> {
    let pipeline = &queries.query_pipeline;
    let is_asked = |handle: &ColliderHandle| queries.collider_entity(*handle) == entity;
    let (asked, collider) = pipeline.colliders.iter().find(|(handle, _)| is_asked(handle))?;
    let body = in_motion(pipeline.bodies, collider, seconds)?;
    let in_the_way = |(handle, other): &(ColliderHandle, &RapierCollider)| {
        *handle != asked
            && other.is_enabled()
            && (other.parent().is_none() || other.parent() != collider.parent())
            && pipeline.filter.test(pipeline.bodies, *handle, other)
    };
    let impacts = pipeline.colliders.iter().filter(in_the_way).filter_map(|(handle, other)| {
        let other = in_motion(pipeline.bodies, other, seconds)?;
        let impact = first_touch([body.clone(), other], Culling::Hybrid, None)?;
        Some((queries.collider_entity(handle), impact))
    });
    impacts.min_by(|a, b| a.1.fraction.total_cmp(&b.1.fraction))
}

/// A collider that goes on as it does. None if nothing is known about its shape.
fn in_motion(bodies: &RigidBodySet, collider: &RapierCollider, seconds: f32) -> Option<Body> {
    let body = collider.parent().and_then(|parent| bodies.get(parent));
    let pose = collider_pose(collider, body);
    let sweep = match body.filter(|body| body.is_moving()) {
        Some(body) => {
            let center = pose.inverse_transform_point(body.center_of_mass());
            Sweep::at_rates(pose, center, body.linvel() * seconds, body.angvel() * seconds)
        }
        None => Sweep::at_rest(pose),
    };
    Some(Body::new(solid(collider.shared_shape())?, sweep))
}
