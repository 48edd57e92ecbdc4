//! The page: what sections found, as one HTML file that needs nothing else.

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

/// What a section found.
#[derive(Default)]
pub struct Findings {
    pub blocks: Vec<Block>,
    /// Its numbers, for programs.
    pub numbers: Map<String, Value>,
}

impl Findings {
    pub fn heading(&mut self, text: impl Into<String>) {
        self.blocks.push(Block::Heading(text.into()));
    }
    pub fn text(&mut self, text: impl Into<String>) {
        self.blocks.push(Block::Text(text.into()));
    }
    pub fn formula(&mut self, latex: &'static str) {
        self.blocks.push(Block::Formula(latex));
    }
    pub fn proof(&mut self, text: impl Into<String>) {
        self.blocks.push(Block::Proof(text.into()));
    }
    pub fn pictures(&mut self, pictures: Vec<Picture>) {
        self.blocks.push(Block::Pictures(pictures));
    }
    pub fn plot(&mut self, name: &str, chart: Chart, alt: impl Into<String>) {
        self.blocks.push(Block::Plot { name: name.into(), chart, alt: alt.into() });
    }
    pub fn drawing(&mut self, name: &str, svg: String, alt: &str, caption: &str) {
        self.blocks.push(Block::Drawing { name: name.into(), svg, alt: alt.into(), caption: caption.into() });
    }
    pub fn table(&mut self, name: &str, caption: &str, head: &[&'static str], rows: Vec<Vec<String>>) {
        let head = head.iter().map(ToString::to_string).collect();
        self.blocks.push(Block::Table(Table { name: name.into(), caption: caption.into(), head, rows }));
    }
    pub fn number(&mut self, name: &str, value: impl Into<Value>) {
        self.numbers.insert(name.into(), value.into());
    }

    /// The files beside the page: name and content.
    pub fn files(&self) -> Vec<(String, Vec<u8>)> {
        let mut files = Vec::new();
        for block in &self.blocks {
            match block {
                Block::Pictures(pictures) => {
                    files.extend(pictures.iter().map(|p| (format!("{}.png", p.name), p.png.clone())));
                }
                Block::Plot { name, chart, .. } => {
                    files.push((format!("{name}.svg"), chart.svg().into_bytes()));
                    files.push((format!("{name}.csv"), chart.csv().into_bytes()));
                }
                Block::Drawing { name, svg, .. } => files.push((format!("{name}.svg"), svg.clone().into_bytes())),
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
    pub findings: Findings,
}

/// The page of these chapters; `made` says how they were made.
pub fn html(chapters: &[Chapter], made: &str) -> String {
    let title = "The lecture, recomputed";
    let body = html! {
        header {
            h1 { (title) }
            p { (made) }
            nav { @for c in chapters { a href={ "#" (c.name) } { (c.title) } } }
        }
        main { @for c in chapters { (chapter(c)) } }
        footer { p { "Pictures, drawings and their numbers stand as files beside this page." } }
    };
    page::document("en", title, "", &body)
}

fn chapter(c: &Chapter) -> Markup {
    html! {
        section id=(c.name) {
            h2 { (c.title) }
            p { "Alone: " code { (c.command) } }
            @for b in &c.findings.blocks { (block(b)) }
        }
    }
}

fn block(b: &Block) -> Markup {
    match b {
        Block::Heading(text) => html! { h3 { (text) } },
        Block::Text(text) => html! { p { (text) } },
        Block::Formula(latex) => html! { div class="formula" { (formula(latex)) } },
        Block::Proof(text) => html! { p class="proof" { (text) } },
        Block::Pictures(pictures) => html! { div class="row" { @for p in pictures { (picture(p)) } } },
        Block::Plot { name, chart, alt } => {
            html! { figure { (drawing(&chart.svg(), alt)) figcaption { "Numbers: " (name) ".csv" } } }
        }
        Block::Drawing { svg, alt, caption, .. } => {
            html! { figure { (drawing(svg, alt)) figcaption { (caption) } } }
        }
        Block::Table(table) => table.html(),
    }
}

fn picture(p: &Picture) -> Markup {
    html! {
        figure {
            (page::image(&p.png, &p.alt))
            figcaption {
                (p.caption)
                @if let Some(command) = &p.command { br; code { (command) } }
            }
        }
    }
}

/// MathML, which browsers draw by themselves.
fn formula(latex: &str) -> Markup {
    use pulldown_latex::config::{DisplayMode, RenderConfig};
    let (storage, mut out) = (pulldown_latex::Storage::new(), String::new());
    let config = RenderConfig { display_mode: DisplayMode::Block, ..RenderConfig::default() };
    let written = pulldown_latex::push_mathml(&mut out, pulldown_latex::Parser::new(latex, &storage), config);
    if written.is_err() || out.contains("<merror") {
        html! { code { (latex) } }
    } else {
        PreEscaped(out)
    }
}
