//! Charts as SVG: up to four curves, or bars. They are legible at a width of 360 pixels, on a light and on a dark page.

use std::{fmt::Write, ops::Range};

/// A chart of up to four curves.
pub struct Chart<'a> {
    pub title: &'a str,
    /// A remark below the title, or an empty text.
    pub note: &'a str,
    pub x: Axis<'a>,
    pub y: Axis<'a>,
    pub curves: Vec<Curve<'a>>,
}

/// An axis: its label, and the direction of better values.
#[derive(Clone, Copy)]
pub struct Axis<'a> {
    pub label: &'a str,
    /// True if smaller values are better. Otherwise neither direction is.
    pub less_is_better: bool,
    /// True for a logarithmic axis. It has no points with values of 0 or less.
    pub is_logarithmic: bool,
}

/// Points that are joined by lines, in their order.
pub struct Curve<'a> {
    pub name: &'a str,
    pub points: Vec<[f64; 2]>,
    /// A constant to compare the curve with, drawn as a line of dashes in the same colour.
    pub level: Option<f64>,
}

/// Lengths of bars: a row of text, and the part of the whole in numbers.
pub struct Bars<'a> {
    pub title: &'a str,
    pub note: &'a str,
    pub rows: Vec<(&'a str, [usize; 2])>,
}

/// Okabe and Ito's blue, orange, green and purple, which colour-blind readers can distinguish.
const COLORS: [&str; 4] = ["#0072b2", "#d55e00", "#009e73", "#cc79a7"];

/// Size of a chart in pixels.
const SIZE: [f64; 2] = [720.0, 640.0];
const FONT: f64 = 24.0;
/// Left, right and bottom margin of the area of the curves. Title, note, legend and the label of the values are above it.
const MARGINS: [f64; 3] = [92.0, 30.0, 84.0];
/// Height of a row of the legend.
const ROW: f64 = 34.0;

/// Colours of the background, of text and of lines of a grid, for pages with dark colours as well.
const STYLE: &str = "<style>text{font-family:sans-serif;fill:#1f2328}.paper{fill:#ffffff}.grid{stroke:#d8dee4}.rest{fill:#d8dee4}\
@media(prefers-color-scheme:dark){text{fill:#e6edf3}.paper{fill:#0d1117}.grid{stroke:#30363d}.rest{fill:#30363d}}</style>";

/// An SVG that is being drawn.
pub struct Drawing(String);

impl Drawing {
    /// An empty picture of a size in pixels.
    pub fn new([width, height]: [f64; 2]) -> Self {
        let head = format!("<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\">\n{STYLE}\n");
        Self(head + &format!("<rect class=\"paper\" width=\"{width}\" height=\"{height}\" rx=\"8\"/>\n"))
    }

    /// Adds text. `anchor`: start, middle or end.
    pub fn text(&mut self, words: &str, [x, y]: [f64; 2], size: f64, anchor: &str) {
        let words = words.replace('&', "&amp;").replace('<', "&lt;");
        let _ = writeln!(
            self.0,
            "<text x=\"{x:.1}\" y=\"{y:.1}\" font-size=\"{size:.0}\" text-anchor=\"{anchor}\">{words}</text>"
        );
    }

    /// The title and the remark of a chart. Returns the height that they take.
    fn head(&mut self, title: &str, note: &str) -> f64 {
        self.text(title, [0.5 * SIZE[0], 38.0], 1.1 * FONT, "middle");
        self.text(note, [0.5 * SIZE[0], 70.0], 0.8 * FONT, "middle");
        if note.is_empty() { 56.0 } else { 84.0 }
    }

    fn line(&mut self, [from, to]: [[f64; 2]; 2], attributes: &str) {
        let [[x1, y1], [x2, y2]] = [from, to];
        let _ = writeln!(self.0, "<line x1=\"{x1:.1}\" y1=\"{y1:.1}\" x2=\"{x2:.1}\" y2=\"{y2:.1}\" {attributes}/>");
    }

    fn rect(&mut self, [x, y]: [f64; 2], [width, height]: [f64; 2], attributes: &str) {
        let _ = writeln!(
            self.0,
            "<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{width:.1}\" height=\"{height:.1}\" {attributes}/>"
        );
    }

    /// Adds elements of SVG.
    pub fn raw(&mut self, svg: &str) {
        self.0 += svg;
    }

    /// The picture as SVG.
    pub fn finish(mut self) -> String {
        self.0 += "</svg>\n";
        self.0
    }
}

/// An axis with its range, and its place in the drawing.
struct Scale {
    is_logarithmic: bool,
    range: Range<f64>,
    /// Places of the ends of the range, in pixels.
    ends: [f64; 2],
}

