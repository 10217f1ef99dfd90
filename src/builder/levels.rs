//! A chain of levels of detail in one compact file, `.medial`.
//!
//! ```text
//! "medial"  version (u16)  checksum (u32, of all that follows)  levels  rest (postcard)      numbers little endian
//! ```
//!
//! The file has about a third of the size of `.ma` text and includes the errors. The checksum detects damage. The version determines the rest, and the
//! oldest one that can hold the content is written: 1 nothing, 2 a skin, 3 a skin, mass properties and limits of the sides, each optional.

use std::{
    fs,
    path::{Path, PathBuf},
    sync::Arc,
};

use bevy::prelude::{Reflect, ReflectDefault};
use glam::{Affine3A, Mat3, Vec3};
use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::{Deviation, TwoSidedError};
use crate::{
    geometry::Sphere,
    medial_axis::{
        JointWeights, MAX_INFLUENCES, MassProperties, MedialAxis, MedialAxisError, Skin, SkinError, SkinJoint,
        ma::MaFile,
    },
    whole_file,
};

const MAGIC: [u8; 6] = *b"medial";
/// Version of files without a skin.
const RIGID: u16 = 1;
/// Version of files with a skin.
const SKINNED: u16 = 2;
/// Version of files with properties of the solid.
const SOLID: u16 = 3;
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
    /// Mass properties of the triangle mesh at unit density, which all levels take over. `None`: those of the finest level.
    pub mass: Option<MassProperties>,
    /// The limits that all levels keep on each side of the surface.
    pub sides: SideLimits,
}

/// Limits of a shape on either side of the surface of its triangle mesh, in percent of the mesh's diagonal. `None`: no limit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, Reflect)]
#[reflect(Default, Clone, PartialEq)]
pub struct SideLimits {
    /// Largest protrusion of the shape from the mesh.
    pub inside: Option<f32>,
    /// Largest distance of a point of the mesh from the shape, outside of the shape.
    pub enclose: Option<f32>,
}

