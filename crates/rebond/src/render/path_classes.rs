//! Which light a picture shows, by the path it took: regular expressions over its vertices (Heckbert 1990, §2).
//!
//! ```text
//! L   a light                         E   the eye
//! D   reflected by a diffuse surface  S   reflected by a mirror, into one direction
//! G   reflected in any other way      T   transmitted, smooth or rough
//! ```
//!
//! A path is written from the light to the eye: `LDE` is direct light on diffuse surfaces, `L(S|T)+DE` a caustic, `L.*E`
//! everything. What stands for a vertex hangs on its material and its two directions, never on how the path was found, so
//! that all algorithms mean the same. `2`, `3..4` and `5..` select by the number of vertices, the light and the eye included.
//!
//! Expressions become one finite automaton that steps along paths from the eye, a table look-up per vertex.

use rebond_lanes::{Index, Real, Record, scalar::Index1};
use regex_automata::dfa::{Automaton, StartKind, dense};
use regex_automata::nfa::thompson;
use regex_automata::util::primitives::StateID;
use regex_automata::util::{start, syntax};
use regex_automata::{Anchored, MatchKind};
use serde::de::{Deserialize, Deserializer, Error, Visitor};
use serde::{Serialize, Serializer};
use std::collections::HashMap;
use std::fmt;

pub use crate::bsdf::Event;

/// Most vertices that a number may ask for.
const MOST_VERTICES: u32 = 1000;
/// Bytes that an expression may need to become an automaton.
const SIZE_LIMIT: usize = 1 << 22;

/// An expression over paths, such as `LS+DE`, `2`, `3..4` or `5..`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PathExpression {
    text: String,
    /// As a regular expression, from the light to the eye.
    regex: String,
}

impl PathExpression {
    /// Every path.
    pub fn all() -> Self {
        "L.*E".parse().expect("a good expression")
    }
}

impl std::str::FromStr for PathExpression {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let number = |digits: &str| -> Result<u32, String> {
            let n = digits.parse().map_err(|_| format!("\"{digits}\" is no number of vertices"))?;
            if (2..=MOST_VERTICES).contains(&n) {
                Ok(n)
            } else {
                Err(format!("no path of {n} vertices: they have 2 to {MOST_VERTICES}, the light and the eye included"))
            }
        };
        let regex = if text.starts_with(|c: char| c.is_ascii_digit()) || text.starts_with("..") {
            let (from, to) = text.split_once("..").map_or((text, text), |(from, to)| (from, to));
            let from = if from.is_empty() { 2 } else { number(from)? };
            match to {
                "" => format!("L.{{{},}}E", from - 2),
                _ => {
                    let to = number(to)?;
                    if to < from {
                        return Err(format!("no number of vertices is in {text}"));
                    }
                    format!("L.{{{},{}}}E", from - 2, to - 2)
                }
            }
        } else {
            if let Some(c) = text.chars().find(|c| !"LDGSTE.()[]|*+?{},^0123456789".contains(*c)) {
                return Err(format!(
                    "'{c}' stands for nothing on a path: L is a light, D, G and S reflect (diffuse, glossy, mirror), \
                     T transmits, E is the eye"
                ));
            }
            text.to_owned()
        };
        let expression = Self { text: text.to_owned(), regex };
        let classes = PathClasses::new(&expression, &[])?;
        if classes.none_is_wanted() {
            return Err(format!("no path is \"{text}\": they begin with L, the light, and end with E, the eye"));
        }
        Ok(expression)
    }
}

impl fmt::Display for PathExpression {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

impl Serialize for PathExpression {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(&self.text)
    }
}

impl<'de> Deserialize<'de> for PathExpression {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Text;
        impl Visitor<'_> for Text {
            type Value = PathExpression;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("an expression over paths such as \"LS+DE\", or a number of vertices such as 3 or 3..4")
            }
            fn visit_str<E: Error>(self, text: &str) -> Result<PathExpression, E> {
                text.parse().map_err(E::custom)
            }
            fn visit_i64<E: Error>(self, vertices: i64) -> Result<PathExpression, E> {
                self.visit_str(&vertices.to_string())
            }
            fn visit_u64<E: Error>(self, vertices: u64) -> Result<PathExpression, E> {
                self.visit_str(&vertices.to_string())
            }
            fn visit_f64<E: Error>(self, number: f64) -> Result<PathExpression, E> {
                self.visit_str(&number.to_string())
            }
        }
        deserializer.deserialize_any(Text)
    }
}

