//! Charts as SVG: both axes logarithmic, a name beside each curve, colours that colour-blind people can tell apart.

use std::ops::Range;

use plotters::prelude::*;

/// A chart.
pub struct Chart<'a> {
    pub title: &'a str,
    pub x: &'a str,
    pub y: &'a str,
    pub curves: Vec<Curve<'a>>,
    /// Whether to draw the line below and left of which there is nothing.
    pub front: bool,
}

/// Points that belong together, in their order.
pub struct Curve<'a> {
    pub name: &'a str,
    pub points: Vec<[f64; 2]>,
}

/// Okabe and Ito's colours, without the yellow that is too pale for lines.
const COLORS: [RGBColor; 7] = [
    RGBColor(213, 94, 0),
    RGBColor(0, 114, 178),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(86, 180, 233),
    RGBColor(230, 159, 0),
    RGBColor(0, 0, 0),
];

const SIZE: (u32, u32) = (960, 720);
const FONT: f64 = 21.0;

type Drawn = Result<String, Box<dyn std::error::Error>>;

impl Chart<'_> {
    /// The chart as SVG. Points that a logarithmic axis does not have are left out.
    ///
    /// # Errors
    /// Those of the backend.
    pub fn svg(&self) -> Drawn {
        let mut text = String::new();
        let curves: Vec<(&str, Vec<(f64, f64)>)> = self
            .curves
            .iter()
            .map(|curve| {
                (
                    curve.name,
                    curve
                        .points
                        .iter()
                        .filter(|p| p.iter().all(|v| *v > 0.0 && v.is_finite()))
                        .map(|p| (p[0], p[1]))
                        .collect(),
                )
            })
            .filter(|(_, points): &(_, Vec<_>)| !points.is_empty())
            .collect();
        let all = || curves.iter().flat_map(|(_, points)| points);
        let (xs, ys) = (around(all().map(|p| p.0)), around(all().map(|p| p.1)));
        {
            let root = SVGBackend::with_string(&mut text, SIZE).into_drawing_area();
            root.fill(&WHITE)?;
            let mut chart = ChartBuilder::on(&root)
                .caption(self.title, ("sans-serif", FONT * 1.2))
                .margin(14)
                .margin_right(40)
                .x_label_area_size(62)
                .y_label_area_size(96)
                .build_cartesian_2d(xs.log_scale(), ys.log_scale())?;
            chart
                .configure_mesh()
                .x_desc(self.x)
                .y_desc(self.y)
                .label_style(("sans-serif", FONT * 0.85))
                .axis_desc_style(("sans-serif", FONT))
                .max_light_lines(0)
                .bold_line_style(RGBColor(205, 205, 205))
                .x_label_formatter(&|v| plain(*v))
                .y_label_formatter(&|v| plain(*v))
                .draw()?;
            if self.front {
                let front = front(all().copied().collect());
                chart.draw_series(LineSeries::new(front, RGBColor(225, 225, 225).stroke_width(12)))?;
            }
            let mut taken: Vec<[Range<i32>; 2]> = Vec::new();
            for (i, (name, points)) in curves.iter().enumerate() {
                let color = COLORS[i % COLORS.len()];
                // Where colours come round again, circles are empty.
                let style = if i < COLORS.len() { color.filled() } else { color.stroke_width(2) };
                chart.draw_series(LineSeries::new(points.iter().copied(), color.stroke_width(3)))?;
                chart.draw_series(points.iter().map(|p| Circle::new(*p, 5, style)))?;
                let at = chart.backend_coord(&points[points.len() - 1]);
                let place = free_place(at, name, &mut taken);
                root.draw(&Text::new((*name).to_owned(), place, ("sans-serif", FONT * 0.9).into_font().color(&color)))?;
            }
            root.present()?;
        }
        Ok(text)
    }
}

/// A place for a name near a point that no other name has.
fn free_place((x, y): (i32, i32), name: &str, taken: &mut Vec<[Range<i32>; 2]>) -> (i32, i32) {
    let (width, height) = ((name.len() as f64 * FONT * 0.47) as i32, FONT as i32);
    let left = if x + 12 + width > SIZE.0 as i32 { x - 12 - width } else { x + 12 };
    let meets = |a: &Range<i32>, b: &Range<i32>| a.start < b.end && b.start < a.end;
    let tries = (0..40).map(|i| y - height / 2 + if i % 2 == 0 { i / 2 } else { -(i + 1) / 2 } * height / 2);
    let top = tries
        .filter(|top| (40..SIZE.1 as i32 - 90).contains(top))
        .find(|top| !taken.iter().any(|[xs, ys]| meets(xs, &(left..left + width)) && meets(ys, &(*top..top + height))));
    let top = top.unwrap_or(y);
    taken.push([left..left + width, top..top + height]);
    (left, top)
}

/// Points that no other one is left of and below, from left to right, as a staircase.
fn front(mut points: Vec<(f64, f64)>) -> Vec<(f64, f64)> {
    points.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let mut found: Vec<(f64, f64)> = Vec::new();
    for (x, y) in points {
        match found.last() {
            Some(&(_, best)) if y >= best => {}
            Some(&(_, best)) => found.extend([(x, best), (x, y)]),
            None => found.push((x, y)),
        }
    }
    found
}

/// A range with some room, from 1 to 10 if there is nothing.
fn around(values: impl Iterator<Item = f64>) -> Range<f64> {
    let (least, most) = values.fold((f64::INFINITY, 0.0f64), |(least, most), v| (least.min(v), most.max(v)));
    if least > most { 1.0..10.0 } else { least / 1.6..most * 1.6 }
}

fn plain(value: f64) -> String {
    match value {
        v if v >= 1e6 => format!("{} M", v / 1e6),
        v if v >= 1e4 => format!("{} k", v / 1e3),
        v => format!("{v}"),
    }
}
