//! Curves over the frames of a scene, as SVG.

use plotters::prelude::*;

/// A value of each frame.
pub struct Curve<'a> {
    pub name: &'a str,
    /// Frames and values. Values of 0 or less are left out, because the axis is logarithmic.
    pub points: Vec<(f64, f64)>,
    /// A constant to compare the curve with, drawn as a line of dashes in the same colour.
    pub level: Option<f64>,
}

/// Okabe and Ito's blue, orange, green and purple, which colour-blind readers can distinguish.
const COLORS: [RGBColor; 4] =
    [RGBColor(0, 114, 178), RGBColor(213, 94, 0), RGBColor(0, 158, 115), RGBColor(204, 121, 167)];

const SIZE: (u32, u32) = (900, 540);
const FONT: f64 = 22.0;

/// Draws up to four curves with a logarithmic value axis. `y` names the values.
///
/// # Errors
/// Errors of the drawing back end.
pub fn over_frames(title: &str, y: &str, curves: &[Curve]) -> Result<String, Box<dyn std::error::Error>> {
    let positive = |curve: &Curve| curve.points.iter().copied().filter(|p| p.1 > 0.0).collect::<Vec<_>>();
    let values = || curves.iter().flat_map(|curve| positive(curve).into_iter().map(|p| p.1).chain(curve.level));
    let (min, max) = values().fold((f64::INFINITY, 0.0f64), |(min, max), v| (min.min(v), max.max(v)));
    let range = if min <= max { min / 1.5..max * 1.5 } else { 0.1..10.0 };
    let last = curves.iter().flat_map(|curve| &curve.points).map(|p| p.0).fold(1.0, f64::max);
    let mut text = String::new();
    {
        let root = SVGBackend::with_string(&mut text, SIZE).into_drawing_area();
        root.fill(&WHITE)?;
        let mut chart = ChartBuilder::on(&root)
            .caption(title, ("sans-serif", FONT * 1.1))
            .margin(12)
            .x_label_area_size(56)
            .y_label_area_size(96)
            .build_cartesian_2d(0.0..last, range.log_scale())?;
        chart
            .configure_mesh()
            .x_desc("frame")
            .y_desc(y)
            .x_labels(7)
            .x_label_formatter(&|frame| format!("{frame:.0}"))
            .y_label_formatter(&|value| format!("{value}"))
            .label_style(("sans-serif", FONT * 0.85))
            .axis_desc_style(("sans-serif", FONT))
            .max_light_lines(0)
            .bold_line_style(RGBColor(215, 215, 215))
            .draw()?;
        for (curve, color) in curves.iter().zip(COLORS) {
            chart
                .draw_series(LineSeries::new(positive(curve), color.stroke_width(3)))?
                .label(curve.name)
                .legend(move |(x, y)| PathElement::new([(x, y), (x + 28, y)], color.stroke_width(4)));
            if let Some(level) = curve.level {
                let dashes = DashedLineSeries::new([(0.0, level), (last, level)], 10, 8, color.stroke_width(2));
                chart.draw_series(dashes)?;
            }
        }
        chart
            .configure_series_labels()
            .position(SeriesLabelPosition::UpperRight)
            .background_style(WHITE.mix(0.85))
            .border_style(RGBColor(160, 160, 160))
            .label_font(("sans-serif", FONT * 0.9))
            .draw()?;
        root.present()?;
    }
    Ok(text)
}
