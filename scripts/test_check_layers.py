"""Tests of check_layers.py: `python3 -m unittest discover -s scripts`."""

import tempfile
import unittest
from pathlib import Path

from check_layers import Layers, imports, tokens, without_tests

FORBID = "#![forbid(unsafe_code)]\n"


def paths(source: str, module: str = "a") -> list[str]:
    code, _ = without_tests(tokens(source))
    return ["::".join(i.path) for i in imports(code, module.split("::"))]


class Reading(unittest.TestCase):
    def test_use_trees(self):
        source = "use crate::{math, scene::{self, Scene as S, description::*}, film::Film};\nuse crate::bsdf::Bsdf;"
        expected = ["math", "scene", "scene::Scene", "scene::description::*", "film::Film", "bsdf::Bsdf"]
        self.assertEqual(paths(source), expected)

    def test_paths_in_code(self):
        self.assertEqual(paths("fn f(x: crate::math::Rgb<f32>) { crate::film::g::<u8>(x) }"), ["math::Rgb", "film::g"])
        self.assertEqual(paths("macro_rules! m { () => { $crate::film::x() } }"), ["film::x"])

    def test_super_and_self(self):
        self.assertEqual(paths("use super::b::C;", "a::d"), ["a::b::C"])
        self.assertEqual(paths("use super::super::b::C; use self::x::Y;", "a::d"), ["b::C", "a::d::x::Y"])
        self.assertEqual(paths("mod inner { use super::super::b; } use super::c;", "a"), ["b", "c"])
        self.assertEqual(paths("pub(crate) fn f(&self) {} pub(in crate::x) struct S;"), ["x"])

    def test_comments_and_text_are_not_code(self):
        source = r'''
            //! [`Film`](crate::film::Film)
            /* crate::a /* crate::b */ crate::c */
            const S: &str = "crate::d \" crate::e"; const R: &str = r#"crate::f " crate::g"#;
            const C: char = '"'; const D: u8 = b'\''; fn f<'a>(x: &'a str) -> char { '\u{1F600}' }
            use crate::math::Vec3; // crate::h
        '''
        self.assertEqual(paths(source), ["math::Vec3"])

    def test_lines(self):
        code = tokens('/* a\nb */\n"c\nd"\nuse crate::{\n  x,\n  y::z,\n};')
        self.assertEqual([(i.path, i.line) for i in imports(code, ["a"])], [(["x"], 6), (["y", "z"], 7)])

    def test_tests_are_left_out(self):
        source = """
            #[cfg(test)] mod tests { use crate::a; mod deep { use crate::b; } }
            #[cfg(test)] #[path = "x.rs"] mod elsewhere;
            #[cfg(all(test, unix))] fn f(x: [u8; 3]) { crate::c(); }
            #[cfg(test)] use crate::d;
            #[cfg(not(test))] use crate::e;
            #[cfg(unix)] use crate::f;
            use crate::g;
        """
        self.assertEqual(paths(source), ["e", "f", "g"])
        self.assertEqual(without_tests(tokens(source))[1], {"elsewhere"})


