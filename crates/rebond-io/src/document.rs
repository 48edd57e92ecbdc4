//! One tree for every text that describes a scene or settings: values, and where each of them stands.
//!
//! A [`Document`] is read from TOML, from a command-line argument or built by hand (from Python, say), and handed to
//! serde by [`crate::deserialize`]. It stays around afterwards: what is found wrong later, when a scene is built from
//! well-formed data, is known by its path, and [`Document::error_at`] turns that path back into a line and a column.

use crate::error::{Error, Place};
use std::ops::Range;
use toml::de::{DeTable, DeValue};

/// Bytes of the text.
pub type Span = Range<usize>;

/// A value and where it stands.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Node {
    /// The value.
    pub value: Value,
    /// Where it stands, if it was read from a text. A table under a header stands at its header.
    pub span: Option<Span>,
}

/// A value; a tree of them.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// `true` or `false`.
    Bool(bool),
    /// A whole number.
    Integer(i64),
    /// Any other number.
    Float(f64),
    /// Text.
    String(String),
    /// Values in order.
    Array(Vec<Node>),
    /// Named values in order; no name occurs twice.
    Table(Vec<Entry>),
}

/// One named value of a table.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    /// The name.
    pub key: String,
    /// Where the name stands.
    pub key_span: Option<Span>,
    /// The value.
    pub node: Node,
}

/// A tree of values and the text it was read from.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Document {
    /// The tree.
    pub root: Node,
    file: Option<String>,
    text: Option<String>,
}

/// Nested brackets a command-line argument may hold.
const MAX_NESTING: usize = 16;

impl Default for Value {
    fn default() -> Self {
        Self::Table(Vec::new())
    }
}

impl From<Value> for Node {
    fn from(value: Value) -> Self {
        Self { value, span: None }
    }
}

impl Node {
    /// The entry of that name, if this is a table that has one.
    pub fn get(&self, key: &str) -> Option<&Entry> {
        match &self.value {
            Value::Table(entries) => entries.iter().find(|e| e.key == key),
            _ => None,
        }
    }
}

impl Document {
    /// Reads TOML; `file` is what errors call it.
    pub fn parse_toml(text: &str, file: &str) -> Result<Self, Error> {
        // A byte order mark is no column.
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        let mut document = Self { root: Node::default(), file: Some(file.to_string()), text: Some(text.to_string()) };
        let table = DeTable::parse(text).map_err(|e| {
            document.error_in(e.span(), String::new(), format!("not valid TOML: {}", e.message().trim()))
        })?;
        document.root.value = from_toml_table(table.into_inner(), &document)?;
        // What is missing at the top is missing from the file: its beginning is the place.
        document.root.span = Some(0..0);
        Ok(document)
    }

    /// Reads a command-line argument `name` or `name:key=value,key=value` as the table
    /// `{ type = "name", key = value, … }`.
    ///
    /// A value is `true`, `false`, a number, a list `[value,value]`, or else text, whose brackets must match.
    pub fn parse_settings(text: &str) -> Result<Self, Error> {
        let document = Self { root: Node::default(), file: None, text: Some(text.to_string()) };
        let fail = |span: Span, message: String| Err(document.error_in(Some(span), String::new(), message));
        let name_end = text.find(':').unwrap_or(text.len());
        if text[..name_end].trim().is_empty() {
            return fail(0..name_end, "a name is missing here".into())
                .map_err(|e: Error| e.with_help("write `name` or `name:key=value,key=value`"));
        }
        let mut entries = vec![Entry {
            key: "type".into(),
            key_span: Some(0..name_end),
            node: Node { value: Value::String(text[..name_end].trim().into()), span: Some(0..name_end) },
        }];
        let settings = if name_end == text.len() { Vec::new() } else { split_list(text, name_end + 1..text.len()) };
        for part in settings {
            let part = trim_span(text, part);
            let Some(equals) = text[part.clone()].find('=') else {
                let message = match &text[part.clone()] {
                    "" => "a setting is missing here".to_string(),
                    other => format!("the setting \"{other}\" has no value"),
                };
                return fail(part, message).map_err(|e: Error| e.with_help("write settings as `key=value,key=value`"));
            };
            let key_span = trim_span(text, part.start..part.start + equals);
            let key = &text[key_span.clone()];
            if key.is_empty() {
                return fail(part, "a key is missing before the `=`".into());
            }
            if key == "type" || entries.iter().any(|e| e.key == key) {
                return fail(key_span, format!("the key \"{key}\" is given twice"));
            }
            let value_span = trim_span(text, part.start + equals + 1..part.end);
            if value_span.is_empty() {
                return fail(key_span, format!("the setting \"{key}\" has no value"));
            }
            let Some(node) = settings_value(text, value_span.clone(), 0) else {
                return fail(value_span, "brackets that do not match".into());
            };
            entries.push(Entry { key: key.into(), key_span: Some(key_span), node });
        }
        Ok(Self { root: Node { value: Value::Table(entries), span: Some(0..name_end) }, ..document })
    }

