/// Number of kinds of primitive pairs.
pub(super) const KINDS: usize = 5;

/// Kinds of primitive pairs, each with shaders of its own. Spheres are cones with two equal spheres.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    ConeCone,
    ConeSlab,
    SlabSlab,
    ConeBox,
    SlabBox,
}

impl Kind {
    /// All kinds, in the order of their constants in `chord.wgsl`.
    pub const ALL: [Kind; KINDS] = [Kind::ConeCone, Kind::ConeSlab, Kind::SlabSlab, Kind::ConeBox, Kind::SlabBox];

    /// Returns the kind of two primitives with these numbers of spheres.
    pub fn of(spheres: [usize; 2]) -> Self {
        [Kind::ConeCone, Kind::ConeSlab, Kind::SlabSlab][spheres.into_iter().filter(|count| *count == 3).count()]
    }

    /// Returns the kind of a primitive with this number of spheres, and a box.
    pub fn with_box(spheres: usize) -> Self {
        if spheres == 3 { Kind::SlabBox } else { Kind::ConeBox }
    }

    /// Returns the constants that specialise a shader.
    pub fn constants(self) -> &'static str {
        match self {
            Kind::ConeCone => {
                "const KIND: u32 = 0u; const IS_SLAB1 = false; const IS_SLAB2 = false; const IS_BOX = false;\n"
            }
            Kind::ConeSlab => {
                "const KIND: u32 = 1u; const IS_SLAB1 = false; const IS_SLAB2 = true; const IS_BOX = false;\n"
            }
            Kind::SlabSlab => {
                "const KIND: u32 = 2u; const IS_SLAB1 = true; const IS_SLAB2 = true; const IS_BOX = false;\n"
            }
            Kind::ConeBox => {
                "const KIND: u32 = 3u; const IS_SLAB1 = false; const IS_SLAB2 = false; const IS_BOX = true;\n"
            }
            Kind::SlabBox => {
                "const KIND: u32 = 4u; const IS_SLAB1 = true; const IS_SLAB2 = false; const IS_BOX = true;\n"
            }
        }
    }
}
