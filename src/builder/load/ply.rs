use glam::Vec3;
use ply_rs_bw::{
    parser::{ParseError, Parser, Reader},
    ply::{ElementDef, Encoding, Property, PropertyAccess, PropertyAccessResult, PropertyType},
};

use super::{FormatError, lines, polygon::triangulate};
use crate::builder::{TriangleMesh, mesh::strip};

/// An element of any kind, with the properties of vertices and of faces.
struct Element {
    position: [Option<f64>; 3],
    corners: Vec<i64>,
}

impl PropertyAccess for Element {
    fn new() -> Self {
        Self { position: [None; 3], corners: Vec::new() }
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        match name {
            "x" => self.position[0] = scalar(&property),
            "y" => self.position[1] = scalar(&property),
            "z" => self.position[2] = scalar(&property),
            name if is_corners(name) => match indices(property) {
                Some(corners) => self.corners = corners,
                None => return PropertyAccessResult::UnsupportedType,
            },
            _ => return PropertyAccessResult::Ignored,
        }
        PropertyAccessResult::Set
    }
}

fn is_corners(name: &str) -> bool {
    name == "vertex_indices" || name == "vertex_index"
}

fn scalar(property: &Property) -> Option<f64> {
    match *property {
        Property::Char(x) => Some(x.into()),
        Property::UChar(x) => Some(x.into()),
        Property::Short(x) => Some(x.into()),
        Property::UShort(x) => Some(x.into()),
        Property::Int(x) => Some(x.into()),
        Property::UInt(x) => Some(x.into()),
        Property::Float(x) => Some(x.into()),
        Property::Double(x) => Some(x),
        _ => None,
    }
}

fn indices(property: Property) -> Option<Vec<i64>> {
    fn widen<T: Into<i64>>(list: Vec<T>) -> Option<Vec<i64>> {
        Some(list.into_iter().map(Into::into).collect())
    }
    match property {
        Property::ListChar(list) => widen(list),
        Property::ListUChar(list) => widen(list),
        Property::ListShort(list) => widen(list),
        Property::ListUShort(list) => widen(list),
        Property::ListInt(list) => widen(list),
        Property::ListUInt(list) => widen(list),
        _ => None,
    }
}

/// Parses the elements `vertex` (x, y, z), `face` and `tristrips` (`vertex_indices` or `vertex_index`) in all three encodings.
pub(super) fn parse(bytes: &[u8]) -> Result<TriangleMesh, FormatError> {
    let content = Content::read(bytes)?;
    let triangles = content.triangles()?;
    Ok(TriangleMesh::new(content.positions, triangles)?)
}

/// The used elements of a file.
#[derive(Default)]
struct Content {
    positions: Vec<Vec3>,
    faces: Vec<Element>,
    strips: Vec<Element>,
}

impl Content {
    fn read(bytes: &[u8]) -> Result<Self, FormatError> {
        let parser = Parser::<Element>::new();
        let (head, body) = bytes.split_at(end_of_header(bytes));
        // Comments may be in any encoding. The parsed properties are ASCII.
        let head = lines(head).map(String::from_utf8_lossy).collect::<Vec<_>>().join("\n");
        let header = parser.read_header(&mut Reader::new(head.as_bytes())).map_err(damaged)?;
        let mut reader = Reader::new(body);
        let mut lines = (head.lines().count() + 1..).zip(lines(body));
        let mut content = Self::default();
        for (name, definition) in &header.elements {
            check_size(name, definition, bytes.len())?;
            let elements = match header.encoding {
                Encoding::Ascii => rows(name, definition, &mut lines)?,
                _ => parser.read_payload_for_element(&mut reader, definition, &header).map_err(damaged)?,
            };
            match name.as_str() {
                "vertex" => content.add_vertices(&elements)?,
                "face" => content.faces = elements,
                "tristrips" => content.strips = elements,
                _ => {}
            }
        }
        Ok(content)
    }

    fn add_vertices(&mut self, vertices: &[Element]) -> Result<(), FormatError> {
        for (number, vertex) in vertices.iter().enumerate() {
            let [Some(x), Some(y), Some(z)] = vertex.position else {
                return Err(FormatError::damaged(format!("vertex {number}"), "x, y or z is missing"));
            };
            self.positions.push(Vec3::new(x as f32, y as f32, z as f32));
        }
        Ok(())
    }