class Judging(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.root = Path(folder.name)
        for name, needs in [
            ("rebond-lanes", []),
            ("rebond-bvh", ["rebond-lanes"]),
            ("rebond", ["rebond-bvh", "rebond-lanes"]),
            ("rebond-io", ["rebond"]),
            ("rebond-cli", ["rebond", "rebond-io"]),
        ]:
            lines = [f'[package]\nname = "{name}"\n[dependencies]\nserde = "1"', *(f"{n}.workspace = true" for n in needs)]
            self.write(f"{name}/Cargo.toml", "\n".join(lines))
            self.write(f"{name}/src/{'main' if name == 'rebond-cli' else 'lib'}.rs", FORBID)

    def write(self, name: str, text: str, append: bool = False):
        file = self.root / "crates" / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text((file.read_text() if append else "") + text)

    def source(self, name: str, text: str):
        self.write(f"rebond/src/{name}", text)

    def found(self) -> str:
        return "\n".join(Layers(self.root).check().violations)

    def test_what_is_in_order_passes(self):
        self.source("integrators/mod.rs", "mod path; pub use path::PathSettings; use crate::scene::Scene;")
        self.source("integrators/path.rs", "use super::Info; use crate::transport::mis; use crate::math::Vec3;")
        self.source("scene/mod.rs", "use crate::{bsdf::Bsdf, math::Vec3}; use self::inner::X;")
        self.source("bsdf/mod.rs", "use crate::math::Vec3; #[cfg(test)] mod tests;")
        self.source("bsdf/tests.rs", "use crate::integrators::Path;")
        self.source("math/mod.rs", "#[cfg(test)] mod tests { use crate::scene::Scene; }")
        self.assertEqual(self.found(), "")

    def test_an_import_from_above_is_found(self):
        self.source("texture/mod.rs", "//! Textures\nuse crate::scene::description::Wrap;")
        place = "crates/rebond/src/texture/mod.rs:2: texture imports scene::description::Wrap, which stands above it"
        self.assertEqual(self.found(), place)

    def test_an_import_by_path_is_found(self):
        self.source("math/mod.rs", "fn f() { super::film::g() }")
        self.assertIn("math imports film::g", self.found())

    def test_the_same_row_is_a_note(self):
        self.source("emitter/mod.rs", "use crate::texture::Textures;")
        layers = Layers(self.root).check()
        self.assertEqual(layers.violations, [])
        self.assertIn("of its own row", layers.notes[0])

    def test_integrators_do_not_import_one_another(self):
        self.source("integrators/mod.rs", "mod path; mod vcm; pub use path::PathSettings;")
        self.source("integrators/path.rs", "use super::path::X;")
        for line in ["use super::path::PathSettings;", "use crate::integrators::path::f;", "use super::PathSettings;"]:
            self.source("integrators/vcm.rs", line)
            self.assertIn("the integrator vcm imports path", self.found(), line)
        self.source("integrators/vcm.rs", "")
        self.source("integrators/vcm/merge.rs", "use super::weights; use crate::integrators::path::f;")
        self.assertIn("the integrator vcm imports path (integrators::path::f)", self.found())

    def test_the_exception_holds_for_one_name_and_while_it_is_used(self):
        self.source("scene/description.rs", "use crate::integrators::IntegratorSettings;")
        self.assertEqual(self.found(), "")
        self.source("scene/build.rs", "use crate::integrators::IntegratorSettings;")
        self.assertIn("scene/build.rs:1", self.found())
        self.source("scene/build.rs", "")
        self.source("scene/description.rs", "")
        self.assertIn("delete the exception", self.found())

    def test_unknown_modules_are_asked_for(self):
        self.source("novelty.rs", "")
        self.source("math/mod.rs", "use crate::Shortcut;")
        self.assertIn("novelty: stands in no row", self.found())
        self.assertIn("math imports Shortcut, which stands in no row", self.found())

    def test_crates_point_one_way(self):
        self.write("rebond-bvh/Cargo.toml", '\n[dev-dependencies]\nlight = { package = "rebond", path = "" }', append=True)
        self.write("rebond-lanes/Cargo.toml", "\n[target.'cfg(unix)'.dependencies]\nrebond-io = '1'", append=True)
        self.assertIn("rebond-bvh depends on rebond, which is not below it (dev-dependencies)", self.found())
        self.assertIn("rebond-lanes depends on rebond-io", self.found())

    def test_a_crate_without_a_row_is_found(self):
        self.write("rebond-new/Cargo.toml", '[package]\nname = "rebond-new"')
        self.assertIn("rebond-new has no row", self.found())

    def test_unsafe_stays_where_it_may_be(self):
        self.write("rebond-bvh/src/lib.rs", "unsafe fn f() {}")
        self.write("rebond-io/tests/a.rs", '// unsafe\nconst A: &str = "unsafe";\nfn g() { unsafe { f() } }')
        self.assertEqual(self.found(), "crates/rebond-io/tests/a.rs:3: `unsafe` outside of rebond-bvh, rebond-lanes")
        self.write("rebond-io/tests/a.rs", "")
        self.write("rebond-io/src/lib.rs", "// #![forbid(unsafe_code)]")
        self.assertEqual(self.found(), "crates/rebond-io/src/lib.rs: lacks #![forbid(unsafe_code)]")

    def test_the_library_touches_no_system(self):
        self.source("film/mod.rs", "use std::{fmt, fs::File};\nfn f() { std::process::exit(1) }")
        self.assertIn("film/mod.rs:1: std::fs", self.found())
        self.assertIn("film/mod.rs:2: std::process", self.found())

    def test_an_empty_folder_is_no_pass(self):
        with tempfile.TemporaryDirectory() as empty:
            self.assertNotEqual(Layers(Path(empty)).check().violations, [])


if __name__ == "__main__":
    unittest.main()
