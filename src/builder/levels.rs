//! A chain of levels of detail in one compact file, `.medial`.
//!
//! ```text
//! "medial"  version (u16)  checksum (u32, of all that follows)  levels (postcard)      numbers little endian
//! ```
//!
//! The file has about a third of the size of `.ma` text and includes the errors. The checksum detects damage.

use std::{
    fs,
    path::{Path, PathBuf},
};

use glam::Vec3;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::{Deviation, TwoSidedError};
use crate::{
    geometry::Sphere,
    medial_axis::{MedialAxis, MedialAxisError, ma::MaFile},
    whole_file,
};

const MAGIC: [u8; 6] = *b"medial";
const VERSION: u16 = 1;
/// Number of bytes before the levels.
const HEADER: usize = 12;

/// A medial mesh and its error relative to the mesh it was built from.
#[derive(Clone, Debug)]
pub struct Level {
    /// The shape.
    pub axis: MedialAxis,
    /// Its two-sided error.
    pub error: TwoSidedError,
}

/// Medial meshes of one shape at several levels of detail.
#[derive(Clone, Debug, Default)]
pub struct MedialLevels {
    /// The levels, the finest first.
    pub levels: Vec<Level>,
}

/// Reasons why bytes are not a chain of levels.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum MedialLevelsError {
    /// The bytes do not start like a `.medial` file.
    #[error("it is not a .medial file; write one with `medial build --levels`")]
    Magic,
    /// Another version of the crate wrote the file.
    #[error("it has version {0} of the format, not {VERSION}; build it again")]
    Version(u16),
    /// The file was truncated or altered.
    #[error("it is damaged: {0}; copy or build it again")]
    Damaged(&'static str),
    /// There is no level.
    #[error("it has no levels; build it again")]
    Empty,
    /// A level does not describe a shape.
    #[error("level {level}: {error}; build it again")]
    Shape {
        /// Index of the level; the finest is 0.
        level: usize,
        /// The error of the shape.
        error: MedialAxisError,
    },
}

/// Reasons why a `.medial` file could not be read or written.
#[derive(Debug, Error)]
pub enum MedialFileError {
    /// The file system reported an error.
    #[error("{}: it cannot be read or written: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The error of the file system.
        source: std::io::Error,
    },
    /// The content is not a chain of levels.
    #[error("{}: {source}", path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// The reason.
        source: MedialLevelsError,
    },
}

/// A level in the file.
#[derive(Serialize, Deserialize)]
struct Stored {
    /// x, y, z, radius.
    spheres: Vec<[f32; 4]>,
    cones: Vec<[u32; 2]>,
    slabs: Vec<[u32; 3]>,
    /// Max and mean from the mesh to the envelope, max and mean back, and the diagonal.
    error: [f32; 5],
}

impl MedialLevels {
    /// The coarsest level with an error of at most `percent` of the diagonal in either direction, or the finest if no level is that accurate.
    /// `None` if there are no levels.
    pub fn coarsest_within(&self, percent: f32) -> Option<&Level> {
        self.levels.iter().rev().find(|level| level.error.max() <= percent).or(self.levels.first())
    }

    /// The finest level, with the others as its coarser levels. `None` if there are no levels.
    pub fn into_medial_axis(self) -> Option<MedialAxis> {
        let mut levels = self.levels.into_iter();
        let finest = levels.next()?;
        let metres = |error: TwoSidedError| error.max() / 100.0 * error.diagonal;
        Some(finest.axis.with_coarser(levels.map(|level| (level.axis, metres(level.error))).collect()))
    }

    /// The content of a `.medial` file.
    pub fn to_bytes(&self) -> Vec<u8> {
        let stored: Vec<Stored> = self
            .levels
            .iter()
            .map(|Level { axis, error }| {
                let file = MaFile::from(axis);
                let [to, from] = [error.mesh_to_envelope, error.envelope_to_mesh];
                Stored {
                    spheres: file.spheres.iter().map(|s| s.center.extend(s.radius).to_array()).collect(),
                    cones: file.edges,
                    slabs: file.faces,
                    error: [to.max, to.mean, from.max, from.mean, error.diagonal],
                }
            })
            .collect();
        // Serialization of lists of numbers in memory cannot fail.
        let body = postcard::to_allocvec(&stored).unwrap_or_default();
        let header = MAGIC.into_iter().chain(VERSION.to_le_bytes()).chain(crc32fast::hash(&body).to_le_bytes());
        header.chain(body.iter().copied()).collect()
    }

