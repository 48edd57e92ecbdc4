//! Errors of tables against their size, as SVG, both axes logarithmic.

use crate::capture::Row;
use crate::output::bytes;
use std::fmt::Write;

const WIDTH: f64 = 760.0;
const HEIGHT: f64 = 480.0;
/// The frame of the curves: left, top, right, bottom.
const FRAME: [f64; 4] = [90.0, 50.0, 560.0, 400.0];

/// The drawing.
pub fn svg(material: &str, rows: &[Row]) -> String {
    type Error = fn(&Row) -> f64;
    let curves: [(&str, &str, Error); 3] = [
        ("bound for any light", "#0072b2", |r| r.error.mean(|d| d.bound)),
        ("rms of f", "#d55e00", |r| r.error.rms),
        ("under even light", "#009e73", |r| r.error.mean(|d| d.even)),
    ];
    let [left, top, right, bottom] = FRAME;
    let percents: Vec<f64> =
        rows.iter().flat_map(|r| curves.map(|(_, _, f)| 100.0 * f(r))).filter(|e| *e > 0.0).collect();
    let (least, most) = percents.iter().fold((f64::INFINITY, 0.0_f64), |(a, b), e| (a.min(*e), b.max(*e)));
    let (low, high) = if least <= most { (least.log10().floor(), most.log10().ceil()) } else { (-1.0, 0.0) };
    let high = high.max(low + 1.0);
    let size = |r: &Row| (r.bytes as f64).log10();
    let (small, large) = (rows.first().map_or(0.0, size), rows.last().map_or(1.0, size));
    let x = |r: &Row| if large > small { left + (right - left) * (size(r) - small) / (large - small) } else { left };
    let y = |percent: f64| bottom - (bottom - top) * (percent.max(1e-300).log10().max(low) - low) / (high - low);
    let mut out = String::new();
    // Writing to a string cannot fail.
    for decade in low as i32..=high as i32 {
        let (at, label) = (y(10_f64.powi(decade)), format!("{:.*} %", (-decade).max(0) as usize, 10_f64.powi(decade)));
        let _ = writeln!(out, "<line x1=\"{left}\" y1=\"{at:.1}\" x2=\"{right}\" y2=\"{at:.1}\" stroke=\"#ddd\"/>");
        let _ = writeln!(out, "<text x=\"{:.0}\" y=\"{:.1}\" text-anchor=\"end\">{label}</text>", left - 8.0, at + 4.0);
    }
    for r in rows {
        let (at, name) = (x(r), r.size.map(|n| n.to_string()).join("×"));
        let _ = writeln!(out, "<line x1=\"{at:.1}\" y1=\"{top}\" x2=\"{at:.1}\" y2=\"{bottom}\" stroke=\"#ddd\"/>");
        for (line, label) in [bytes(r.bytes as u64), name].iter().enumerate() {
            let below = bottom + 20.0 + 17.0 * line as f64;
            let _ = writeln!(out, "<text x=\"{at:.1}\" y=\"{below}\" text-anchor=\"middle\">{label}</text>");
        }
    }
    for (i, (name, color, f)) in curves.into_iter().enumerate() {
        let points: Vec<(f64, f64)> = rows.iter().map(|r| (x(r), y(100.0 * f(r)))).collect();
        let path: Vec<String> = points.iter().map(|(x, y)| format!("{x:.1},{y:.1}")).collect();
        let _ = writeln!(
            out,
            "<polyline points=\"{}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"2\"/>",
            path.join(" ")
        );
        for (x, y) in points {
            let _ = writeln!(out, "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"4\" fill=\"{color}\"/>");
        }
        let at = top + 20.0 + 24.0 * i as f64;
        let (from, to) = (right + 24.0, right + 46.0);
        let _ = writeln!(
            out,
            "<line x1=\"{from}\" y1=\"{at}\" x2=\"{to}\" y2=\"{at}\" stroke=\"{color}\" stroke-width=\"2\"/>"
        );
        let _ = writeln!(out, "<text x=\"{:.0}\" y=\"{:.0}\">{name}</text>", to + 6.0, at + 4.0);
    }
    let title = material.replace('&', "&amp;").replace('<', "&lt;");
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" width=\"{WIDTH}\" height=\"{HEIGHT}\" \
         font-family=\"sans-serif\" font-size=\"13\">\n<rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n\
         <text x=\"20\" y=\"28\" font-size=\"16\">{title}: error against the size of its table</text>\n{out}\
         <text x=\"{:.0}\" y=\"{:.0}\" text-anchor=\"middle\">bytes, and samples along θi × φi × θo × φo</text>\n</svg>\n",
        (left + right) / 2.0,
        bottom + 64.0
    )
}
