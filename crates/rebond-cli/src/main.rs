//! The `rebond` program: arguments, progress, reports.

mod bsdf;
mod capture;
mod capture_plot;
mod compare;
mod diff;
mod judge;
mod lecture;
mod list;
mod lobe_plot;
mod open;
mod output;
mod page;
mod plot;
mod progress;
mod pyramid;
mod radiosity;
mod render;
mod trace;

use clap::{Parser, Subcommand};
use std::process::ExitCode;

#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

/// A physically based renderer that proves its answer right.
#[derive(Parser)]
#[command(name = "rebond", version, about, max_term_width = 110)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Render a scene to image files.
    Render(render::Arguments),
    /// Run several integrators on a scene, and show on one page how wrong each still is.
    Compare(compare::Arguments),
    /// Tell what became of one path, vertex by vertex.
    Trace(trace::Arguments),
    /// Measure how far apart two images are.
    Diff(diff::Arguments),
    /// Check that a material is what it claims to be, and draw its lobe.
    Bsdf(bsdf::Arguments),
    /// Tabulate a material as `f_r[θi][φi][θo][φo][colour]`, and say what the table gets wrong.
    Capture(capture::Arguments),
    /// Solve a scene by radiosity: save it, relight it, bake it.
    Radiosity(radiosity::Arguments),
    /// Recompute the lecture's experiments, as one page.
    Lecture(lecture::Arguments),
    /// List the built-in scenes.
    Scenes(list::JsonFlag),
    /// Say what a scene is made of.
    Info(list::InfoArguments),
    /// Write a scene as TOML, with its meshes and images beside it.
    Convert(open::ConvertArguments),
    /// List the integrators and their settings.
    Integrators(list::JsonFlag),
}

/// Why a command did not do what it should.
enum Failure {
    /// Bad usage or a bad scene: exit code 2.
    Input(Box<rebond_io::Error>),
    /// The run failed: exit code 1.
    Run(String),
    /// A material is not what it claims to be, as has been said: exit code 1.
    Claims,
    /// Interrupted; what was rendered is written: exit code 130.
    Interrupted,
}

impl From<rebond_io::Error> for Failure {
    fn from(e: rebond_io::Error) -> Self {
        Self::Input(Box::new(e))
    }
}

impl Failure {
    /// Bad usage, with advice.
    fn usage(message: impl Into<String>, help: impl Into<String>) -> Self {
        Self::from(rebond_io::Error::new(message).with_help(help))
    }
}

fn main() -> ExitCode {
    let outcome = match Arguments::try_parse().map(|a| a.command) {
        Ok(Command::Render(a)) => render::run(&a),
        Ok(Command::Compare(a)) => compare::run(&a),
        Ok(Command::Trace(a)) => trace::run(&a),
        Ok(Command::Diff(a)) => diff::run(&a),
        Ok(Command::Bsdf(a)) => bsdf::run(&a),
        Ok(Command::Capture(a)) => capture::run(&a),
        Ok(Command::Radiosity(a)) => radiosity::run(&a),
        Ok(Command::Lecture(a)) => lecture::run(&a),
        Ok(Command::Scenes(a)) => list::scenes(&a),
        Ok(Command::Info(a)) => list::info(&a),
        Ok(Command::Convert(a)) => open::run(&a),
        Ok(Command::Integrators(a)) => list::integrators(&a),
        Err(e) if e.use_stderr() => e.exit(),
        // What was asked for is the help, or the version.
        Err(e) => output::written(e.print()),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(Failure::Input(error)) => {
            output::note(error.snippet().trim_end());
            ExitCode::from(2)
        }
        Err(Failure::Run(message)) => {
            output::note(&format!("error: {message}"));
            ExitCode::from(1)
        }
        Err(Failure::Claims) => ExitCode::from(1),
        Err(Failure::Interrupted) => {
            output::note("interrupted");
            ExitCode::from(130)
        }
    }
}
