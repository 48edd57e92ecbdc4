//! pbrt-v4's text as words and directives, each with its place; includes opened.

use crate::document::place_of;
use crate::error::Error;
use crate::import::{self, Assets, Part};
use std::cell::Cell;
use std::sync::Arc;

/// Files of a scene, included ones counted as often as they are.
const MOST_FILES: usize = 256;
/// Includes within includes.
const DEEPEST: usize = 16;
/// Parameters of a directive.
const MOST_PARAMETERS: usize = 256;

/// A place in one of the files.
#[derive(Clone, Copy, Debug, Default)]
pub struct Spot {
    file: usize,
    start: usize,
    end: usize,
}

impl Spot {
    /// To be noted.
    pub fn part(self) -> Part {
        (self.file, Some(self.start..self.end))
    }
}

/// The files read so far.
#[derive(Debug, Default)]
pub struct Sources(pub import::Sources);

impl Sources {
    /// An error at that place.
    pub fn error(&self, at: Spot, message: impl Into<String>) -> Error {
        match self.0.get(at.file) {
            Some((file, text)) => {
                let place = Some(Box::new(place_of(text, at.start..at.end)));
                Error { file: Some(file.clone()), place, ..Error::new(message) }
            }
            None => Error::new(message),
        }
    }
}

/// A word of the text.
#[derive(Clone, Debug, PartialEq)]
pub enum Word {
    /// Without quotes: a directive, a number, `true`.
    Bare(String),
    /// In quotes.
    Quoted(String),
    /// `[`.
    Open,
    /// `]`.
    Close,
}

/// A named list of values.
#[derive(Debug)]
pub struct Parameter {
    /// Its type, such as `float`.
    pub kind: String,
    /// Its name.
    pub name: String,
    /// Where it stands.
    pub at: Spot,
    /// Numbers, if they are.
    pub numbers: Vec<f64>,
    /// Words, if they are.
    pub words: Vec<String>,
    used: Cell<bool>,
}

/// The parameters of a directive.
#[derive(Debug, Default)]
pub struct Parameters(pub Vec<Parameter>);

impl Parameters {
    /// The parameter of that name, which is thereby used.
    pub fn get(&self, name: &str) -> Option<&Parameter> {
        self.0.iter().find(|p| p.name == name).inspect(|p| p.used.set(true))
    }

    /// What nobody has asked for.
    pub fn unused(&self) -> impl Iterator<Item = &Parameter> {
        self.0.iter().filter(|p| !p.used.get())
    }
}

/// A file that is being read.
struct Open {
    file: usize,
    text: Arc<str>,
    at: usize,
}

/// Where a text begins: behind the mark of its byte order, if it has one.
fn start(text: &str) -> usize {
    if text.starts_with('\u{feff}') { '\u{feff}'.len_utf8() } else { 0 }
}

/// What stands up to the end of a quote, and its length with that end.
fn quote(rest: &str) -> Result<(String, usize), String> {
    let (mut text, mut chars) = (String::new(), rest.char_indices());
    while let Some((at, c)) = chars.next() {
        match c {
            '"' => return Ok((text, at + 1)),
            '\n' => break,
            '\\' => text.push(match chars.next() {
                Some((_, 'n')) => '\n',
                Some((_, 'r')) => '\r',
                Some((_, 't')) => '\t',
                Some((_, 'b')) => '\u{8}',
                Some((_, 'f')) => '\u{c}',
                Some((_, c @ ('"' | '\\' | '\''))) => c,
                _ => return Err("a backslash that means nothing: \\\\ stands for one".into()),
            }),
            c => text.push(c),
        }
    }
    Err("a quote without its end".into())
}

/// The words of a scene, file by file.
pub struct Words<'a> {
    /// The files.
    pub sources: Sources,
    assets: &'a Assets,
    open: Vec<Open>,
    peeked: Option<(Word, Spot)>,
    last: Spot,
}

impl<'a> Words<'a> {
    /// Of that text.
    pub fn new(text: &str, file: &str, assets: &'a Assets) -> Self {
        let text: Arc<str> = text.into();
        let sources = Sources(vec![(file.to_string(), text.clone())]);
        let open = vec![Open { file: 0, at: start(&text), text }];
        Self { sources, assets, open, peeked: None, last: Spot::default() }
    }

    /// How many files are open, within each other.
    pub fn depth(&self) -> usize {
        self.open.len()
    }

    /// Goes on with another file, then with this one.
    pub fn include(&mut self, name: &str, at: Spot) -> Result<(), Error> {
        if self.sources.0.len() >= MOST_FILES || self.open.len() > DEEPEST {
            return Err(self
                .sources
                .error(at, format!("more than {MOST_FILES} files, or files within files without end")));
        }
        let bytes = self.assets.read(name).map_err(|m| self.sources.error(at, m))?;
        let bytes =
            if name.ends_with(".gz") { super::unpack(&bytes).map_err(|m| self.sources.error(at, m))? } else { bytes };
        let text =
            String::from_utf8(bytes).map_err(|_| self.sources.error(at, format!("\"{name}\" is not UTF-8 text")))?;
        let text: Arc<str> = text.into();
        self.sources.0.push((self.assets.folder().join(name).display().to_string(), text.clone()));
        self.open.push(Open { file: self.sources.0.len() - 1, at: start(&text), text });
        Ok(())
    }