    /// The levels in the content of a `.medial` file.
    ///
    /// # Errors
    /// If the bytes are not such a file, are damaged, or do not describe shapes. Memory use is bounded by the number of bytes.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, MedialLevelsError> {
        let header = bytes.get(..HEADER).filter(|header| header.starts_with(&MAGIC)).ok_or(MedialLevelsError::Magic)?;
        let version = u16::from_le_bytes([header[6], header[7]]);
        if version != VERSION {
            return Err(MedialLevelsError::Version(version));
        }
        let body = &bytes[HEADER..];
        if header[8..] != crc32fast::hash(body).to_le_bytes() {
            return Err(MedialLevelsError::Damaged("the checksum does not match"));
        }
        let (stored, rest) = postcard::take_from_bytes::<Vec<Stored>>(body)
            .map_err(|_| MedialLevelsError::Damaged("the lists do not have the expected length"))?;
        if !rest.is_empty() {
            return Err(MedialLevelsError::Damaged("bytes follow the last level"));
        }
        if stored.is_empty() {
            return Err(MedialLevelsError::Empty);
        }
        let level = |(level, stored): (usize, Stored)| {
            let spheres = stored.spheres.iter().map(|&[x, y, z, radius]| Sphere::new(Vec3::new(x, y, z), radius));
            let (axis, _) = MedialAxis::from_lists(spheres.collect(), &stored.cones, &stored.slabs)
                .map_err(|error| MedialLevelsError::Shape { level, error })?;
            let [max, mean, back_max, back_mean, diagonal] = stored.error;
            let error = TwoSidedError {
                mesh_to_envelope: Deviation { max, mean },
                envelope_to_mesh: Deviation { max: back_max, mean: back_mean },
                diagonal,
            };
            Ok(Level { axis, error })
        };
        Ok(Self { levels: stored.into_iter().enumerate().map(level).collect::<Result<_, _>>()? })
    }

    /// Reads a `.medial` file.
    ///
    /// # Errors
    /// The path of the file and the reason.
    pub fn load(path: &Path) -> Result<Self, MedialFileError> {
        let bytes = fs::read(path).map_err(|source| MedialFileError::Io { path: path.into(), source })?;
        Self::from_bytes(&bytes).map_err(|source| MedialFileError::Content { path: path.into(), source })
    }

    /// Writes a `.medial` file atomically: the file gets its name when it is complete.
    ///
    /// # Errors
    /// The path of the file and the error of the file system.
    pub fn save(&self, path: &Path) -> Result<(), MedialFileError> {
        let written = whole_file::write(path, &self.to_bytes());
        written.map_err(|source| MedialFileError::Io { path: path.into(), source })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    fn chain() -> MedialLevels {
        let levels = [16, 8, 4].map(|segments| {
            let deviation = Deviation { max: 8.0 / segments as f32, mean: 0.1 };
            let error = TwoSidedError { mesh_to_envelope: deviation, envelope_to_mesh: deviation, diagonal: 3.0 };
            Level { axis: MedialAxis::torus(1.0, 0.2, segments).unwrap(), error }
        });
        MedialLevels { levels: levels.into() }
    }

    /// Bytes with a matching checksum.
    fn sealed(body: &[u8]) -> Vec<u8> {
        let head = MAGIC.into_iter().chain(VERSION.to_le_bytes()).chain(crc32fast::hash(body).to_le_bytes());
        head.chain(body.iter().copied()).collect()
    }

    #[test]
    fn levels_survive_a_round_trip() {
        let chain = chain();
        let again = MedialLevels::from_bytes(&chain.to_bytes()).unwrap();
        assert_eq!(again.levels.len(), 3);
        for (a, b) in chain.levels.iter().zip(&again.levels) {
            let lists = |level: &Level| (level.axis.spheres().to_vec(), level.axis.primitives().to_vec(), level.error);
            assert_eq!(lists(a), lists(b));
        }
    }

    #[test]
    fn the_coarsest_level_within_a_budget_is_found() {
        let chain = chain();
        for (percent, spheres) in [(0.1, 16), (0.5, 16), (1.0, 8), (1.9, 8), (2.0, 4), (50.0, 4)] {
            assert_eq!(chain.coarsest_within(percent).unwrap().axis.spheres().len(), spheres, "{percent} %");
        }
        assert!(MedialLevels::default().coarsest_within(1.0).is_none());
    }

    #[test]
    fn errors_name_cause_and_remedy() {
        let error = |bytes: &[u8]| MedialLevels::from_bytes(bytes).unwrap_err().to_string();
        let good = chain().to_bytes();
        let no_file = "it is not a .medial file; write one with `medial build --levels`";
        assert_eq!((error(b""), error(b"2 1 0\nv 0 0 0 1\n")), (no_file.into(), no_file.into()));
        let mut newer = good.clone();
        newer[6] = 2;
        assert_eq!(error(&newer), "it has version 2 of the format, not 1; build it again");
        let damaged = "it is damaged: the checksum does not match; copy or build it again";
        assert_eq!(error(&good[..good.len() - 1]), damaged);
        assert_eq!(
            error(&sealed(&[])),
            "it is damaged: the lists do not have the expected length; copy or build it again"
        );
        let more: Vec<u8> = good[HEADER..].iter().copied().chain([0]).collect();
        assert_eq!(error(&sealed(&more)), "it is damaged: bytes follow the last level; copy or build it again");
        assert_eq!(error(&sealed(&[0])), "it has no levels; build it again");
        let stored = |cones| Stored { spheres: vec![[0.0, 0.0, 0.0, 1.0]], cones, slabs: vec![], error: [0.0; 5] };
        let wild = postcard::to_allocvec(&vec![stored(vec![]), stored(vec![[0, 7]])]).unwrap();
        assert_eq!(error(&sealed(&wild)), "level 1: primitive 0: there is no sphere 7 among 1; build it again");
        let missing = MedialLevels::load(Path::new("no such.medial")).unwrap_err().to_string();
        assert!(missing.starts_with("no such.medial: "), "{missing}");
    }

    #[test]
    fn damage_never_passes_for_a_shape() {
        let good = chain().to_bytes();
        let mut random = Random(3);
        let mut passed = 0;
        for round in 0..2000 {
            let mut bytes = good.clone();
            let at = random.below(bytes.len());
            match round % 3 {
                0 => bytes.truncate(at),
                1 => bytes[at] ^= 1 << random.below(8),
                _ => drop(bytes.drain(at..bytes.len().min(at + 1 + random.below(9)))),
            }
            assert!(MedialLevels::from_bytes(&bytes).is_err(), "round {round}");
            // With a matching checksum, the same bytes must not cause a panic or an allocation beyond their size.
            if round % 20 == 0 {
                let body = bytes.get(HEADER..).unwrap_or_default();
                passed += usize::from(MedialLevels::from_bytes(&sealed(body)).is_ok());
            }
        }
        assert!(passed > 10, "only {passed} have passed the checksum");
    }
}
