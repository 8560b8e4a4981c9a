//! Plots that are readable at the width of a README: few large marks, distinguished by shape and by colour.
//!
//! The colours are those of Okabe and Ito ("Color Universal Design", 2008), which remain distinct for common kinds of
//! colour blindness. Shapes make them distinct in print.

mod raster;

use std::ops::Range;

use anyhow::{Result, anyhow};
use image::RgbImage;
use plotters::coord::Shift;
use plotters::coord::ranged1d::{DefaultFormatting, KeyPointHint, Ranged};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use self::raster::Raster;

/// One plot, with a name for its file.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Plot {
    /// The file's name, after the study's.
    pub name: String,
    /// One line above the plot.
    pub title: String,
    /// The horizontal axis.
    pub x: Axis,
    /// The vertical axis.
    pub y: Axis,
    /// The series, in the order of the legend.
    pub series: Vec<Series>,
    /// Points of the Pareto front with labels, joined by a line.
    pub front: Vec<Mark>,
    /// Vertical lines with labels.
    pub guides: Vec<(f64, String)>,
    /// Whether the legend is at the upper left, where rising series leave space, or at the upper right.
    pub rises: bool,
    /// Space above the series for the legend, as a share of their height.
    pub headroom: f64,
}

/// An axis of a plot.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Axis {
    /// Quantity and unit.
    pub label: String,
    /// Logarithmic scale; values that are not above 0 are dropped.
    pub log: bool,
}

impl Axis {
    /// A linear axis.
    pub fn linear(label: &str) -> Self {
        Self { label: label.to_owned(), log: false }
    }

    /// A logarithmic axis.
    pub fn log(label: &str) -> Self {
        Self { label: label.to_owned(), log: true }
    }
}

/// One series of points.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Series {
    /// Name in the legend.
    pub name: String,
    /// The points as (x, y).
    pub points: Vec<(f64, f64)>,
    /// Whether a line joins the points.
    pub line: bool,
}

/// A point with a label.
#[derive(Debug, Clone, PartialEq)]
pub struct Mark {
    /// The point as (x, y).
    pub at: (f64, f64),
    /// The label.
    pub label: String,
}

const SIZE: (u32, u32) = (900, 560);
const COLORS: [RGBColor; 7] = [
    RGBColor(0, 0, 0),
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
];

/// The range of an axis. Positions are values after [`Self::at`], so a logarithmic axis becomes linear.
#[derive(Clone)]
struct Scale {
    log: bool,
    least: f64,
    most: f64,
}

impl Scale {
    fn over(axis: &Axis, values: impl Iterator<Item = f64>) -> Self {
        let log = axis.log;
        let usable = |v: &f64| v.is_finite() && (!log || *v > 0.0);
        let mapped = values.filter(usable).map(|v| if log { v.log10() } else { v });
        let (least, most) = mapped.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
        if !(least <= most) {
            return Self { log, least: 0.0, most: 1.0 };
        }
        // Space for marks and labels. A linear axis starts at 0, so that heights can be compared.
        let least = if log { least } else { least.min(0.0) };
        let room = (most - least).max(if log { 0.2 } else { 1e-9 * most.abs().max(1e-9) }) * 0.08;
        Self { log, least: if log { least - room } else { least }, most: most + room }
    }

    fn at(&self, value: f64) -> Option<f64> {
        let mapped = if self.log { value.log10() } else { value };
        mapped.is_finite().then_some(mapped)
    }

    /// Positions of round values within the axis.
    fn ticks(&self) -> Vec<f64> {
        let inside = |at: &f64| (self.least..=self.most).contains(at);
        if !self.log {
            let step = round_step((self.most - self.least) / 6.0);
            let first = (self.least / step).ceil() as i64;
            return (first..).map(|i| i as f64 * step).take_while(|at| *at <= self.most).collect();
        }
        let decades = self.least.floor() as i32..=self.most.ceil() as i32;
        let digits: &[f64] = if self.most - self.least > 2.0 { &[1.0] } else { &[1.0, 2.0, 5.0] };
        decades.flat_map(|d| digits.iter().map(move |m| f64::from(d) + m.log10())).filter(inside).collect()
    }

