//! `rebond bsdf`: what a material claims, and whether it holds.

use crate::Failure;
use crate::lobe_plot;
use crate::output::{answer, write_text};
use clap::Args;
use rebond::bsdf::TransportMode;
use rebond::bsdf::check::{Albedo, Effort, LARGEST_ASYMMETRY, LARGEST_DISAGREEMENT, Material, Report};
use rebond::scene::description::{MaterialDescription, MaterialRef};
use rebond::scene::{SceneDescription, material};
use rebond_io::{Error, SceneFiles, SceneSource, from_settings};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

#[derive(Args)]
pub struct Arguments {
    /// A material and its parameters, such as `phong:form=lecture,exponent=60`; or a scene and the name of one of its
    /// materials, such as `glossy-spheres#gold`.
    material: String,
    /// Where to draw the lobe for several directions of light: a file ending in .svg, or a folder for one file of each
    /// kind.
    #[arg(short, long, value_name = "FILE|FOLDER")]
    output: Option<PathBuf>,
    /// Seed of the random numbers.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Print one JSON object with all that was found.
    #[arg(long)]
    json: bool,
}

pub fn run(a: &Arguments) -> Result<(), Failure> {
    let material = open(&a.material)?;
    let outputs = a.output.as_deref().map(outputs).transpose()?.unwrap_or_default();
    let report = material.check(&Effort { seed: a.seed, ..Effort::default() });
    for (path, plot) in &outputs {
        write_text(path, &lobe_plot::svg(&material, &a.material, *plot, lobe_plot::ENGLISH))?;
    }
    if a.json {
        let names: Vec<String> = outputs.iter().map(|(path, _)| path.display().to_string()).collect();
        answer(&as_json(&a.material, &report, &names).to_string())?;
    } else {
        as_table(&a.material, &report).iter().try_for_each(|line| answer(line))?;
        outputs.iter().try_for_each(|(path, _)| answer(&path.display().to_string()))?;
    }
    if report.holds() { Ok(()) } else { Err(Failure::Claims) }
}

/// The material that an argument names or describes.
pub fn open(text: &str) -> Result<Material, Failure> {
    if let Some((scene, name)) = text.rsplit_once('#') {
        let source = SceneSource::open(scene)?;
        return Ok(source.material(name)?);
    }
    let (description, document) = from_settings::<MaterialDescription>(text).map_err(|e| match e.help {
        // Settings hold no tables.
        None if e.message.contains("table") => e.with_help(IN_A_SCENE),
        _ => e,
    })?;
    use MaterialDescription as M;
    let nests = matches!(description, M::Mix { .. } | M::Mask { .. } | M::TwoSided { .. });
    let scene = SceneDescription::default();
    let reference = MaterialRef::Inline(Box::new(description));
    let files = SceneFiles::Folder(PathBuf::new());
    material(&scene, &reference, &files).map_err(|e| {
        let path = e.path.strip_prefix("material").unwrap_or(&e.path).trim_start_matches('.');
        let help = if nests { Some(IN_A_SCENE.into()) } else { e.help };
        Error { help, ..document.error_at(path, e.message) }.into()
    })
}

/// What to do about materials that settings cannot describe.
const IN_A_SCENE: &str = "describe a material that holds images or other materials in a scene, and give SCENE#MATERIAL";

/// The files to draw, and what to draw in each.
fn outputs(path: &Path) -> Result<Vec<(PathBuf, lobe_plot::Plot)>, Failure> {
    use lobe_plot::Plot;
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    if path.is_dir() {
        return Ok(vec![(path.join("polar.svg"), Plot::Polar), (path.join("hemisphere.svg"), Plot::Hemisphere)]);
    }
    if path.extension().is_none_or(|e| !e.eq_ignore_ascii_case("svg")) {
        let message = format!("the output \"{}\" is neither a folder nor an SVG file", path.display());
        return Err(Failure::usage(message, "name a file that ends in .svg, or a folder that exists"));
    }
    if !folder.is_dir() {
        let message = format!("there is no folder \"{}\" for the output \"{}\"", folder.display(), path.display());
        return Err(Failure::usage(message, "create it, or name another place"));
    }
    Ok(vec![(path.to_path_buf(), Plot::Both)])
}

/// What an albedo is the albedo of.
fn side(mode: TransportMode) -> &'static str {
    match mode {
        TransportMode::Importance => "arriving from",
        TransportMode::Radiance => "leaving to",
    }
}

fn of_albedo(a: &Albedo) -> Value {
    json!({ "theta": a.at.theta, "phi": a.at.phi, "light": side(a.mode), "albedo": a.mean, "standard_error": a.error })
}

