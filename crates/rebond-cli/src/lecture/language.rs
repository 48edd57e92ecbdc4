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

/// Between groups of three digits.
const THIN: char = '\u{202f}';

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

    /// A text as it is set: numbers have minus signs, not hyphens, and long ones groups of digits; French has a comma in its numbers, and space before some of its marks.
    pub fn set(self, text: &str) -> String {
        let marks = self.say(["%±", "%±:;?!»"]);
        let mut out = String::with_capacity(text.len());
        let mut rest = text.char_indices().peekable();
        while let Some((at, c)) = rest.next() {
            let next = rest.peek().map(|(_, c)| *c);
            if c.is_ascii_digit() && ends_group(text, at) {
                out.push(THIN);
            }
            out.push(match c {
                ' ' if is_grouped(text, at) => THIN,
                ' ' if next.is_some_and(|n| marks.contains(n)) => NO_BREAK,
                ' ' if text[..at].ends_with('«') => NO_BREAK,
                '-' if next.is_some_and(|n| n.is_ascii_digit())
                    && (at == 0 || text[..at].ends_with(|c| " ([".contains(c))) =>
                {
                    '−'
                }
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

/// The digits before a place, and those after it.
fn digits_around(text: &str, at: usize) -> [usize; 2] {
    let before = text[..at].len() - text[..at].trim_end_matches(|c: char| c.is_ascii_digit()).len();
    let after = text[at..].len() - text[at..].trim_start_matches(|c: char| c.is_ascii_digit()).len();
    [before, after]
}

/// Whether the digit at this place begins a group of three of a number of five digits and more.
fn ends_group(text: &str, at: usize) -> bool {
    let [before, after] = digits_around(text, at);
    let within_word = |c: char| c.is_alphanumeric() || "._-".contains(c);
    before > 0 && before + after > 4 && after % 3 == 0 && !text[..at - before].ends_with(within_word)
}

/// Whether the space at this place stands before the thousands of a number.
fn is_grouped(text: &str, at: usize) -> bool {
    let ([before, _], [_, after]) = (digits_around(text, at), digits_around(text, at + 1));
    (1..=3).contains(&before) && text[at + 1..].starts_with("000") && after == 3
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
            "{} sur {tested} sous 1 % d'après le test de Welch, {}",
            counted(below as u64, "bloc"),
            if agree { "les images s'accordent" } else { "les images diffèrent" }
        ),
    ]
}

/// How an error compares with another that is `gain` times as large.
pub fn times(gain: f64) -> [String; 2] {
    let factor = gain.max(1.0 / gain);
    let factor = if factor < 9.95 { format!("{factor:.1}") } else { format!("{factor:.0}") };
    if gain >= 1.0 {
        [format!("{factor} times less error"), format!("{factor} fois moins d'erreur")]
    } else {
        [format!("{factor} times as much error"), format!("{factor} fois plus d'erreur")]
    }
}

/// So many, and the noun with the mark of its plural where there are several.
pub fn counted(n: u64, noun: &str) -> String {
    format!("{n} {noun}{}", if n < 2 { "" } else { "s" })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gains_are_worded_both_ways() {
        assert_eq!(times(3.12), ["3.1 times less error", "3.1 fois moins d'erreur"]);
        assert_eq!(times(0.05), ["20 times as much error", "20 fois plus d'erreur"]);
    }

    #[test]
    fn long_numbers_are_grouped() {
        for language in [Language::En, Language::Fr] {
            assert_eq!(language.set("1234567 of 500 000"), "1\u{202f}234\u{202f}567 of 500\u{202f}000");
            assert_eq!(
                language.set("4096, r = 60 300, a12345, x 1234 500, rebond 0.1.12345"),
                "4096, r = 60 300, a12345, x 1234 500, rebond 0.1.12345"
            );
        }
        assert_eq!(Language::Fr.set("12345.123456"), "12\u{202f}345,123456");
    }

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
