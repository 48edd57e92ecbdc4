//! One error with its place in a text, ready to be shown.

use std::fmt::{self, Display, Write};

/// What is wrong with a text, where, and what to do about it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Error {
    /// The file, or `None` for a command-line argument or for data that never was a text.
    pub file: Option<String>,
    /// Where in the text, if the data came from one.
    pub place: Option<Box<Place>>,
    /// The keys that lead to the value in question, such as `shapes[3].emission.radiance`; may be empty.
    pub path: String,
    /// What is wrong.
    pub message: String,
    /// What to do about it.
    pub help: Option<String>,
}

/// A place in a text.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Place {
    /// Line, from 1.
    pub line: usize,
    /// Column in characters, from 1.
    pub column: usize,
    /// How many characters of this line are in question; at least 1.
    pub width: usize,
    /// The whole line.
    pub source_line: String,
}

/// Longest line that is shown whole, and how much of a longer one, from how far before the place; in characters.
const LONGEST: usize = 200;
const SHOWN: usize = 160;
const BEFORE: usize = 60;

impl Place {
    /// The line, or what of it is around the place if it is long; characters before the place there, and its width.
    fn shown(&self) -> (String, usize, usize) {
        let (count, at) = (self.source_line.chars().count(), self.column.saturating_sub(1));
        if count <= LONGEST {
            return (self.source_line.clone(), at, self.width.max(1));
        }
        let start = at.saturating_sub(BEFORE).min(count - SHOWN);
        let part: String = self.source_line.chars().skip(start).take(SHOWN).collect();
        let [left, right] = [start > 0, start + SHOWN < count].map(|more| if more { "…" } else { "" });
        let before = at - start + left.chars().count();
        (format!("{left}{part}{right}"), before, self.width.clamp(1, (start + SHOWN).saturating_sub(at).max(1)))
    }
}

impl Error {
    /// An error that names no place.
    pub fn new(message: impl Into<String>) -> Self {
        Self { message: message.into(), ..Self::default() }
    }

    /// The same error with advice.
    pub fn with_help(self, help: impl Into<String>) -> Self {
        Self { help: Some(help.into()), ..self }
    }

    /// The same error with the file it is about, if it names none yet.
    pub fn with_file(self, file: impl Into<String>) -> Self {
        Self { file: self.file.or_else(|| Some(file.into())), ..self }
    }

    /// Line in the text, from 1.
    pub fn line(&self) -> Option<usize> {
        self.place.as_ref().map(|p| p.line)
    }

    /// Column in characters, from 1.
    pub fn column(&self) -> Option<usize> {
        self.place.as_ref().map(|p| p.column)
    }

    /// The error over several lines: the words, the place, the line itself with carets under it, the advice.
    ///
    /// ```text
    /// error: unknown key "refectance"
    ///   --> scene.toml:12:1
    ///    |
    /// 12 | refectance = 0.5
    ///    | ^^^^^^^^^^
    ///    = help: did you mean "reflectance"? valid keys: reflectance
    /// ```
    pub fn snippet(&self) -> String {
        let number = self.place.as_ref().map_or(String::new(), |p| p.line.to_string());
        let margin = " ".repeat(number.len());
        let mut out = format!("error: {}\n", self.message);
        // Writing to a string cannot fail.
        if let (None, None, false) = (&self.file, &self.place, self.path.is_empty()) {
            let _ = writeln!(out, "{margin}--> {}", self.path);
        } else if self.file.is_some() || self.place.is_some() {
            let _ = writeln!(out, "{margin}--> {}", self.address());
        }
        // A line that is too long to be shown is not there.
        if let Some(place) = self.place.as_ref().filter(|p| !p.source_line.is_empty() || p.column == 1) {
            let (line, before, width) = place.shown();
            // A tab must stay a tab under the line, for the carets to stand where they should.
            let indent: String = line.chars().take(before).map(|c| if c == '\t' { '\t' } else { ' ' }).collect();
            let _ = writeln!(out, "{margin} |");
            let _ = writeln!(out, "{}", format_args!("{number} | {line}").to_string().trim_end());
            let _ = writeln!(out, "{margin} | {indent}{}", "^".repeat(width));
        }
        if let Some(help) = &self.help {
            let _ = writeln!(out, "{margin} = help: {help}");
        }
        out
    }

    /// `file:line:column`, or as much of it as is known.
    fn address(&self) -> String {
        match (&self.file, &self.place) {
            (Some(file), Some(place)) => format!("{file}:{}:{}", place.line, place.column),
            (Some(file), None) => file.clone(),
            (None, Some(place)) => format!("column {} of `{}`", place.column, place.source_line),
            (None, None) => self.path.clone(),
        }
    }
}

impl Display for Error {
    /// `scene.toml:12:5: message`, and a second line of advice if there is any.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let address = self.address();
        if !address.is_empty() {
            write!(f, "{address}: ")?;
        }
        f.write_str(&self.message)?;
        match &self.help {
            Some(help) => write!(f, "\n  help: {help}"),
            None => Ok(()),
        }
    }
}

impl std::error::Error for Error {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_lines_are_shown_around_the_place() {
        let line: String = (0..1000_u32).map(|i| char::from(b'a' + (i % 26) as u8)).collect();
        for (column, width, left, right) in
            [(1, 3, "", "…"), (501, 4, "…", "…"), (998, 3, "…", ""), (600, 900, "…", "…")]
        {
            let place = Place { line: 1, column, width, source_line: line.clone() };
            let snippet = Error { place: Some(Box::new(place)), ..Error::new("no") }.with_file("a").snippet();
            let shown: Vec<&str> = snippet.lines().skip(3).collect();
            let [text, carets] = [shown[0], shown[1]].map(|l| l.chars().skip(4).collect::<Vec<char>>());
            assert!(text.len() <= SHOWN + 2, "{snippet}");
            assert!(
                text.iter().collect::<String>().starts_with(left) && text.iter().collect::<String>().ends_with(right)
            );
            let at = carets.iter().position(|c| *c == '^').expect("carets");
            let wanted: Vec<char> = line.chars().skip(column - 1).take(3).collect();
            assert_eq!(text[at..at + 3], wanted, "{snippet}");
            assert_eq!(carets.len() - at, width.min(SHOWN - BEFORE), "{snippet}");
        }
    }
}
