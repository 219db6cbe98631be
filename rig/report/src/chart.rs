//! One plot as inline SVG.
//!
//! Series keep to the few colours named here, because the style sheet finds them again: it maps them for dark
//! screens and dashes what is simulated.

use maud::{Markup, PreEscaped, html};
use plotters::prelude::*;

/// Measured: blue, solid.
pub(super) const MEASURED: RGBColor = RGBColor(0x1f, 0x5f, 0xbf);
/// Simulated: red, dashed by the style sheet.
pub(super) const SIMULATED: RGBColor = RGBColor(0xd0, 0x35, 0x2b);
/// One colour a keypoint, in turn.
pub(super) const KEYPOINTS: [RGBColor; 6] = [
    RGBColor(0x2a, 0x78, 0xb8),
    RGBColor(0xd9, 0x7b, 0x13),
    RGBColor(0x2f, 0x8f, 0x4e),
    RGBColor(0x8a, 0x54, 0xb0),
    RGBColor(0xa8, 0x5a, 0x3c),
    RGBColor(0x5c, 0x6b, 0x77),
];
const AXIS: RGBColor = RGBColor(0x44, 0x44, 0x44);
const GRID: RGBColor = RGBColor(0xdd, 0xdd, 0xdd);
const BAND: RGBColor = RGBColor(0x99, 0x99, 0x99);

/// Canvas units per pixel of the page: plotters places points on whole units.
const SCALE: u32 = 4;
/// plotters divides font sizes by this when it writes SVG.
const FONT_FACTOR: f64 = 1.24;
/// A line with more points than this is thinned to the extremes of as many intervals.
const LINE_POINTS_MAX: usize = 1600;

/// A line; a point that is not finite interrupts it.
pub(super) struct Series {
    /// (abscissa, ordinate).
    pub(super) points: Vec<(f64, f64)>,
    /// One of the colours above.
    pub(super) colour: RGBColor,
    /// 0 to 1.
    pub(super) opacity: f64,
    /// Line width \[px\].
    pub(super) width: f64,
}

impl Series {
    pub(super) fn line(points: Vec<(f64, f64)>, colour: RGBColor) -> Self {
        Self { points, colour, opacity: 1.0, width: 1.4 }
    }
}

/// A plot: lines over a plane, with axes.
#[derive(Default)]
pub(super) struct Chart {
    /// Above the plot.
    pub(super) title: String,
    /// Below the horizontal axis.
    pub(super) x_label: String,
    /// Beside the vertical axis.
    pub(super) y_label: String,
    /// Size on the page \[px\].
    pub(super) size: (u32, u32),
    /// One unit is as long on either axis.
    pub(super) equal_axes: bool,
    /// Shaded between minus and plus this.
    pub(super) band: Option<f64>,
    /// Vertical marks.
    pub(super) marks: Vec<f64>,
    /// Drawn in order.
    pub(super) series: Vec<Series>,
    /// Dots drawn over the lines.
    pub(super) dots: Vec<((f64, f64), RGBColor)>,
}

impl Chart {
    /// Inline SVG; nothing when no point is finite.
    pub(super) fn svg(&self) -> Markup {
        let Some(ranges) = self.ranges() else { return html! {} };
        let mut svg = String::new();
        match self.draw(&mut svg, ranges) {
            Ok(()) => html! { (PreEscaped(svg)) },
            Err(why) => html! { p.missing { "This figure could not be drawn: " (why) } },
        }
    }

    fn points(&self) -> impl Iterator<Item = (f64, f64)> {
        let lines = self.series.iter().flat_map(|s| s.points.iter().copied());
        lines.chain(self.dots.iter().map(|&(p, _)| p)).filter(|p| p.0.is_finite() && p.1.is_finite())
    }

