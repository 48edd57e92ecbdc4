//! Charts, as SVG: curves over axes that are linear or logarithmic, drawn by plotters.

use plotters::coord::Shift;
use plotters::coord::combinators::LogCoord;
use plotters::coord::ranged1d::{AsRangedCoord, DefaultFormatting, KeyPointHint, Ranged, ValueFormatter};
use plotters::prelude::*;
use std::fmt::Write;

const SIZE: (u32, u32) = (760, 440);
/// Colours that the colour-blind can tell apart (Okabe and Ito 2008), readable on white and on black.
const COLORS: [RGBColor; 7] = [
    RGBColor(0x00, 0x7f, 0xc4),
    RGBColor(0xd5, 0x5e, 0x00),
    RGBColor(0x00, 0x9e, 0x73),
    RGBColor(0xcc, 0x79, 0xa7),
    RGBColor(0xe6, 0x9f, 0x00),
    RGBColor(0x56, 0xb4, 0xe9),
    RGBColor(0x80, 0x80, 0x80),
];
/// The last of the colours, for what theory says.
pub const GREY: usize = COLORS.len() - 1;

/// How a curve is drawn.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Mark {
    Line,
    Dashes,
    LineAndDots,
}

pub struct Curve {
    pub name: String,
    pub mark: Mark,
    pub color: usize,
    pub points: Vec<[f64; 2]>,
}

/// What lies between two curves: x, and from where to where.
pub struct Band {
    pub name: String,
    pub color: usize,
    pub points: Vec<[f64; 3]>,
}

pub struct Axis {
    pub label: &'static str,
    pub log: bool,
    /// From where to where; as the curves need it if not given.
    pub range: Option<[f64; 2]>,
}

/// The corner in which curves are named.
#[derive(Clone, Copy, Default)]
pub enum Legend {
    #[default]
    UpperRight,
    UpperLeft,
    LowerLeft,
}

pub struct Chart {
    pub title: String,
    pub x: Axis,
    pub y: Axis,
    pub bands: Vec<Band>,
    pub curves: Vec<Curve>,
    pub legend: Legend,
}

type Outcome = Result<(), DrawingAreaErrorKind<std::io::Error>>;

impl Axis {
    fn range(&self, values: impl Iterator<Item = f64>) -> [f64; 2] {
        if let Some(range) = self.range {
            return range;
        }
        let values = values.filter(|v| v.is_finite() && (!self.log || *v > 0.0));
        let [a, b] = values.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], v| [a.min(v), b.max(v)]);
        match (a < b, self.log) {
            (true, true) => [a / (b / a).powf(0.04), b * (b / a).powf(0.04)],
            (true, false) => [a - 0.04 * (b - a), b + 0.04 * (b - a)],
            (false, _) if a.is_finite() && a != 0.0 => [a - 0.5 * a.abs(), a + 0.5 * a.abs()],
            _ => [0.1, 1.0],
        }
    }
}

/// A logarithmic axis, on which plotters marks some places twice: those from the tenfold of a power of ten on, and those of the next
/// power.
struct Powers(LogCoord<f64>);

impl Powers {
    fn new(range: [f64; 2]) -> Self {
        Self((range[0]..range[1]).log_scale().into())
    }
}

impl Ranged for Powers {
    type FormatOption = DefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, limit: (i32, i32)) -> i32 {
        self.0.map(value, limit)
    }

    fn key_points<H: KeyPointHint>(&self, hint: H) -> Vec<f64> {
        let mut points = self.0.key_points(hint);
        points.sort_by(f64::total_cmp);
        points.dedup_by(|b, a| (*b / *a - 1.0).abs() < 1e-9);
        points
    }

    fn range(&self) -> std::ops::Range<f64> {
        self.0.range()
    }
}

/// A number on an axis, as short as it goes.
fn label(x: f64) -> String {
    match x.abs() {
        0.0 => "0".into(),
        1e-3..1e6 => format!("{}", (x * 1e6).round() / 1e6),
        // As many digits as tell neighbours apart.
        _ => format!("{:e}", format!("{x:.2e}").parse::<f64>().unwrap_or(x)),
    }
}

