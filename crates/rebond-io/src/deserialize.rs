//! From a [`Document`] to any type that derives serde's `Deserialize`, with every error at its exact place.
//!
//! What a plain derived type looks like in a text:
//!
//! - A struct is a table. With `#[serde(deny_unknown_fields)]` a wrong key is an error at that key.
//! - An enum (serde's default, *external* tagging) is a table with the key `type`, which names the variant; the other
//!   keys are the variant's content. So `enum Material { Diffuse(Diffuse), Mirror }` reads
//!   `{ type = "diffuse", reflectance = 0.5 }` and `{ type = "mirror" }`. The bare string `"mirror"` stands for
//!   `{ type = "mirror" }`, whatever the variant's kind.
//! - A whole number may stand where a fraction is wanted, `4.0` may stand where a whole number is wanted.
//! - `nan` and `inf` are errors everywhere, and so is a number no `f32` can hold.
//! - A fixed-size array or a tuple wants exactly that many values.
//!
//! A hand-written `Deserialize` that calls `deserialize_any` gets `visit_seq`, `visit_map`, `visit_str`, `visit_bool`,
//! `visit_i64` or `visit_f64`. Its `visit_map` may pass the map on with serde's `MapAccessDeserializer`, also to an enum
//! as described above, without losing any place. `#[serde(untagged)]`, `#[serde(flatten)]` and internally tagged enums
//! work as far as serde's own buffer goes: an error inside then has the place of the whole value, and an enum inside
//! an untagged enum must be a bare string.

use crate::document::{Document, Entry, Node, Span, Value};
use crate::error::Error;
use serde::de::{self, DeserializeOwned, DeserializeSeed, Deserializer, Expected, Unexpected, Visitor};
use std::fmt::Display;

/// Reads a value from TOML; `file` is what errors call it.
pub fn from_toml<T: DeserializeOwned>(text: &str, file: &str) -> Result<(T, Document), Error> {
    let document = Document::parse_toml(text, file)?;
    Ok((document.read()?, document))
}

/// Reads a value from a command-line argument `name` or `name:key=value,key=value`, which stands for the table
/// `{ type = "name", key = value, … }`. Errors give the column in the argument.
pub fn from_settings<T: DeserializeOwned>(text: &str) -> Result<(T, Document), Error> {
    let document = Document::parse_settings(text)?;
    Ok((document.read()?, document))
}

impl Document {
    /// Reads a value from the whole tree.
    pub fn read<T: DeserializeOwned>(&self) -> Result<T, Error> {
        T::deserialize(Reader { node: &self.root, tagged: false }).map_err(|failure| {
            let Failure { span, path, message, help, .. } = *failure.0;
            Error { help, ..self.error_in(span, path, message) }
        })
    }
}

/// An error on its way up to where its file is known.
#[derive(Debug)]
struct Raised(Box<Failure>);

#[derive(Debug, Default)]
struct Failure {
    span: Option<Span>,
    path: String,
    message: String,
    help: Option<String>,
    /// The valid names, if the fault is the name of an enum's variant.
    variants: Option<&'static [&'static str]>,
}

impl Raised {
    fn new(message: String) -> Self {
        Self(Box::new(Failure { message, ..Failure::default() }))
    }

    fn with_help(mut self, help: String) -> Self {
        self.0.help = Some(help);
        self
    }

    /// The first to know a place knows the narrowest.
    fn at(mut self, span: &Option<Span>) -> Self {
        self.0.span = self.0.span.or_else(|| span.clone());
        self
    }

    fn under_key(mut self, key: &str) -> Self {
        let plain = !key.is_empty() && key.chars().all(|c| c.is_alphanumeric() || matches!(c, '-' | '_'));
        let key = if plain { key.to_string() } else { format!("\"{key}\"") };
        let dot = if self.0.path.is_empty() || self.0.path.starts_with('[') { "" } else { "." };
        self.0.path = format!("{key}{dot}{}", self.0.path);
        self
    }

    fn under_index(mut self, index: usize) -> Self {
        let dot = if self.0.path.is_empty() || self.0.path.starts_with('[') { "" } else { "." };
        self.0.path = format!("[{index}]{dot}{}", self.0.path);
        self
    }