    fn label(&self, at: f64) -> String {
        let value = if self.log { 10f64.powf(at) } else { at };
        let rounded = (value * 1e6).round() / 1e6;
        format!("{rounded}")
    }
}

impl Ranged for Scale {
    type FormatOption = DefaultFormatting;
    type ValueType = f64;

    fn map(&self, at: &f64, (first, last): (i32, i32)) -> i32 {
        first + ((at - self.least) / (self.most - self.least) * f64::from(last - first)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        if hint.weight().allow_light_points() { Vec::new() } else { self.ticks() }
    }

    fn range(&self) -> Range<f64> {
        self.least..self.most
    }
}

/// The smallest of 1, 2 or 5 times a power of ten that is at least `step`.
fn round_step(step: f64) -> f64 {
    if !(step > 0.0) {
        return 1.0;
    }
    let decade = 10f64.powf(step.log10().floor());
    [1.0, 2.0, 5.0, 10.0].into_iter().map(|m| m * decade).find(|s| *s >= step * 0.999).unwrap_or(step)
}

impl Plot {
    /// The plot as SVG text.
    ///
    /// # Errors
    /// An error of the drawing library.
    pub fn svg(&self) -> Result<String> {
        let mut text = String::new();
        {
            let area = SVGBackend::with_string(&mut text, SIZE).into_drawing_area();
            self.draw(&area).map_err(|error| anyhow!("cannot draw {}: {error}", self.name))?;
        }
        Ok(text)
    }

    /// The plot as an image of the same size.
    ///
    /// # Errors
    /// An error of the drawing library.
    pub fn image(&self) -> Result<RgbImage> {
        let mut image = RgbImage::new(SIZE.0, SIZE.1);
        let area = Raster(&mut image).into_drawing_area();
        self.draw(&area).map_err(|error| anyhow!("cannot draw {}: {error}", self.name))?;
        drop(area);
        Ok(image)
    }

