//! Pass rates as a heat map: blue cells pass, orange cells fail. Each cell shows its pass rate and its most frequent fault.

use std::path::Path;

use plotters::{
    coord::Shift,
    prelude::*,
    style::text_anchor::{HPos, Pos, VPos},
};

use bevy_medial_compare::stability::run::Cell;

use crate::report::Report;

const LABELS: i32 = 190;
const HEADER: i32 = 58;
const CELL: [i32; 2] = [98, 32];
const MARGIN: i32 = 10;

/// Colours from no passed seed to all. Colour-blind readers can distinguish them, also in print.
const COLORS: [[u8; 3]; 3] = [[230, 97, 1], [247, 241, 232], [146, 197, 222]];

/// Draws the picture.
///
/// # Errors
/// If the file cannot be written.
pub fn draw(report: &Report, path: &Path) -> Result<(), String> {
    let width = LABELS + CELL[0] * report.methods.len() as i32 + 2 * MARGIN;
    let height = HEADER + CELL[1] * report.hazards.len() as i32 + 2 * MARGIN;
    let area = SVGBackend::new(path, (width as u32, height as u32)).into_drawing_area();
    fill(&area, report).map_err(|error| format!("{}: {error}", path.display()))
}

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

fn fill(area: &Area, report: &Report) -> Result<(), Box<dyn std::error::Error>> {
    area.fill(&WHITE)?;
    let text = |words: &str, place: (i32, i32), size: i32, across: HPos| {
        let style = TextStyle::from(("sans-serif", size).into_font()).pos(Pos::new(across, VPos::Center));
        area.draw_text(words, &style, place)
    };
    let left = |column: usize| MARGIN + LABELS + CELL[0] * column as i32;
    let top = |row: usize| MARGIN + HEADER + CELL[1] * row as i32;
    for (column, method) in report.methods.iter().enumerate() {
        // Names of two parts take two lines.
        let lines: Vec<&str> = method.name.splitn(2, ", ").collect();
        let first = MARGIN + HEADER - 10 - 17 * (lines.len() as i32 - 1);
        for (line, words) in lines.iter().enumerate() {
            text(words, (left(column) + CELL[0] / 2, first + 17 * line as i32), 17, HPos::Center)?;
        }
    }
    for (row, hazard) in report.hazards.iter().enumerate() {
        text(hazard.name, (MARGIN + LABELS - 8, top(row) + CELL[1] / 2), 17, HPos::Right)?;
    }
    for cell in report.cells {
        let (x, y) = (left(cell.method), top(cell.hazard));
        let share = cell.passed() as f64 / cell.results.len().max(1) as f64;
        let corners = [(x + 1, y + 1), (x + CELL[0] - 1, y + CELL[1] - 1)];
        area.draw(&Rectangle::new(corners, color(share).filled()))?;
        let rate = format!("{}/{}", cell.passed(), cell.results.len());
        let middle = x + CELL[0] / 2;
        match fault(cell) {
            None => text(&rate, (middle, y + CELL[1] / 2), 16, HPos::Center)?,
            Some(fault) => {
                text(&rate, (middle, y + 10), 16, HPos::Center)?;
                text(fault, (middle, y + 23), 14, HPos::Center)?;
            }
        }
    }
    area.present()?;
    Ok(())
}

/// The most frequent fault, by the words before its colon.
fn fault(cell: &Cell) -> Option<&str> {
    let words: Vec<&str> = cell.results.iter().filter_map(|result| result.as_ref().err()?.split(':').next()).collect();
    words.iter().max_by_key(|word| words.iter().filter(|other| other == word).count()).copied()
}

fn color(share: f64) -> RGBColor {
    let at = 2.0 * share;
    let [from, to] = if at < 1.0 { [COLORS[0], COLORS[1]] } else { [COLORS[1], COLORS[2]] };
    let mix = |i: usize| (f64::from(from[i]) + (f64::from(to[i]) - f64::from(from[i])) * at.fract()).round() as u8;
    if share >= 1.0 {
        return RGBColor(COLORS[2][0], COLORS[2][1], COLORS[2][2]);
    }
    RGBColor(mix(0), mix(1), mix(2))
}