    fn unknown(what: &str, name: &str, valid: &[&str]) -> Self {
        let raised = Self::new(format!("unknown {what} \"{name}\""));
        if valid.is_empty() {
            return raised.with_help(format!("no {what} is valid here"));
        }
        let guess = nearest(name, valid).map_or(String::new(), |guess| format!("did you mean \"{guess}\"? "));
        raised.with_help(format!("{guess}valid {what}s: {}", valid.join(", ")))
    }

    /// An error in the name of an enum's variant, given as the tag of a table.
    fn in_tag(self, name: &str, span: &Option<Span>) -> Self {
        let error = match self.0.variants {
            Some(valid) => Self::unknown(TAG, name, valid),
            None => self,
        };
        error.at(span).under_key(TAG)
    }

    fn expected(what: &str, found: &Value) -> Self {
        Self::new(format!("expected {what}, found {}", name_of(found)))
    }
}

impl Display for Raised {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0.message)
    }
}

impl std::error::Error for Raised {}

impl de::Error for Raised {
    fn custom<T: Display>(message: T) -> Self {
        Self::new(message.to_string())
    }

    fn invalid_type(found: Unexpected<'_>, expected: &dyn Expected) -> Self {
        Self::new(format!("expected {}, found {}", plain_words(expected), plain_name(found)))
    }

    fn invalid_value(found: Unexpected<'_>, expected: &dyn Expected) -> Self {
        Self::invalid_type(found, expected)
    }

    fn invalid_length(length: usize, expected: &dyn Expected) -> Self {
        Self::new(format!("expected {}, found {length} values", plain_words(expected)))
    }

    fn unknown_variant(name: &str, valid: &'static [&'static str]) -> Self {
        let mut raised = Self::unknown("value", name, valid);
        raised.0.variants = Some(valid);
        raised
    }

    fn unknown_field(name: &str, valid: &'static [&'static str]) -> Self {
        Self::unknown("key", name, valid)
    }

    fn missing_field(name: &'static str) -> Self {
        Self::new(format!("the key \"{name}\" is missing"))
    }

    fn duplicate_field(name: &'static str) -> Self {
        Self::new(format!("the key \"{name}\" is given twice"))
    }
}

/// The valid name most like `name`, if any is like it at all.
pub fn nearest<'a>(name: &str, valid: &[&'a str]) -> Option<&'a str> {
    let plain = |s: &str| s.to_lowercase().replace(['_', ' '], "-");
    let name = plain(name);
    let far = |v: &str| {
        let v = plain(v);
        let start_of = name.len() >= 3 && (v.starts_with(&name) || name.starts_with(&v));
        (strsim::damerau_levenshtein(&name, &v), v.chars().count().max(name.chars().count()), start_of)
    };
    let close = valid.iter().map(|&v| (far(v), v)).filter(|&((distance, length, start_of), _)| {
        // A third of the letters wrong is still a slip.
        start_of || distance * 3 <= length || distance == 1 && length > 1
    });
    close.min_by_key(|&((distance, ..), _)| distance).map(|(_, v)| v)
}

/// serde's words for what it expects, in the words of a scene file.
fn plain_words(expected: &dyn Expected) -> String {
    let words = expected.to_string();
    let kind = words.split(' ').next().unwrap_or_default();
    match words.as_str() {
        "a sequence" => "an array".into(),
        "a map" => "a table".into(),
        "unit" => "nothing".into(),
        _ if words.starts_with("a nonzero") => "a whole number of 1 or more".into(),
        _ if matches!(kind, "struct" | "enum" | "variant" | "unit") || words.starts_with("struct variant") => {
            "a table".into()
        }
        _ => words,
    }
}

fn plain_name(found: Unexpected<'_>) -> String {
    match found {
        Unexpected::Bool(b) => format!("`{b}`"),
        Unexpected::Unsigned(i) => format!("the whole number {i}"),
        Unexpected::Signed(i) => format!("the whole number {i}"),
        Unexpected::Float(x) => format!("the number {x:?}"),
        Unexpected::Str(s) => format!("the text \"{s}\""),
        Unexpected::Seq => "an array".into(),
        Unexpected::Map | Unexpected::StructVariant => "a table".into(),
        Unexpected::NewtypeVariant | Unexpected::TupleVariant => "a table".into(),
        Unexpected::UnitVariant => "a bare name".into(),
        other => other.to_string(),
    }
}

