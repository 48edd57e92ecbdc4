//! `rebond lecture`: the lecture's experiments, recomputed, as one page.
//!
//! A section is one file: what it shows, as a [`Section`] in [`SECTIONS`], and a function that makes its [`Findings`].

mod ambient_occlusion;
mod book;
mod both_ends;
mod camera;
mod direct;
mod direct_errors;
mod language;
mod materials;
mod monte_carlo;
mod page;
mod path_tracing;
mod photons;
mod radiosity;
mod workshop;

pub use workshop::png;

use crate::Failure;
use crate::output::{answer, make_folder, note, write_bytes};
use crate::progress::catch_interrupt;
use clap::Args;
use language::Language;
use page::{Chapter, Findings};
use rebond_io::deserialize::nearest;
use serde_json::{Map, Value, json};
use std::path::PathBuf;
use std::time::Instant;
use workshop::Workshop;

/// A part of the lecture.
struct Section {
    /// Its name on the command line.
    name: &'static str,
    /// In English and in French.
    title: [&'static str; 2],
    /// What it makes, in a few words.
    makes: &'static str,
    /// The files that it is about.
    sources: &'static [&'static str],
    run: fn(&Workshop) -> Result<Findings, Failure>,
}

/// The sections, in the lecture's order.
const SECTIONS: &[Section] = &[
    direct::SECTION,
    materials::SECTION,
    radiosity::SECTION,
    monte_carlo::SECTION,
    ambient_occlusion::SECTION,
    direct_errors::SECTION,
    path_tracing::SECTION,
    camera::SECTION,
    both_ends::SECTION,
    photons::SECTION,
];

#[derive(Args)]
pub struct Arguments {
    /// Only these sections, such as `monte-carlo,direct`; see --list.
    #[arg(long, value_name = "NAME,..", value_delimiter = ',')]
    only: Vec<String>,
    /// Say which sections there are, and what they make.
    #[arg(long)]
    list: bool,
    /// Thumbnails in seconds, small pictures in minutes, or large ones of more samples.
    #[arg(long, value_enum, default_value_t = Quality::Quick)]
    quality: Quality,
    /// Language of the page.
    #[arg(long, value_enum, default_value_t)]
    lang: Language,
    /// Seed of the sample values.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Threads to use [default: all].
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Folder for the page (index.html), its pictures, drawings and numbers; made if there is none.
    #[arg(short, long, value_name = "DIR", default_value = "lecture")]
    output: PathBuf,
    /// Folder for the same as Markdown, the chapters of a book that mdBook builds (docs/book.toml); made if there is none.
    #[arg(long, value_name = "DIR")]
    book: Option<PathBuf>,
    /// No progress and no notes.
    #[arg(long)]
    quiet: bool,
    /// Print one JSON object with all numbers.
    #[arg(long)]
    json: bool,
}

/// How much work to spend.
#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Quality {
    Draft,
    Quick,
    Full,
}

impl Quality {
    fn name(self) -> &'static str {
        match self {
            Self::Draft => "draft",
            Self::Quick => "quick",
            Self::Full => "full",
        }
    }
}

/// The sections of these names, in the lecture's order; all, if there are none.
fn chosen(only: &[String]) -> Result<Vec<&'static Section>, Failure> {
    let names: Vec<&str> = SECTIONS.iter().map(|s| s.name).collect();
    for name in only {
        if !names.contains(&name.as_str()) {
            let list = names.join(", ");
            let help = match nearest(name, &names) {
                Some(near) => format!("did you mean \"{near}\"? sections: {list}"),
                None => format!("sections: {list}"),
            };
            return Err(Failure::usage(format!("there is no section \"{name}\""), help));
        }
    }
    Ok(SECTIONS.iter().filter(|s| only.is_empty() || only.iter().any(|name| name == s.name)).collect())
}

