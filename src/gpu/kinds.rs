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
    /// All kinds, in the order of their constants in `kinds.wgsl`.
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
    pub fn constants(self) -> String {
        let is_box = matches!(self, Kind::ConeBox | Kind::SlabBox);
        let [is_slab1, is_slab2] = match self {
            Kind::ConeCone | Kind::ConeBox => [false, false],
            Kind::ConeSlab => [false, true],
            Kind::SlabSlab => [true, true],
            Kind::SlabBox => [true, false],
        };
        format!(
            "const KIND: u32 = {}u;\nconst IS_SLAB1 = {is_slab1};\nconst IS_SLAB2 = {is_slab2};\nconst IS_BOX = {is_box};\n",
            self as u32
        )
    }
}