/// A layer of a picture that is split: the light of the paths of an expression that no layer before it took.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PathLayer {
    /// Its name.
    pub name: String,
    /// Its paths.
    pub paths: PathExpression,
}

impl PathLayer {
    fn new(name: &str, paths: &str) -> Self {
        Self { name: name.into(), paths: paths.parse().expect("a good expression") }
    }

    /// A layer for each number of vertices up to `longest`, and one for all longer paths.
    pub fn by_length(longest: u32) -> Vec<Self> {
        let mut layers: Vec<Self> =
            (2..=longest).map(|n| Self::new(&format!("vertices-{n}"), &n.to_string())).collect();
        layers.push(Self::new("longer", &format!("{}..", longest + 1)));
        layers
    }

    /// Layers by what happened last before the eye, and whether it happened to light that came straight from a lamp.
    pub fn by_class() -> Vec<Self> {
        [
            ("emission", "LE"),
            ("direct-diffuse", "LDE"),
            ("direct-glossy", "LGE"),
            ("direct-specular", "L(S|T)E"),
            ("caustic", "L(G|S|T)*(S|T)(G|S|T)*DE"),
            ("indirect-diffuse", "L.*DE"),
            ("indirect-glossy", "L.*GE"),
            ("indirect-specular", "L.*(S|T)E"),
        ]
        .map(|(name, paths)| Self::new(name, paths))
        .to_vec()
    }

    /// A layer for each of these expressions, and one for the rest.
    pub fn by_expressions(expressions: &[PathExpression]) -> Vec<Self> {
        let mut layers: Vec<Self> =
            expressions.iter().map(|e| Self { name: e.to_string(), paths: e.clone() }).collect();
        layers.push(Self::new("rest", "L.*E"));
        layers
    }
}

/// The automaton: which paths count, and in which layer.
#[derive(Clone, Debug)]
pub struct PathClasses {
    /// Per state two records: where each [`Event`] leads; [layer + 1 if light now counts or 0, whether any ever may, –, –]
    /// (words).
    states: Vec<Record>,
    layers: usize,
}

/// The state of a path that has left the eye.
const START: u32 = 0;

impl PathClasses {
    /// Light of the paths of `wanted`, laid into `layers`. If a path is in none of several layers, the whole is more than their
    /// sum.
    pub fn new(wanted: &PathExpression, layers: &[PathLayer]) -> Result<Self, String> {
        let wanted = Dfa::new(&[&wanted.regex])?;
        let all = PathExpression { text: String::new(), regex: "L.*E".into() };
        let patterns: Vec<&str> = match layers {
            [] => vec![&all.regex],
            layers => layers.iter().map(|l| &*l.paths.regex).collect(),
        };
        let sorted = Dfa::new(&patterns)?;

        // States are pairs of states, found breadth-first.
        let mut numbers = HashMap::new();
        let mut found = vec![(wanted.start, sorted.start)];
        numbers.insert(found[0], START);
        let (mut next, mut light) = (Vec::new(), Vec::new());
        while let Some(&(a, b)) = found.get(next.len()) {
            next.push(Event::ALL.map(|event| {
                let pair = (wanted.step(a, event.symbol()), sorted.step(b, event.symbol()));
                *numbers.entry(pair).or_insert_with(|| {
                    found.push(pair);
                    found.len() as u32 - 1
                })
            }));
            let layer = wanted.pattern_after(a, b'L').and_then(|_| sorted.pattern_after(b, b'L'));
            light.push(layer.map_or(0, |layer| layer + 1));
        }
        // A state is alive if light counts there, or wherever it leads.
        let mut alive: Vec<bool> = light.iter().map(|l| *l != 0).collect();
        loop {
            let grown: Vec<bool> =
                (0..alive.len()).map(|s| alive[s] || next[s].iter().any(|to| alive[*to as usize])).collect();
            if grown == alive {
                break;
            }
            alive = grown;
        }
        let records = (0..next.len())
            .flat_map(|s| [Record::words(next[s]), Record::words([light[s], u32::from(alive[s]), 0, 0])])
            .collect();
        Ok(Self { states: records, layers: layers.len() })
    }

    /// How many layers there are.
    pub fn layers(&self) -> usize {
        self.layers
    }

    fn none_is_wanted(&self) -> bool {
        !self.may_count::<f32>(Self::start::<f32>())
    }

    /// The state of paths that have left the eye.
    #[inline(always)]
    pub fn start<F: Real>() -> F::Index {
        F::Index::splat(START)
    }