fn as_json(material: &str, r: &Report, outputs: &[String]) -> Value {
    let (reciprocity, sampling) = (&r.reciprocity, &r.sampling);
    let tests = sampling.tests.iter().map(|t| {
        json!({ "theta": t.at.theta, "phi": t.at.phi, "chi2": t.chi2, "degrees": t.degrees, "p": t.p, "decided": t.decided,
            "integral": t.mass })
    });
    json!({
        "material": material,
        "holds": r.holds(),
        "positivity": {
            "claimed": true, "holds": r.is_positive(), "values": r.positivity.values, "bad": r.positivity.bad,
            "smallest": r.positivity.smallest,
        },
        "reciprocity": {
            "claimed": r.claims.reciprocity, "holds": r.is_reciprocal(), "pairs": reciprocity.pairs,
            "asymmetry": reciprocity.asymmetry,
            "from": { "theta": reciprocity.from.theta, "phi": reciprocity.from.phi },
            "to": { "theta": reciprocity.to.theta, "phi": reciprocity.to.phi },
            "forth": reciprocity.forth, "back": reciprocity.back,
        },
        "energy": {
            "claimed": r.claims.energy, "holds": r.conserves_energy(), "excesses": r.energy.excesses,
            "largest": of_albedo(&r.energy.largest),
            "smallest": of_albedo(&r.energy.smallest),
            "first_excess": r.energy.first_excess.as_ref().map(of_albedo),
            "level": r.energy.level,
            "albedos": r.energy.albedos.iter().map(of_albedo).collect::<Vec<_>>(),
        },
        "sampling": {
            "claimed": true, "holds": r.is_sampled_right(), "failures": sampling.failures,
            "undecided": sampling.undecided, "level": sampling.level,
            "disagreement": sampling.disagreement, "tests": tests.collect::<Vec<_>>(),
        },
        "outputs": outputs,
    })
}

/// A number of so many digits that count.
fn figures(x: f64, digits: usize) -> String {
    let power = x.abs().log10().floor();
    match x.abs() {
        0.0 => "0".into(),
        // Rounding may have carried it to the next power of ten, which is one digit more and no harm.
        0.01..1e6 => format!("{x:.*}", (digits as f64 - 1.0 - power).max(0.0) as usize),
        _ => format!("{x:.*e}", digits - 1),
    }
}

fn as_table(material: &str, r: &Report) -> Vec<String> {
    let yes = |b: bool| if b { "yes" } else { "no" };
    let line = |property: &str, claimed: bool, holds: Option<bool>, words: String| {
        let holds = holds.map_or("not decided", |holds| if holds { "yes" } else { "NO" });
        format!("{property:<12} {:<8} {holds:<12} {words}", yes(claimed))
    };
    let at = |a: &Albedo| format!("light {} {:.1}°", side(a.mode), a.at.theta);
    let mut lines = vec![material.to_string(), String::new()];
    lines.push(format!("{:<12} {:<8} {:<12} figures", "property", "claimed", "holds"));
    let p = &r.positivity;
    let bad = if p.bad > 0 { format!(", {} negative or not finite", p.bad) } else { String::new() };
    lines.push(line(
        "positivity",
        true,
        Some(r.is_positive()),
        format!("{} values, smallest {}{bad}", p.values, p.smallest),
    ));
    let q = &r.reciprocity;
    let words = if r.is_reciprocal() {
        format!("{} pairs, largest asymmetry {:.1e} (up to {LARGEST_ASYMMETRY:e} is rounding)", q.pairs, q.asymmetry)
    } else {
        format!(
            "f from {:.1}° to {:.1}° is {}, back it is {}; asymmetry {}",
            q.from.theta,
            q.to.theta,
            figures(q.forth.into(), 5),
            figures(q.back.into(), 5),
            figures(q.asymmetry, 2)
        )
    };
    lines.push(line("reciprocity", r.claims.reciprocity, Some(r.is_reciprocal()), words));
    let e = &r.energy;
    let words = match &e.first_excess {
        None => format!(
            "albedo from {:.4} ({}) to {:.4} ({})",
            e.smallest.mean,
            at(&e.smallest),
            e.largest.mean,
            at(&e.largest)
        ),
        Some(first) => format!(
            "albedo {:.3} for {}; above 1 from {:.1}° on ({:.3})",
            e.largest.mean,
            at(&e.largest),
            first.at.theta,
            first.mean
        ),
    };
    lines.push(line("energy", r.claims.energy, Some(r.conserves_energy()), words));
    let s = &r.sampling;
    let words = match s.tests.iter().filter(|t| t.decided || s.failures == 0).min_by(|a, b| a.p.total_cmp(&b.p)) {
        None => "specular: every direction is the one there is".into(),
        Some(worst) if s.failures > 0 => format!(
            "{} of {} χ² tests fail; from {:.0}° χ² = {:.0} over {:.0} degrees, p = {:.1e}",
            s.failures,
            s.tests.len(),
            worst.at.theta,
            worst.chi2,
            worst.degrees,
            worst.p
        ),
        Some(_) if s.disagreement > LARGEST_DISAGREEMENT => {
            format!("weights differ from f·cos/pdf by up to {:.1e}", s.disagreement)
        }
        Some(_) if s.undecided > 0 => {
            format!("{} of {} χ² tests: the lobe is narrower than f32 directions resolve", s.undecided, s.tests.len())
        }
        Some(worst) => {
            format!("{} χ² tests, smallest p = {} (level {:.1e})", s.tests.len(), figures(worst.p, 2), s.level)
        }
    };
    lines.push(line("sampling", true, r.is_sampled_right(), words));
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_show_the_digits_that_count() {
        let two = [0.0, 0.0024, 0.0312, 0.4567, 0.02, 1.0].map(|x| figures(x, 2));
        assert_eq!(two, ["0", "2.4e-3", "0.031", "0.46", "0.020", "1.0"]);
        assert_eq!(
            [6203.21, 6202.94, 31.4159, 2e7, 1e-4].map(|x| figures(x, 5)),
            ["6203.2", "6202.9", "31.416", "2.0000e7", "1.0000e-4"]
        );
    }
}