    fn ranges(&self) -> Option<[(f64, f64); 2]> {
        let mut ranges = [(f64::INFINITY, f64::NEG_INFINITY); 2];
        for (x, y) in self.points() {
            for (range, value) in ranges.iter_mut().zip([x, y]) {
                *range = (range.0.min(value), range.1.max(value));
            }
        }
        if ranges[0].0 > ranges[0].1 {
            return None;
        }
        if let Some(half) = self.band.filter(|half| half.is_finite()) {
            ranges[1] = (ranges[1].0.min(-1.25 * half), ranges[1].1.max(1.25 * half));
        }
        if self.equal_axes {
            let (width, height) = self.plot_size();
            let span = |r: (f64, f64)| (r.1 - r.0).max(1e-9) * 1.1;
            let per_pixel = (span(ranges[0]) / width).max(span(ranges[1]) / height);
            for (range, pixels) in ranges.iter_mut().zip([width, height]) {
                let middle = 0.5 * (range.0 + range.1);
                let half = 0.5 * per_pixel * pixels;
                *range = (middle - half, middle + half);
            }
        } else {
            let (low, high) = ranges[1];
            let margin = if high > low { 0.06 * (high - low) } else { high.abs().max(1.0) * 0.05 };
            ranges[1] = (low - margin, high + margin);
            if ranges[0].0 == ranges[0].1 {
                ranges[0] = (ranges[0].0 - 0.5, ranges[0].1 + 0.5);
            }
        }
        Some(ranges)
    }

    /// Left, right, top, bottom \[px\] taken by labels.
    fn insets(&self) -> [u32; 4] {
        let top = if self.title.is_empty() { 8 } else { 24 };
        let bottom = if self.x_label.is_empty() { 22 } else { 38 };
        [58, 12, top, bottom]
    }

    fn plot_size(&self) -> (f64, f64) {
        let [left, right, top, bottom] = self.insets();
        (f64::from(self.size.0 - left - right), f64::from(self.size.1 - top - bottom))
    }

    fn draw(&self, svg: &mut String, [x, y]: [(f64, f64); 2]) -> Result<(), Box<dyn std::error::Error + '_>> {
        let px = |pixels: u32| pixels * SCALE;
        let font = |pixels: f64, colour: RGBColor| {
            ("sans-serif", pixels * FONT_FACTOR * f64::from(SCALE)).into_font().color(&colour)
        };
        let thin = |colour: RGBColor| colour.stroke_width(SCALE);
        let root = SVGBackend::with_string(svg, (px(self.size.0), px(self.size.1))).into_drawing_area();
        let [left, right, top, bottom] = self.insets();
        let middle = i32::try_from(px(left) + (px(self.size.0 - left - right)) / 2)?;
        let title = font(12.5, AXIS).pos(plotters::style::text_anchor::Pos::new(
            plotters::style::text_anchor::HPos::Center,
            plotters::style::text_anchor::VPos::Top,
        ));
        root.draw(&Text::new(self.title.clone(), (middle, i32::try_from(px(4))?), title))?;
        let mut chart = ChartBuilder::on(&root)
            .margin_top(px(top))
            .margin_right(px(right))
            .margin_left(px(if self.y_label.is_empty() { 0 } else { 4 }))
            .set_label_area_size(LabelAreaPosition::Left, px(left - 4))
            .set_label_area_size(LabelAreaPosition::Bottom, px(bottom))
            .build_cartesian_2d(x.0..x.1, y.0..y.1)?;
        let (wide, high) = self.plot_size();
        let (ticks_x, ticks_y) = ((wide / 70.0) as usize + 2, (high / 32.0) as usize + 2);
        chart
            .configure_mesh()
            .x_labels(ticks_x)
            .y_labels(ticks_y)
            .x_label_formatter(&|v| tick(*v, x.1 - x.0))
            .y_label_formatter(&|v| tick(*v, y.1 - y.0))
            .light_line_style(TRANSPARENT)
            .bold_line_style(thin(GRID))
            .axis_style(thin(AXIS))
            .label_style(font(11.0, AXIS))
            .axis_desc_style(font(11.5, AXIS))
            .x_desc(self.x_label.as_str())
            .y_desc(self.y_label.as_str())
            .draw()?;
        if let Some(half) = self.band.filter(|half| half.is_finite()) {
            chart.draw_series([Rectangle::new([(x.0, -half), (x.1, half)], BAND.mix(0.22).filled())])?;
        }
        for &mark in self.marks.iter().filter(|m| (x.0..x.1).contains(*m)) {
            chart.draw_series(LineSeries::new([(mark, y.0), (mark, y.1)], BAND.stroke_width(SCALE)))?;
        }
        for series in &self.series {
            let style =
                series.colour.mix(series.opacity).stroke_width((series.width * f64::from(SCALE)) as u32);
            for line in unbroken(&series.points) {
                chart.draw_series(LineSeries::new(thinned(line), style))?;
            }
        }
        for &(point, colour) in &self.dots {
            if point.0.is_finite() && point.1.is_finite() {
                chart.draw_series([Circle::new(point, 3 * SCALE, colour.filled())])?;
            }
        }
        root.present()?;
        Ok(())
    }
}

