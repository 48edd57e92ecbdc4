//! `rebond diff`.

use crate::Failure;
use crate::judge::t_tests;
use crate::output::{answer, check, write};
use clap::Args;
use rebond::compare::{PIXELS_PER_DEGREE, Pair, Welch};
use rebond::film::Image;
use rebond_io::{PngOptions, read_image};
use serde_json::json;
use std::path::{Path, PathBuf};

/// Side of the blocks that the t-test compares, and its level.
const BLOCK: u32 = 8;
const LEVEL: f64 = 0.01;

#[derive(Args)]
pub struct Arguments {
    /// The image taken for right (.exr .hdr .pfm .png .jpg).
    reference: PathBuf,
    /// The image to be judged.
    image: PathBuf,
    /// Write FLIP's map of the visible differences here.
    #[arg(long, value_name = "FILE")]
    flip_map: Option<PathBuf>,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

fn read(path: &Path) -> Result<Image, Failure> {
    let name = path.display().to_string();
    let bytes = std::fs::read(path).map_err(|e| rebond_io::Error::new(format!("cannot read \"{name}\": {e}")))?;
    Ok(read_image(&bytes, &name)?)
}

fn colours(image: &Image, path: &Path) -> Result<Vec<[f32; 3]>, Failure> {
    let missing = || Failure::usage(format!("\"{}\" has no colour channels", path.display()), "compare pictures");
    image.rgb("").ok_or_else(missing)
}

pub fn run(a: &Arguments) -> Result<(), Failure> {
    if let Some(path) = &a.flip_map {
        check(std::slice::from_ref(path))?;
    }
    let (reference, image) = (read(&a.reference)?, read(&a.image)?);
    if (reference.width, reference.height) != (image.width, image.height) {
        let size = |i: &Image| format!("{}x{}", i.width, i.height);
        let message = format!("the images have different sizes, {} and {}", size(&reference), size(&image));
        return Err(Failure::usage(message, "compare images of one size"));
    }
    let (r, t) = (colours(&reference, &a.reference)?, colours(&image, &a.image)?);
    let pair = Pair::new(&r, &t, image.width, image.height)
        .map_err(|e| Failure::usage(e.to_string(), "compare finite pictures"))?;
    let flip = pair.flip(PIXELS_PER_DEGREE);
    let tests = t_tests(&reference, &image, BLOCK, LEVEL);
    let errors = [
        ("mse", pair.mse()),
        ("rmse", pair.rmse()),
        ("rel_mse", pair.rel_mse(0.0)),
        ("rel_mse_trimmed", pair.rel_mse(0.001)),
        ("flip", flip.mean),
        ("hdr_flip", pair.hdr_flip(PIXELS_PER_DEGREE).mean),
    ];
    let bias = pair.mean_signed_error();
    if a.json {
        let mut object = serde_json::Map::new();
        errors.iter().for_each(|(name, value)| drop(object.insert(name.to_string(), json!(value))));
        object.insert("mean_signed_error".into(), json!(bias));
        let test = |(c, w): &(&str, Welch)| {
            json!({ "channel": c, "blocks": w.tested, "significant": w.significant, "below_level": w.below_alpha,
                "below_level_p": w.below_alpha_p, "level": w.alpha, "passes": w.passes() })
        };
        object.insert("welch".into(), json!(tests.as_ref().map(|t| t.iter().map(test).collect::<Vec<_>>())));
        answer(&serde_json::Value::Object(object).to_string())?;
    } else {
        let names = ["MSE", "RMSE", "relMSE", "relMSE without the worst 0.1 %", "FLIP", "HDR-FLIP"];
        let mut rows = names.iter().zip(&errors);
        rows.try_for_each(|(name, (_, value))| answer(&format!("{name:<32} {value:.6e}")))?;
        answer(&format!("{:<32} {:+.6e} {:+.6e} {:+.6e}", "mean signed error (R, G, B)", bias[0], bias[1], bias[2]))?;
        match &tests {
            None => answer("Welch t-test                     not possible: needs two EXR files with variance")?,
            Some(tests) => tests.iter().try_for_each(|(c, w)| {
                let verdict = if w.passes() { "agree" } else { "differ" };
                let counts = format!(
                    "{} of {} blocks below {LEVEL} (p = {:.2e}), {} significant",
                    w.below_alpha, w.tested, w.below_alpha_p, w.significant
                );
                answer(&format!("{:<32} {verdict}: {counts}", format!("Welch t-test, {c}")))
            })?,
        }
    }
    match &a.flip_map {
        None => Ok(()),
        Some(path) => {
            let map: Vec<[f32; 3]> = flip.map.iter().map(|e| [*e; 3]).collect();
            write(&Image::from_rgb(image.width, image.height, &map), std::slice::from_ref(path), &PngOptions::default())
        }
    }
}
