//! Solids that are the union of a few convex regions, such as boxes, prisms and stairs. They need no search: the medial mesh of a convex region
//! [is exact](super::roof).
//!
//! The planes of the surface divide the solid into convex cells. Each cell grows to a convex region as large as the solid allows, so regions overlap and have no
//! seams.

use glam::DVec3;

use super::{
    Level,
    hull::Ball,
    roof::{CLOSE, Plane, Roof},
    solid::Solid,
};
use crate::{
    geometry::{Primitive, Sphere},
    medial_axis::{MedialAxis, numbers_of_kept},
};

/// Largest radius of the rounded edges, as a part of the diagonal and of the region's largest ball. A sharp edge has no core to sweep.
const ROUND: [f64; 2] = [0.004, 0.25];

/// Largest distance of a corner from the shape, as a part of the diagonal.
const CORNER: f64 = 0.003;

/// Largest number of radii that are tried.
const TRIALS: usize = 3;

/// Largest error of a shape without the sharp edges of its smallest regions, as a part of the diagonal.
const BLUNT: f64 = 0.02;

/// The levels of a solid that consists of a few convex regions, the finest first: with narrow edges, and with edges that are as round as possible. If narrow
/// edges of all regions require more than `most` spheres, regions that exceed them have round edges in both; the largest regions come first. `None` for other
/// solids, for too few spheres, and if the error is too large. `finest`: largest error as a part of the diagonal.
pub(super) fn exact(solid: &Solid, most: usize, finest: f64) -> Option<[Level; 2]> {
    solid.mass?;
    let regions = Facets::new(solid, most)?.regions(most)?.into_iter();
    let with_radius = |planes: Vec<Plane>| Some((Roof::new(&planes, 0.0)?.largest().radius, planes));
    let mut regions: Vec<(f64, Vec<Plane>)> = regions.map(with_radius).collect::<Option<_>>()?;
    regions.sort_by(|(a, _), (b, _)| b.total_cmp(a));
    let parts = |scale: f64, shape: fn(&Roof) -> Vec<Primitive>| -> Option<Vec<Part>> {
        let edge = |largest: f64| scale * ROUND[0].min(ROUND[1] * largest);
        regions.iter().map(|(largest, planes)| Some(Part::new(&Roof::new(planes, edge(*largest))?, shape))).collect()
    };
    let round = parts(1.0, Roof::ridge)?;
    let spare = most.checked_sub(round.iter().map(|part| part.balls.len()).sum())?;
    let mut scale = 1.0;
    for _ in 0..TRIALS {
        let narrow = parts(scale, Roof::slabs)?;
        let mut left = spare;
        let mut is_blunt = false;
        let chosen = round.iter().zip(&narrow).map(|(round, narrow)| {
            let Some(rest) = (left + round.balls.len()).checked_sub(narrow.balls.len()) else {
                is_blunt = true;
                return round;
            };
            left = rest;
            narrow
        });
        let fine = level(solid, chosen)?;
        let goal = finest.min(if is_blunt { BLUNT } else { CORNER });
        let error = f64::from(fine.error.max()) / 100.0;
        if error <= goal {
            return Some([fine, level(solid, round.iter())?]);
        }
        if is_blunt {
            return None;
        }
        // The error at a corner is proportional to the radius.
        scale *= 0.95 * goal / error;
    }
    None
}

/// The shape of a region.
struct Part {
    balls: Vec<Ball>,
    primitives: Vec<Primitive>,
}

impl Part {
    fn new(roof: &Roof, shape: fn(&Roof) -> Vec<Primitive>) -> Self {
        let shape = shape(roof);
        let is_used = |i: u32| shape.iter().any(|primitive| primitive.indices().contains(&i));
        let balls: Vec<Ball> = roof.balls().collect();
        let numbers = numbers_of_kept((0..balls.len() as u32).map(is_used));
        let primitives = shape.iter().map(|primitive| primitive.renumbered(|i| numbers[i as usize])).collect();
        Self { balls: (0..).zip(balls).filter(|(i, _)| is_used(*i)).map(|(_, ball)| ball).collect(), primitives }
    }
}

/// The union of the regions' shapes.
fn level<'a>(solid: &Solid, parts: impl Iterator<Item = &'a Part>) -> Option<Level> {
    let (mut spheres, mut primitives) = (vec![], vec![]);
    for part in parts {
        let first = spheres.len() as u32;
        primitives.extend(part.primitives.iter().map(|primitive| primitive.renumbered(|i| first + i)));
        spheres.extend(part.balls.iter().map(|ball| {
            let center = (ball.center * solid.diagonal + solid.origin).as_vec3();
            Sphere::new(center, (ball.radius * solid.diagonal) as f32)
        }));
    }
    let (axis, _) = MedialAxis::new(spheres, primitives).ok()?;
    Some(Level { error: solid.measure(&axis), axis })
}

/// True if a region contains a cell.
fn covers(region: &[Plane], cell: &Roof) -> bool {
    region.iter().all(|plane| cell.balls().all(|ball| plane.height(ball.center) + ball.radius < CLOSE))
}

/// The triangles of a solid and their planes.
struct Facets<'a> {
    solid: &'a Solid,
    planes: Vec<Plane>,
    /// Index of each triangle's plane.
    of_triangle: Vec<usize>,
}