/// A tick label with just the decimals that a range of `span` needs.
fn tick(value: f64, span: f64) -> String {
    let decimals = (1.0 - span.log10().floor()).clamp(0.0, 9.0) as usize;
    let text = format!("{value:.decimals$}");
    let text = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    if text == "-0" { "0".into() } else { text.replace('-', "−") }
}

/// The stretches between points that are not finite.
fn unbroken(points: &[(f64, f64)]) -> impl Iterator<Item = &[(f64, f64)]> {
    points.split(|p| !(p.0.is_finite() && p.1.is_finite())).filter(|part| !part.is_empty())
}

/// At most about [`LINE_POINTS_MAX`] points that keep every extreme: the lowest and highest of each interval, in
/// order of time.
fn thinned(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    if points.len() <= LINE_POINTS_MAX {
        return points.to_vec();
    }
    let size = points.len().div_ceil(LINE_POINTS_MAX / 2);
    points
        .chunks(size)
        .flat_map(|chunk| {
            let by_height = |a: &&(f64, f64), b: &&(f64, f64)| a.1.total_cmp(&b.1);
            let extremes = [chunk.iter().min_by(by_height), chunk.iter().max_by(by_height)];
            let mut kept: Vec<_> = extremes.into_iter().flatten().copied().collect();
            kept.sort_by(|a, b| a.0.total_cmp(&b.0));
            kept
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thinning_keeps_a_single_spike() {
        let mut points: Vec<_> = (0..100_000).map(|i| (f64::from(i), 0.0)).collect();
        points[77_777].1 = 5.0;
        let kept = thinned(&points);
        assert!(kept.len() <= LINE_POINTS_MAX + 2, "{}", kept.len());
        assert!(kept.contains(&(77_777.0, 5.0)));
        assert!(kept.windows(2).all(|w| w[0].0 <= w[1].0));
    }

    #[test]
    fn gaps_interrupt_a_line() {
        let gap = (1.0, f64::NAN);
        let parts: Vec<_> =
            unbroken(&[(0.0, 0.0), gap, gap, (2.0, 1.0), (3.0, 1.0)]).map(<[_]>::len).collect();
        assert_eq!(parts, [1, 2]);
    }

    #[test]
    fn equal_axes_give_a_metre_the_same_length_on_both() {
        let chart = Chart {
            size: (400, 300),
            equal_axes: true,
            series: vec![Series::line(vec![(0.0, 0.0), (1.0, 0.2)], MEASURED)],
            ..Chart::default()
        };
        let [x, y] = chart.ranges().unwrap();
        let (width, height) = chart.plot_size();
        assert!(((x.1 - x.0) / width - (y.1 - y.0) / height).abs() < 1e-12);
    }

    #[test]
    fn chart_without_a_finite_point_is_left_out() {
        let chart = Chart {
            size: (400, 300),
            series: vec![Series::line(vec![(0.0, f64::NAN)], MEASURED)],
            ..Chart::default()
        };
        assert_eq!(chart.svg().into_string(), "");
    }
}
