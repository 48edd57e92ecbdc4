//! `rebond capture`: a virtual gonioreflectometer.

use crate::Failure;
use crate::bsdf::open;
use crate::capture_plot;
use crate::output::{answer, bytes, check_place, write_bytes, write_text};
use clap::Args;
use rebond::bsdf::capture::{CaptureError, CaptureSettings, DirectionError, capture, error, is_isotropic};
use rebond::bsdf::check::Material;
use rebond::bsdf::measured::AngleTable;
use rebond_io::write_table;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

#[derive(Args)]
pub struct Arguments {
    /// A material and its parameters, such as `phong:exponent=60`; or a scene and the name of one of its materials, such as
    /// `glossy-spheres#gold`.
    material: String,
    /// Samples along θi, φi, θo and φo of light and viewer; one φi says that turning both about the normal changes nothing,
    /// and φo counts from φi. Or samples along θ, of which φ gets twice as many. 90,1,90,180 if not given, or 24,48,24,48 for
    /// what is anisotropic.
    #[arg(short, long, value_name = "N|N,N,N,N")]
    resolution: Option<String>,
    /// The table, a file ending in .safetensors.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Draw the errors of tables of several resolutions: a file ending in .svg.
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
    /// Random directions to average each value over; with 0 a value is that at its very angles.
    #[arg(long, default_value_t = 0, value_name = "N")]
    samples: u32,
    /// Standard deviation of the error that the instrument makes, over the value.
    #[arg(long, default_value_t = 0.0, value_name = "SHARE")]
    noise: f32,
    /// Seed of the random numbers.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Write over files that exist.
    #[arg(long)]
    force: bool,
    /// Print one JSON object with all that was found.
    #[arg(long)]
    json: bool,
}

/// Directions of the viewer in which tables are compared with the material.
const DIRECTIONS: u32 = 90;

/// A table and what it gets wrong.
pub struct Row {
    pub size: [u32; 4],
    pub bytes: usize,
    pub error: CaptureError,
}

pub fn run(a: &Arguments) -> Result<(), Failure> {
    let material = open(&a.material)?;
    check_output(&a.output, "safetensors", a.force)?;
    if let Some(plot) = &a.plot {
        check_output(plot, "svg", a.force)?;
    }
    let size = match &a.resolution {
        Some(text) => resolution(text, || is_isotropic(&material, a.seed))?,
        None if is_isotropic(&material, a.seed) => [90, 1, 90, 180],
        None => [24, 48, 24, 48],
    };
    let help = if material.is_partly_specular() || material.transmits() {
        "tables hold what is reflected over a range of directions: rough metal, plastic, diffuse and the like"
    } else {
        "give another --resolution, or another --noise"
    };
    let refuse = |problem: String| Failure::usage(format!("\"{}\" is not captured: {problem}", a.material), help);
    let of = |size: [u32; 4]| {
        let settings = CaptureSettings { size, samples: a.samples, noise: a.noise, seed: a.seed };
        let table = capture(&material, &settings).map_err(refuse)?;
        let row =
            Row { size, bytes: table.bytes(), error: error(&material, &table, DIRECTIONS, a.seed).map_err(refuse)? };
        Ok::<(AngleTable, Row), Failure>((table, row))
    };
    let (table, finest) = of(size)?;
    let mut rows = vec![finest];
    for divisor in [2, 4, 8] {
        let coarser = size.map(|n| n.div_ceil(divisor));
        // No coarser than a sample every 45°, and nothing twice.
        if coarser[0] < 2 || coarser[2] < 2 {
            break;
        }
        rows.push(of(coarser)?.1);
    }
    rows.reverse();
    let file = write_table(&table, &a.material);
    write_bytes(&a.output, &file).map_err(|e| Failure::Run(format!("cannot write \"{}\": {e}", a.output.display())))?;
    if let Some(plot) = &a.plot {
        write_text(plot, &capture_plot::svg(&a.material, &rows))?;
    }
    if a.json {
        answer(&as_json(a, &material, &rows, file.len()).to_string())?;
    } else {
        as_table(a, &rows, file.len()).iter().try_for_each(|line| answer(line))?;
    }
    Ok(())
}

