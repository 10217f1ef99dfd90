//! Lines of shapes: one asset for each shape, level of detail and set of colours.

use std::{
    collections::HashMap,
    sync::{Arc, Weak},
};

use bevy::{asset::StrongHandle, prelude::*};

use crate::medial_axis::MedialAxis;

/// Key of the lines of a shape.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub(super) struct Drawing {
    pub asset: AssetId<MedialAxis>,
    level: usize,
    /// Bits of the colours of spheres, cones and slabs.
    colors: [Option<[u32; 4]>; 3],
}

impl Drawing {
    pub fn new(asset: AssetId<MedialAxis>, level: usize, colors: [Option<Color>; 3]) -> Self {
        Self { asset, level, colors: colors.map(|color| color.map(bits)) }
    }
}

/// The lines that are in use.
#[derive(Resource, Default)]
pub(super) struct Lines(HashMap<Drawing, Weak<StrongHandle>>);

impl Lines {
    /// Drops the lines of changed shapes, and those that no entity shows.
    pub fn clean(&mut self, changed: &[AssetId<MedialAxis>]) {
        self.0.retain(|drawing, lines| !changed.contains(&drawing.asset) && lines.strong_count() > 0);
    }

    /// Returns the lines of a drawing, and makes them if they do not exist.
    pub fn get(
        &mut self,
        drawing: Drawing,
        gizmos: &mut Assets<GizmoAsset>,
        draw: impl FnOnce() -> GizmoAsset,
    ) -> Handle<GizmoAsset> {
        self.0.get(&drawing).and_then(Weak::upgrade).map(Handle::Strong).unwrap_or_else(|| {
            let lines = gizmos.add(draw());
            if let Handle::Strong(handle) = &lines {
                self.0.insert(drawing, Arc::downgrade(handle));
            }
            lines
        })
    }
}

fn bits(color: Color) -> [u32; 4] {
    color.to_linear().to_f32_array().map(f32::to_bits)
}
