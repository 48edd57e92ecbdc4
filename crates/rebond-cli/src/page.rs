//! What pages are made of: one HTML file each that needs nothing else, readable on a phone and in the dark.

use crate::plot::quoted;
use base64::Engine;
use maud::{DOCTYPE, Markup, PreEscaped, html};
use std::fmt::Write;

const STYLE: &str = include_str!("page.css");

/// A table, as it is shown and written.
pub struct Table {
    /// File name without its extension.
    pub name: String,
    pub caption: String,
    pub head: Vec<String>,
    pub rows: Vec<Vec<String>>,
}

impl Table {
    pub fn csv(&self) -> String {
        let mut out = String::new();
        for row in std::iter::once(&self.head).chain(&self.rows) {
            let cells: Vec<String> = row.iter().map(|c| quoted(c)).collect();
            // Writing to a string cannot fail.
            let _ = writeln!(out, "{}", cells.join(","));
        }
        out
    }

    pub fn html(&self) -> Markup {
        html! {
            div class="wide" {
                table {
                    caption { (self.caption) }
                    thead { tr { @for cell in &self.head { th { (cell) } } } }
                    tbody { @for row in &self.rows { tr { @for cell in row { td { (cell) } } } } }
                }
            }
        }
    }
}

/// A page in a language, with styles of its own beside those of all pages.
pub fn document(language: &str, title: &str, style: &str, body: &Markup) -> String {
    let page = html! {
        (DOCTYPE)
        html lang=(language) {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { (title) }
                link rel="icon" href="data:,";
                style { (PreEscaped(STYLE)) (PreEscaped(style)) }
            }
            body { (body) }
        }
    };
    page.into_string()
}

/// A word as a shell reads it.
pub fn shell(word: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_+.,:=/@%".contains(c);
    if !word.is_empty() && word.chars().all(plain) { word.into() } else { format!("'{}'", word.replace('\'', "'\\''")) }
}

/// Bytes as text.
pub fn base64(bytes: &[u8]) -> String {
    base64::engine::general_purpose::STANDARD.encode(bytes)
}

/// A PNG file within the page.
pub fn image(png: &[u8], alt: &str) -> Markup {
    html! { img src={ "data:image/png;base64," (base64(png)) } alt=(alt); }
}

/// An SVG of the page itself, so that it can follow the page's colours.
pub fn drawing(svg: &str, alt: &str) -> Markup {
    let at = svg.find("<svg").map_or(0, |i| i + 4);
    let alt = html! { (alt) }.into_string();
    PreEscaped(format!("<svg role=\"img\" aria-label=\"{alt}\"{}", &svg[at..]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shells_read_words_as_they_are() {
        assert_eq!(shell("path:mode=mis,rr_depth=5"), "path:mode=mis,rr_depth=5");
        assert_eq!(shell("path:paths=L(S|T)+DE"), "'path:paths=L(S|T)+DE'");
        assert_eq!(shell("my scene's.toml"), "'my scene'\\''s.toml'");
    }
}