    /// The state behind a vertex, on the way from the eye to the light.
    #[inline(always)]
    pub fn step<F: Real>(&self, state: F::Index, event: F::Index) -> F::Index {
        let next = F::words(&self.states, state + state);
        let mut to = next[0];
        for (k, candidate) in next.into_iter().enumerate().skip(1) {
            to = F::Index::select(event.eq(F::Index::splat(k as u32)), candidate, to);
        }
        to
    }

    /// Where light that arrives in this state goes: a layer's number + 1, or 0 if it does not count.
    #[inline(always)]
    pub fn light<F: Real>(&self, state: F::Index) -> F::Index {
        F::words(&self.states, state + state + F::Index::splat(1))[0]
    }

    /// Whether any path that goes on from this state counts.
    #[inline(always)]
    pub fn may_count<F: Real>(&self, state: F::Index) -> F::Mask {
        F::words(&self.states, state + state + F::Index::splat(1))[1].ne(F::Index::splat(0))
    }

    /// Where the light of a whole path goes, its events from the eye to the light; none if it does not count. Without layers
    /// all that counts is layer 0.
    pub fn layer_of(&self, events: impl IntoIterator<Item = Event>) -> Option<usize> {
        let state =
            events.into_iter().fold(Self::start::<f32>(), |state, event| self.step::<f32>(state, Index1(event as u32)));
        (self.light::<f32>(state).0 as usize).checked_sub(1)
    }
}

/// An automaton that reads paths from the eye to the light.
struct Dfa {
    automaton: dense::DFA<Vec<u32>>,
    start: StateID,
}

impl Dfa {
    fn new(patterns: &[&str]) -> Result<Self, String> {
        // Only what is a path may be repeated by a dot.
        let patterns: Vec<String> = patterns.iter().map(|p| p.replace('.', "[DGST]")).collect();
        let fail = |e: dense::BuildError| {
            let cause = std::error::Error::source(&e).map_or_else(|| e.to_string(), ToString::to_string);
            format!("not a regular expression over paths: {}", cause.trim().lines().next_back().unwrap_or_default())
        };
        let automaton = dense::Builder::new()
            .configure(
                dense::Config::new()
                    .start_kind(StartKind::Anchored)
                    .match_kind(MatchKind::All)
                    .minimize(true)
                    .dfa_size_limit(Some(SIZE_LIMIT))
                    .determinize_size_limit(Some(SIZE_LIMIT)),
            )
            .thompson(thompson::Config::new().reverse(true).nfa_size_limit(Some(SIZE_LIMIT)))
            .syntax(syntax::Config::new().unicode(false).utf8(false))
            .build_many(&patterns)
            .map_err(fail)?;
        let begin = automaton.start_state(&start::Config::new().anchored(Anchored::Yes)).map_err(|e| e.to_string())?;
        let start = automaton.next_state(begin, b'E');
        Ok(Self { automaton, start })
    }

    fn step(&self, state: StateID, symbol: u8) -> StateID {
        self.automaton.next_state(state, symbol)
    }

