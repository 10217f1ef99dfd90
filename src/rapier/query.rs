//! Scene queries.
//!
//! Rapier's own queries treat medial shapes as compounds of convex primitives. [`MedialQueries`] runs the same queries with this crate's kernels.
//! Both take the same filters.
//!
//! | query | with rapier's own API | with [`MedialQueries`] |
//! |---|---|---|
//! | `cast_ray`, `cast_ray_and_get_normal`, `intersect_ray`, picking | exact | the same |
//! | `project_point`, `intersect_point` | exact; from inside, see below | the same |
//! | `intersect_shape` | accuracy of parry's iterative distance | exact |
//! | `cast_shape` | finds every hit; time and witness points may be off by up to a quarter of the shape's size | exact |
//! | `KinematicCharacterController`, `move_shape` | uses `cast_shape` as above | |
//! | `contact_pair`, `intersection_pair`, events | results of the simulation, exact | |
//! | `cast_shape_nonlinear` of rapier's `QueryPipeline` | as `cast_shape` | finds no medial shape |
//! | next impact of a body, with its rotation | | `first_impact`, exact |
//!
//! There are two picking back ends. `MedialPickingPlugin` (feature `picking`) hits medial bodies and static boxes. The back end of `bevy_rapier3d` (its feature
//! `picking-backend`) calls `intersect_ray` for each pointer and hits all colliders.
//!
//! *Exact* results have an error of rounding only: at most a ten-thousandth of the shape's size. The casts of `move_shape` are exact too if its
//! `RapierQueryPipelineMut` is made with a [`MedialDispatcher`](super::MedialDispatcher) chained to parry's dispatcher.
//!
//! A ray that starts inside hits where it leaves the union of all primitives, unless it is `solid`. A point inside is projected to a point of the union's
//! surface whose distance is a local minimum.
//!
//! Queries use the collider poses after rapier's last step. The collider of a body that has stopped at an impact follows its body in the next step.
//!
//! # Other views of a medial collider
//!
//! Parry has no medial shape, so code that draws, prints or scales a collider gets a compound of cylinders, one along the longest edge of each primitive.
//! Rapier's debug render draws these cylinders, and `{:?}` of a `Collider` prints a compound. `Collider::set_scale` replaces the medial shape by a scaled
//! compound. The scale of a medial body is the scale of its `Transform`; a `ColliderScale` on it has no effect.
//!
//! A compound cannot be nested, so `Collider::compound` panics for the collider of a medial mesh, as it does for a triangle mesh.

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

use super::{context::collider_pose, parts::solid};
use crate::{
    geometry::Sweep,
    pipeline::{Body, Culling, Impact, first_touch},
};

/// Rapier's scene queries with the dispatcher of the simulation, which supports medial shapes.
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
    /// Calls `ask` with a query pipeline of the colliders that pass the filter. Rapier's `with_query_pipeline` does the same without support for medial shapes.
    fn with_medial_queries<T>(&self, filter: QueryFilter, ask: impl FnOnce(RapierQueryPipeline) -> T) -> T;

    /// Predicts the first impact of a medial body within some seconds, on the assumption that all bodies keep their linear and angular velocities. Returns the
    /// entity of the hit collider, and the impact. The fraction of the impact is a fraction of `seconds`.
    ///
    /// `entity`: the entity with the [`MedialMesh`](crate::plugin::MedialMesh). Ignores the other shapes of its rigid body, the colliders that the filter
    /// excludes, and the body's own collision groups. A body in touch counts if its overlap would grow. Returns `None` without an impact, or if the
    /// entity has no medial collider. Tests every collider once.
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
    let is_obstacle = |(handle, other): &(ColliderHandle, &RapierCollider)| {
        *handle != asked
            && other.is_enabled()
            && (other.parent().is_none() || other.parent() != collider.parent())
            && pipeline.filter.test(pipeline.bodies, *handle, other)
    };
    let impacts = pipeline.colliders.iter().filter(is_obstacle).filter_map(|(handle, other)| {
        let other = in_motion(pipeline.bodies, other, seconds)?;
        let impact = first_touch([body.clone(), other], Culling::Hybrid, None)?;
        Some((queries.collider_entity(handle), impact))
    });
    impacts.min_by(|a, b| a.1.fraction.total_cmp(&b.1.fraction))
}

/// Returns a collider with its motion at constant velocities. `None` for a custom shape without a support map.
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