fn name_of(value: &Value) -> String {
    plain_name(match value {
        Value::Bool(b) => Unexpected::Bool(*b),
        Value::Integer(i) => Unexpected::Signed(*i),
        Value::Float(x) => Unexpected::Float(*x),
        Value::String(s) => Unexpected::Str(s),
        Value::Array(_) => Unexpected::Seq,
        Value::Table(_) => Unexpected::Map,
    })
}

/// The tag of an enum's table.
const TAG: &str = "type";

/// A node, seen whole or, when `tagged`, as the content of an enum's variant: a table without its tag, and a bare
/// string as an empty one.
#[derive(Clone, Copy)]
struct Reader<'de> {
    node: &'de Node,
    tagged: bool,
}

impl<'de> Reader<'de> {
    /// The table's entries; `None` if there is no table here.
    fn entries(self) -> Option<Entries<'de>> {
        let entries: &[Entry] = match &self.node.value {
            Value::Table(entries) => entries,
            Value::String(_) if self.tagged => &[],
            _ => return None,
        };
        Some(Entries { table: self.node, left: entries.iter(), hide_tag: self.tagged, current: None })
    }

    fn expected(self, what: &str) -> Raised {
        Raised::expected(what, &self.node.value).at(&self.node.span)
    }

    fn table<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Raised> {
        let entries = self.entries().ok_or_else(|| self.expected("a table"))?;
        visitor.visit_map(entries).map_err(|e| e.at(&self.node.span))
    }

    fn array<V: Visitor<'de>>(self, length: Option<usize>, visitor: V) -> Result<V::Value, Raised> {
        let wanted = || length.map_or("an array".to_string(), |n| format!("an array of {n} values"));
        let Value::Array(items) = &self.node.value else { return Err(self.expected(&wanted())) };
        let wrong_length = || {
            let s = if items.len() == 1 { "" } else { "s" };
            Err(Raised::new(format!("expected {}, found {} value{s}", wanted(), items.len())).at(&self.node.span))
        };
        if length.is_some_and(|n| n != items.len()) {
            return wrong_length();
        }
        let mut left = Items { left: items.iter(), index: 0 };
        let value = visitor.visit_seq(&mut left).map_err(|e| e.at(&self.node.span))?;
        if left.left.len() > 0 {
            return Err(Raised::new(format!("expected an array of {} values, found {}", left.index, items.len()))
                .at(&self.node.span));
        }
        Ok(value)
    }

    /// A whole number from `low` to `high`.
    fn whole(self, low: i128, high: i128) -> Result<i128, Raised> {
        let number = match self.node.value {
            Value::Integer(i) => Some(i as i128),
            // Beyond 2⁵³ a float may have been rounded to a whole number.
            Value::Float(x) if x.fract() == 0.0 && x.abs() <= 9_007_199_254_740_992.0 => Some(x as i128),
            _ => None,
        };
        let in_range = number.filter(|n| (low..=high).contains(n));
        in_range.ok_or_else(|| match (number, low, high) {
            (None, ..) => self.expected("a whole number"),
            (_, 0, _) if number < Some(0) => self.expected("a whole number that is not negative"),
            _ => self.expected(&format!("a whole number from {low} to {high}")),
        })
    }

    /// A finite number that an `f32` can hold.
    fn number(self) -> Result<f64, Raised> {
        match self.node.value {
            Value::Integer(i) => Ok(i as f64),
            Value::Float(x) if x.is_nan() => {
                Err(Raised::new("expected a number, found `nan`".into()).at(&self.node.span))
            }
            Value::Float(x) if x.is_infinite() => {
                Err(Raised::new("expected a finite number, found an infinite one".into()).at(&self.node.span))
            }
            Value::Float(x) if !(x as f32).is_finite() => {
                Err(Raised::new(format!("the number {x:?} is too large for single precision")).at(&self.node.span))
            }
            Value::Float(x) => Ok(x),
            _ => Err(self.expected("a number")),
        }
    }

    fn text(self) -> Result<&'de str, Raised> {
        match &self.node.value {
            Value::String(s) => Ok(s),
            _ => Err(self.expected("text in quotes")),
        }
    }

    /// An error if a variant without content has any.
    fn no_content(self) -> Result<(), Raised> {
        let extra = self.entries().and_then(|mut entries| entries.next_entry());
        extra.map_or(Ok(()), |entry| Err(Raised::unknown("key", &entry.key, &[TAG]).at(&entry.key_span)))
    }
}

