use glam::Vec3;

use super::{FormatError, lines, polygon::triangulate, position};
use crate::builder::TriangleMesh;

/// Parses `v` and `f` records. Indices count from 1, or backwards from the latest vertex if negative.
pub(super) fn parse(bytes: &[u8], warnings: &mut Vec<String>) -> Result<TriangleMesh, FormatError> {
    let mut positions: Vec<Vec3> = Vec::new();
    // The corners of all faces in one list, and for each face its line and the end of its corners.
    let (mut corners, mut faces) = (Vec::new(), Vec::new());
    let (mut joined, mut left_out) = (String::new(), 0);
    let mut lines = (1..).zip(lines(bytes)).peekable();
    while let Some((line, content)) = lines.next() {
        // Names may be in any encoding. The parsed records are ASCII.
        joined.push_str(String::from_utf8_lossy(content).trim_end());
        if joined.ends_with('\\') && !joined.trim_start().starts_with('#') {
            joined.pop();
            joined.push(' ');
            if lines.peek().is_some() {
                continue;
            }
        }
        let mut fields = joined.split_whitespace().take_while(|field| !field.starts_with('#'));
        let damaged = |problem: String| FormatError::damaged(format!("line {line}"), problem);
        match fields.next() {
            Some("v") => {
                positions.push(position(&mut fields).map_err(damaged)?);
            }
            Some("f") => {
                let before = corners.len();
                for field in fields {
                    let number = field.split('/').next().unwrap_or_default();
                    let index = index(number, positions.len());
                    corners.push(index.ok_or_else(|| damaged(format!("`{field}` is not the index of a vertex")))?);
                }
                if corners.len() - before < 3 {
                    return Err(damaged("a face has fewer than 3 corners".into()));
                }
                faces.push((line, corners.len()));
            }
            Some("l" | "p") => left_out += 1,
            Some("surf") => {
                let remedy = "convert it to triangles and export it again";
                return Err(FormatError::new(format!("line {line}"), "it is a free-form surface", remedy));
            }
            _ => {}
        }
        joined.clear();
    }
    if left_out > 0 {
        warnings.push(format!("{left_out} records of lines or points are left out"));
    }
    let mut triangles = Vec::with_capacity(faces.len());
    let mut start = 0;
    for (line, end) in faces {
        let face = &corners[start..end];
        // A face may precede its vertices.
        if let Some(index) = face.iter().find(|&&index| index as usize >= positions.len()) {
            let problem = format!("there is no vertex {}: the file has {}", u64::from(*index) + 1, positions.len());
            return Err(FormatError::damaged(format!("line {line}"), problem));
        }
        triangulate(face, &positions, &mut triangles);
        start = end;
    }
    Ok(TriangleMesh::new(positions, triangles)?)
}

/// The zero-based index for a face's number, if there are `count` vertices so far.
fn index(number: &str, count: usize) -> Option<u32> {
    let number: i64 = number.parse().ok()?;
    let index = if number > 0 { number - 1 } else { i64::try_from(count).ok()?.checked_add(number)? };
    if number == 0 { None } else { u32::try_from(index).ok() }
}