/// Reasons why bytes are not a chain of levels.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum MedialLevelsError {
    /// The bytes do not start like a `.medial` file.
    #[error("it is not a .medial file; write one with `medial build --levels`")]
    Magic,
    /// Another version of the crate wrote the file.
    #[error("it has version {0} of the format, not {RIGID} to {SOLID}; build it again")]
    Version(u16),
    /// The file was truncated or altered.
    #[error("it is damaged: {0}; copy or build it again")]
    Damaged(&'static str),
    /// There is no level.
    #[error("it has no levels; build it again")]
    Empty,
    /// The joints, or the weights of a level, are not a skin.
    #[error("level {level}: {error}; build it again")]
    Skin {
        /// Index of the level; the finest is 0.
        level: usize,
        /// The error of the skin. A point is a sphere.
        error: SkinError,
    },
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

/// The rest of a file of version 3, after the levels.
#[derive(Default, Serialize, Deserialize)]
struct StoredSolid {
    skin: Option<StoredSkin>,
    /// Volume, centre of mass, and the inertia tensor as xx, yy, zz, xy, xz, yz.
    mass: Option<[f32; 10]>,
    sides: SideLimits,
}

fn stored_mass(mass: MassProperties) -> [f32; 10] {
    let ([x, y, z], i) = (mass.center_of_mass.to_array(), mass.inertia);
    [mass.volume, x, y, z, i.x_axis.x, i.y_axis.y, i.z_axis.z, i.x_axis.y, i.x_axis.z, i.y_axis.z]
}

fn mass_of([volume, x, y, z, xx, yy, zz, xy, xz, yz]: [f32; 10]) -> Result<MassProperties, MedialLevelsError> {
    let inertia = Mat3::from_cols_array(&[xx, xy, xz, xy, yy, yz, xz, yz, zz]);
    let center_of_mass = Vec3::new(x, y, z);
    let is_positive = [volume, xx, yy, zz].into_iter().all(|value| value > 0.0 && value.is_finite());
    if is_positive && inertia.is_finite() && center_of_mass.is_finite() {
        Ok(MassProperties { volume, center_of_mass, inertia })
    } else {
        Err(MedialLevelsError::Damaged("its mass properties are not those of a solid"))
    }
}

/// The skin in the file.
#[derive(Serialize, Deserialize)]
struct StoredSkin {
    /// Names and inverse bind poses, by columns.
    joints: Vec<(String, [f32; 12])>,
    /// For each level and sphere, up to four joints and their weights.
    weights: Vec<Vec<Vec<(u16, f32)>>>,
}

impl StoredSkin {
    /// `None` unless all levels have a skin with the same joints.
    fn of(levels: &[Level]) -> Option<Self> {
        let joints = levels.first()?.axis.skin()?.joints();
        let used = |weights: &JointWeights| weights.iter().copied().filter(|(_, weight)| *weight > 0.0).collect();
        let weights = levels.iter().map(|level| {
            let skin = level.axis.skin().filter(|skin| skin.joints() == joints)?;
            Some(skin.weights().iter().map(used).collect())
        });
        Some(Self {
            weights: weights.collect::<Option<_>>()?,
            joints: joints.iter().map(|joint| (joint.name.clone(), joint.inverse_bind.to_cols_array())).collect(),
        })
    }

    /// Gives each level its skin.
    fn bind(self, levels: &mut [Level]) -> Result<(), MedialLevelsError> {
        if self.weights.len() != levels.len() {
            return Err(MedialLevelsError::Damaged("it has no weights for some level"));
        }
        let joint = |(name, columns): (String, [f32; 12])| SkinJoint {
            name,
            inverse_bind: Affine3A::from_cols_array(&columns),
        };
        let joints: Arc<[SkinJoint]> = self.joints.into_iter().map(joint).collect();
        for (number, (level, weights)) in levels.iter_mut().zip(self.weights).enumerate() {
            if weights.iter().any(|weights| weights.len() > MAX_INFLUENCES) {
                return Err(MedialLevelsError::Damaged("a sphere has more than four weights"));
            }
            let padded =
                |weights: &Vec<(u16, f32)>| std::array::from_fn(|at| weights.get(at).copied().unwrap_or_default());
            let weights: Vec<JointWeights> = weights.iter().map(padded).collect();
            let skin = Skin::new(joints.clone(), &weights);
            let bound = skin.and_then(|skin| level.axis.clone().with_skin(skin));
            level.axis = bound.map_err(|error| MedialLevelsError::Skin { level: number, error })?;
        }
        Ok(())
    }
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
        let Level { axis: finest, .. } = levels.next()?;
        let finest = self.mass.map_or(finest.clone(), |mass| finest.with_mass(mass));
        let metres = |error: TwoSidedError| error.max() / 100.0 * error.diagonal;
        Some(finest.with_coarser(levels.map(|level| (level.axis, metres(level.error))).collect()))
    }

    /// The content of a `.medial` file. It has a skin if all levels have one, with the same joints.
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
        let mut body = postcard::to_allocvec(&stored).unwrap_or_default();
        let skin = StoredSkin::of(&self.levels);
        let (version, rest) = match skin {
            skin if self.mass.is_some() || self.sides != SideLimits::default() => {
                let rest = StoredSolid { skin, mass: self.mass.map(stored_mass), sides: self.sides };
                (SOLID, postcard::to_allocvec(&rest))
            }
            Some(skin) => (SKINNED, postcard::to_allocvec(&skin)),
            None => (RIGID, Ok(vec![])),
        };
        body.extend(rest.unwrap_or_default());
        let header = MAGIC.into_iter().chain(version.to_le_bytes()).chain(crc32fast::hash(&body).to_le_bytes());
        header.chain(body.iter().copied()).collect()
    }

    /// The levels in the content of a `.medial` file.
    ///
    /// # Errors
    /// If the bytes are not such a file, are damaged, or do not describe shapes. Memory use is bounded by the number of bytes.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, MedialLevelsError> {
        let header = bytes.get(..HEADER).filter(|header| header.starts_with(&MAGIC)).ok_or(MedialLevelsError::Magic)?;
        let version = u16::from_le_bytes([header[6], header[7]]);
        if !(RIGID..=SOLID).contains(&version) {
            return Err(MedialLevelsError::Version(version));
        }
        let body = &bytes[HEADER..];
        if header[8..] != crc32fast::hash(body).to_le_bytes() {
            return Err(MedialLevelsError::Damaged("the checksum does not match"));
        }
        let cut = |_| MedialLevelsError::Damaged("the lists do not have the expected length");
        let (stored, rest) = postcard::take_from_bytes::<Vec<Stored>>(body).map_err(cut)?;
        let (StoredSolid { skin, mass, sides }, rest) = match version {
            SOLID => postcard::take_from_bytes(rest).map_err(cut)?,
            SKINNED => {
                let (skin, rest) = postcard::take_from_bytes(rest).map_err(cut)?;
                (StoredSolid { skin: Some(skin), ..StoredSolid::default() }, rest)
            }
            _ => (StoredSolid::default(), rest),
        };
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
        let mut levels: Vec<Level> = stored.into_iter().enumerate().map(level).collect::<Result<_, _>>()?;
        if let Some(skin) = skin {
            skin.bind(&mut levels)?;
        }
        Ok(Self { levels, mass: mass.map(mass_of).transpose()?, sides })
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
mod tests;