macro_rules! whole_numbers {
    ($($method:ident $visit:ident $type:ty),*) => {$(
        fn $method<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Raised> {
            let number = self.whole(<$type>::MIN as i128, <$type>::MAX as i128)?;
            visitor.$visit(number as $type).map_err(|e: Raised| e.at(&self.node.span))
        }
    )*};
}

impl<'de> Deserializer<'de> for Reader<'de> {
    type Error = Raised;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Raised> {
        let result = match &self.node.value {
            _ if self.tagged => return self.table(visitor),
            Value::Bool(b) => visitor.visit_bool(*b),
            Value::Integer(i) => visitor.visit_i64(*i),
            Value::Float(_) => visitor.visit_f64(self.number()?),
            Value::String(s) => visitor.visit_borrowed_str(s),
            Value::Array(_) => return self.array(None, visitor),
            Value::Table(_) => return self.table(visitor),
        };
        result.map_err(|e: Raised| e.at(&self.node.span))
    }

    fn deserialize_bool<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Raised> {
        match self.node.value {
            Value::Bool(b) => visitor.visit_bool(b).map_err(|e: Raised| e.at(&self.node.span)),
            _ => Err(self.expected("`true` or `false`")),
        }
    }

    whole_numbers!(
        deserialize_i8 visit_i8 i8, deserialize_i16 visit_i16 i16, deserialize_i32 visit_i32 i32,
        deserialize_i64 visit_i64 i64, deserialize_u8 visit_u8 u8, deserialize_u16 visit_u16 u16,
        deserialize_u32 visit_u32 u32, deserialize_u64 visit_u64 u64
    );

    fn deserialize_f32<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Raised> {
        self.deserialize_f64(visitor)
    }

    fn deserialize_f64<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Raised> {
        visitor.visit_f64(self.number()?).map_err(|e: Raised| e.at(&self.node.span))
    }

    fn deserialize_str<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Raised> {
        visitor.visit_borrowed_str(self.text()?).map_err(|e: Raised| e.at(&self.node.span))
    }

    fn deserialize_string<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Raised> {
        self.deserialize_str(visitor)
    }

    fn deserialize_char<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Raised> {
        self.deserialize_str(visitor)
    }

    fn deserialize_identifier<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Raised> {
        self.deserialize_str(visitor)
    }

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Raised> {
        visitor.visit_some(self).map_err(|e| e.at(&self.node.span))
    }

    fn deserialize_unit<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Raised> {
        if !matches!(self.node.value, Value::Table(_)) && !self.tagged {
            return Err(self.expected("an empty table"));
        }
        self.no_content()?;
        visitor.visit_unit().map_err(|e: Raised| e.at(&self.node.span))
    }

    fn deserialize_unit_struct<V: Visitor<'de>>(self, _: &'static str, visitor: V) -> Result<V::Value, Raised> {
        self.deserialize_unit(visitor)
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(self, _: &'static str, visitor: V) -> Result<V::Value, Raised> {
        visitor.visit_newtype_struct(self).map_err(|e| e.at(&self.node.span))
    }

    fn deserialize_seq<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Raised> {
        self.array(None, visitor)
    }

    fn deserialize_tuple<V: Visitor<'de>>(self, length: usize, visitor: V) -> Result<V::Value, Raised> {
        self.array(Some(length), visitor)
    }

    fn deserialize_tuple_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        length: usize,
        visitor: V,
    ) -> Result<V::Value, Raised> {
        self.array(Some(length), visitor)
    }

    fn deserialize_map<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Raised> {
        self.table(visitor)
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        _: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Raised> {
        self.table(visitor)
    }

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        _: &'static str,
        variants: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Raised> {
        let (name, name_span) = match &self.node.value {
            Value::String(name) if !self.tagged => (name, &self.node.span),
            Value::Table(_) if !self.tagged => {
                let help = || format!("valid types: {}", variants.join(", "));
                let Some(tag) = self.node.get(TAG) else {
                    return Err(de::Error::missing_field(TAG))
                        .map_err(|e: Raised| e.with_help(help()).at(&self.node.span));
                };
                let Value::String(name) = &tag.node.value else {
                    let error = Raised::expected("the name of a type in quotes", &tag.node.value).with_help(help());
                    return Err(error.at(&tag.node.span).under_key(TAG));
                };
                (name, &tag.node.span)
            }
            _ => {
                let error = self.expected(&format!("a name or a table with the key \"{TAG}\""));
                return Err(error.with_help(format!("valid names: {}", variants.join(", "))));
            }
        };
        visitor
            .visit_enum(Tagged { name, name_span, content: Reader { tagged: true, ..self } })
            .map_err(|e| e.at(&self.node.span))
    }

    serde::forward_to_deserialize_any! { i128 u128 bytes byte_buf ignored_any }
}

