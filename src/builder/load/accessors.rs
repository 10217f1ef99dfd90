//! Arrays of a glTF document.

use gltf::{
    Accessor,
    accessor::{DataType, Dimensions, sparse::IndexType},
    buffer::View,
};

use super::FormatError;
use crate::builder::{MAX_MESH_SIZE, MeshError};

/// Values of vertices or joints.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Values {
    /// f32, or integers with `KHR_mesh_quantization`.
    Positions,
    /// Integers: four joints of a vertex.
    Joints,
    /// f32, or normalized integers: the weights of these joints.
    Weights,
    /// f32: matrices of 4 x 4.
    InverseBinds,
    /// f32: seconds.
    Times,
    /// f32: translations and scales.
    Vectors,
    /// f32, or normalized integers: quaternions.
    Rotations,
}

impl Values {
    /// Name, dimensions, and types of the numbers.
    fn kind(self) -> (&'static str, Dimensions, &'static [DataType]) {
        use DataType::{F32, I8, I16, U8, U16};
        match self {
            Self::Positions => ("positions", Dimensions::Vec3, &[F32, I8, U8, I16, U16]),
            Self::Joints => ("joints", Dimensions::Vec4, &[U8, U16]),
            Self::Weights => ("weights", Dimensions::Vec4, &[F32, U8, U16]),
            Self::InverseBinds => ("inverse bind poses", Dimensions::Mat4, &[F32]),
            Self::Times => ("times", Dimensions::Scalar, &[F32]),
            Self::Vectors => ("vectors", Dimensions::Vec3, &[F32]),
            Self::Rotations => ("rotations", Dimensions::Vec4, &[F32, I8, U8, I16, U16]),
        }
    }
}

/// The numbers of all elements. Normalized integers stand for -1 to 1, or 0 to 1.
pub(super) fn values(
    accessor: &Accessor,
    buffers: &[Vec<u8>],
    place: &str,
    values: Values,
) -> Result<Vec<f32>, FormatError> {
    let (kind, shape) = (accessor.data_type(), accessor.dimensions());
    let (name, dimensions, kinds) = values.kind();
    if shape != dimensions || !kinds.contains(&kind) {
        return Err(FormatError::damaged(place, format!("its {name} are {kind:?} {shape:?}")));
    }
    let scaled = |value: f32, largest: f32| if accessor.normalized() { (value / largest).max(-1.0) } else { value };
    let value = |bytes: &[u8]| {
        let bits = number(bytes);
        match kind {
            DataType::I8 => scaled(f32::from(bits as i8), 127.0),
            DataType::U8 => scaled(f32::from(bits as u8), 255.0),
            DataType::I16 => scaled(f32::from(bits as i16), 32767.0),
            DataType::U16 => scaled(f32::from(bits as u16), 65535.0),
            DataType::U32 | DataType::F32 => f32::from_bits(bits),
        }
    };
    Ok(elements(accessor, buffers)?.chunks_exact(kind.size()).map(value).collect())
}

/// The indices of a primitive.
pub(super) fn indices(accessor: &Accessor, buffers: &[Vec<u8>], place: &str) -> Result<Vec<u32>, FormatError> {
    let (kind, shape) = (accessor.data_type(), accessor.dimensions());
    if shape != Dimensions::Scalar || !matches!(kind, DataType::U8 | DataType::U16 | DataType::U32) {
        return Err(FormatError::damaged(place, format!("its indices are {kind:?} {shape:?}")));
    }
    Ok(elements(accessor, buffers)?.chunks_exact(kind.size()).map(number).collect())
}

/// The little-endian number of up to 4 bytes.
fn number(bytes: &[u8]) -> u32 {
    bytes.iter().rev().fold(0, |number, &byte| number << 8 | u32::from(byte))
}

/// The bytes of all elements without gaps. A sparse accessor replaces some elements of its view; without a view the others are 0.
fn elements(accessor: &Accessor, buffers: &[Vec<u8>]) -> Result<Vec<u8>, FormatError> {
    let (count, width) = (accessor.count(), accessor.size());
    let damaged = |problem: &str| FormatError::damaged(format!("accessor {}", accessor.index()), problem);
    let outside = || damaged("its elements do not lie within its buffer");
    let mut bytes = match accessor.view() {
        Some(view) => {
            packed(view, accessor.offset(), count, width, buffers).ok_or_else(outside)?.flatten().copied().collect()
        }
        None if count > MAX_MESH_SIZE => {
            return Err(MeshError::TooLarge { what: "elements of an accessor", count }.into());
        }
        None => vec![0; count * width],
    };
    let Some(sparse) = accessor.sparse() else { return Ok(bytes) };
    let (indices, values) = (sparse.indices(), sparse.values());
    let index_width = match indices.index_type() {
        IndexType::U8 => 1,
        IndexType::U16 => 2,
        IndexType::U32 => 4,
    };
    let places = packed(indices.view(), indices.offset(), sparse.count(), index_width, buffers).ok_or_else(outside)?;
    let values = packed(values.view(), values.offset(), sparse.count(), width, buffers).ok_or_else(outside)?;
    for (place, value) in places.map(number).zip(values) {
        let element = bytes.chunks_exact_mut(width).nth(place as usize);
        element.ok_or_else(|| damaged("it replaces an element that does not exist"))?.copy_from_slice(value);
    }
    Ok(bytes)
}

/// The elements of a view, or `None` if they do not lie within its buffer.
fn packed<'b>(
    view: View,
    offset: usize,
    count: usize,
    width: usize,
    buffers: &'b [Vec<u8>],
) -> Option<impl Iterator<Item = &'b [u8]>> {
    let stride = view.stride().unwrap_or(width);
    let end = view.offset().checked_add(view.length())?;
    let bytes = buffers.get(view.buffer().index())?.get(view.offset()..end)?.get(offset..)?;
    let needed = count.checked_sub(1).map_or(Some(0), |gaps| gaps.checked_mul(stride)?.checked_add(width))?;
    let bytes = bytes.get(..needed).filter(|_| stride >= width)?;
    Some((0..count).map(move |i| &bytes[i * stride..i * stride + width]))
}
