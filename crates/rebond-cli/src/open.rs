//! Opening scenes, other programs' among them; `rebond convert`.

use crate::Failure;
use crate::output::{answer, note};
use clap::Args;
use rebond_io::{ImportOptions, SceneSource, convert};
use std::path::PathBuf;

/// How another program's scene is opened.
#[derive(Args)]
pub struct ImportArguments {
    /// Of another program's scene, leave out what is not supported, with a warning.
    #[arg(long)]
    lenient: bool,
    /// Let another program's scene open files outside of its folder.
    #[arg(long)]
    allow_outside: bool,
}

/// Opens a scene and tells, unless quiet, what of it is not as it was.
pub fn open(scene: &str, import: &ImportArguments, quiet: bool) -> Result<SceneSource, Failure> {
    let options = ImportOptions { lenient: import.lenient, allow_outside: import.allow_outside };
    let source = SceneSource::open_with(scene, options)?;
    if !quiet {
        source.warnings.iter().for_each(|w| note(&format!("warning: {w}")));
    }
    Ok(source)
}

#[derive(Args)]
pub struct ConvertArguments {
    /// A built-in scene, a .toml file or another program's scene.
    scene: String,
    /// The TOML file to write; meshes and images go to a folder beside it.
    out: PathBuf,
    #[command(flatten)]
    import: ImportArguments,
    /// No warnings.
    #[arg(long)]
    quiet: bool,
}

pub fn run(a: &ConvertArguments) -> Result<(), Failure> {
    if a.out.extension().is_none_or(|e| !e.eq_ignore_ascii_case("toml")) {
        let message = format!("\"{}\" is no name of a scene file", a.out.display());
        return Err(Failure::usage(message, "give a name that ends in .toml"));
    }
    let source = open(&a.scene, &a.import, a.quiet)?;
    // What cannot be built is not worth writing.
    source.build()?;
    let written = convert(&source, &a.out).map_err(|e| match e.help {
        // Something else is to be asked for.
        Some(_) => Failure::from(e),
        None => Failure::Run(e.to_string()),
    })?;
    written.iter().try_for_each(|path| answer(&path.display().to_string()))
}
