//! The `.ma` text format, as written by Q-MAT and the Blender MAT add-on.
//!
//! ```text
//! 3 1 1                     spheres, edges, faces
//! v 0.5 -0.25 1 0.125       a sphere: centre x y z and radius
//! e 0 1                     an edge (a medial cone): two spheres, counted from 0
//! f 0 1 2                   a face (a medial slab): three spheres; its edges need not be listed
//! ```
//!
//! Blank lines and lines that start with `#` are allowed everywhere. Records may come in any order, but their numbers must match
//! the first line.

use std::{fmt::Write, io, path::Path};

use glam::Vec3;
use thiserror::Error;

use super::{CleanupReport, MedialAxis, MedialAxisError};
use crate::{
    geometry::{Primitive, Sphere},
    whole_file,
};

/// The content of a `.ma` file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MaFile {
    /// Medial spheres, in the units of the file.
    pub spheres: Vec<Sphere>,
    /// Pairs of spheres.
    pub edges: Vec<[u32; 2]>,
    /// Triples of spheres.
    pub faces: Vec<[u32; 3]>,
}

/// Reason and line of a syntax error in a `.ma` file.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("line {line}: {kind}")]
pub struct MaError {
    /// The line, counted from 1. For missing records, the line of the header.
    pub line: usize,
    /// Kind of error.
    pub kind: MaErrorKind,
}

/// Kind of error in a line.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum MaErrorKind {
    /// The bytes are not UTF-8 text.
    #[error("not UTF-8 text")]
    NotUtf8,
    /// There are only blank lines and comments.
    #[error("no header: expected `spheres edges faces`")]
    NoHeader,
    /// The header declares zero spheres.
    #[error("an empty mesh: the header declares no spheres")]
    Empty,
    /// The line ends before the value.
    #[error("{0} is missing")]
    Missing(&'static str),
    /// A count or index is not a whole number from 0 to 4,294,967,295.
    #[error("{what} is `{token}`, not a whole number from 0 to {}", u32::MAX)]
    NotCount {
        /// Name of the value.
        what: &'static str,
        /// Text found in its place.
        token: String,
    },
    /// A coordinate or radius is not a number, is NaN, or is beyond the range of f32.
    #[error("{what} is `{token}`, not a finite number")]
    NotFinite {
        /// Name of the value.
        what: &'static str,
        /// Text found in its place.
        token: String,
    },
    /// A radius is negative.
    #[error("the radius is `{0}`, which is negative")]
    NegativeRadius(String),
    /// An index is not less than the number of spheres.
    #[error("there is no sphere {index}: the header declares {spheres}")]
    IndexOutOfRange {
        /// The index.
        index: u32,
        /// Number of spheres declared by the header.
        spheres: u32,
    },
    /// An edge or face refers to the same sphere twice.
    #[error("sphere {0} is repeated")]
    RepeatedIndex(u32),
    /// A line continues after its last value.
    #[error("trailing `{0}`")]
    Trailing(String),
    /// A line is not a record.
    #[error("expected a record `v`, `e` or `f`, found `{0}`")]
    UnknownRecord(String),
    /// There are more records than the header declares; the line is that of the first excess record.
    #[error("one `{record}` record more than the {promised} that the header declares")]
    TooMany {
        /// Letter of the record.
        record: char,
        /// Number declared by the header.
        promised: u32,
    },
    /// There are fewer records than the header declares.
    #[error("the header declares {promised} `{record}` records, the file has {found}")]
    TooFew {
        /// Letter of the record.
        record: char,
        /// Number declared by the header.
        promised: u32,
        /// Number in the file.
        found: usize,
    },
}

use MaErrorKind as Kind;

impl MaFile {
    /// Edges and faces as primitives.
    pub fn primitives(&self) -> Vec<Primitive> {
        let cones = self.edges.iter().map(|&e| Primitive::Cone(e));
        cones.chain(self.faces.iter().map(|&f| Primitive::Slab(f))).collect()
    }

    /// The cleaned-up shape, and a report of the clean-up.
    ///
    /// # Errors
    /// The errors of [`MedialAxis::new`]. After [`parse`], only numbers beyond [`MAX_EXTENT`](super::MAX_EXTENT) and more spheres than
    /// [`MAX_SPHERES`](super::MAX_SPHERES) can cause one.
    pub fn into_medial_axis(self) -> Result<(MedialAxis, CleanupReport), MedialAxisError> {
        let primitives = self.primitives();
        MedialAxis::new(self.spheres, primitives)
    }
}

impl From<&MedialAxis> for MaFile {
    /// Keeps all primitives. Sphere primitives are not listed, because a sphere without an edge or face becomes a primitive on reading.
    fn from(axis: &MedialAxis) -> Self {
        let mut file = Self { spheres: axis.spheres().to_vec(), ..Self::default() };
        for primitive in axis.primitives() {
            match *primitive {
                Primitive::Sphere(_) => {}
                Primitive::Cone(edge) => file.edges.push(edge),
                Primitive::Slab(face) => file.faces.push(face),
            }
        }
        file
    }
}

