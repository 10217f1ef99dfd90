//! The criteria of the paper compared with those of this crate, on random slabs, and on random pairs of a cone and a box.

use bevy_medial::geometry::Primitive;
use bevy_medial_compare::paper::{conic, slabs};

use crate::score::setting;

#[test]
fn degenerate_slabs_are_those_whose_circles_do_not_cross() {
    let count = setting("PAPER_CASES", 1_000_000) as usize;
    let verdicts = slabs::compare(count, 1);
    println!("{verdicts:#?}");
    assert_eq!((verdicts.ours_wrong, verdicts.ours_lossy), (0, 0));
    assert!(verdicts.ours_max_loss < 1e-6);
    assert!(verdicts.degenerate > count / 10 && verdicts.undecided < count / 10);
    assert_eq!(verdicts.circles_wrong, 0);
    // On a sphere of radius 0 both circles are one point. The paper's rule keeps a single cone where two are necessary.
    assert!(verdicts.circles_wrong_on_triangles == verdicts.triangles && verdicts.triangles > count / 20);
    assert!(verdicts.cone_wrong > count / 1000 && verdicts.cone_max_loss > 0.01);
}

#[test]
fn a_slab_with_a_bulging_middle_sphere_becomes_two_cones() {
    let parts: Vec<Primitive> = Primitive::Slab([0, 1, 2]).simplified(&slabs::BULGING).iter().copied().collect();
    assert_eq!(parts.len(), 2, "{parts:?}");
    assert_eq!(slabs::paper_rule(&slabs::BULGING), [1, 0], "the paper's rule drops the third sphere");
}

#[test]
fn overlap_of_cone_and_box_is_that_of_the_conic_on_all_faces_of_the_tesseract() {
    let count = setting("PAPER_CASES", 1_000_000) as usize;
    let verdicts = conic::compare(count, 2);
    println!("{verdicts:#?}");
    assert_eq!((verdicts.ours_wrong, verdicts.faces_wrong), (0, 0));
    assert!(verdicts.overlapping > count / 4 && verdicts.overlapping < count * 3 / 4);
    assert!(verdicts.spheres > count / 20 && verdicts.undecided < count / 1000);
    // The edges of the tesseract alone are not sufficient, and there is never an ellipsoid.
    assert!(verdicts.edges_missed > 0 && verdicts.ellipsoids == 0);
}
