//! Medial meshes in the layout of the GPU. The shape of a rigid body is uploaded once and shared by all bodies. Deforming shapes follow in the same lists and
//! are uploaded in each step.

use std::{array::from_fn, collections::HashMap};

use bytemuck::cast_slice;

use super::{
    buffers::{Buffers, Slot},
    device::{GpuDevice, GpuError},
    layout::{self, NODE},
};
use crate::{
    medial_axis::{MedialAxis, WeakMedialAxis, packed::PackedMedialMesh},
    pipeline::Deforming,
};

/// The shapes that have been uploaded.
#[derive(Default)]
pub(super) struct Shapes {
    /// Index by the address of the shape's data. The weak handle keeps the address from being used again.
    known: HashMap<usize, (WeakMedialAxis, u32)>,
    table: Vec<layout::Shape>,
    spheres: Vec<[f32; 4]>,
    primitives: Vec<[i32; 3]>,
    nodes: Vec<u8>,
    /// Length of each list without deforming shapes.
    kept: [usize; 4],
    /// Number of bytes of each list that have been uploaded.
    uploaded: [usize; 4],
}

impl Shapes {
    /// Returns the index of a shape. A new shape is added.
    pub fn index_of(&mut self, axis: &MedialAxis) -> u32 {
        if let Some((_, index)) = self.known.get(&axis.address()) {
            return *index;
        }
        self.add(axis)
    }

    fn add(&mut self, axis: &MedialAxis) -> u32 {
        debug_assert_eq!(self.kept[0], self.table.len(), "deforming shapes come last");
        let index = self.push(axis);
        self.kept = [self.table.len(), self.spheres.len(), self.primitives.len(), self.nodes.len()];
        self.known.insert(axis.address(), (axis.downgrade(), index));
        index
    }

    /// Adds a deforming shape after all others, and returns its index. Its spheres are enlarged to contain their paths.
    pub fn add_deforming(&mut self, shape: &Deforming) -> u32 {
        self.push(&shape.cover())
    }

    /// Removes the deforming shapes of the last step.
    pub fn begin_step(&mut self) {
        let [table, spheres, primitives, nodes] = self.kept;
        self.table.truncate(table);
        self.spheres.truncate(spheres);
        self.primitives.truncate(primitives);
        self.nodes.truncate(nodes);
        let bytes = self.lists().map(|(_, bytes)| bytes.len());
        self.uploaded = from_fn(|list| self.uploaded[list].min(bytes[list]));
    }

    fn push(&mut self, axis: &MedialAxis) -> u32 {
        let PackedMedialMesh { spheres, primitives } = PackedMedialMesh::new(axis);
        let nodes = axis.bvh().bytes();
        let index = self.table.len() as u32;
        self.table.push(layout::Shape {
            spheres: self.spheres.len() as u32,
            primitives: self.primitives.len() as u32,
            primitive_count: primitives.len() as u32,
            nodes: (self.nodes.len() / NODE as usize) as u32,
            node_count: (nodes.len() / NODE as usize) as u32,
        });
        self.spheres.extend(spheres);
        self.primitives.extend(primitives);
        self.nodes.extend_from_slice(nodes);
        index
    }

    /// Drops unused shapes if they are the majority. Returns true if the others have new indices then.
    pub fn tidy(&mut self) -> bool {
        let used = || self.known.values().filter_map(|(axis, index)| Some((axis.upgrade()?, *index)));
        if 2 * used().count() >= self.known.len() {
            return false;
        }
        let mut kept: Vec<(MedialAxis, u32)> = used().collect();
        kept.sort_by_key(|(_, index)| *index);
        *self = Self::default();
        for (axis, _) in kept {
            self.add(&axis);
        }
        true
    }

    /// Uploads new data.
    pub fn upload(&mut self, gpu: &GpuDevice, buffers: &mut Buffers) -> Result<(), GpuError> {
        for (list, (slot, bytes)) in self.lists().into_iter().enumerate() {
            if bytes.len() > self.uploaded[list] {
                buffers.append(gpu, slot, bytes, self.uploaded[list])?;
            }
        }
        self.uploaded = self.lists().map(|(_, bytes)| bytes.len());
        Ok(())
    }

    fn lists(&self) -> [(Slot, &[u8]); 4] {
        [
            (Slot::Shapes, cast_slice(&self.table)),
            (Slot::Spheres, cast_slice(&self.spheres)),
            (Slot::Primitives, cast_slice(&self.primitives)),
            (Slot::ShapeNodes, &self.nodes),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shapes_that_are_gone_are_dropped_with_their_levels() {
        let mut shapes = Shapes::default();
        let mut make = |spheres: u32| {
            let coarser = MedialAxis::torus(0.3, 0.1, spheres / 2).unwrap();
            let axis = MedialAxis::torus(0.3, 0.1, spheres).unwrap().with_coarser(vec![(coarser, 0.01)]);
            let [fine, coarse] = [0, 1].map(|level| shapes.index_of(axis.level(level)));
            (axis, fine, coarse)
        };
        let kept = make(8);
        let gone = [10, 12, 14].map(&mut make);
        assert_eq!((kept.1, kept.2, gone[2].2), (0, 1, 7));
        assert!(!shapes.tidy(), "shapes in use were dropped");
        let lengths = |shapes: &Shapes| shapes.lists().map(|(_, bytes)| bytes.len());
        let before = lengths(&shapes);
        let deforming = Deforming::new(&MedialAxis::torus(0.3, 0.1, 8).unwrap(), Vec::new());
        assert_eq!([0, 1].map(|_| shapes.add_deforming(&deforming)), [8, 9]);
        shapes.begin_step();
        assert_eq!(lengths(&shapes), before);
        let spheres = shapes.spheres.len();
        drop(gone);
        assert!(shapes.tidy() && shapes.known.len() == 2 && shapes.spheres.len() < spheres / 2);
        assert_eq!([0, 1].map(|level| shapes.index_of(kept.0.level(level))), [0, 1]);
    }
}