/// An enum's variant: its name and its content.
struct Tagged<'de> {
    name: &'de str,
    name_span: &'de Option<Span>,
    content: Reader<'de>,
}

impl<'de> de::EnumAccess<'de> for Tagged<'de> {
    type Error = Raised;
    type Variant = Reader<'de>;

    fn variant_seed<V: DeserializeSeed<'de>>(self, seed: V) -> Result<(V::Value, Reader<'de>), Raised> {
        let variant = seed.deserialize(Name(self.name)).map_err(|e| match &self.content.node.value {
            Value::Table(_) => e.in_tag(self.name, self.name_span),
            _ => e.at(self.name_span),
        })?;
        Ok((variant, self.content))
    }
}

impl<'de> de::VariantAccess<'de> for Reader<'de> {
    type Error = Raised;

    fn unit_variant(self) -> Result<(), Raised> {
        self.no_content()
    }

    fn newtype_variant_seed<T: DeserializeSeed<'de>>(self, seed: T) -> Result<T::Value, Raised> {
        seed.deserialize(self).map_err(|e| e.at(&self.node.span))
    }

    fn tuple_variant<V: Visitor<'de>>(self, _: usize, _: V) -> Result<V::Value, Raised> {
        Err(Raised::new("a type of unnamed fields cannot be written in a table".into()).at(&self.node.span))
    }

    fn struct_variant<V: Visitor<'de>>(self, _: &'static [&'static str], visitor: V) -> Result<V::Value, Raised> {
        self.table(visitor)
    }
}

/// A key or a variant's name.
struct Name<'de>(&'de str);

impl<'de> Deserializer<'de> for Name<'de> {
    type Error = Raised;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Raised> {
        visitor.visit_borrowed_str(self.0)
    }

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        _: &'static str,
        _: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Raised> {
        visitor.visit_enum(de::value::BorrowedStrDeserializer::new(self.0))
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(self, _: &'static str, visitor: V) -> Result<V::Value, Raised> {
        visitor.visit_newtype_struct(self)
    }

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Raised> {
        visitor.visit_some(self)
    }

    serde::forward_to_deserialize_any! {
        bool i8 i16 i32 i64 i128 u8 u16 u32 u64 u128 f32 f64 char str string bytes byte_buf unit unit_struct seq tuple
        tuple_struct map struct identifier ignored_any
    }
}

/// The values of an array that are still to be read.
struct Items<'de> {
    left: std::slice::Iter<'de, Node>,
    index: usize,
}

impl<'de> de::SeqAccess<'de> for Items<'de> {
    type Error = Raised;

    fn next_element_seed<T: DeserializeSeed<'de>>(&mut self, seed: T) -> Result<Option<T::Value>, Raised> {
        let Some(node) = self.left.next() else { return Ok(None) };
        let index = self.index;
        self.index += 1;
        let value = seed.deserialize(Reader { node, tagged: false });
        value.map(Some).map_err(|e| e.at(&node.span).under_index(index))
    }

    fn size_hint(&self) -> Option<usize> {
        Some(self.left.len())
    }
}

