use bevy_rapier3d::{
    parry::{
        math::{Pose, Real, Vector},
        query::{
            ClosestPoints, Contact as ParryContact, ContactManifold, ContactManifoldsWorkspace, NonlinearRigidMotion,
            PersistentQueryDispatcher, QueryDispatcher, ShapeCastHit, TrackedContact, TypedWorkspaceData, Unsupported,
            WorkspaceData,
            details::{NormalConstraints, ShapeCastOptions},
        },
        shape::{PackedFeatureId, Shape as ParryShape},
    },
    rapier::geometry::{ContactData, ContactManifoldData},
};
use glam::Vec3;

use super::{
    context::rigid,
    parts::{RapierShape, is_known},
    shape::MedialShape,
    shape_cast,
    table::{ContactTable, PairKey, SecondKey},
};
use crate::{
    geometry::Pose3,
    pipeline::{Contact, ContactMargin, Manifold, OtherShape, Shape, contacts},
};

/// Query dispatcher for pairs with a medial shape. Passes all other pairs to the next dispatcher of the chain.
///
/// Manifolds come from the [`ContactTable`] if it has the pair at exactly this relative pose. Otherwise they are computed.
pub struct MedialDispatcher {
    /// Contacts of the last step.
    pub table: ContactTable,
}

/// A pair with the medial shape first. Of two medial shapes, a skinned one is the second, as in the pipeline's pairs.
struct Pair<'a> {
    first: &'a MedialShape,
    other: &'a dyn ParryShape,
    /// Pose of the other collider in the frame of the first.
    pose12: Pose3,
    /// True if the first shape of this pair is rapier's second one.
    swapped: bool,
}

impl<'a> Pair<'a> {
    fn new(pose12: &Pose, shape1: &'a dyn ParryShape, shape2: &'a dyn ParryShape) -> Result<Self, Unsupported> {
        let pose12 = rigid(*pose12);
        let pair = match (shape1.as_shape::<MedialShape>(), shape2.as_shape::<MedialShape>()) {
            (Some(skinned), Some(first)) if skinned.skin.is_some() && first.skin.is_none() => {
                Self { first, other: shape1, pose12: pose12.inverse(), swapped: true }
            }
            (Some(first), _) => Self { first, other: shape2, pose12, swapped: false },
            (None, Some(first)) => Self { first, other: shape1, pose12: pose12.inverse(), swapped: true },
            (None, None) => return Err(Unsupported),
        };
        if is_known(pair.other) { Ok(pair) } else { Err(Unsupported) }
    }

    fn key(&self) -> PairKey {
        PairKey::new(self.first.key, SecondKey::of(self.other), &self.pose12)
    }

    /// Exchanges two medial shapes if the table has them in the other order.
    fn in_order_of(self, table: &ContactTable) -> Self {
        let Some(other) = self.other.as_shape::<MedialShape>().filter(|_| !table.contains(&self.key())) else {
            return self;
        };
        let exchanged = Self { first: other, other: self.first, pose12: self.pose12.inverse(), swapped: !self.swapped };
        if table.contains(&exchanged.key()) { exchanged } else { self }
    }

    /// Calls `function` with the medial shape and the other side.
    fn with_sides<R>(&self, function: impl FnOnce(&Shape, OtherShape) -> R) -> R {
        match self.other.as_shape::<MedialShape>() {
            Some(MedialShape { skin: Some(skin), .. }) => function(&self.first.shape, OtherShape::Parts(&**skin)),
            Some(other) => function(&self.first.shape, OtherShape::Shape(&other.shape)),
            None => function(&self.first.shape, OtherShape::Parts(&RapierShape(self.other))),
        }
    }

    fn manifolds(&self, prediction: f32, table: &ContactTable) -> Vec<Manifold> {
        let second = SecondKey::of(self.other);
        let (reach, has_skins) = table.reach(self.first.key, second, prediction);
        let known = table.get(&self.key(), reach, has_skins);
        known
            .unwrap_or_else(|| self.with_sides(|first, second| contacts::manifolds(first, second, &self.pose12, reach)))
    }

    fn nearest(&self, max_distance: f32, table: &ContactTable) -> Option<Contact> {
        let mut contacts = Vec::new();
        let reach = ContactMargin::new(max_distance, table.length_unit());
        self.with_sides(|first, second| contacts::find(first, second, &self.pose12, reach, &mut contacts));
        contacts.into_iter().min_by(|a, b| a.distance.total_cmp(&b.distance))
    }

    /// Returns the points and outward normals of both sides, each in its collider's frame, in rapier's order.
    fn sides(&self, contact: &Contact) -> [(Vec3, Vec3); 2] {
        let normal2 = self.pose12.rotation.inverse() * -contact.normal1;
        self.in_order((contact.point1, contact.normal1), (contact.point2, normal2))
    }

    fn in_order<T>(&self, first: T, second: T) -> [T; 2] {
        if self.swapped { [second, first] } else { [first, second] }
    }

    /// Returns an upper bound of the distance of the pair, in metres.
    fn distance_bound(&self) -> f32 {
        let bound = self.first.shape.bounding_sphere();
        let center = self.pose12.inverse_transform_point(bound.center);
        self.other.distance_to_local_point(center, true) + bound.radius
    }
}

impl QueryDispatcher for MedialDispatcher {
    fn intersection_test(&self, pos12: &Pose, g1: &dyn ParryShape, g2: &dyn ParryShape) -> Result<bool, Unsupported> {
        Ok(Pair::new(pos12, g1, g2)?.nearest(0.0, &self.table).is_some())
    }