    /// Returns the triangles of all faces, then those of all strips.
    fn triangles(&self) -> Result<Vec<[u32; 3]>, FormatError> {
        let mut triangles = Vec::with_capacity(self.faces.len());
        for (number, face) in self.faces.iter().enumerate() {
            let corners = self.vertices("face", number, &face.corners)?;
            if corners.len() < 3 {
                let problem = format!("it has {} corners in `vertex_indices`, not 3 or more", corners.len());
                return Err(FormatError::damaged(format!("face {number}"), problem));
            }
            triangulate(&corners, &self.positions, &mut triangles);
        }
        for (number, strips) in self.strips.iter().enumerate() {
            // A negative index ends a strip.
            for corners in strips.corners.split(|&index| index < 0) {
                triangles.extend(strip(&self.vertices("strip", number, corners)?));
            }
        }
        Ok(triangles)
    }

    /// Returns the corners of a face or strip as indices of vertices, or an error if a vertex does not exist.
    fn vertices(&self, what: &str, number: usize, corners: &[i64]) -> Result<Vec<u32>, FormatError> {
        let count = self.positions.len();
        let in_range = |&index: &i64| u32::try_from(index).ok().filter(|&i| (i as usize) < count).ok_or(index);
        corners.iter().map(in_range).collect::<Result<_, _>>().map_err(|index| {
            let problem = format!("there is no vertex {index} among {count}");
            FormatError::damaged(format!("{what} {number}"), problem)
        })
    }
}

/// Returns an error for more elements than a file of this many bytes can contain.
fn check_size(name: &str, definition: &ElementDef, bytes: usize) -> Result<(), FormatError> {
    let count = definition.count;
    let problem = if definition.properties.is_empty() && count > 0 {
        // Elements without a property would take time and memory, but no bytes of the file.
        "it has no property".into()
    } else if count > bytes {
        format!("the file is too short for {count}")
    } else {
        return Ok(());
    };
    Err(FormatError::damaged(format!("element `{name}`"), problem))
}

/// End of the last line of the header, or the number of bytes without such a line.
fn end_of_header(bytes: &[u8]) -> usize {
    const LAST: &[u8] = b"end_header";
    let is_end = |byte: &u8| matches!(byte, b'\n' | b'\r');
    let is_last = |bytes: &[u8]| is_end(&bytes[0]) && &bytes[1..] == LAST;
    let end = bytes.windows(1 + LAST.len()).position(is_last).and_then(|start| {
        let after = start + 1 + LAST.len();
        let end = after + bytes[after..].iter().position(is_end)?;
        // With lines that end in CR alone, an LF is the first byte of the body.
        let is_pair = bytes[end..].starts_with(b"\r\n") && bytes[..end].contains(&b'\n');
        Some(end + 1 + usize::from(is_pair))
    });
    end.unwrap_or(bytes.len())
}

/// The elements of a text file, one per line. Unused properties are not parsed, because the crate would refuse values that occur there: words, and
/// numbers such as `.5`.
fn rows<'b>(
    name: &str,
    definition: &ElementDef,
    lines: &mut impl Iterator<Item = (usize, &'b [u8])>,
) -> Result<Vec<Element>, FormatError> {
    let mut lines = lines.filter(|(_, content)| !content.trim_ascii().is_empty());
    let row = |number| {
        let missing = || FormatError::damaged("the end of the file", format!("{name} {number} is missing"));
        let (line, content) = lines.next().ok_or_else(missing)?;
        row(definition, &String::from_utf8_lossy(content))
            .map_err(|problem| FormatError::damaged(format!("line {line}"), problem))
    };
    (0..definition.count).map(row).collect()
}

fn row(definition: &ElementDef, content: &str) -> Result<Element, String> {
    let mut element = Element::new();
    let mut fields = content.split_whitespace();
    for (name, property) in &definition.properties {
        let mut field = || fields.next().ok_or_else(|| format!("it ends before `{name}` does"));
        let count = match property.data_type {
            PropertyType::Scalar(_) => {
                let field = field()?;
                if let Some(axis) = ["x", "y", "z"].iter().position(|axis| axis == name) {
                    let value = field.parse().map_err(|_| format!("`{field}` is not a number"))?;
                    element.position[axis] = Some(value);
                }
                continue;
            }
            PropertyType::List(..) => field()?,
        };
        let count: usize = count.parse().map_err(|_| format!("`{count}` is not a number of items"))?;
        for _ in 0..count {
            let field = field()?;
            if is_corners(name) {
                element.corners.push(field.parse().map_err(|_| format!("`{field}` is not the index of a vertex"))?);
            }
        }
    }
    Ok(element)
}

/// The message of the crate, which quotes lines of the file, without its line breaks.
fn damaged(error: ParseError) -> FormatError {
    let place = error.line().map_or("the header".into(), |line| format!("line {line}"));
    let message = error.to_string();
    FormatError::damaged(place, message.split_whitespace().collect::<Vec<_>>().join(" "))
}