impl<'a> Facets<'a> {
    /// `None` if there are more planes than `most` spheres: few polyhedra with more planes have few enough corners.
    fn new(solid: &'a Solid, most: usize) -> Option<Self> {
        let triangles = solid.tree.triangles();
        let areas: Vec<DVec3> = triangles.iter().map(|[a, b, c]| (b - a).cross(c - a)).collect();
        let mut order: Vec<usize> = (0..triangles.len()).collect();
        order.sort_by(|&a, &b| areas[b].length_squared().total_cmp(&areas[a].length_squared()).then(a.cmp(&b)));
        let (mut planes, mut of_triangle) = (Vec::<Plane>::new(), vec![0; triangles.len()]);
        for triangle in order {
            let corners = &triangles[triangle];
            let holds = |plane: &Plane| corners.iter().all(|&corner| plane.height(corner).abs() < CLOSE);
            of_triangle[triangle] = planes.iter().position(holds).unwrap_or(planes.len());
            if of_triangle[triangle] == planes.len() {
                if planes.len() == most {
                    return None;
                }
                let normal = areas[triangle].normalize_or_zero();
                planes.push(Plane { normal, offset: normal.dot((corners[0] + corners[1] + corners[2]) / 3.0) });
            }
        }
        Some(Self { solid, planes, of_triangle })
    }

    /// Convex regions whose union is the solid. `None` if there are more cells than `most`.
    fn regions(&self, most: usize) -> Option<Vec<Vec<Plane>>> {
        let all: Vec<usize> = (0..self.of_triangle.len()).collect();
        let mut cells = vec![];
        self.divide(&Roof::new(&[], 0.0)?, &all, most, &mut cells)?;
        cells.sort_by(|a, b| b.largest().radius.total_cmp(&a.largest().radius));
        let mut regions: Vec<Vec<Plane>> = vec![];
        for cell in &cells {
            if !regions.iter().any(|region| covers(region, cell)) {
                regions.push(self.grown(cell.planes(), &all));
            }
        }
        for at in (0..regions.len()).rev() {
            let others = || regions.iter().enumerate().filter(|(other, _)| *other != at);
            if cells.iter().all(|cell| others().any(|(_, region)| covers(region, cell))) {
                regions.remove(at);
            }
        }
        Some(regions)
    }

    /// Divides a convex cell along the planes of the triangles that cross it, and adds the parts inside the solid. `None` if there are more than `most`.
    fn divide(&self, cell: &Roof, among: &[usize], most: usize, cells: &mut Vec<Roof>) -> Option<()> {
        let planes = cell.planes();
        let crossing: Vec<usize> = among.iter().copied().filter(|&triangle| self.crosses(&planes, triangle)).collect();
        if let Some(plane) = crossing.iter().map(|&triangle| self.of_triangle[triangle]).min() {
            for side in [self.planes[plane], self.planes[plane].flipped()] {
                // A part that is too thin to have a ball is left out.
                if let Some(part) = cell.below(&side) {
                    self.divide(&part, &crossing, most, cells)?;
                }
            }
        } else if self.solid.is_inside(cell.largest().center) {
            cells.push(cell.clone());
        }
        (cells.len() <= most).then_some(())
    }

    /// A convex region around a cell from which no further plane can be removed.
    fn grown(&self, mut cell: Vec<Plane>, all: &[usize]) -> Vec<Plane> {
        let mut at = 0;
        while at < cell.len() {
            match self.without(&cell, at, all) {
                Some(larger) => (cell, at) = (larger, 0),
                None => at += 1,
            }
        }
        cell
    }

    /// The cell without one of its planes, bounded by the planes of the surface beyond. `None` if there is no larger region.
    fn without(&self, cell: &[Plane], at: usize, all: &[usize]) -> Option<Vec<Plane>> {
        let own = Roof::new(cell, 0.0)?;
        let mut planes = cell.to_vec();
        let removed = planes.remove(at);
        loop {
            let roof = Roof::new(&planes, 0.0)?;
            if covers(&[removed], &roof) {
                return None;
            }
            planes = roof.planes();
            let crossing = all.iter().filter(|&&triangle| self.crosses(&planes, triangle));
            let mut crossing = crossing.map(|&triangle| self.planes[self.of_triangle[triangle]]).peekable();
            if crossing.peek().is_none() {
                return Some(planes);
            }
            let mut sides = crossing.flat_map(|plane| [plane, plane.flipped()]);
            let side = sides.find(|&side| covers(&[side], &own))?;
            planes.push(side);
        }
    }

    /// True if a triangle divides a region. Surfaces inside the solid, where its pieces overlap, do not.
    fn crosses(&self, region: &[Plane], triangle: usize) -> bool {
        let mut polygon = self.solid.tree.triangles()[triangle].to_vec();
        for plane in region {
            let heights: Vec<f64> = polygon.iter().map(|&point| plane.height(point) + 2.0 * CLOSE).collect();
            let mut clipped = vec![];
            for (i, (&point, &height)) in polygon.iter().zip(&heights).enumerate() {
                let next = (i + 1) % polygon.len();
                if height <= 0.0 {
                    clipped.push(point);
                }
                if (height <= 0.0) != (heights[next] <= 0.0) {
                    clipped.push(point.lerp(polygon[next], height / (height - heights[next])));
                }
            }
            polygon = clipped;
        }
        let middle = polygon.iter().sum::<DVec3>() / polygon.len() as f64;
        // Inside the polygon, near its corners.
        let mut near = polygon.iter().map(|corner| corner.lerp(middle, 0.1)).chain([middle]);
        polygon.len() > 2 && !near.all(|point| self.solid.is_hidden(point))
    }
}

#[cfg(test)]
mod tests;