    /// The first pattern that a path is which ends here with this symbol.
    fn pattern_after(&self, state: StateID, symbol: u8) -> Option<u32> {
        let end = self.automaton.next_eoi_state(self.step(state, symbol));
        if !self.automaton.is_match_state(end) {
            return None;
        }
        (0..self.automaton.match_len(end)).map(|i| self.automaton.match_pattern(end, i).as_u32()).min()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Events of a path written from the light to the eye, from the eye to the light.
    fn events(path: &str) -> Vec<Event> {
        let inner = path.strip_prefix('L').and_then(|p| p.strip_suffix('E')).expect("a path");
        inner.bytes().rev().map(|c| Event::ALL.into_iter().find(|e| e.symbol() == c).expect("an event")).collect()
    }

    fn is(path: &str, expression: &str) -> bool {
        let classes = PathClasses::new(&expression.parse().expect("an expression"), &[]).expect("classes");
        classes.layer_of(events(path)).is_some()
    }

    #[test]
    fn expressions_select_paths() {
        for (expression, yes, no) in [
            ("LE", vec!["LE"], vec!["LDE", "LSE"]),
            ("LDE", vec!["LDE"], vec!["LE", "LDDE", "LGE"]),
            ("LS+DE", vec!["LSDE", "LSSSDE"], vec!["LDE", "LDSE", "LSTDE"]),
            ("L(S|T)*DE", vec!["LDE", "LSTSDE"], vec!["LGDE", "LSE"]),
            ("L[ST]*DE", vec!["LDE", "LSTSDE"], vec!["LGDE", "LSE"]),
            ("L.*E", vec!["LE", "LDGSTE"], vec![]),
            ("L[^D]*E", vec!["LE", "LGGE"], vec!["LGDGE"]),
            ("2", vec!["LE"], vec!["LDE"]),
            ("3..4", vec!["LDE", "LTTE"], vec!["LE", "LDDDE"]),
            ("..3", vec!["LE", "LDE"], vec!["LDDE"]),
            ("4..", vec!["LDDE", "LDDDDDDDE"], vec!["LDE"]),
        ] {
            yes.iter().for_each(|p| assert!(is(p, expression), "{p} is {expression}"));
            no.iter().for_each(|p| assert!(!is(p, expression), "{p} is not {expression}"));
        }
    }

    #[test]
    fn bad_expressions_say_why() {
        for (text, part) in [
            ("LXE", "'X' stands for nothing"),
            ("LD", "begin with L"),
            ("", "begin with L"),
            ("ED", "begin with L"),
            ("1", "2 to 1000"),
            ("3..2", "no number of vertices"),
            ("3..x", "no number of vertices"),
            ("L(DE", "regular expression"),
            ("L**(E", "regular expression"),
            ("LD{999}{999}E", "regular expression"),
        ] {
            let error = text.parse::<PathExpression>().expect_err(text);
            assert!(error.contains(part), "{text}: {error}");
        }
    }

    #[test]
    fn a_path_is_in_the_first_layer_that_takes_it() {
        let classes = |layers: &[PathLayer]| PathClasses::new(&PathExpression::all(), layers).expect("classes");
        let by_class = PathLayer::by_class();
        let layer = |path: &str| by_class[classes(&by_class).layer_of(events(path)).expect("a layer")].name.clone();
        for (path, name) in [
            ("LE", "emission"),
            ("LDE", "direct-diffuse"),
            ("LTE", "direct-specular"),
            ("LTTDE", "caustic"),
            ("LGDE", "indirect-diffuse"),
            ("LDDE", "indirect-diffuse"),
            ("LDSE", "indirect-specular"),
            ("LSGE", "indirect-glossy"),
        ] {
            assert_eq!(layer(path), name, "{path}");
        }
        let by_length = PathLayer::by_length(4);
        let names: Vec<&str> = by_length.iter().map(|l| &*l.name).collect();
        assert_eq!(names, ["vertices-2", "vertices-3", "vertices-4", "longer"]);
        for (path, layer) in [("LE", 0), ("LDE", 1), ("LSTE", 2), ("LDDDE", 3), ("LDDDDDDE", 3)] {
            assert_eq!(classes(&by_length).layer_of(events(path)), Some(layer), "{path}");
        }
        // Both at once: only what is wanted, in its layer.
        let both = PathClasses::new(&"L.*DE".parse().expect("an expression"), &by_length).expect("classes");
        assert_eq!((both.layer_of(events("LSE")), both.layer_of(events("LSDE"))), (None, Some(2)));
    }

    #[test]
    fn hopeless_paths_end() {
        let classes = PathClasses::new(&"LS+DE".parse().expect("an expression"), &[]).expect("classes");
        let after = |path: &[Event]| {
            path.iter().fold(Index1(START), |state, event| classes.step::<f32>(state, Index1(*event as u32)))
        };
        assert!(classes.may_count::<f32>(after(&[Event::Diffuse])));
        assert!(classes.may_count::<f32>(after(&[Event::Diffuse, Event::Specular])));
        assert!(!classes.may_count::<f32>(after(&[Event::Specular])));
        assert!(!classes.may_count::<f32>(after(&[Event::Diffuse, Event::Diffuse])));
    }

    proptest! {
        /// Layers by class leave nothing out, and lanes agree with single paths.
        #[test]
        fn classes_are_complete(path in prop::collection::vec(0usize..4, 0..12)) {
            let classes = PathClasses::new(&PathExpression::all(), &PathLayer::by_class()).expect("classes");
            prop_assert!(classes.layer_of(path.iter().map(|e| Event::ALL[*e])).is_some());
            use rebond_lanes::{F32x16, Index16};
            let one = path.iter().fold(Index1(START), |s, e| classes.step::<f32>(s, Index1(*e as u32)));
            let wide = path.iter().fold(Index16::splat(START), |s, e| classes.step::<F32x16>(s, Index16::splat(*e as u32)));
            prop_assert_eq!(wide.lane(7), one.0);
        }

        #[test]
        fn no_text_breaks_it(text in "[LDGSTE.()\\[\\]|*+?{},^0-9]{0,24}") {
            let _ = text.parse::<PathExpression>();
        }
    }
}