impl Scale {
    fn new(axis: Axis, values: impl Iterator<Item = f64>, ends: [f64; 2]) -> Self {
        let is_logarithmic = axis.is_logarithmic;
        let (min, max) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(min, max), v| (min.min(v), max.max(v)));
        let range = match (min <= max, is_logarithmic) {
            (false, _) => 1.0..10.0,
            (_, true) => min / 1.4..max * 1.4,
            _ => min..max.max(min + 1.0),
        };
        Self { is_logarithmic, range, ends }
    }

    fn place(&self, value: f64) -> f64 {
        let of = |value: f64| if self.is_logarithmic { value.ln() } else { value };
        let part = (of(value) - of(self.range.start)) / (of(self.range.end) - of(self.range.start));
        self.ends[0] + part * (self.ends[1] - self.ends[0])
    }

    /// On a logarithmic axis: the powers of ten, or, if there are fewer than three, also 2 and 5 times the powers. On a linear axis: up to eight equal
    /// steps from zero.
    fn ticks(&self) -> Vec<Tick> {
        let powers = || (-12..=12).map(|power| (1, power));
        let fine = || powers().flat_map(|(_, power)| [1, 2, 5].map(|digit| (digit, power)));
        let inside = |(digit, power): (u32, i32)| {
            let value = f64::from(digit) * 10f64.powi(power);
            (self.range.start <= value && value <= self.range.end * (1.0 + 1e-9)).then_some(Tick { digit, power })
        };
        if self.is_logarithmic {
            let coarse: Vec<Tick> = powers().filter_map(inside).collect();
            return if coarse.len() < 3 { fine().filter_map(inside).collect() } else { coarse };
        }
        // A linear axis starts at zero.
        let step = fine().map(|(digit, power)| Tick { digit, power }).find(|step| self.range.end / step.value() <= 7.0);
        let Some(step) = step else { return Vec::new() };
        let last = (self.range.end / step.value()) as u32;
        (0..=last).map(|number| Tick { digit: number * step.digit, power: step.power }).collect()
    }
}

/// A number of an axis: a whole number times a power of ten.
struct Tick {
    digit: u32,
    power: i32,
}

impl Tick {
    fn value(&self) -> f64 {
        f64::from(self.digit) * 10f64.powi(self.power)
    }

    /// The number without rounding errors.
    fn label(&self) -> String {
        match self.value() {
            v if v >= 1e6 => format!("{:.0} M", v / 1e6),
            v if v >= 1e3 => format!("{:.0} k", v / 1e3),
            v => format!("{v:.*}", self.power.min(0).unsigned_abs() as usize),
        }
    }
}

impl Chart<'_> {
    /// The chart as SVG. Points that do not fit on a logarithmic axis are left out.
    pub fn svg(&self) -> String {
        let [left, right, bottom] = MARGINS;
        let fits = |p: &[f64; 2]| {
            [self.x, self.y].iter().zip(p).all(|(axis, v)| v.is_finite() && (!axis.is_logarithmic || *v > 0.0))
        };
        let points = |curve: &Curve| curve.points.iter().copied().filter(fits).collect::<Vec<_>>();
        let all = || self.curves.iter().flat_map(points);
        let levels = self.curves.iter().filter_map(|curve| curve.level);
        let mut drawing = Drawing::new(SIZE);
        let legend = drawing.head(self.title, self.note);
        let top = legend + ROW * self.curves.len().div_ceil(2) as f64 + 52.0;
        let x = Scale::new(self.x, all().map(|p| p[0]), [left, SIZE[0] - right]);
        let y = Scale::new(self.y, all().map(|p| p[1]).chain(levels), [SIZE[1] - bottom, top]);
        self.draw_legend(&mut drawing, legend);
        self.draw_axes(&mut drawing, &x, &y);
        // Dots would hide long curves.
        let has_dots = self.curves.iter().all(|curve| curve.points.len() < 40);
        for (curve, color) in self.curves.iter().zip(COLORS) {
            let points = points(curve);
            let path: String = points.iter().map(|p| format!("{:.1},{:.1} ", x.place(p[0]), y.place(p[1]))).collect();
            let _ = writeln!(
                drawing.0,
                "<polyline points=\"{}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"3\"/>",
                path.trim_end()
            );
            for p in points.iter().filter(|_| has_dots) {
                let [x, y] = [x.place(p[0]), y.place(p[1])];
                let _ = writeln!(drawing.0, "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"6\" fill=\"{color}\"/>");
            }
            if let Some(level) = curve.level {
                let ends = x.ends.map(|end| [end, y.place(level)]);
                drawing.line(ends, &format!("stroke=\"{color}\" stroke-width=\"3\" stroke-dasharray=\"10 8\""));
            }
        }
        drawing.finish()
    }

    fn draw_legend(&self, drawing: &mut Drawing, top: f64) {
        for (number, (curve, color)) in self.curves.iter().zip(COLORS).enumerate() {
            let at = [24.0 + (number % 2) as f64 * 0.46 * SIZE[0], top + (number / 2) as f64 * ROW + 0.5 * ROW];
            drawing.line([at, [at[0] + 40.0, at[1]]], &format!("stroke=\"{color}\" stroke-width=\"6\""));
            drawing.text(curve.name, [at[0] + 50.0, at[1] + 0.35 * FONT], FONT, "start");
        }
    }

    /// Draws the axes with their grid, and arrows to better values.
    fn draw_axes(&self, drawing: &mut Drawing, x: &Scale, y: &Scale) {
        for tick in x.ticks() {
            let at = x.place(tick.value());
            drawing.line(y.ends.map(|end| [at, end]), "class=\"grid\" stroke-width=\"1.5\"");
            drawing.text(&tick.label(), [at, y.ends[0] + 30.0], FONT, "middle");
        }
        for tick in y.ticks() {
            let at = y.place(tick.value());
            drawing.line(x.ends.map(|end| [end, at]), "class=\"grid\" stroke-width=\"1.5\"");
            drawing.text(&tick.label(), [x.ends[0] - 10.0, at + 0.35 * FONT], FONT, "end");
        }
        let label = |axis: Axis, arrow| {
            if axis.less_is_better { format!("{arrow} better · {}", axis.label) } else { axis.label.into() }
        };
        drawing.text(&label(self.x, '←'), [0.5 * (x.ends[0] + x.ends[1]), SIZE[1] - 16.0], FONT, "middle");
        drawing.text(&label(self.y, '↓'), [24.0, y.ends[1] - 18.0], FONT, "start");
    }
}

