//! Renders a scene with the path tracer of `docs/fifty_lines.rs`.
//!
//! ```text
//! cargo run --release -p rebond-io --example fifty_lines [SCENE [SAMPLES]]      writes fifty-lines.png
//! ```

#[path = "../../../docs/fifty_lines.rs"]
mod fifty_lines;

use rebond_io::{ImageFormat, PngOptions, SceneSource, write_image};
use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let source = SceneSource::open(&arguments.next().unwrap_or("cornell-box".into()))?;
    let spp = arguments.next().map_or(Ok(16), |n| n.parse())?;
    let film = &source.description.film;
    let image = fifty_lines::render(&source.build()?, film.width, film.height, spp, 1);
    Ok(std::fs::write("fifty-lines.png", write_image(&image, ImageFormat::Png, &PngOptions::default())?)?)
}