/// The entries of a table that are still to be read.
struct Entries<'de> {
    table: &'de Node,
    left: std::slice::Iter<'de, Entry>,
    hide_tag: bool,
    /// What the last key stands for.
    current: Option<Current<'de>>,
}

#[derive(Clone, Copy)]
enum Current<'de> {
    Entry(&'de Entry),
    /// The key was the name of an enum's variant; its value is the rest of the table.
    Variant,
}

impl<'de> Entries<'de> {
    fn next_entry(&mut self) -> Option<&'de Entry> {
        self.left.by_ref().find(|e| !(self.hide_tag && e.key == TAG))
    }
}

impl<'de> de::MapAccess<'de> for Entries<'de> {
    type Error = Raised;

    fn next_key_seed<K: DeserializeSeed<'de>>(&mut self, seed: K) -> Result<Option<K::Value>, Raised> {
        let tag = self.table.get(TAG).filter(|_| !self.hide_tag && self.current.is_none());
        let Some(entry) = self.next_entry() else { return Ok(None) };
        let mut key = Key { key: &entry.key, tag, was_variant: false };
        let value = seed.deserialize(&mut key);
        let was_variant = key.was_variant;
        self.current = Some(if was_variant { Current::Variant } else { Current::Entry(entry) });
        value.map(Some).map_err(|e| match tag {
            Some(Entry { node: Node { value: Value::String(name), span }, .. }) if was_variant => e.in_tag(name, span),
            Some(tag) if was_variant => e.at(&tag.node.span).under_key(TAG),
            None if was_variant => e.at(&self.table.span),
            _ => e.at(&entry.key_span),
        })
    }

    fn next_value_seed<T: DeserializeSeed<'de>>(&mut self, seed: T) -> Result<T::Value, Raised> {
        match self.current {
            Some(Current::Entry(entry)) => seed
                .deserialize(Reader { node: &entry.node, tagged: false })
                .map_err(|e| e.at(&entry.node.span).under_key(&entry.key)),
            Some(Current::Variant) => seed.deserialize(Reader { node: self.table, tagged: true }),
            None => Err(Raised::new("a value was asked for before its key".into())),
        }
    }
}

/// The first key of a table that may yet turn out to be an enum's.
///
/// serde's `MapAccessDeserializer` reads an enum from a map as `{ variant: content }`: it asks for a key that names a
/// variant. Such a request is known by the words a derived enum expects its names with, and is answered with the tag.
struct Key<'de> {
    key: &'de str,
    tag: Option<&'de Entry>,
    was_variant: bool,
}

impl<'de> Deserializer<'de> for &mut Key<'de> {
    type Error = Raised;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Raised> {
        Name(self.key).deserialize_any(visitor)
    }

    fn deserialize_identifier<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Raised> {
        let expects: &dyn Expected = &visitor;
        if expects.to_string() != "variant identifier" {
            return Name(self.key).deserialize_any(visitor);
        }
        self.was_variant = true;
        match self.tag.map(|tag| &tag.node.value) {
            Some(Value::String(name)) => Name(name).deserialize_any(visitor),
            Some(other) => Err(Raised::expected("the name of a type in quotes", other)),
            None => Err(de::Error::missing_field(TAG)),
        }
    }

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        name: &'static str,
        variants: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Raised> {
        Name(self.key).deserialize_enum(name, variants, visitor)
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(self, name: &'static str, visitor: V) -> Result<V::Value, Raised> {
        Name(self.key).deserialize_newtype_struct(name, visitor)
    }

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Raised> {
        visitor.visit_some(self)
    }

    serde::forward_to_deserialize_any! {
        bool i8 i16 i32 i64 i128 u8 u16 u32 u64 u128 f32 f64 char str string bytes byte_buf unit unit_struct seq tuple
        tuple_struct map struct ignored_any
    }
}

#[cfg(test)]
mod tests;