    /// A tree that was not read from a text; `name` is what errors call it.
    pub fn from_tree(root: Node, name: Option<&str>) -> Self {
        Self { root, file: name.map(str::to_string), text: None }
    }

    /// What errors call this document.
    pub fn file(&self) -> Option<&str> {
        self.file.as_deref()
    }

    /// Where the value of that path stands, such as `shapes[3].emission.radiance` or `materials.white`: its key if it
    /// has one, else itself; where the path leaves the tree, the place it left it.
    ///
    /// Keys may themselves hold dots and brackets, quoted as in TOML or not; `-` and `_` in keys count as the same.
    pub fn locate(&self, path: &str) -> Option<Span> {
        let mut node = &self.root;
        let mut place = node.span.clone();
        let mut rest = path;
        while !rest.is_empty() {
            let (child, child_place, after) = match &node.value {
                Value::Table(entries) => {
                    let step = rest.strip_prefix('.').unwrap_or(rest);
                    let matching = entries.iter().filter_map(|e| Some((e, strip_key(step, &e.key)?)));
                    // The longest key that fits.
                    let Some((entry, after)) = matching.min_by_key(|(_, after)| after.len()) else { break };
                    (&entry.node, entry.key_span.clone().or(entry.node.span.clone()), after)
                }
                // A list of one may stand for its item.
                Value::Array(items) if items.len() == 1 && !rest.starts_with('[') => {
                    (&items[0], items[0].span.clone(), rest)
                }
                Value::Array(items) => {
                    let Some((index, after)) = rest.strip_prefix('[').and_then(|r| r.split_once(']')) else { break };
                    let Some(item) = index.trim().parse::<usize>().ok().and_then(|i| items.get(i)) else { break };
                    (item, item.span.clone(), after)
                }
                _ => break,
            };
            node = child;
            place = child_place.or(place);
            rest = after;
        }
        place
    }

    /// An error about the value of that path (see [`Document::locate`]).
    pub fn error_at(&self, path: &str, message: impl Into<String>) -> Error {
        self.error_in(self.locate(path), path.to_string(), message)
    }

    pub(crate) fn error_in(&self, span: Option<Span>, path: String, message: impl Into<String>) -> Error {
        let place = match (&self.text, span) {
            (Some(text), Some(span)) => Some(Box::new(place_of(text, span))),
            _ => None,
        };
        Error { file: self.file.clone(), place, path, message: message.into(), help: None }
    }
}

/// What follows `key` in `path`, if the path begins with it.
fn strip_key<'p>(path: &'p str, key: &str) -> Option<&'p str> {
    let same = |a: char, b: char| a == b || matches!((a, b), ('-', '_') | ('_', '-'));
    let strip = |path: &'p str| {
        let mut rest = path.chars();
        key.chars().all(|k| rest.next().is_some_and(|p| same(p, k))).then_some(rest.as_str())
    };
    let quoted = |quote: char| path.strip_prefix(quote).and_then(strip).and_then(|rest| rest.strip_prefix(quote));
    let after = quoted('"').or_else(|| quoted('\'')).or_else(|| strip(path))?;
    (after.is_empty() || after.starts_with(['.', '['])).then_some(after)
}

/// Bytes of a line that is shown; a whole scene may be one line.
const LONGEST_LINE: usize = 4096;

/// The place of a span, without its line if that is too long to be shown.
pub(crate) fn place_of(text: &str, span: Span) -> Place {
    let start = text.floor_char_boundary(span.start.min(text.len()));
    let line_start = text[..start].rfind('\n').map_or(0, |i| i + 1);
    let line_end = text[start..].find('\n').map_or(text.len(), |i| start + i);
    let end = text.ceil_char_boundary(span.end.clamp(start, line_end));
    Place {
        line: text[..start].matches('\n').count() + 1,
        column: text[line_start..start].chars().count() + 1,
        width: text[start..end].trim_end_matches('\r').chars().count().max(1),
        source_line: match line_end - line_start {
            0..=LONGEST_LINE => text[line_start..line_end].trim_end_matches('\r').to_string(),
            _ => String::new(),
        },
    }
}