impl Bars<'_> {
    /// The bars as SVG, each with its numbers.
    pub fn svg(&self) -> String {
        let (names, row) = (244.0, 44.0);
        let mut drawing = Drawing::new([SIZE[0], 96.0 + row * self.rows.len() as f64]);
        let top = drawing.head(self.title, self.note);
        let width = SIZE[0] - names - 120.0;
        for (number, (name, [part, whole])) in self.rows.iter().enumerate() {
            let y = top + row * number as f64;
            let length = width * *part as f64 / (*whole).max(1) as f64;
            let color = if part == whole { COLORS[0] } else { COLORS[1] };
            drawing.text(name, [names - 12.0, y + 0.5 * row + 0.35 * FONT], FONT, "end");
            drawing.rect([names, y + 6.0], [width, row - 12.0], "class=\"rest\"");
            drawing.rect([names, y + 6.0], [length, row - 12.0], &format!("fill=\"{color}\""));
            let numbers = format!("{part}/{whole}");
            drawing.text(&numbers, [SIZE[0] - 12.0, y + 0.5 * row + 0.35 * FONT], FONT, "end");
        }
        drawing.finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(range: Range<f64>, is_logarithmic: bool) -> Vec<String> {
        Scale { is_logarithmic, range, ends: [0.0, 1.0] }.ticks().iter().map(Tick::label).collect()
    }

    #[test]
    fn ticks_have_short_labels_without_rounding_errors() {
        assert_eq!(labels(0.15..0.9, true), ["0.2", "0.5"]);
        assert_eq!(labels(0.07..2.0, true), ["0.1", "0.2", "0.5", "1", "2"]);
        assert_eq!(labels(0.004..3e6, true), ["0.01", "0.1", "1", "10", "100", "1 k", "10 k", "100 k", "1 M"]);
        assert_eq!(labels(0.0..0.65, false), ["0.0", "0.1", "0.2", "0.3", "0.4", "0.5", "0.6"]);
        assert_eq!(labels(0.0..599.0, false), ["0", "100", "200", "300", "400", "500"]);
    }

    #[test]
    fn points_that_do_not_fit_are_left_out() {
        let axis = Axis { label: "x", less_is_better: true, is_logarithmic: true };
        let points = vec![[1.0, 1.0], [0.0, 1.0], [2.0, f64::NAN], [10.0, 100.0]];
        let curves = vec![Curve { name: "a < b & c", points, level: Some(10.0) }];
        let svg = Chart { title: "title", note: "", x: axis, y: axis, curves }.svg();
        assert_eq!(svg.matches("<circle").count(), 2);
        assert!(svg.contains("a &lt; b &amp; c") && svg.contains("← better · x") && !svg.contains("NaN"), "{svg}");
    }
}