pub fn run(a: &Arguments) -> Result<(), Failure> {
    let sections = chosen(&a.only)?;
    if a.list {
        return list(&sections, a.json);
    }
    if let Some(folder) = a.book.as_deref().filter(|f| f.join("README.md").exists() && !f.join("SUMMARY.md").exists()) {
        let message = format!("\"{}\" has a README.md that is of no book, and would be overwritten", folder.display());
        return Err(Failure::usage(message, "give another folder to --book, such as docs/book"));
    }
    make_folder(&a.output)?;
    a.book.as_deref().map_or(Ok(()), make_folder)?;
    catch_interrupt();
    let threads = a.threads.map_or_else(|| std::thread::available_parallelism().map_or(1, |n| n.get()), usize::from);
    let workshop = Workshop::new(a.quality, a.lang, a.seed, threads, a.quiet);
    let (mut chapters, mut numbers, mut outcome) = (Vec::new(), Map::new(), Ok(()));
    for section in sections {
        let start = Instant::now();
        match (section.run)(&workshop) {
            Ok(mut findings) => {
                let seconds = start.elapsed().as_secs_f64();
                findings.number("seconds", seconds);
                if !a.quiet {
                    note(&format!("{}: {seconds:.1} s", section.name));
                }
                numbers.insert(section.name.into(), Value::Object(findings.numbers.clone()));
                let command = workshop.command_of(section.name);
                let (name, title, sources) = (section.name, a.lang.say(section.title), section.sources);
                chapters.push(Chapter { name, title, command, sources, findings });
            }
            // What is done by then is still written.
            Err(Failure::Interrupted) => {
                outcome = Err(Failure::Interrupted);
                break;
            }
            Err(e) => return Err(e),
        }
    }
    let dropped = workshop.dropped_samples();
    if dropped > 0 && !a.quiet {
        note(&format!("warning: {dropped} samples were not finite, or too bright for a film, and count as black"));
    }
    let mut numbers = json!({ "quality": a.quality.name(), "seed": a.seed, "threads": threads,
        "dropped_samples": dropped, "sections": numbers });
    let names = write(a, &chapters, &numbers, &workshop.made())?;
    if a.json {
        numbers["outputs"] = json!(names);
        answer(&numbers.to_string())?;
    } else {
        // The page is first; the rest lies beside it.
        names.iter().take(1).try_for_each(|n| answer(n))?;
    }
    outcome
}

fn list(sections: &[&Section], as_json: bool) -> Result<(), Failure> {
    if as_json {
        let one = |s: &&Section| json!({ "name": s.name, "title": s.title[0], "makes": s.makes });
        return answer(&Value::from(sections.iter().map(one).collect::<Vec<_>>()).to_string());
    }
    sections.iter().try_for_each(|s| answer(&format!("{:<18} {}", s.name, s.makes)))
}

/// Writes the page and what lies beside it, and the book if it is asked for; returns the names.
fn write(a: &Arguments, chapters: &[Chapter], numbers: &Value, made: &str) -> Result<Vec<String>, Failure> {
    let beside: Vec<(String, Vec<u8>)> = chapters.iter().flat_map(|c| c.findings.files()).collect();
    let mut files = vec![
        (a.output.join("index.html"), page::html(chapters, made, a.lang).into_bytes()),
        (a.output.join("numbers.json"), format!("{numbers:#}\n").into_bytes()),
    ];
    if let Some(book) = &a.book {
        let texts = book::files(chapters, made, a.lang);
        files.extend(texts.into_iter().map(|(name, text)| (book.join(name), text.into_bytes())));
        let pictures = beside.iter().filter(|(name, _)| !name.ends_with(".csv"));
        files.extend(pictures.map(|(name, bytes)| (book.join(name), bytes.clone())));
    }
    files.extend(beside.into_iter().map(|(name, bytes)| (a.output.join(name), bytes)));
    for (path, bytes) in &files {
        write_bytes(path, bytes).map_err(|e| Failure::Run(format!("cannot write \"{}\": {e}", path.display())))?;
    }
    Ok(files.iter().map(|(path, _)| path.display().to_string()).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sections_are_named_once_and_found() {
        let all = chosen(&[]).ok().expect("all");
        assert_eq!(all.len(), SECTIONS.len());
        for section in SECTIONS {
            let found = chosen(&[section.name.to_owned()]).ok().expect(section.name);
            assert_eq!(found.iter().map(|s| s.name).collect::<Vec<_>>(), [section.name]);
            assert!(!section.makes.is_empty() && section.title[0] != section.title[1]);
            // What it says that it is about is there.
            let workspace = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
            assert!(!section.sources.is_empty());
            assert!(section.sources.iter().all(|file| workspace.join(file).exists()), "{}", section.name);
        }
    }
}
