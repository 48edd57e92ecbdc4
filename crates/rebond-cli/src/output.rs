//! What the program says, and the files it writes.

use crate::Failure;
use rebond::film::Image;
use rebond::render::Integrator;
use rebond_io::{ImageFormat, PngOptions, write_image};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

/// The answer, on standard output. A reader that went away is no error.
pub fn answer(text: &str) -> Result<(), Failure> {
    written(writeln!(std::io::stdout().lock(), "{text}"))
}

/// What became of an answer.
pub fn written(outcome: std::io::Result<()>) -> Result<(), Failure> {
    match outcome {
        Err(e) if e.kind() != ErrorKind::BrokenPipe => Err(Failure::Run(format!("cannot write the answer: {e}"))),
        _ => Ok(()),
    }
}

/// Anything else, on standard error.
pub fn note(text: &str) {
    let _ = writeln!(std::io::stderr().lock(), "{text}");
}

/// What an integrator did otherwise than it was asked to, after whose name.
pub fn warn(integrator: &dyn Integrator, whose: &str) {
    integrator.warnings().iter().for_each(|w| note(&format!("warning: {whose}{w}")));
}

/// The formats of these files, and a look at whether they can be written at all, before any work is done.
pub fn check(paths: &[PathBuf]) -> Result<(), Failure> {
    for path in paths {
        let name = path.to_string_lossy();
        let format = ImageFormat::of_name(&name)?;
        if matches!(format, ImageFormat::Jpeg | ImageFormat::Tga) {
            let message = format!("{} is only read, never written", format.name());
            let error = rebond_io::Error::new(message).with_file(name);
            return Err(error.with_help("valid extensions: exr, hdr, pfm, png").into());
        }
        check_place(path)?;
    }
    Ok(())
}

/// The folder to write to, before any work is done.
pub fn make_folder(folder: &Path) -> Result<(), Failure> {
    let shown = folder.display();
    if folder.exists() && !folder.is_dir() {
        return Err(Failure::usage(format!("the output \"{shown}\" is a file"), "name a folder"));
    }
    std::fs::create_dir_all(folder)
        .map_err(|e| Failure::usage(format!("cannot make the folder \"{shown}\": {e}"), "name another place"))
}

/// Whether there may be a file of this name.
pub fn check_place(path: &Path) -> Result<(), Failure> {
    let shown = path.display();
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    if !folder.is_dir() {
        let message = format!("there is no folder \"{}\" for the output \"{shown}\"", folder.display());
        return Err(Failure::usage(message, "create it, or name another place"));
    }
    if path.is_dir() {
        return Err(Failure::usage(format!("the output \"{shown}\" is a folder"), "name a file"));
    }
    Ok(())
}

/// Where layers go that the format of an output cannot hold beside the picture: `box.png` has its layer `caustic` in
/// `box-caustic.png`. Layers and files.
pub fn layer_outputs<'a>(paths: &[PathBuf], layers: impl Iterator<Item = &'a str> + Clone) -> Vec<(String, PathBuf)> {
    let holds_layers = |p: &Path| ImageFormat::of_name(&p.to_string_lossy()).is_ok_and(|f| f == ImageFormat::Exr);
    let of_path = |path: &PathBuf| {
        let (stem, extension) = (path.file_stem().unwrap_or_default(), path.extension().unwrap_or_default());
        let (stem, extension) = (stem.to_string_lossy().into_owned(), extension.to_string_lossy().into_owned());
        let path = path.clone();
        layers.clone().map(move |layer| {
            let safe = layer.replace(|c: char| !c.is_alphanumeric() && !"-_+.".contains(c), "_");
            (layer.to_string(), path.with_file_name(format!("{stem}-{safe}.{extension}")))
        })
    };
    paths.iter().filter(|p| !holds_layers(p)).flat_map(of_path).collect()
}

/// Writes an image to each of the files. If one cannot be written the picture is saved in the folder for temporary
/// files instead, so that no work is lost.
pub fn write(image: &Image, paths: &[PathBuf], png: &PngOptions) -> Result<(), Failure> {
    let mut failed = Vec::new();
    for path in paths {
        if let Err(e) = write_one(image, path, png) {
            failed.push(format!("cannot write \"{}\": {e}", path.display()));
        }
    }
    if failed.is_empty() {
        return Ok(());
    }
    let rescue = std::env::temp_dir().join(format!("rebond-{}.exr", std::process::id()));
    let outcome = match write_one(image, &rescue, png) {
        Ok(()) => format!("the picture was saved as \"{}\"", rescue.display()),
        Err(e) => format!("nor could it be saved as \"{}\": {e}", rescue.display()),
    };
    Err(Failure::Run(format!("{}; {outcome}", failed.join("; "))))
}

/// Writes a text to a file.
pub fn write_text(path: &Path, text: &str) -> Result<(), Failure> {
    write_bytes(path, text.as_bytes()).map_err(|e| Failure::Run(format!("cannot write \"{}\": {e}", path.display())))
}

fn write_one(image: &Image, path: &Path, png: &PngOptions) -> Result<(), String> {
    let format = ImageFormat::of_name(&path.to_string_lossy()).map_err(|e| e.message)?;
    let bytes = write_image(image, format, png).map_err(|e| e.message)?;
    write_bytes(path, &bytes)
}

/// Writes beside the file and renames, so that a failure leaves no half of one.
pub fn write_bytes(path: &Path, bytes: &[u8]) -> Result<(), String> {
    let mut beside = path.as_os_str().to_owned();
    beside.push(".part");
    let written = std::fs::write(&beside, bytes).and_then(|()| std::fs::rename(&beside, path));
    written.map_err(|e| {
        let _ = std::fs::remove_file(&beside);
        e.to_string()
    })
}

/// Lets [`peak_memory_bytes`] begin anew, where the system can.
pub fn forget_peak_memory() {
    // Where it cannot, the peak is that of the whole run.
    let _ = std::fs::write("/proc/self/clear_refs", "5");
}

/// The most memory this process has used, where the system tells.
pub fn peak_memory_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"))?;
    Some(line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()? * 1024)
}

/// The memory that is free to take, where the system tells.
pub fn available_memory_bytes() -> Option<u64> {
    let memory = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = memory.lines().find_map(|l| l.strip_prefix("MemAvailable:"))?;
    Some(line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()? * 1024)
}

/// Bytes as a person reads them.
pub fn bytes(n: u64) -> String {
    let mut x = n as f64;
    for unit in ["B", "kB", "MB"] {
        if x < 1000.0 {
            return if unit == "B" { format!("{n} B") } else { format!("{x:.1} {unit}") };
        }
        x /= 1000.0;
    }
    format!("{x:.2} GB")
}