    fn distance(&self, pos12: &Pose, g1: &dyn ParryShape, g2: &dyn ParryShape) -> Result<Real, Unsupported> {
        let pair = Pair::new(pos12, g1, g2)?;
        Ok(pair.nearest(pair.distance_bound(), &self.table).map_or(0.0, |contact| contact.distance.max(0.0)))
    }

    fn contact(
        &self,
        pos12: &Pose,
        g1: &dyn ParryShape,
        g2: &dyn ParryShape,
        prediction: Real,
    ) -> Result<Option<ParryContact>, Unsupported> {
        let pair = Pair::new(pos12, g1, g2)?;
        Ok(pair.nearest(prediction, &self.table).map(|contact| {
            let [(point1, normal1), (point2, normal2)] = pair.sides(&contact);
            ParryContact::new(point1, point2, normal1, normal2, contact.distance)
        }))
    }

    fn closest_points(
        &self,
        pos12: &Pose,
        g1: &dyn ParryShape,
        g2: &dyn ParryShape,
        max_dist: Real,
    ) -> Result<ClosestPoints, Unsupported> {
        let pair = Pair::new(pos12, g1, g2)?;
        Ok(match pair.nearest(max_dist, &self.table) {
            None => ClosestPoints::Disjoint,
            Some(contact) if contact.distance <= 0.0 => ClosestPoints::Intersecting,
            Some(contact) => {
                let [(point1, _), (point2, _)] = pair.sides(&contact);
                ClosestPoints::WithinMargin(point1, point2)
            }
        })
    }

    fn cast_shapes(
        &self,
        pos12: &Pose,
        velocity12: Vector,
        g1: &dyn ParryShape,
        g2: &dyn ParryShape,
        options: ShapeCastOptions,
    ) -> Result<Option<ShapeCastHit>, Unsupported> {
        let pair = Pair::new(pos12, g1, g2)?;
        let velocity12 = if pair.swapped { pair.pose12.rotation * -velocity12 } else { velocity12 };
        let hit = shape_cast::first_touch(&pair.first.shape, pair.other, &pair.pose12, velocity12, &options);
        Ok(hit.map(|hit| if pair.swapped { hit.swapped() } else { hit }))
    }

    /// Always returns no hit, because the step finds the impacts of medial shapes with both motions.
    fn cast_shapes_nonlinear(
        &self,
        _: &NonlinearRigidMotion,
        g1: &dyn ParryShape,
        _: &NonlinearRigidMotion,
        g2: &dyn ParryShape,
        _: Real,
        _: Real,
        _: bool,
    ) -> Result<Option<ShapeCastHit>, Unsupported> {
        Pair::new(&Pose::IDENTITY, g1, g2).map(|_| None)
    }
}

/// Marks a pair whose number of manifolds changes. Rapier rebuilds its solver graph for such a pair instead of patching it.
#[derive(Clone)]
struct Composite;

impl WorkspaceData for Composite {
    fn as_typed_workspace_data(&self) -> TypedWorkspaceData<'_> {
        TypedWorkspaceData::Custom
    }

    fn clone_dyn(&self) -> Box<dyn WorkspaceData> {
        Box::new(self.clone())
    }
}

impl PersistentQueryDispatcher<ContactManifoldData, ContactData> for MedialDispatcher {
    fn contact_manifolds(
        &self,
        pos12: &Pose,
        g1: &dyn ParryShape,
        g2: &dyn ParryShape,
        prediction: Real,
        manifolds: &mut Vec<ContactManifold<ContactManifoldData, ContactData>>,
        workspace: &mut Option<ContactManifoldsWorkspace>,
    ) -> Result<(), Unsupported> {
        let pair = Pair::new(pos12, g1, g2)?.in_order_of(&self.table);
        let found = pair.manifolds(prediction, &self.table);
        if workspace.is_none() {
            *workspace = Some(Composite.into());
        }
        let previous: Vec<_> = manifolds.drain(..).flat_map(|manifold| manifold.points).collect();
        for found in found {
            let mut manifold = ContactManifold::with_data(0, 0, ContactManifoldData::default());
            let normal2 = pair.pose12.rotation.inverse() * -found.normal1;
            [manifold.local_n1, manifold.local_n2] = pair.in_order(found.normal1, normal2);
            for contact in found.contacts() {
                let [point1, point2] = pair.in_order(contact.point1, contact.point2);
                let [feature1, feature2] =
                    pair.in_order(contact.primitive1, contact.primitive2).map(PackedFeatureId::face);
                manifold.points.push(TrackedContact::new(point1, point2, feature1, feature2, contact.distance));
            }
            manifold.match_contacts(&previous);
            manifolds.push(manifold);
        }
        // With two or more manifolds, rapier matches contacts by position. This works even if the number of manifolds changes, so an empty one is added.
        manifolds.push(ContactManifold::with_data(0, 0, ContactManifoldData::default()));
        Ok(())
    }

    fn contact_manifold_convex_convex(
        &self,
        _: &Pose,
        _: &dyn ParryShape,
        _: &dyn ParryShape,
        _: Option<&dyn NormalConstraints>,
        _: Option<&dyn NormalConstraints>,
        _: Real,
        _: &mut ContactManifold<ContactManifoldData, ContactData>,
    ) -> Result<(), Unsupported> {
        Err(Unsupported)
    }
}
