use std::{collections::HashSet, fmt};

use super::{
    TriangleMesh,
    clean::Cleaned,
    mesh::{edge_uses, is_flat},
};

/// A triangle with a smaller height, relative to its longest side, counts as having no area, because of rounding.
const FLAT: f64 = 1.0e-6;

/// Properties and flaws of a mesh that matter before a shape is built from it.
///
/// Vertices at equal positions count as one. The text form lists each flaw with its effect and remedy.
#[derive(Clone, Debug, PartialEq)]
pub struct MeshReport {
    /// Number of triangles.
    pub triangles: usize,
    /// Number of different positions of vertices that triangles use.
    pub vertices: usize,
    /// Number of connected pieces.
    pub components: usize,
    /// Edges with only one triangle: the rims of holes and of sheets.
    pub boundary_edges: usize,
    /// Edges with three or more triangles.
    pub non_manifold_edges: usize,
    /// Edges whose two triangles face opposite ways.
    pub flipped_edges: usize,
    /// Triangles with the same three vertices as an earlier one.
    pub duplicate_faces: usize,
    /// Connected pieces that enclose no volume: sheets, and strips with one side. A build leaves them out.
    pub sheets: usize,
    /// Triangles without an area.
    pub zero_area_faces: usize,
    /// Vertices of the list that no triangle uses.
    pub unused_vertices: usize,
    /// Enclosed volume in cubic metres. Negative if the triangles face inwards, meaningless unless the surface
    /// [is closed](Self::is_closed).
    pub volume: f64,
    /// Area in square metres.
    pub area: f64,
    /// Diagonal of the bounding box in metres.
    pub diagonal: f32,
}

impl MeshReport {
    /// Examines a mesh.
    pub fn new(mesh: &TriangleMesh) -> Self {
        let mut used = vec![false; mesh.positions.len()];
        mesh.triangles.iter().flatten().for_each(|&i| used[i as usize] = true);
        let welded = mesh.welded();
        let origin = welded.aabb().center().as_dvec3();
        let mut report = Self {
            triangles: mesh.triangles.len(),
            vertices: welded.positions.len(),
            components: welded.components().len(),
            boundary_edges: 0,
            non_manifold_edges: 0,
            flipped_edges: 0,
            duplicate_faces: 0,
            sheets: 0,
            zero_area_faces: 0,
            unused_vertices: used.iter().filter(|&&used| !used).count(),
            volume: 0.0,
            area: 0.0,
            diagonal: welded.diagonal(),
        };
        let mut faces = HashSet::new();
        for triangle in &welded.triangles {
            let [a, b, c] = welded.corners(*triangle).map(|p| p.as_dvec3() - origin);
            report.area += (b - a).cross(c - a).length() * 0.5;
            report.volume += a.dot(b.cross(c)) / 6.0;
            report.zero_area_faces += usize::from(is_flat(&[a, b, c], FLAT));
            let mut sorted = *triangle;
            sorted.sort_unstable();
            report.duplicate_faces += usize::from(!faces.insert(sorted));
        }
        for along in edge_uses(&welded.triangles).values() {
            match along[0] + along[1] {
                1 => report.boundary_edges += 1,
                2 => report.flipped_edges += usize::from(along[0] != 1),
                _ => report.non_manifold_edges += 1,
            }
        }
        if report.boundary_edges + report.duplicate_faces > 0 {
            report.sheets = Cleaned::new(mesh).sheets;
        }
        report
    }

    /// True if the surface bounds a solid: each edge has two triangles that face the same way.
    pub fn is_closed(&self) -> bool {
        self.boundary_edges + self.non_manifold_edges + self.flipped_edges == 0
    }

