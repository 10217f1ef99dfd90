//! Medial meshes as the GPU has them: uploaded once, shared by all bodies.

use std::collections::HashMap;

use bytemuck::cast_slice;

use super::{
    buffers::{Buffers, Slot},
    device::{GpuDevice, GpuError},
    layout::{self, NODE},
};
use crate::medial_axis::{MedialAxis, packed::PackedMedialMesh};

/// The shapes that have been uploaded.
#[derive(Default)]
pub(super) struct Shapes {
    /// By the place of their data, which stays theirs as long as they are kept here.
    known: HashMap<usize, (MedialAxis, u32)>,
    table: Vec<layout::Shape>,
    spheres: Vec<[f32; 4]>,
    primitives: Vec<[i32; 3]>,
    nodes: Vec<u8>,
    /// How many bytes of each list have been uploaded.
    uploaded: [usize; 4],
}

impl Shapes {
    /// Index of a shape.
    pub fn index_of(&mut self, axis: &MedialAxis) -> u32 {
        if let Some((_, index)) = self.known.get(&axis.address()) {
            return *index;
        }
        self.add(axis)
    }

    fn add(&mut self, axis: &MedialAxis) -> u32 {
        let PackedMedialMesh { spheres, primitives } = PackedMedialMesh::pack_dynamic(axis);
        let index = self.table.len() as u32;
        let nodes = axis.bvh().bytes();
        self.table.push(layout::Shape {
            spheres: self.spheres.len() as u32,
            // The first is the bound.
            primitives: self.primitives.len() as u32 + 1,
            primitive_count: primitives.len() as u32 - 1,
            nodes: (self.nodes.len() / NODE as usize) as u32,
            node_count: (nodes.len() / NODE as usize) as u32,
        });
        self.spheres.extend(spheres);
        self.primitives.extend(primitives);
        self.nodes.extend_from_slice(nodes);
        self.known.insert(axis.address(), (axis.clone(), index));
        index
    }

    /// Drops shapes that nobody else has any more, once they are the greater part. True if others have new indices then.
    pub fn tidy(&mut self) -> bool {
        let used = self.known.values().filter(|(axis, _)| axis.is_shared()).count();
        if 2 * used >= self.known.len() {
            return false;
        }
        let mut kept: Vec<(MedialAxis, u32)> = self.known.drain().map(|(_, entry)| entry).collect();
        kept.retain(|(axis, _)| axis.is_shared());
        kept.sort_by_key(|(_, index)| *index);
        *self = Self::default();
        for (axis, _) in kept {
            self.add(&axis);
        }
        true
    }

    /// Uploads what is new.
    pub fn upload(&mut self, gpu: &GpuDevice, buffers: &mut Buffers) -> Result<(), GpuError> {
        let lists: [(Slot, &[u8]); 4] = [
            (Slot::Shapes, cast_slice(&self.table)),
            (Slot::Spheres, cast_slice(&self.spheres)),
            (Slot::Primitives, cast_slice(&self.primitives)),
            (Slot::ShapeNodes, &self.nodes),
        ];
        for ((slot, bytes), uploaded) in lists.into_iter().zip(&mut self.uploaded) {
            if bytes.len() > *uploaded {
                buffers.append(gpu, slot, bytes, *uploaded)?;
                *uploaded = bytes.len();
            }
        }
        Ok(())
    }
}
