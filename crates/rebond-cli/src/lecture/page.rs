//! The page: what sections found, as one HTML file that needs nothing else.

use super::language::{Language, pieces};
use crate::page::{self, Table, drawing};
use crate::plot::Chart;
use maud::{Markup, PreEscaped, html};
use serde_json::{Map, Value};

/// A picture, as it is shown and written.
pub struct Picture {
    /// File name without its extension.
    pub name: String,
    /// The file's content.
    pub png: Vec<u8>,
    /// For who does not see it.
    pub alt: String,
    pub caption: String,
    /// What makes this one alone.
    pub command: Option<String>,
}

/// A piece of a section.
pub enum Block {
    Heading(String),
    Text(String),
    /// LaTeX.
    Formula(&'static str),
    /// The number that shows it is right.
    Proof(String),
    /// Side by side.
    Pictures(Vec<Picture>),
    Plot {
        name: String,
        chart: Chart,
        alt: String,
    },
    /// A drawing.
    Drawing {
        name: String,
        svg: String,
        alt: String,
        caption: String,
    },
    Table(Table),
}

/// What a section found, told in one language; texts are given in both.
pub struct Findings {
    language: Language,
    pub blocks: Vec<Block>,
    /// Its numbers, for programs.
    pub numbers: Map<String, Value>,
}

impl Findings {
    pub fn new(language: Language) -> Self {
        Self { language, blocks: Vec::new(), numbers: Map::new() }
    }
    pub fn heading<T: Into<String>>(&mut self, words: [T; 2]) {
        self.blocks.push(Block::Heading(self.language.say(words).into()));
    }
    /// What stands between backticks is code.
    pub fn text<T: Into<String>>(&mut self, words: [T; 2]) {
        self.blocks.push(Block::Text(self.language.say(words).into()));
    }
    pub fn formula(&mut self, latex: &'static str) {
        self.blocks.push(Block::Formula(latex));
    }
    pub fn proof<T: Into<String>>(&mut self, words: [T; 2]) {
        self.blocks.push(Block::Proof(self.language.say(words).into()));
    }
    pub fn pictures(&mut self, pictures: Vec<Picture>) {
        self.blocks.push(Block::Pictures(pictures));
    }
    pub fn plot<T: Into<String>>(&mut self, name: &str, chart: Chart, alt: [T; 2]) {
        let alt = self.language.say(alt).into();
        self.blocks.push(Block::Plot { name: name.into(), chart, alt });
    }
    pub fn drawing<T: Into<String>>(&mut self, name: &str, svg: String, alt: [T; 2], caption: [T; 2]) {
        let [alt, caption] = [alt, caption].map(|words| self.language.say(words).into());
        self.blocks.push(Block::Drawing { name: name.into(), svg, alt, caption });
    }
    pub fn table(&mut self, name: &str, caption: [&str; 2], head: &[[&str; 2]], rows: Vec<Vec<String>>) {
        let head = head.iter().map(|words| self.language.say(*words).into()).collect();
        let caption = self.language.say(caption).into();
        self.blocks.push(Block::Table(Table { name: name.into(), caption, head, rows }));
    }
    pub fn number(&mut self, name: &str, value: impl Into<Value>) {
        self.numbers.insert(name.into(), value.into());
    }

    /// The files beside the page: name and content. Numbers are written for programs, those in drawings for readers.
    pub fn files(&self) -> Vec<(String, Vec<u8>)> {
        let mut files = Vec::new();
        for block in &self.blocks {
            match block {
                Block::Pictures(pictures) => {
                    files.extend(pictures.iter().map(|p| (format!("{}.png", p.name), p.png.clone())));
                }
                Block::Plot { name, chart, .. } => {
                    files.push((format!("{name}.svg"), self.language.set_svg(&chart.svg()).into_bytes()));
                    files.push((format!("{name}.csv"), chart.csv().into_bytes()));
                }
                Block::Drawing { name, svg, .. } => {
                    files.push((format!("{name}.svg"), self.language.set_svg(svg).into_bytes()));
                }
                Block::Table(table) => files.push((format!("{}.csv", table.name), table.csv().into_bytes())),
                Block::Heading(_) | Block::Text(_) | Block::Formula(_) | Block::Proof(_) => {}
            }
        }
        files
    }
}

/// A section that ran.
pub struct Chapter {
    pub name: &'static str,
    pub title: &'static str,
    /// What makes it alone.
    pub command: String,
    /// The files that it is about.
    pub sources: &'static [&'static str],
    pub findings: Findings,
}

