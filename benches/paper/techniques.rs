//! Every technique of the paper, where it is, what differs and why, and the test that proves it.

/// A row of the table, as Markdown.
pub struct Technique {
    pub section: &'static str,
    pub name: &'static str,
    pub code: &'static str,
    pub difference: &'static str,
    pub test: &'static str,
}

pub const TECHNIQUES: [Technique; 12] = [
    Technique {
        section: "3.1",
        name: "degenerate cones",
        code: "`Primitive::simplified`, `src/geometry/primitive.rs`",
        difference: "A relative tolerance of 1e-7, so that f32 kernels never meet a mantle of zero width.",
        test: "`medial_axis::cleanup::tests::generated_hard_cases_keep_their_envelope`",
    },
    Technique {
        section: "3.2",
        name: "degenerate slabs, case 1: a sphere in another",
        code: "`Primitive::simplified`",
        difference: "None.",
        test: "`medial_axis::cleanup::tests::simplified_slab_is_the_union_of_its_parts`",
    },
    Technique {
        section: "3.2, figures 3 and 4",
        name: "degenerate slabs, case 2: two circles on the largest sphere",
        code: "`Primitive::simplified`",
        difference: "The criterion is the length of the in-plane gradient of the radius: the same verdict, without a sphere of positive radius. The result is one or two \
            cones, whichever the gradient leaves. The paper keeps the cone of the two larger spheres, which can lose volume.",
        test: "`kernels::paper::degenerate_slabs_are_those_whose_circles_do_not_cross`",
    },
    Technique {
        section: "4, figure 5",
        name: "a swept bounding sphere is a medial cone",
        code: "`src/pipeline/broad/swept_sphere.rs`",
        difference: "The cone is widened by the sagitta of the rotation and by half of the prediction distance, so no pair is missed. A BVH over the cones replaces the test of \
            all pairs.",
        test: "`physics::culling::culling_changes_no_result_of_many_bodies`",
    },
    Technique {
        section: "4, figure 5",
        name: "a chain of cones along a curved path",
        code: "`src/pipeline/broad/swept_sphere.rs`, `shaders/broad_phase.wgsl`; `src/pipeline/sweep/first_impact.rs` halves the time interval of a pair",
        difference: "A chain has as many links as a small sagitta takes, up to eight. Each link is tested against each other one, because bodies that stop are at a place of their \
            path at other times. Pairs whose rotation bends the path of their primitives are searched in intervals.",
        test: "`gpu::culling::chains_of_cones_leave_half_of_the_pairs_of_clubs_that_spin_for_several_steps`",
    },
    Technique {
        section: "4.1, equations 1 to 3",
        name: "distance of a cone and a box",
        code: "`separation` with a `Cuboid`, `src/query/separation.rs`",
        difference: "The exact min instead of its sign, because the same kernel gives contacts.",
        test: "`kernels::swept_cones::separation_of_cone_and_box_solves_equation_3`",
    },
    Technique {
        section: "4.1, equations 4 and 5",
        name: "overlap by a 4D conic on the tesseract",
        code: "in `benches/src/paper/conic.rs` only",
        difference: "The min of the conic needs all 81 faces of the tesseract. The quadratic form has rank 3, minus a square, so the 4D ellipsoid of the paper does not exist.",
        test: "`kernels::paper::overlap_of_cone_and_box_is_that_of_the_conic_on_all_faces_of_the_tesseract`",
    },
    Technique {
        section: "4.1",
        name: "BVH of static boxes",
        code: "`Statics`, `src/pipeline/input.rs`; `src/geometry/bvh.rs`",
        difference: "Nodes are aligned boxes, and the oriented box of a leaf is tested exactly.",
        test: "`physics::culling::culling_changes_no_result_of_few_bodies`",
    },
    Technique {
        section: "4.2, figure 6",
        name: "generalized medial mesh",
        code: "`PackedMedialMesh`, `src/medial_axis/packed.rs`",
        difference: "Shapes are uploaded in this form, without their bounds. Bounds lie in the records of bodies and statics, because boxes and other colliders have no sphere list, and \
            because the broad phase already reads the eight storage buffers that every adapter supports. A box is a unit quaternion and half extents: three vectors would have to be \
            normalised in each test.",
        test: "`medial_axis::packed::tests::kinds_and_indices_are_those_of_the_paper`",
    },
    Technique {
        section: "4.2",
        name: "continuous collision detection of all primitive pairs on the GPU",
        code: "`src/gpu/`, `shaders/`; in lanes on the CPU: `times_of_impact`",
        difference: "A tree over the primitives of each shape leaves few pairs. The GPU computes a lower bound of each first touch, and the CPU the exact times in the order of the \
            bounds, so both back ends give the same bits.",
        test: "`gpu::parity::scenes_are_identical_on_all_back_ends`",
    },
    Technique {
        section: "2 (Song et al.)",
        name: "alternating time of impact",
        code: "`src/query/alternating.rs`, `shaders/alternating.wgsl`, for comparison; `time_of_impact` in a step",
        difference: "Conservative advancement instead, because the alternation misses hits and reports late ones.",
        test: "`kernels::judge_finds_faults_of_wrong_kernels`",
    },
    Technique {
        section: "6",
        name: "hierarchical medial axis for culling between bodies",
        code: "`src/pipeline/sweep/mid_phase.rs`",
        difference: "Trees of aligned boxes instead, because trees of medial primitives take longer: see [hierarchies](#hierarchies).",
        test: "`physics::culling::baselines_give_the_same_results`",
    },
];