impl Chart {
    pub fn svg(&self) -> String {
        let values = |k: usize| {
            let of_curves = self.curves.iter().flat_map(move |c| c.points.iter().map(move |p| p[k]));
            let of_bands = self.bands.iter().flat_map(move |b| b.points.iter().flat_map(move |p| [p[k], p[k + k]]));
            of_curves.chain(of_bands)
        };
        let (x, y) = (self.x.range(values(0)), self.y.range(values(1)));
        let whole = |[from, to]: [f64; 2]| from..to;
        let mut out = String::new();
        let drawn = {
            let root = SVGBackend::with_string(&mut out, SIZE).into_drawing_area();
            match (self.x.log, self.y.log) {
                (false, false) => self.draw(&root, whole(x), whole(y)),
                (true, false) => self.draw(&root, Powers::new(x), whole(y)),
                (false, true) => self.draw(&root, whole(x), Powers::new(y)),
                (true, true) => self.draw(&root, Powers::new(x), Powers::new(y)),
            }
        };
        debug_assert!(drawn.is_ok(), "writing to a string cannot fail");
        out
    }

    fn draw<X, Y>(&self, root: &DrawingArea<SVGBackend<'_>, Shift>, x: X, y: Y) -> Outcome
    where
        X: AsRangedCoord<Value = f64>,
        Y: AsRangedCoord<Value = f64>,
        X::CoordDescType: Ranged<ValueType = f64> + ValueFormatter<f64>,
        Y::CoordDescType: Ranged<ValueType = f64> + ValueFormatter<f64>,
    {
        root.fill(&WHITE)?;
        let mut chart = ChartBuilder::on(root)
            .caption(&self.title, ("sans-serif", 18))
            .margin(12)
            .margin_right(30)
            .x_label_area_size(46)
            .y_label_area_size(74)
            .build_cartesian_2d(x, y)?;
        let grey = COLORS[GREY];
        // There is nothing between whole quantities.
        let whole = !self.x.log && self.curves.iter().flat_map(|c| &c.points).all(|p| p[0].fract() == 0.0);
        chart
            .configure_mesh()
            .x_desc(self.x.label)
            .y_desc(self.y.label)
            .label_style(("sans-serif", 14))
            .bold_line_style(grey.mix(0.35))
            .light_line_style(grey.mix(0.12))
            .max_light_lines(4)
            .x_label_formatter(&|x| if whole && x.fract().abs() > 1e-9 { String::new() } else { label(*x) })
            .y_label_formatter(&|y| label(*y))
            .draw()?;
        for band in &self.bands {
            let color = COLORS[band.color % COLORS.len()];
            let back = band.points.iter().rev().map(|p| (p[0], p[2]));
            let outline: Vec<(f64, f64)> = band.points.iter().map(|p| (p[0], p[1])).chain(back).collect();
            chart
                .draw_series(std::iter::once(Polygon::new(outline, color.mix(0.25))))?
                .label(&band.name)
                .legend(move |(x, y)| Rectangle::new([(x, y - 5), (x + 22, y + 5)], color.mix(0.25).filled()));
        }
        for curve in &self.curves {
            let color = COLORS[curve.color % COLORS.len()];
            let points = || curve.points.iter().map(|p| (p[0], p[1]));
            let line = color.stroke_width(2);
            let series = match curve.mark {
                Mark::Dashes => chart.draw_series(DashedLineSeries::new(points(), 6, 5, line))?,
                Mark::Line | Mark::LineAndDots => chart.draw_series(LineSeries::new(points(), line))?,
            };
            let mark = curve.mark;
            // A curve without a name stands for itself.
            if !curve.name.is_empty() {
                series.label(&curve.name).legend(move |(x, y)| {
                    let dash = if mark == Mark::Dashes { 8 } else { 22 };
                    PathElement::new(vec![(x, y), (x + dash, y)], line)
                });
            }
            if curve.mark == Mark::LineAndDots {
                chart.draw_series(points().map(|p| Circle::new(p, 3, color.filled())))?;
            }
        }
        chart
            .configure_series_labels()
            .position(match self.legend {
                Legend::UpperRight => SeriesLabelPosition::UpperRight,
                Legend::UpperLeft => SeriesLabelPosition::UpperLeft,
                Legend::LowerLeft => SeriesLabelPosition::LowerLeft,
            })
            .label_font(("sans-serif", 14))
            .legend_area_size(30)
            .margin(8)
            .background_style(WHITE.mix(0.85))
            .border_style(grey.mix(0.4))
            .draw()?;
        root.present()
    }

    /// The numbers: one line a point.
    pub fn csv(&self) -> String {
        let mut out = String::from("curve,x,y\n");
        for curve in &self.curves {
            for [x, y] in &curve.points {
                // Writing to a string cannot fail.
                let _ = writeln!(out, "{},{x},{y}", quoted(&curve.name));
            }
        }
        out
    }
}

/// A cell of a CSV file (RFC 4180).
pub fn quoted(text: &str) -> String {
    if text.contains(['"', ',', '\n']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text.into() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chart(log: bool, points: &[[f64; 2]]) -> Chart {
        let axis = || Axis { label: "a & b", log, range: None };
        let curve = |mark| Curve { name: "a, \"b\" <c>".into(), mark, color: 0, points: points.to_vec() };
        let curves = [Mark::Line, Mark::Dashes, Mark::LineAndDots].map(curve).into();
        Chart { title: "<t>".into(), x: axis(), y: axis(), bands: vec![], curves, legend: Legend::LowerLeft }
    }

    #[test]
    fn charts_are_drawn_whatever_the_points() {
        for log in [false, true] {
            for points in [vec![], vec![[0.0, 0.0]], vec![[1.0, 1.0]; 2], vec![[1.0, 1e-9], [1e6, 1e9]]] {
                let svg = chart(log, &points).svg();
                assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"), "{points:?}");
                assert!(svg.contains("&lt;t&gt;") && !svg.contains("<t>") && !svg.contains("NaN"), "{points:?}");
            }
        }
    }

    #[test]
    fn no_mark_of_an_axis_is_there_twice() {
        for range in [[1.0, 100.0], [0.5, 300.0], [1.0, 64.0], [1e-3, 2.0], [1e-6, 1e3], [3.0, 30.0]] {
            for marks in [5, 11, 50, 400] {
                let points = Powers::new(range).key_points(marks);
                let mut labels: Vec<String> = points.iter().map(|x| label(*x)).collect();
                let count = labels.len();
                assert!(count > 0, "{range:?}, {marks}");
                labels.sort();
                labels.dedup();
                assert_eq!(labels.len(), count, "{range:?}, {marks}: {points:?}");
            }
        }
        // Seen in a chart: what is written along the axes.
        let axis = |label| Axis { label, log: true, range: Some([1.0, 100.0]) };
        let svg = Chart { x: axis("x"), y: axis("y"), ..chart(true, &[[1.0, 1.0], [100.0, 100.0]]) }.svg();
        assert_eq!(svg.lines().filter(|l| l.trim() == "10").count(), 2, "{svg}");
    }

    #[test]
    fn numbers_are_kept_whole() {
        let csv = chart(false, &[[0.1, 1.0 / 3.0]]).csv();
        assert!(csv.starts_with("curve,x,y\n\"a, \"\"b\"\" <c>\",0.1,0.3333333333333333\n"), "{csv}");
        assert_eq!([0.0, 1e-9, 0.25, 4096.0, 1e7].map(label), ["0", "1e-9", "0.25", "4096", "1e7"]);
        assert_eq!([1.5e-4, 2e-4].map(label), ["1.5e-4", "2e-4"]);
    }
}
