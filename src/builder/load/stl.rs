use glam::Vec3;

use super::{FormatError, lines, position};
use crate::{builder::TriangleMesh, medial_axis::ma::without_mark};

/// Size of the header of a binary file in bytes: free text, and the number of triangles.
const HEADER: usize = 84;
/// Size of a triangle in bytes: a normal, three corners, and two unused bytes.
const TRIANGLE: usize = 50;

/// Parses both forms.
pub(super) fn parse(bytes: &[u8], warnings: &mut Vec<String>) -> Result<TriangleMesh, FormatError> {
    let positions = if is_text(bytes) { text(bytes) } else { binary(bytes, warnings) }?;
    let triangles = (0..positions.len() as u32 / 3).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    Ok(TriangleMesh::new(positions, triangles)?)
}

/// True for a text file, and for a binary file of exactly the size that its header declares.
pub(super) fn is_stl(bytes: &[u8]) -> bool {
    is_text(bytes) || count(bytes).is_some_and(|count| count > 0 && end(count) == bytes.len() as u64)
}

/// Many binary files start with `solid` like text files. The highest byte of their number of triangles, and unused bytes of their header, are 0.
fn is_text(bytes: &[u8]) -> bool {
    let word = without_mark(bytes).trim_ascii_start().split(u8::is_ascii_whitespace).next();
    word.is_some_and(|word| word.eq_ignore_ascii_case(b"solid")) && !bytes.iter().take(HEADER).any(|&byte| byte == 0)
}

/// The number of triangles that the header of a binary file declares.
fn count(bytes: &[u8]) -> Option<u32> {
    bytes.get(80..HEADER).and_then(|count| count.try_into().ok()).map(u32::from_le_bytes)
}

/// Number of bytes of a binary file.
fn end(count: u32) -> u64 {
    HEADER as u64 + TRIANGLE as u64 * u64::from(count)
}

/// Some programs write the number of triangles last and may leave it at 0: then the size of the file determines it. Other programs add bytes at the end.
fn binary(bytes: &[u8], warnings: &mut Vec<String>) -> Result<Vec<Vec3>, FormatError> {
    let cut = |problem: String| FormatError::damaged("the end of the file", problem);
    let short = || cut(format!("{} bytes are less than an STL header of {HEADER}", bytes.len()));
    let mut count = count(bytes).ok_or_else(short)?;
    let present = (bytes.len() - HEADER) / TRIANGLE;
    if count == 0 && present > 0 {
        warnings.push(format!("the header declares 0 triangles, the {present} in the file are read"));
        count = u32::try_from(present).unwrap_or(u32::MAX);
    }
    let end = end(count);
    let body = usize::try_from(end).ok().and_then(|end| bytes.get(HEADER..end));
    let body = body.ok_or_else(|| cut(format!("the header declares {end} bytes, there are {}", bytes.len())))?;
    let after = bytes.len() - HEADER - body.len();
    if after > 0 {
        warnings.push(format!("{after} bytes after the last triangle are left out"));
    }
    let corners = body.as_chunks::<TRIANGLE>().0.iter().flat_map(|triangle| triangle[12..48].as_chunks::<12>().0);
    Ok(corners
        .map(|corner| bytemuck::pod_read_unaligned::<[[u8; 4]; 3]>(corner).map(f32::from_le_bytes).into())
        .collect())
}

/// Parses the `vertex` lines between `outer loop` and `endloop`, in upper or lower case. An `endsolid` must follow the last loop.
fn text(bytes: &[u8]) -> Result<Vec<Vec3>, FormatError> {
    let mut positions = Vec::new();
    let mut open = None;
    let mut ended = false;
    for (line, content) in (1..).zip(lines(bytes)) {
        let content = String::from_utf8_lossy(content).to_ascii_lowercase();
        let mut fields = content.split_whitespace();
        let damaged = |problem: String| FormatError::damaged(format!("line {line}"), problem);
        match (fields.next(), open) {
            (Some("outer"), None) => (open, ended) = (Some(positions.len()), false),
            (Some("vertex"), Some(_)) => {
                positions.push(position(&mut fields).map_err(damaged)?);
            }
            (Some("endloop"), Some(start)) if positions.len() == start + 3 => open = None,
            (Some("endloop"), Some(start)) => {
                return Err(damaged(format!("a facet has {} corners, not 3", positions.len() - start)));
            }
            (Some("endsolid"), None) => ended = true,
            (None | Some("solid" | "facet" | "endfacet"), None) => {}
            (None, Some(_)) => {}
            (Some(word), _) => return Err(damaged(format!("unexpected `{word}`"))),
        }
    }
    if !ended {
        return Err(FormatError::damaged("the end of the file", "`endsolid` is missing"));
    }
    Ok(positions)
}
