//! English and French: every text of the page stands in both, side by side.

use crate::judge::verdict;
use rebond::compare::Welch;

/// The page's language.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Language {
    #[default]
    En,
    Fr,
}

/// Between a number and its unit, or a word and its colon, no line breaks.
const NO_BREAK: char = '\u{a0}';

impl Language {
    /// As HTML names it.
    pub fn name(self) -> &'static str {
        match self {
            Self::En => "en",
            Self::Fr => "fr",
        }
    }

    /// The one of two, English first, that is of this language.
    pub fn say<T>(self, [english, french]: [T; 2]) -> T {
        match self {
            Self::En => english,
            Self::Fr => french,
        }
    }

    /// A text as it is set: numbers have minus signs, not hyphens; French has a comma in its numbers, and space before some of its marks.
    pub fn set(self, text: &str) -> String {
        let marks = self.say(["%±", "%±:;?!»"]);
        let mut out = String::with_capacity(text.len());
        let mut rest = text.char_indices().peekable();
        while let Some((at, c)) = rest.next() {
            let next = rest.peek().map(|(_, c)| *c);
            out.push(match c {
                ' ' if next.is_some_and(|n| marks.contains(n)) => NO_BREAK,
                ' ' if text[..at].ends_with('«') => NO_BREAK,
                '-' if next.is_some_and(|n| n.is_ascii_digit()) && text[..at].ends_with(|c| " ([".contains(c)) => '−',
                '.' if self == Self::Fr && is_point(text, at) => ',',
                _ => c,
            });
        }
        out
    }

    /// The same of the words of a drawing, but not of what draws it.
    pub fn set_svg(self, svg: &str) -> String {
        let mut out = String::with_capacity(svg.len());
        for (i, piece) in svg.split('<').enumerate() {
            match piece.split_once('>') {
                Some((tag, words)) if i > 0 => {
                    out.push('<');
                    out.push_str(tag);
                    out.push('>');
                    out.push_str(&self.set(words));
                }
                _ => out.push_str(piece),
            }
        }
        out
    }
}

/// Whether the dot at this place stands within a number, and not within a version.
fn is_point(text: &str, at: usize) -> bool {
    let digits = |c: char| c.is_ascii_digit();
    let (before, after) = (&text[..at], &text[at + 1..]);
    let (head, tail) = (before.trim_end_matches(digits), after.trim_start_matches(digits));
    let version = |outer: Option<char>| outer == Some('.');
    head.len() < before.len()
        && tail.len() < after.len()
        && !(version(head.chars().next_back()) && head.len() > 1 && head[..head.len() - 1].ends_with(digits))
        && !(version(tail.chars().next()) && tail[1..].starts_with(digits))
}

/// Text between backticks is code: pieces, and whether they are.
pub fn pieces(text: &str) -> impl Iterator<Item = (bool, &str)> {
    text.split('`').enumerate().map(|(i, piece)| (i % 2 == 1, piece)).filter(|(_, piece)| !piece.is_empty())
}

/// What Welch's test said of two pictures.
pub fn told(test: &Welch) -> [String; 2] {
    let (below, tested, agree) = (test.below_alpha, test.tested, test.passes());
    [
        format!("{below} of {tested} blocks below 1 % by Welch's test, {}", verdict(test)),
        format!(
            "{below} blocs sur {tested} sous 1 % d'après le test de Welch, {}",
            if agree { "les images s'accordent" } else { "les images diffèrent" }
        ),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn french_has_commas_in_numbers_only() {
        let set = |text| Language::Fr.set(text);
        assert_eq!(set("0.785398, 1.5e-3."), "0,785398, 1,5e-3.");
        assert_eq!(set("rebond 0.1.0 de 1.2.34"), "rebond 0.1.0 de 1.2.34");
        assert_eq!(set("5.. et .5 et 5."), "5.. et .5 et 5.");
        assert_eq!(set("pente : « −0.5 » ± 3.25 %"), "pente\u{a0}: «\u{a0}−0,5\u{a0}»\u{a0}± 3,25\u{a0}%");
        assert_eq!(set("de -0.5 à Owen-2"), "de −0,5 à Owen-2");
        assert_eq!(Language::En.set("slope: 0.5 ± 3.25 %"), "slope: 0.5\u{a0}± 3.25\u{a0}%");
    }

    #[test]
    fn drawings_keep_their_numbers() {
        let svg = "<svg width=\"1.5\"><text x=\"0.5\">0.25 a</text></svg>\n";
        assert_eq!(Language::Fr.set_svg(svg), "<svg width=\"1.5\"><text x=\"0.5\">0,25 a</text></svg>\n");
        assert_eq!(Language::En.set_svg(svg), svg);
    }

    #[test]
    fn code_stands_between_backticks() {
        let all: Vec<_> = pieces("a `b 0.5` c").collect();
        assert_eq!(all, [(false, "a "), (true, "b 0.5"), (false, " c")]);
        assert_eq!(pieces("`b`").collect::<Vec<_>>(), [(true, "b")]);
    }
}
