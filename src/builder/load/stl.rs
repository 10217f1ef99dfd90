use glam::Vec3;

use super::{FormatError, position};
use crate::builder::TriangleMesh;

/// Size of the header of a binary file in bytes: free text, and the number of triangles.
const HEADER: usize = 84;
/// Size of a triangle in bytes: a normal, three corners, and two unused bytes.
const TRIANGLE: usize = 50;

/// Parses both forms. Many binary files start with `solid` like text files, so the size is checked first.
pub(super) fn parse(bytes: &[u8]) -> Result<TriangleMesh, FormatError> {
    let count = bytes.get(80..HEADER).and_then(|count| count.try_into().ok()).map(u32::from_le_bytes);
    let promised = count.map(|count| HEADER as u64 + TRIANGLE as u64 * u64::from(count));
    let is_text = bytes.trim_ascii_start().get(..5).is_some_and(|word| word.eq_ignore_ascii_case(b"solid"));
    let positions =
        if promised == Some(bytes.len() as u64) || !is_text { binary(bytes, promised) } else { text(bytes) }?;
    let triangles = (0..positions.len() as u32 / 3).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    Ok(TriangleMesh::new(positions, triangles)?)
}

fn binary(bytes: &[u8], promised: Option<u64>) -> Result<Vec<Vec3>, FormatError> {
    let cut = |problem: String| FormatError::damaged("the end of the file", problem);
    let end = promised.ok_or_else(|| cut(format!("{} bytes are less than an STL header of {HEADER}", bytes.len())))?;
    let body = usize::try_from(end).ok().and_then(|end| bytes.get(HEADER..end));
    let body = body.ok_or_else(|| cut(format!("the header declares {end} bytes, there are {}", bytes.len())))?;
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
    for (line, content) in (1..).zip(bytes.split(|&byte| byte == b'\n')) {
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