/// Parses the text of a `.ma` file.
///
/// # Errors
/// The first line that violates the format, with the reason. Memory use is bounded by the size of `bytes`, independent of the
/// header.
pub fn parse(bytes: &[u8]) -> Result<MaFile, MaError> {
    let bytes = without_mark(bytes);
    let text = std::str::from_utf8(bytes).map_err(|error| {
        let line = 1 + bytes[..error.valid_up_to()].iter().filter(|&&byte| byte == b'\n').count();
        MaError { line, kind: Kind::NotUtf8 }
    })?;
    let mut file = MaFile::default();
    let mut header: Option<(usize, [u32; 3])> = None;
    for (line, content) in (1..).zip(text.lines()) {
        let content = content.trim();
        if content.is_empty() || content.starts_with('#') {
            continue;
        }
        let mut fields = Fields(content.split_whitespace());
        let read = match header {
            None => fields.header().map(|counts| header = Some((line, counts))),
            Some((_, counts)) => fields.record(counts, &mut file),
        };
        read.and_then(|()| fields.end()).map_err(|kind| MaError { line, kind })?;
    }
    let (line, counts) = header.ok_or(MaError { line: 1, kind: Kind::NoHeader })?;
    let found = [file.spheres.len(), file.edges.len(), file.faces.len()];
    for ((record, promised), found) in ['v', 'e', 'f'].into_iter().zip(counts).zip(found) {
        if found < promised as usize {
            return Err(MaError { line, kind: Kind::TooFew { record, promised, found } });
        }
    }
    Ok(file)
}

/// Formats the text of a `.ma` file. [`parse`] reads the same numbers from it, bit for bit.
pub fn write(file: &MaFile) -> String {
    let mut text = format!("{} {} {}\n", file.spheres.len(), file.edges.len(), file.faces.len());
    // Writing to a string cannot fail. `{:?}` is the shortest text that reads back as the same f32.
    for Sphere { center: Vec3 { x, y, z }, radius } in &file.spheres {
        let _ = writeln!(text, "v {x:?} {y:?} {z:?} {radius:?}");
    }
    for [i, j] in &file.edges {
        let _ = writeln!(text, "e {i} {j}");
    }
    for [i, j, k] in &file.faces {
        let _ = writeln!(text, "f {i} {j} {k}");
    }
    text
}

/// Writes a `.ma` file atomically: the file gets its name when it is complete.
///
/// # Errors
/// The error of the file system.
pub fn save(path: &Path, file: &MaFile) -> io::Result<()> {
    whole_file::write(path, write(file).as_bytes())
}

/// Strips the UTF-8 byte order mark, which some programs write at the start of a text.
pub(crate) fn without_mark(bytes: &[u8]) -> &[u8] {
    bytes.strip_prefix("\u{feff}".as_bytes()).unwrap_or(bytes)
}

/// Maximum number of characters of a field in a message.
const LONGEST_QUOTE: usize = 60;

/// The first characters of a field, for a message. A file of another format may be one long line.
fn quoted(token: &str) -> String {
    token.chars().take(LONGEST_QUOTE).collect()
}

/// The remaining fields of a line.
struct Fields<'a>(std::str::SplitWhitespace<'a>);

impl<'a> Fields<'a> {
    fn header(&mut self) -> Result<[u32; 3], Kind> {
        let counts = [
            self.count("the number of spheres")?,
            self.count("the number of edges")?,
            self.count("the number of faces")?,
        ];
        if counts[0] == 0 { Err(Kind::Empty) } else { Ok(counts) }
    }

    fn record(&mut self, [spheres, edges, faces]: [u32; 3], file: &mut MaFile) -> Result<(), Kind> {
        let room = |record: char, found: usize, promised: u32| {
            if found < promised as usize { Ok(()) } else { Err(Kind::TooMany { record, promised }) }
        };
        match self.token("the record")? {
            "v" => {
                room('v', file.spheres.len(), spheres)?;
                file.spheres.push(self.sphere()?);
            }
            "e" => {
                room('e', file.edges.len(), edges)?;
                file.edges.push(self.indices(spheres)?);
            }
            "f" => {
                room('f', file.faces.len(), faces)?;
                file.faces.push(self.indices(spheres)?);
            }
            other => return Err(Kind::UnknownRecord(quoted(other))),
        }
        Ok(())
    }

    fn sphere(&mut self) -> Result<Sphere, Kind> {
        let center = Vec3::new(self.number("x")?, self.number("y")?, self.number("z")?);
        let radius = self.number("the radius")?;
        if radius < 0.0 { Err(Kind::NegativeRadius(radius.to_string())) } else { Ok(Sphere::new(center, radius)) }
    }

    fn indices<const N: usize>(&mut self, spheres: u32) -> Result<[u32; N], Kind> {
        let mut indices = [0; N];
        for at in 0..N {
            let index = self.count("an index")?;
            if index >= spheres {
                return Err(Kind::IndexOutOfRange { index, spheres });
            }
            if indices[..at].contains(&index) {
                return Err(Kind::RepeatedIndex(index));
            }
            indices[at] = index;
        }
        Ok(indices)
    }

    fn count(&mut self, what: &'static str) -> Result<u32, Kind> {
        let token = self.token(what)?;
        token.parse().map_err(|_| Kind::NotCount { what, token: quoted(token) })
    }

    fn number(&mut self, what: &'static str) -> Result<f32, Kind> {
        let token = self.token(what)?;
        let number = token.parse::<f32>().ok().filter(|number| number.is_finite());
        number.ok_or_else(|| Kind::NotFinite { what, token: quoted(token) })
    }

    fn token(&mut self, what: &'static str) -> Result<&'a str, Kind> {
        self.0.next().ok_or(Kind::Missing(what))
    }

    fn end(&mut self) -> Result<(), Kind> {
        self.0.next().map_or(Ok(()), |token| Err(Kind::Trailing(quoted(token))))
    }
}

#[cfg(test)]
mod tests;