    fn draw<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> Result<(), Box<dyn std::error::Error>>
    where
        B::ErrorType: 'static,
    {
        let points = || self.series.iter().flat_map(|series| &series.points);
        let guides = self.guides.iter().map(|guide| guide.0);
        let x = Scale::over(&self.x, points().map(|p| p.0).chain(guides));
        let y = Scale::over(&self.y, points().map(|p| p.1));
        let y = Scale { most: y.most + self.headroom * (y.most - y.least), ..y };
        let place = |&(px, py): &(f64, f64)| Some((x.at(px)?, y.at(py)?));
        area.fill(&WHITE)?;
        let mut chart = ChartBuilder::on(area)
            .caption(&self.title, ("sans-serif", 22))
            .margin(12)
            .x_label_area_size(52)
            .y_label_area_size(72)
            .build_cartesian_2d(x.clone(), y.clone())?;
        chart
            .configure_mesh()
            .x_desc(self.x.label.as_str())
            .y_desc(self.y.label.as_str())
            .axis_desc_style(("sans-serif", 18))
            .label_style(("sans-serif", 16))
            .x_label_formatter(&|at| x.label(*at))
            .y_label_formatter(&|at| y.label(*at))
            .light_line_style(TRANSPARENT)
            .bold_line_style(BLACK.mix(0.12))
            .draw()?;
        let small = ("sans-serif", 15).into_font();
        for (at, word) in &self.guides {
            let Some(at) = x.at(*at) else { continue };
            chart.draw_series(DashedLineSeries::new(
                [(at, y.least), (at, y.most)],
                6,
                5,
                BLACK.mix(0.6).into(),
            ))?;
            let style = small.clone().color(&BLACK.mix(0.7)).pos(Pos::new(HPos::Left, VPos::Top));
            let top = EmptyElement::at((at, y.most)) + Text::new(word.clone(), (5, 4), style);
            chart.draw_series([top])?;
        }
        let front: Vec<(f64, f64)> = self.front.iter().filter_map(|mark| place(&mark.at)).collect();
        if !front.is_empty() {
            let style = BLACK.mix(0.45).stroke_width(2);
            chart
                .draw_series(LineSeries::new(front.iter().copied(), style))?
                .label("Pareto front")
                .legend(move |(x, y)| PathElement::new([(x, y), (x + 20, y)], style));
        }
        for (i, series) in self.series.iter().enumerate() {
            let color = COLORS[i % COLORS.len()];
            let placed: Vec<(f64, f64)> = series.points.iter().filter_map(place).collect();
            if series.line {
                chart.draw_series(LineSeries::new(placed.iter().copied(), color.stroke_width(2)))?;
            }
            let marks = placed.iter().map(|&at| EmptyElement::at(at) + mark(i, (0, 0), 5, color.mix(0.8)));
            chart
                .draw_series(marks)?
                .label(&series.name)
                .legend(move |(x, y)| mark(i, (x + 10, y), 6, color.mix(0.9)));
        }
        let mut worded: Option<(f64, f64)> = None;
        for Mark { at, label } in &self.front {
            let Some(at) = place(at) else { continue };
            // Labels go beyond the front, where there are no points. Close neighbours share a label.
            let apart = |last: (f64, f64)| {
                (at.0 - last.0).abs() > 0.12 * (x.most - x.least)
                    || (at.1 - last.1).abs() > 0.03 * (y.most - y.least)
            };
            if !worded.is_none_or(apart) {
                continue;
            }
            worded = Some(at);
            // A label at the left border goes to the right, or it would leave the plot.
            let near = at.0 < x.least + 0.2 * (x.most - x.least);
            let (right, side) = if near { (8, HPos::Left) } else { (-8, HPos::Right) };
            let style = small.clone().color(&BLACK).pos(Pos::new(side, VPos::Top));
            chart.draw_series([EmptyElement::at(at) + Text::new(label.clone(), (right, 2), style)])?;
        }
        chart
            .configure_series_labels()
            .position(if self.rises {
                SeriesLabelPosition::UpperLeft
            } else {
                SeriesLabelPosition::UpperRight
            })
            .background_style(WHITE.mix(0.85))
            .border_style(BLACK.mix(0.3))
            .label_font(("sans-serif", 16))
            .draw()?;
        area.present()?;
        Ok(())
    }
}

/// Plots below one another as SVG text, each of its own size.
///
/// # Errors
/// An error of the drawing library.
pub fn stacked_svg(plots: &[Plot]) -> Result<String> {
    let mut text = String::new();
    stack(plots, SVGBackend::with_string(&mut text, stacked_size(plots)))?;
    Ok(text)
}

/// Plots below one another as an image of the same size as [`stacked_svg`].
///
/// # Errors
/// An error of the drawing library.
pub fn stacked_image(plots: &[Plot]) -> Result<RgbImage> {
    let (width, height) = stacked_size(plots);
    let mut image = RgbImage::new(width, height);
    stack(plots, Raster(&mut image))?;
    Ok(image)
}

/// Height of a plot among others, pixels.
const STACKED_HEIGHT: u32 = 400;

fn stacked_size(plots: &[Plot]) -> (u32, u32) {
    (SIZE.0, STACKED_HEIGHT * plots.len().max(1) as u32)
}

fn stack<B: DrawingBackend>(plots: &[Plot], backend: B) -> Result<()>
where
    B::ErrorType: 'static,
{
    let areas = backend.into_drawing_area().split_evenly((plots.len().max(1), 1));
    plots.iter().zip(&areas).try_for_each(|(plot, area)| {
        plot.draw(area).map_err(|error| anyhow!("cannot draw {}: {error}", plot.name))
    })
}

/// The shape of the `index`-th series.
fn mark(index: usize, (x, y): (i32, i32), size: i32, color: RGBAColor) -> Polygon<(i32, i32)> {
    let ring = |corners: u32, turn: f64, size: f64| -> Vec<(i32, i32)> {
        (0..corners)
            .map(|k| {
                let angle = (f64::from(k) / f64::from(corners) + turn) * std::f64::consts::TAU;
                (x + (size * angle.sin()).round() as i32, y - (size * angle.cos()).round() as i32)
            })
            .collect()
    };
    let size = f64::from(size);
    let corners = match index % 7 {
        0 => ring(4, 0.125, size * 1.3),
        1 => ring(16, 0.0, size),
        2 => ring(3, 0.0, size * 1.4),
        3 => ring(4, 0.0, size * 1.4),
        4 => ring(3, 0.5, size * 1.4),
        5 => ring(5, 0.0, size * 1.2),
        _ => ring(6, 0.0, size),
    };
    Polygon::new(corners, color.filled())
}

/// Indices of the points that no other point beats in both coordinates, by ascending x; lower is better. Points with
/// NaN are left out.
pub fn pareto_front(points: &[(f64, f64)]) -> Vec<usize> {
    let mut order: Vec<usize> =
        (0..points.len()).filter(|&i| points[i].0.is_finite() && points[i].1.is_finite()).collect();
    order.sort_by(|&a, &b| points[a].0.total_cmp(&points[b].0).then(points[a].1.total_cmp(&points[b].1)));
    let mut best = f64::INFINITY;
    order.retain(|&i| {
        let better = points[i].1 < best;
        best = best.min(points[i].1);
        better
    });
    order
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_front_has_exactly_the_points_that_no_other_beats() {
        let points = [(2.0, 2.0), (1.0, 3.0), (3.0, 2.0), (4.0, 1.0), (0.5, f64::NAN), (1.0, 2.9)];
        assert_eq!(pareto_front(&points), vec![5, 0, 3]);
        assert!(pareto_front(&[]).is_empty());
    }

    #[test]
    fn empty_single_and_infinite_series_are_drawn() {
        let series =
            |points: &[(f64, f64)]| Series { name: "a<b".to_owned(), points: points.to_vec(), line: true };
        for points in [
            &[][..],
            &[(1.0, 1.0)],
            &[(0.0, 0.0), (f64::NAN, 1.0), (f64::INFINITY, 2.0)],
            &[(1.0, 0.03), (2000.0, 0.07)],
        ] {
            for log in [false, true] {
                let axis = Axis { label: "ms".to_owned(), log };
                let front = points.iter().map(|&at| Mark { at, label: "x".to_owned() }).collect();
                let plot = Plot {
                    x: axis.clone(),
                    y: axis,
                    series: vec![series(points)],
                    front,
                    guides: vec![(0.5, "floor".to_owned())],
                    ..Plot::default()
                };
                let svg = plot.svg().unwrap();
                assert!(svg.starts_with("<svg") && svg.contains("a&lt;b") && !svg.contains("NaN"), "{svg}");
                let image = plot.image().unwrap();
                assert!(
                    image.pixels().any(|pixel| pixel.0 == [0; 3]) && image.pixels().any(|p| p.0 == [255; 3])
                );
            }
        }
    }

    #[test]
    fn stacked_plots_share_one_picture() {
        let plot = |title: &str| Plot {
            title: title.to_owned(),
            series: vec![Series { name: "a".to_owned(), points: vec![(0.0, -0.1), (1.0, 2.0)], line: true }],
            ..Plot::default()
        };
        let plots = [plot("first"), plot("second")];
        let svg = stacked_svg(&plots).unwrap();
        assert!(svg.contains("first") && svg.contains("second") && svg.matches("<svg").count() == 1);
        assert_eq!(stacked_image(&plots).unwrap().dimensions(), (900, 800));
    }

    #[test]
    fn ticks_are_round_and_within_the_axis() {
        let scale = Scale { log: true, least: 0.1, most: 1.9 };
        let shown: Vec<String> = scale.ticks().iter().map(|&at| scale.label(at)).collect();
        assert_eq!(shown, ["2", "5", "10", "20", "50"]);
        let scale = Scale { log: false, least: 0.0, most: 0.11 };
        let shown: Vec<String> = scale.ticks().iter().map(|&at| scale.label(at)).collect();
        assert_eq!(shown, ["0", "0.02", "0.04", "0.06", "0.08", "0.1"]);
    }
}
