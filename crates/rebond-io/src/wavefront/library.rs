//! Libraries of materials (`.mtl`) as they are written: lines of a key and its words.

use crate::error::{Error, Place};
use crate::meshes::place_in;

/// A material: its lines.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Material {
    /// Its name.
    pub name: String,
    /// What it says.
    pub lines: Vec<Line>,
}

/// A line of a library.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Line {
    /// Its first word.
    pub key: String,
    /// The rest.
    pub words: Vec<String>,
    /// Where it is.
    pub file: String,
    /// Place of its first word.
    pub place: Place,
}

impl Line {
    /// An error about it.
    pub fn error(&self, message: impl Into<String>) -> Error {
        Error { place: Some(Box::new(self.place.clone())), ..Error::new(message).with_file(&self.file) }
    }

    /// Its words from the given one on as numbers.
    pub fn numbers(&self, words: &[String]) -> Result<Vec<f32>, Error> {
        let number = |word: &String| word.parse().ok().filter(|x: &f32| x.is_finite());
        words.iter().map(|w| number(w).ok_or_else(|| self.error(format!("\"{w}\" is not a number")))).collect()
    }

    /// One number.
    pub fn number(&self) -> Result<f32, Error> {
        match self.numbers(&self.words)?[..] {
            [x] => Ok(x),
            _ => Err(self.error(format!("{} is one number", self.key))),
        }
    }

    /// A colour of three numbers, or of one for grey.
    pub fn color(&self) -> Result<[f32; 3], Error> {
        if let Some(word @ ("spectral" | "xyz")) = self.words.first().map(String::as_str) {
            return Err(self.error(format!("a colour given as {word} is not supported")));
        }
        match self.numbers(&self.words)?[..] {
            [r, g, b] => Ok([r, g, b]),
            [x] => Ok([x; 3]),
            _ => Err(self.error(format!("{} is three numbers, or one", self.key))),
        }
    }
}

/// Reads a library. What is before the first `newmtl` belongs to none.
pub fn read(text: &str, file: &str) -> Vec<Material> {
    let mut materials: Vec<Material> = Vec::new();
    for (number, line) in text.lines().enumerate() {
        let content = line.split('#').next().unwrap_or_default().trim();
        let mut words = content.split_whitespace();
        let Some(key) = words.next() else { continue };
        if key == "newmtl" {
            // Names may have spaces in them.
            materials.push(Material { name: content[key.len()..].trim().to_string(), lines: Vec::new() });
        } else if let Some(material) = materials.last_mut() {
            material.lines.push(Line {
                key: key.to_string(),
                words: words.map(str::to_string).collect(),
                file: file.to_string(),
                place: place_in(line, key, number + 1),
            });
        }
    }
    materials
}