fn from_toml_table(table: DeTable<'_>, document: &Document) -> Result<Value, Error> {
    let entry = |(key, value): (toml::Spanned<_>, toml::Spanned<_>)| {
        let key_span = Some(key.span());
        let key: toml::de::DeString<'_> = key.into_inner();
        Ok(Entry { key: key.into_owned(), key_span, node: from_toml_value(value, document)? })
    };
    Ok(Value::Table(table.into_iter().map(entry).collect::<Result<_, Error>>()?))
}

fn from_toml_value(value: toml::Spanned<DeValue<'_>>, document: &Document) -> Result<Node, Error> {
    let span = Some(value.span());
    let fail = |message: String| Err(document.error_in(span.clone(), String::new(), message));
    let value = match value.into_inner() {
        DeValue::Boolean(b) => Value::Bool(b),
        DeValue::Integer(i) => match i64::from_str_radix(i.as_str(), i.radix()) {
            Ok(i) => Value::Integer(i),
            Err(_) => return fail(format!("the number {} is too large", i.as_str())),
        },
        DeValue::Float(x) => match x.as_str().parse() {
            Ok(x) => Value::Float(x),
            Err(_) => return fail(format!("{} is not a number", x.as_str())),
        },
        DeValue::String(s) => Value::String(s.into_owned()),
        DeValue::Datetime(_) => {
            return fail("dates and times mean nothing here".into())
                .map_err(|e: Error| e.with_help("if it is meant as text, quote it"));
        }
        DeValue::Array(items) => {
            Value::Array(items.into_iter().map(|v| from_toml_value(v, document)).collect::<Result<_, _>>()?)
        }
        DeValue::Table(table) => from_toml_table(table, document)?,
    };
    Ok(Node { value, span })
}

/// The same place without white space at either end.
fn trim_span(text: &str, span: Span) -> Span {
    let part = &text[span.clone()];
    let start = span.start + (part.len() - part.trim_start().len());
    start..start + part.trim().len()
}

/// The parts between the commas that stand outside brackets.
fn split_list(text: &str, span: Span) -> Vec<Span> {
    let (mut parts, mut start, mut depth) = (Vec::new(), span.start, 0usize);
    for (i, byte) in text[span.clone()].bytes().enumerate() {
        match byte {
            b'[' | b'{' => depth += 1,
            b']' | b'}' => depth = depth.saturating_sub(1),
            b',' if depth == 0 => {
                parts.push(start..span.start + i);
                start = span.start + i + 1;
            }
            _ => {}
        }
    }
    parts.push(start..span.end);
    parts
}

/// Whether every `[` has its `]`, as in the expression `L[DG]*E`.
fn is_balanced(word: &str) -> bool {
    let mut depth = 0_i32;
    let never_below = word.bytes().all(|byte| {
        depth += i32::from(byte == b'[') - i32::from(byte == b']');
        depth >= 0
    });
    never_below && depth == 0
}

/// The value written there; `None` if its brackets do not match.
fn settings_value(text: &str, span: Span, nesting: usize) -> Option<Node> {
    let word = &text[span.clone()];
    let value = if let Some(inside) = word.strip_prefix('[') {
        let inside = inside.strip_suffix(']').filter(|_| nesting < MAX_NESTING)?;
        let parts = match inside.trim() {
            "" => Vec::new(),
            _ => split_list(text, span.start + 1..span.end - 1),
        };
        let item = |part| settings_value(text, trim_span(text, part), nesting + 1);
        Value::Array(parts.into_iter().map(item).collect::<Option<_>>()?)
    } else {
        let unsigned = word.strip_prefix(['+', '-']).unwrap_or(word);
        let number =
            unsigned.starts_with(|c: char| c.is_ascii_digit() || c == '.') || matches!(unsigned, "nan" | "inf");
        match (word, word.parse(), word.parse()) {
            ("true", ..) => Value::Bool(true),
            ("false", ..) => Value::Bool(false),
            (_, Ok(integer), _) => Value::Integer(integer),
            (_, _, Ok(float)) if number => Value::Float(float),
            _ if !is_balanced(word) => return None,
            _ => Value::String(word.into()),
        }
    };
    Some(Node { value, span: Some(span) })
}