    /// The next word, which stays the next.
    pub fn peek(&mut self) -> Result<Option<&Word>, Error> {
        if self.peeked.is_none() {
            self.peeked = self.read()?;
        }
        Ok(self.peeked.as_ref().map(|(word, _)| word))
    }

    /// The next word.
    pub fn next(&mut self) -> Result<Option<(Word, Spot)>, Error> {
        let next = match self.peeked.take() {
            Some(word) => Some(word),
            None => self.read()?,
        };
        if let Some((_, at)) = &next {
            self.last = *at;
        }
        Ok(next)
    }

    fn read(&mut self) -> Result<Option<(Word, Spot)>, Error> {
        while let Some(open) = self.open.last_mut() {
            let rest = &open.text[open.at..];
            let skipped = rest.len() - rest.trim_start().len();
            open.at += skipped;
            let rest = &open.text[open.at..];
            let start = open.at;
            let spot = |length: usize| Spot { file: open.file, start, end: start + length };
            let Some(first) = rest.chars().next() else {
                self.open.pop();
                continue;
            };
            match first {
                '#' => open.at += rest.find('\n').unwrap_or(rest.len()),
                '[' | ']' => {
                    open.at += 1;
                    return Ok(Some((if first == '[' { Word::Open } else { Word::Close }, spot(1))));
                }
                '"' => {
                    let (text, length) = quote(&rest[1..]).map_err(|message| self.sources.error(spot(1), message))?;
                    let word = (Word::Quoted(text), spot(length + 1));
                    open.at += length + 1;
                    return Ok(Some(word));
                }
                _ => {
                    let length = rest
                        .find(|c: char| c.is_whitespace() || matches!(c, '[' | ']' | '"' | '#'))
                        .unwrap_or(rest.len());
                    let word = (Word::Bare(rest[..length].to_string()), spot(length));
                    open.at += length;
                    return Ok(Some(word));
                }
            }
        }
        Ok(None)
    }

    /// An error where the words end.
    pub fn fail<T>(&self, message: impl Into<String>) -> Result<T, Error> {
        Err(self.sources.error(self.last, message))
    }

    /// A word in quotes.
    pub fn quoted(&mut self, what: &str) -> Result<(String, Spot), Error> {
        match self.next()? {
            Some((Word::Quoted(text), at)) => Ok((text, at)),
            _ => self.fail(format!("expected {what} in quotes")),
        }
    }

    /// Numbers, in brackets or not.
    pub fn numbers<const N: usize>(&mut self) -> Result<[f64; N], Error> {
        let brackets = self.peek()? == Some(&Word::Open);
        if brackets {
            self.next()?;
        }
        let mut values = [0.0; N];
        for x in &mut values {
            *x = match self.next()? {
                Some((Word::Bare(word), at)) => self.number(&word, at)?,
                _ => return self.fail(format!("expected {N} numbers")),
            };
        }
        if brackets && !matches!(self.next()?, Some((Word::Close, _))) {
            return self.fail(format!("expected {N} numbers and a ]"));
        }
        Ok(values)
    }

    fn number(&self, word: &str, at: Spot) -> Result<f64, Error> {
        match word.parse::<f64>() {
            Ok(x) if (x as f32).is_finite() => Ok(x),
            Ok(_) => Err(self.sources.error(at, format!("{word} is no finite number of single precision"))),
            Err(_) => Err(self.sources.error(at, format!("\"{word}\" is not a number"))),
        }
    }

    /// The parameters that follow.
    pub fn parameters(&mut self) -> Result<Parameters, Error> {
        let mut list = Vec::new();
        while let Some(Word::Quoted(_)) = self.peek()? {
            let (declaration, at) = self.quoted("a parameter")?;
            let mut parts = declaration.split_whitespace();
            let (Some(kind), Some(name), None) = (parts.next(), parts.next(), parts.next()) else {
                return Err(self.sources.error(at, format!("\"{declaration}\" is not a type and a name")));
            };
            if list.len() >= MOST_PARAMETERS {
                return Err(self.sources.error(at, format!("more than {MOST_PARAMETERS} parameters of one directive")));
            }
            let mut parameter = Parameter {
                kind: kind.to_string(),
                name: name.to_string(),
                at,
                numbers: Vec::new(),
                words: Vec::new(),
                used: Cell::new(false),
            };
            let brackets = self.peek()? == Some(&Word::Open);
            if brackets {
                self.next()?;
            }
            loop {
                match self.next()? {
                    Some((Word::Close, _)) if brackets => break,
                    Some((Word::Quoted(text), _)) => parameter.words.push(text),
                    Some((Word::Bare(word), _)) if matches!(&*word, "true" | "false") => parameter.words.push(word),
                    Some((Word::Bare(word), at)) => parameter.numbers.push(self.number(&word, at)?),
                    _ => return self.fail(format!("the values of \"{name}\" do not end")),
                }
                if !brackets {
                    break;
                }
            }
            if list.iter().any(|p: &Parameter| p.name == parameter.name) {
                return Err(self.sources.error(at, format!("\"{name}\" is given twice")));
            }
            list.push(parameter);
        }
        Ok(Parameters(list))
    }
}