/// A look at whether a file can be written, before any work is done, without losing one that is there.
pub fn check_output(path: &Path, extension: &str, force: bool) -> Result<(), Failure> {
    let shown = path.display();
    if path.extension().is_none_or(|e| !e.eq_ignore_ascii_case(extension)) {
        let help = format!("name a file that ends in .{extension}");
        return Err(Failure::usage(format!("the output \"{shown}\" does not end in .{extension}"), help));
    }
    check_place(path)?;
    if path.exists() && !force {
        return Err(Failure::usage(
            format!("the output \"{shown}\" exists"),
            "name another, or give --force to write over it",
        ));
    }
    Ok(())
}

/// `N` or `THETA_I,PHI_I,THETA_O,PHI_O`.
fn resolution(text: &str, isotropic: impl Fn() -> bool) -> Result<[u32; 4], Failure> {
    let numbers: Option<Vec<u32>> = text.split(',').map(|n| n.trim().parse().ok().filter(|n| *n > 0)).collect();
    match numbers.as_deref() {
        Some(&[n]) if n <= 1 << 20 => Ok([n, if isotropic() { 1 } else { 2 * n }, n, 2 * n]),
        Some(&[a, b, c, d]) => Ok([a, b, c, d]),
        _ => {
            let help = "give samples along θi, φi, θo and φo, such as 90,1,90,180; or one number for all";
            Err(Failure::usage(format!("\"{text}\" is no resolution"), help))
        }
    }
}

fn even(d: &DirectionError) -> f64 {
    d.even
}

fn bound(d: &DirectionError) -> f64 {
    d.bound
}

fn as_json(a: &Arguments, material: &Material, rows: &[Row], file_bytes: usize) -> Value {
    let direction = |d: &DirectionError| json!({ "theta": d.at.theta, "phi": d.at.phi, "albedo": d.albedo, "even_light": d.even, "bound": d.bound });
    let tables = rows.iter().map(|r| {
        json!({
            "resolution": r.size, "bytes": r.bytes, "rms": r.error.rms,
            "even_light": r.error.mean(even), "even_light_largest": r.error.largest(even).map(direction),
            "bound": r.error.mean(bound), "bound_largest": r.error.largest(bound).map(direction),
            "directions": r.error.directions.iter().map(direction).collect::<Vec<_>>(),
        })
    });
    let outputs: Vec<String> =
        [Some(&a.output), a.plot.as_ref()].into_iter().flatten().map(|p| p.display().to_string()).collect();
    json!({
        "material": a.material,
        "isotropic": is_isotropic(material, a.seed),
        "samples": a.samples,
        "noise": a.noise,
        "file_bytes": file_bytes,
        "tables": tables.collect::<Vec<_>>(),
        "outputs": outputs,
    })
}

fn as_table(a: &Arguments, rows: &[Row], file_bytes: usize) -> Vec<String> {
    let percent = |x: f64| format!("{:.3} %", 100.0 * x);
    let mut lines = vec![a.material.clone(), String::new()];
    let row = |cells: [String; 7]| {
        let [size, bytes, rms, even, even_most, bound, bound_most] = cells;
        format!("{size:<18} {bytes:>9} {rms:>10} {even:>10} {even_most:>20} {bound:>10} {bound_most:>20}")
    };
    let titles = ["θi × φi × θo × φo", "bytes", "rms", "even light", "at most", "bound", "at most"];
    lines.push(row(titles.map(String::from)));
    for r in rows {
        let most = |f: fn(&DirectionError) -> f64| {
            let d = r.error.largest(f);
            d.map_or(String::new(), |d| format!("{} at {:.0}°", percent(f(d)), d.at.theta))
        };
        lines.push(row([
            r.size.map(|n| n.to_string()).join(" × "),
            bytes(r.bytes as u64),
            percent(r.error.rms),
            percent(r.error.mean(even)),
            most(even),
            percent(r.error.mean(bound)),
            most(bound),
        ]));
    }
    lines.push(String::new());
    lines.push(
        "rms: of f, weighted by both cosines, over the material's own. even light: error of what is reflected where"
            .into(),
    );
    lines.push(
        "light is the same from everywhere. bound: the most that any light can make of it, times the brightest".into(),
    );
    lines.push(
        "radiance, over the albedo. Both are means over the hemisphere of viewers; at most: for the viewer at θo."
            .into(),
    );
    lines.push(String::new());
    lines.push(format!("{} ({})", a.output.display(), bytes(file_bytes as u64)));
    lines.extend(a.plot.iter().map(|p| p.display().to_string()));
    lines
}
