//! Charts as SVG, with two logarithmic axes and the names of the curves at the side. Colour-blind readers can distinguish the colours.

use std::ops::Range;

use plotters::prelude::*;

/// A chart.
pub struct Chart<'a> {
    pub title: &'a str,
    pub x: &'a str,
    pub y: &'a str,
    pub curves: Vec<Curve<'a>>,
    /// True if the Pareto front of all points is drawn.
    pub front: bool,
}

/// Points that are joined by lines, in their order.
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

const SIZE: (u32, u32) = (1200, 720);
/// Width of the space for the names of the curves, in pixels.
const SIDE: i32 = 310;
const FONT: f64 = 21.0;

type Drawn = Result<String, Box<dyn std::error::Error>>;

impl Chart<'_> {
    /// The chart as SVG. Points without positive, finite coordinates are left out, because the axes are logarithmic.
    ///
    /// # Errors
    /// Errors of the drawing back end.
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
                .margin_right(SIDE)
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
            let font = ("sans-serif", FONT * 0.9).into_font();
            for (i, (name, points)) in curves.iter().enumerate() {
                let color = COLORS[i % COLORS.len()];
                // Circles are empty where colours repeat.
                let style = if i < COLORS.len() { color.filled() } else { color.stroke_width(2) };
                chart.draw_series(LineSeries::new(points.iter().copied(), color.stroke_width(3)))?;
                chart.draw_series(points.iter().map(|p| Circle::new(*p, 5, style)))?;
                let (left, middle) = (SIZE.0 as i32 - SIDE + 16, 60 + i as i32 * (1.4 * FONT) as i32);
                root.draw(&PathElement::new([(left, middle), (left + 32, middle)], color.stroke_width(3)))?;
                root.draw(&Circle::new((left + 16, middle), 5, style))?;
                let place = (left + 42, middle - (0.45 * FONT) as i32);
                root.draw(&Text::new((*name).to_owned(), place, font.clone()))?;
            }
            root.present()?;
        }
        Ok(text)
    }
}

/// The Pareto front: points without another point to the left and below, from left to right, as a staircase.
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

/// The range of the values with a margin. Default without values: 1 to 10.
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