    /// One line per flaw, with its effect and remedy. Empty for a clean, closed, outward surface.
    pub fn flaws(&self) -> Vec<String> {
        let inwards = usize::from(self.is_closed() && self.volume < 0.0);
        let mut flaws: Vec<String> = [
            (
                self.boundary_edges,
                "boundary edges: the surface has holes or sheets; a build closes holes with flat caps, close them yourself if they are not flat",
            ),
            (self.non_manifold_edges, "edges of more than two triangles: pieces touch or cross there; separate them"),
            (self.flipped_edges, "edges between triangles that face opposite ways: make normals consistent"),
            (self.duplicate_faces, "duplicate triangles: a build uses one of each; remove doubles"),
            (self.sheets, "pieces that enclose no volume: a build leaves them out; give sheets a thickness"),
            (self.zero_area_faces, "triangles without area: dissolve degenerate faces"),
            (self.unused_vertices, "unused vertices: harmless"),
        ]
        .into_iter()
        .filter(|(count, _)| *count > 0)
        .map(|(count, what)| format!("{count} {what}"))
        .collect();
        if inwards > 0 {
            flaws.push("triangles face inwards, the volume is negative: harmless for a build; flip all normals if the mesh is drawn".into());
        }
        flaws
    }
}

impl fmt::Display for MeshReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { triangles, vertices, components, diagonal, .. } = self;
        write!(f, "triangles: {triangles}, vertices: {vertices}, pieces: {components}, diagonal: {diagonal} m, ")?;
        if self.is_closed() {
            write!(f, "closed, volume: {:.6e} m^3", self.volume)?;
        } else {
            write!(f, "not closed")?;
        }
        self.flaws().iter().try_for_each(|flaw| write!(f, "\n  {flaw}"))
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::builder::mesh::tests::tetrahedron;

    /// The report of the tetrahedron after a change.
    fn changed(change: impl FnOnce(&mut TriangleMesh)) -> MeshReport {
        let mut mesh = tetrahedron();
        change(&mut mesh);
        MeshReport::new(&TriangleMesh::new(mesh.positions, mesh.triangles).unwrap())
    }

    #[test]
    fn a_clean_solid_has_no_flaws() {
        let report = changed(|_| ());
        assert!(report.is_closed() && report.flaws().is_empty(), "{report}");
        assert!((report.volume - 1.0 / 6.0).abs() < 1e-12 && (report.area - (1.5 + 0.75f64.sqrt())).abs() < 1e-12);
        assert_eq!((report.triangles, report.vertices, report.components), (4, 4, 1));
        let expected = "triangles: 4, vertices: 4, pieces: 1, diagonal: 1.7320508 m, closed, volume: 1.666667e-1 m^3";
        assert_eq!(report.to_string(), expected);
    }

    #[test]
    fn each_flaw_is_found_and_named() {
        type Change = fn(&mut TriangleMesh);
        let cases: [(Change, &[&str]); 8] = [
            (|m| m.triangles.truncate(3), &["3 boundary edges"]),
            (|m| m.triangles[0].swap(0, 1), &["3 edges between triangles that face opposite ways"]),
            (|m| m.triangles.iter_mut().for_each(|t| t.swap(0, 1)), &["triangles face inwards"]),
            (|m| m.triangles.push([1, 0, 2]), &["3 edges of more than two triangles", "1 duplicate triangles"]),
            // A sliver along an edge.
            (
                |m| {
                    m.positions.push(Vec3::X * 0.5);
                    m.triangles.push([0, 4, 1]);
                },
                &["2 boundary edges", "1 edges of more than two triangles", "1 triangles without area"],
            ),
            (|m| m.triangles.push([2, 2, 2]), &["1 triangles without area"]),
            // A triangle with a repeated vertex, as at the pole of a sphere.
            (|m| m.triangles.push([0, 1, 1]), &["1 triangles without area"]),
            (|m| m.positions.push(Vec3::ONE), &["1 unused vertices"]),
        ];
        for (change, expected) in cases {
            let flaws = changed(change).flaws();
            let found: Vec<_> = flaws.iter().map(|flaw| flaw.split(':').next().unwrap()).collect();
            let found: Vec<_> = found.iter().map(|flaw| flaw.split(',').next().unwrap()).collect();
            assert_eq!(found, expected);
        }
    }

    #[test]
    fn split_vertices_are_no_holes() {
        let report = changed(|m| {
            m.positions = m.triangles.iter().flat_map(|t| m.corners(*t)).collect();
            m.triangles = (0..4).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        });
        assert!(report.is_closed() && report.vertices == 4, "{report}");
    }
}