/// The title of the whole.
pub const TITLE: [&str; 2] = ["The lecture, recomputed", "Le cours, recalculé"];

/// The page of these chapters; `made` says how they were made.
pub fn html(chapters: &[Chapter], made: &str, language: Language) -> String {
    let title = language.say(TITLE);
    let beside = language.say([
        "Pictures, drawings and their numbers stand as files beside this page.",
        "Les images, les dessins et leurs nombres se trouvent dans des fichiers à côté de cette page.",
    ]);
    let body = html! {
        header {
            h1 { (title) }
            p { (language.set(made)) }
            nav { @for c in chapters { a href={ "#" (c.name) } { (c.title) } } }
        }
        main { @for c in chapters { (chapter(c, language)) } }
        footer { p { (beside) } }
    };
    page::document(language.name(), title, "", &body)
}

fn chapter(c: &Chapter, language: Language) -> Markup {
    html! {
        section id=(c.name) {
            h2 { (c.title) }
            p class="made" {
                (language.say(["Alone: ", "Cette section seule\u{a0}: "])) (command(&c.command)) br;
                (language.say(["In the source: ", "Dans le code source\u{a0}: "]))
                @for (i, file) in c.sources.iter().enumerate() { @if i > 0 { ", " } code { (file) } }
            }
            @for b in &c.findings.blocks { (block(b, language)) }
        }
    }
}

/// Words, and code between backticks.
fn words(text: &str, language: Language) -> Markup {
    html! {
        @for (is_code, piece) in pieces(text) {
            @if is_code { code { (piece) } } @else { (language.set(piece)) }
        }
    }
}

fn block(b: &Block, language: Language) -> Markup {
    let words = |text: &str| words(text, language);
    match b {
        Block::Heading(text) => html! { h3 { (words(text)) } },
        Block::Text(text) => html! { p { (words(text)) } },
        Block::Formula(latex) => html! { div class="formula" { (formula(latex)) } },
        Block::Proof(text) => html! { p class="proof" { (words(text)) } },
        Block::Pictures(pictures) => html! { div class="row" { @for p in pictures { (picture(p, language)) } } },
        Block::Plot { name, chart, alt } => {
            let numbers = language.say(["Numbers: ", "Nombres\u{a0}: "]);
            let svg = language.set_svg(&chart.svg());
            html! { figure { (drawing(&svg, &language.set(alt))) figcaption { (numbers) (name) ".csv" } } }
        }
        Block::Drawing { svg, alt, caption, .. } => {
            html! { figure { (drawing(&language.set_svg(svg), &language.set(alt))) figcaption { (words(caption)) } } }
        }
        Block::Table(table) => set(table, language).html(),
    }
}

/// A table as it is read; its file has its numbers as programs read them.
fn set(table: &Table, language: Language) -> Table {
    let all = |cells: &Vec<String>| cells.iter().map(|c| language.set(c)).collect();
    Table {
        name: table.name.clone(),
        caption: language.set(&table.caption),
        head: all(&table.head),
        rows: table.rows.iter().map(all).collect(),
    }
}

/// A command, word by word.
pub fn command(line: &str) -> Markup {
    html! { code class="command" { @for (i, word) in line.split(' ').enumerate() { @if i > 0 { " " } span { (word) } } } }
}

fn picture(p: &Picture, language: Language) -> Markup {
    html! {
        figure {
            (page::image(&p.png, &language.set(&p.alt)))
            figcaption {
                (words(&p.caption, language))
                @if let Some(line) = &p.command { br; (command(line)) }
            }
        }
    }
}

/// MathML, which browsers draw by themselves.
pub fn formula(latex: &str) -> Markup {
    use pulldown_latex::config::{DisplayMode, RenderConfig};
    let (storage, mut out) = (pulldown_latex::Storage::new(), String::new());
    let config = RenderConfig { display_mode: DisplayMode::Block, ..RenderConfig::default() };
    let written = pulldown_latex::push_mathml(&mut out, pulldown_latex::Parser::new(latex, &storage), config);
    if written.is_err() || out.contains("<merror") {
        html! { code { (latex) } }
    } else {
        // It leaves this sign as it is.
        PreEscaped(out.replace("<mo><</mo>", "<mo>&lt;</mo>"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn formulas_are_escaped() {
        let less = formula("a<b").into_string();
        assert!(less.contains("<mo>&lt;</mo>") && !less.contains("<<"), "{less}");
    }
}
