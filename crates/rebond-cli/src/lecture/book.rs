//! The same findings as the sources of a book for mdBook: a chapter for each section, its pictures beside it.
//!
//! Formulas are MathML, as on the page, so that the book needs no script and asks nobody for anything.

use super::language::{Language, pieces};
use super::page::{Block, Chapter, Picture, TITLE, command, formula};
use crate::page::Table;
use maud::html;
use std::fmt::Write;

/// The chapters as files: name and content. Pictures are those of [`super::page::Findings::files`].
pub fn files(chapters: &[Chapter], made: &str, language: Language) -> Vec<(String, String)> {
    let title = language.say(TITLE);
    let mut summary = format!("# {title}\n\n[{title}](README.md)\n\n");
    let mut front = format!("# {title}\n\n{}\n\n", escaped(&language.set(made)));
    let mut files = Vec::new();
    for c in chapters {
        // Writing to a string cannot fail.
        let _ = writeln!(summary, "- [{}]({}.md)", c.title, c.name);
        let _ = writeln!(front, "- [{}]({}.md)", c.title, c.name);
        files.push((format!("{}.md", c.name), chapter(c, language)));
    }
    files.push(("README.md".into(), front));
    files.push(("SUMMARY.md".into(), summary));
    files
}

fn chapter(c: &Chapter, language: Language) -> String {
    let sources: Vec<String> = c.sources.iter().map(|file| format!("`{file}`")).collect();
    let mut out = format!(
        "# {}\n\n*{}* `{}`  \n*{}* {}\n\n",
        c.title,
        language.say(["Alone:", "Ce chapitre seul\u{a0}:"]),
        c.command,
        language.say(["In the source:", "Dans le code source\u{a0}:"]),
        sources.join(", ")
    );
    for block in &c.findings.blocks {
        out.push_str(&of_block(block, language));
        out.push_str("\n\n");
    }
    out
}

fn of_block(block: &Block, language: Language) -> String {
    let words = |text: &str| words(text, language);
    match block {
        Block::Heading(text) => format!("## {}", words(text)),
        Block::Text(text) => words(text),
        // HTML lasts until an empty line.
        Block::Formula(latex) => {
            format!("<div class=\"formula\">{}</div>", formula(latex).into_string().replace('\n', " "))
        }
        Block::Proof(text) => format!("> {}", words(text)),
        Block::Pictures(pictures) => {
            let all: Vec<String> = pictures.iter().map(|p| picture(p, language)).collect();
            format!("<div class=\"row\">\n{}\n</div>", all.join("\n"))
        }
        Block::Plot { name, alt, .. } => figure(&format!("{name}.svg"), &language.set(alt), ""),
        Block::Drawing { name, alt, caption, .. } => {
            figure(&format!("{name}.svg"), &language.set(alt), &marked(caption, language))
        }
        Block::Table(t) => table(t, language),
    }
}

fn figure(file: &str, alt: &str, caption: &str) -> String {
    let alt = html! { (alt) }.into_string();
    format!("<figure><img src=\"{file}\" alt=\"{alt}\"><figcaption>{caption}</figcaption></figure>")
}

fn picture(p: &Picture, language: Language) -> String {
    let mut caption = marked(&p.caption, language);
    if let Some(line) = &p.command {
        caption.push_str(&html! { br; (command(line)) }.into_string());
    }
    figure(&format!("{}.png", p.name), &language.set(&p.alt), &caption)
}

/// A text as HTML.
fn marked(text: &str, language: Language) -> String {
    let one = |(is_code, piece): (bool, &str)| {
        if is_code {
            html! { code { (piece) } }
        } else {
            html! { (language.set(piece)) }
        }
        .into_string()
    };
    pieces(text).map(one).collect()
}

/// A text as Markdown.
fn words(text: &str, language: Language) -> String {
    let one = |(is_code, piece): (bool, &str)| {
        if is_code { format!("`{piece}`") } else { escaped(&language.set(piece)) }
    };
    pieces(text).map(one).collect()
}

/// What Markdown would read as its own.
fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        if "\\`*_[]<>|#&".contains(c) {
            out.push('\\');
        }
        out.push(c);
    }
    out
}

fn table(t: &Table, language: Language) -> String {
    let line = |cells: &[String]| {
        let cells: Vec<String> = cells.iter().map(|c| escaped(&language.set(c))).collect();
        format!("| {} |", cells.join(" | "))
    };
    // Numbers stand to the right, but for the first column.
    let under: Vec<&str> = (0..t.head.len()).map(|i| if i == 0 { "---" } else { "--:" }).collect();
    let rows: Vec<String> = t.rows.iter().map(|row| line(row)).collect();
    format!("{}\n|{}|\n{}\n\n*{}*", line(&t.head), under.join("|"), rows.join("\n"), escaped(&language.set(&t.caption)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_stay_words() {
        assert_eq!(words("f_r * 2 [a] `a_b 0.5` 0.5", Language::Fr), "f\\_r \\* 2 \\[a\\] `a_b 0.5` 0,5");
        assert_eq!(marked("a < b `c<d`", Language::En), "a &lt; b <code>c&lt;d</code>");
        let cells = |all: [&str; 2]| all.map(String::from).to_vec();
        let t =
            Table { name: "t".into(), caption: "c".into(), head: cells(["a", "b"]), rows: vec![cells(["x|y", "1.5"])] };
        assert_eq!(table(&t, Language::Fr), "| a | b |\n|---|--:|\n| x\\|y | 1,5 |\n\n*c*");
    }
}
