#!/usr/bin/env python3
"""Holds the arrows of the house: who may import whom, and where `unsafe` may stand.

- Crates depend only on crates of the rows below them (`CRATES`), by their Cargo.toml files.
- Inside `crates/rebond/src` a module imports only from the rows below its own (`ROWS`). Modules of one row should not
  import one another; where they do, it is said but allowed. Integrators never do.
- `unsafe` stands only in the crates of `MAY_BE_UNSAFE`; the library of every other crate forbids it.
- `crates/rebond` opens no file, starts no process and reads no environment.

Tests (`#[cfg(test)]`) may import what they like. Needs Python 3.10, nothing else.

    scripts/check_layers.py [FOLDER]      exit code 0 if everything holds, 1 if not
"""

import re
import sys
from pathlib import Path
from typing import NamedTuple

# From top to bottom.
CRATES = [
    ["rebond-cli", "rebond-py", "rebond-web"],
    ["rebond-io"],
    ["rebond"],
    ["rebond-bvh"],
    ["rebond-lanes"],
]
ROWS = [
    ["integrators"],
    ["transport"],
    ["render"],
    ["scene"],
    ["bsdf", "emitter", "camera", "shape", "texture", "film", "compare"],
    ["sampling"],
    ["math"],
]
MAY_BE_UNSAFE = {"rebond-bvh", "rebond-lanes"}
NOT_IN_THE_LIBRARY = {"env", "fs", "net", "process"}  # of std

# (importing file in crates/rebond/src, what it imports): why that may stay.
EXCEPTIONS = {
    ("scene/description.rs", "integrators::IntegratorSettings"): (
        "a scene names the integrator it is meant for; settings are plain data"
    ),
}

LEXEMES = re.compile(
    r"""(?P<line_comment> //[^\n]*)
      | (?P<block_comment> /\*)
      | (?P<string> \b(?:b|c)?r(?P<hashes>\#*)".*?"(?P=hashes) | (?:\b[bc])?"(?:\\.|[^"\\])*")
      | (?P<char> \bb?'(?:\\(?:u\{[^}]*\}|x[0-9a-fA-F]{2}|.)|[^\\'\n])' | '(?:\\(?:u\{[^}]*\}|x[0-9a-fA-F]{2}|.)|[^\\'\n])')
      | (?P<token> '\w+ | (?:r\#)?\w+ | :: | \S)
    """,
    re.VERBOSE | re.DOTALL,
)


class Token(NamedTuple):
    text: str
    line: int


class Import(NamedTuple):
    """A path within the crate, such as ["scene", "Scene"], and the line where it stands."""

    path: list[str]
    line: int


def tokens(source: str) -> list[Token]:
    """The tokens of Rust source, without comments and literals of text."""
    found, at, line = [], 0, 1
    while match := LEXEMES.search(source, at):
        line += source.count("\n", at, match.start())
        end = match.end()
        if match.lastgroup == "block_comment":
            end = end_of_comment(source, end)
        elif match.lastgroup == "token":
            found.append(Token(match["token"], line))
        line += source.count("\n", match.start(), end)
        at = end
    return found


def end_of_comment(source: str, at: int) -> int:
    """The end of a block comment, which may hold others."""
    depth = 1
    while depth:
        mark = re.compile(r"/\*|\*/").search(source, at)
        if not mark:
            return len(source)
        depth += 1 if mark[0] == "/*" else -1
        at = mark.end()
    return at


def end_of_group(code: list[Token], at: int) -> int:
    """The place after the bracket that closes the one at `at`."""
    depth = 0
    for i in range(at, len(code)):
        depth += (code[i].text in "([{") - (code[i].text in ")]}")
        if depth == 0:
            return i + 1
    return len(code)


def without_tests(code: list[Token]) -> tuple[list[Token], set[str]]:
    """The code without the items under `#[cfg(test)]`; and the names of the modules in other files among those."""
    kept, modules, i = [], set(), 0
    while i < len(code):
        texts = [t.text for t in code[i : i + 4]]
        if texts[:2] != ["#", "["] or texts[2:] != ["cfg", "("]:
            kept.append(code[i])
            i += 1
            continue
        end = end_of_group(code, i + 1)
        condition = [t.text for t in code[i + 3 : end]]
        if "test" not in condition or "not" in condition:
            kept += code[i:end]
            i = end
            continue
        while [t.text for t in code[end : end + 2]] == ["#", "["]:
            end = end_of_group(code, end + 1)
        start = end
        while end < len(code) and code[end].text != ";":
            if code[end].text in ("(", "[", "{"):
                braces = code[end].text == "{"
                end = end_of_group(code, end)
                if braces:
                    break
            else:
                end += 1
        else:
            item = [t.text for t in code[start:end]]
            if "mod" in item:
                modules.add(item[item.index("mod") + 1])
            end += 1
        i = end
    return kept, modules


def imports(code: list[Token], module: list[str]) -> list[Import]:
    """Every path in the code of a module that starts at `crate`, `super` or `self`."""
    found = []
    inner: list[tuple[str, int]] = []  # modules written in place, and the depth of their braces
    depth = 0
    for i, token in enumerate(code):
        following = code[i + 1].text if i + 1 < len(code) else ""
        if token.text == "{":
            depth += 1
            if i >= 2 and code[i - 2].text == "mod":
                inner.append((code[i - 1].text, depth))
        elif token.text == "}":
            if inner and inner[-1][1] == depth:
                inner.pop()
            depth -= 1
        elif token.text in ("crate", "super", "self") and following == "::" and (i == 0 or code[i - 1].text != "::"):
            here = [] if token.text == "crate" else module + [name for name, _ in inner]
            at = i
            while code[at].text in ("super", "self", "crate") and at + 1 < len(code) and code[at + 1].text == "::":
                here = here[:-1] if code[at].text == "super" else here
                at += 2
            paths, _ = tree(code, at)
            found += [Import(here + path, line) for path, line in paths]
    return found


def tree(code: list[Token], at: int) -> tuple[list[tuple[list[str], int]], int]:
    """The paths of a use tree such as `a::{b, c::d}`, each with its line; and the place after it."""
    start, path = at, []
    while at < len(code):
        text = code[at].text
        if text == "{":
            paths = []
            at += 1
            while at < len(code) and code[at].text != "}":
                below, following = tree(code, at)
                paths += [(path + [name for name in p if name != "self"], line) for p, line in below]
                at = max(following, at + 1)
                # `as name`, and commas
                while at < len(code) and code[at].text not in (",", "}"):
                    at += 1
                at += at < len(code) and code[at].text == ","
            return paths, at + 1
        if not (text == "*" or re.fullmatch(r"(r#)?\w+", text)):
            break
        path.append(text)
        at += 1
        if at >= len(code) or code[at].text != "::":
            break
        at += 1
    return [(path, code[min(start, len(code) - 1)].line)] if path else [], at


def module_of(file: Path) -> list[str]:
    """The module that a file under `src` is: `a/b.rs` and `a/b/mod.rs` are a::b."""
    parts = list(file.with_suffix("").parts)
    return parts[:-1] if parts[-1] in ("mod", "lib", "main") else parts


def manifest(text: str) -> tuple[str, list[tuple[str, str]]]:
    """The name of a package and its dependencies with their kind, from a Cargo.toml of one line per key."""
    name, found, section = "", [], ""
    for line in text.splitlines():
        if header := re.match(r"\s*\[(.+)\]", line):
            section = header[1]
        elif entry := re.match(r"""\s*["']?([\w-]+)["']?\s*(?:\.\w+)*\s*=\s*(.*)""", line):
            key, value = entry.groups()
            if section == "package" and key == "name":
                name = value.strip("\"' ")
            elif kind := re.search(r"(?:^|\.)((?:dev-|build-)?dependencies)$", section):
                renamed = re.search(r"""\bpackage\s*=\s*["']([\w-]+)""", value)
                found.append((kind[1], renamed[1] if renamed else key))
        if section_of_one := re.match(r"\s*\[.*\b((?:dev-|build-)?dependencies)\.([\w-]+)\]", line):
            found.append(section_of_one.groups())
    return name, found


class Layers:
    """What was found in a workspace."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.violations: list[str] = []
        self.notes: list[str] = []
        self.checked = 0

    def check(self) -> "Layers":
        crates = sorted(p.parent for p in (self.root / "crates").glob("*/Cargo.toml"))
        for crate in crates:
            self.dependencies(crate)
            self.unsafe(crate)
        library = self.root / "crates" / "rebond" / "src"
        if library.is_dir():
            self.rows(library)
        if not crates:
            self.violations.append(f"{self.root}: there are no crates here")
        return self

    def dependencies(self, crate: Path) -> None:
        name, dependencies = manifest((crate / "Cargo.toml").read_text(encoding="utf-8"))
        place = f"crates/{crate.name}/Cargo.toml"
        row = row_of(name, CRATES)
        if row is None:
            self.violations.append(f"{place}: the crate {name} has no row; give it one in scripts/check_layers.py")
            return
        for kind, other in dependencies:
            other_row = row_of(other, CRATES)
            if other_row is None:
                continue
            self.checked += 1
            if other_row <= row:
                self.violations.append(f"{place}: {name} depends on {other}, which is not below it ({kind})")

    def unsafe(self, crate: Path) -> None:
        if crate.name in MAY_BE_UNSAFE:
            return
        for file in sorted(crate.rglob("*.rs")):
            for token in tokens(file.read_text(encoding="utf-8")):
                if token.text == "unsafe":
                    place = file.relative_to(self.root).as_posix()
                    self.violations.append(f"{place}:{token.line}: `unsafe` outside of {', '.join(sorted(MAY_BE_UNSAFE))}")
        library = crate / "src" / "lib.rs"
        if library.exists():
            code = "".join(t.text for t in tokens(library.read_text(encoding="utf-8")))
            if "#![forbid(unsafe_code)]" not in code:
                self.violations.append(f"crates/{crate.name}/src/lib.rs: lacks #![forbid(unsafe_code)]")

    def rows(self, src: Path) -> None:
        files, tests = {}, set()
        for file in sorted(src.rglob("*.rs")):
            relative = file.relative_to(src)
            module = module_of(relative)
            code, test_modules = without_tests(tokens(file.read_text(encoding="utf-8")))
            files[relative.as_posix()] = (module, code)
            tests |= {tuple(module + [name]) for name in test_modules}
        files = {
            name: (module, code)
            for name, (module, code) in files.items()
            if not any(tuple(module[:n]) in tests for n in range(1, len(module) + 1))
        }

        for top in sorted({m[0] for m, _ in files.values() if m}):
            if row_of(top, ROWS) is None:
                self.violations.append(f"crates/rebond/src/{top}: stands in no row; give it one in scripts/check_layers.py")

        algorithms = {m[1] for m, _ in files.values() if m[:1] == ["integrators"] and len(m) > 1}
        from_algorithm = reexports(files.get("integrators/mod.rs", ([], []))[1], algorithms)
        used = set()
        for name, (module, code) in files.items():
            if not module:
                continue
            for found in imports(code, module):
                self.checked += 1
                problem, note = judge(module, found.path, algorithms, from_algorithm)
                key = (name, "::".join(found.path[:2]))
                if problem and key in EXCEPTIONS:
                    used.add(key)
                elif problem or note:
                    place = f"crates/rebond/src/{name}:{found.line}"
                    (self.violations if problem else self.notes).append(f"{place}: {problem or note}")
            for i, token in enumerate(code):
                for path, line in tree(code, i)[0] if token.text == "std" else []:
                    if len(path) > 1 and path[1] in NOT_IN_THE_LIBRARY:
                        place = f"crates/rebond/src/{name}:{line}"
                        self.violations.append(f"{place}: std::{path[1]}; the library touches no system")
        for file, what in sorted(set(EXCEPTIONS) - used):
            if file in files:
                self.violations.append(f"crates/rebond/src/{file}: no longer imports {what}; delete the exception")


def row_of(name: str, rows: list[list[str]]) -> int | None:
    return next((i for i, row in enumerate(rows) if name in row), None)


def reexports(code: list[Token], algorithms: set[str]) -> dict[str, str]:
    """Names that `integrators/mod.rs` takes from an algorithm's file: `pub use path::PathSettings`."""
    names = {}
    for i, token in enumerate(code):
        if token.text == "use":
            at = i + 3 if [t.text for t in code[i + 1 : i + 3]] == ["self", "::"] else i + 1
            for path, _ in tree(code, at)[0]:
                if len(path) > 1 and path[0] in algorithms:
                    names[path[-1]] = path[0]
    return names


def judge(
    module: list[str], path: list[str], algorithms: set[str], from_algorithm: dict[str, str]
) -> tuple[str | None, str | None]:
    """What is wrong with a module importing a path, and what is only worth a note."""
    here, what = module[0], "::".join(path)
    if not path or path[0] == "*":
        return f"{here} imports everything from the root of the crate", None
    there = path[0]
    if here == there:
        if here == "integrators" and len(module) > 1 and len(path) > 1:
            other = from_algorithm.get(path[1], path[1])
            if other in algorithms and other != module[1]:
                return f"the integrator {module[1]} imports {other} ({what}); what both need goes to transport/", None
        return None, None
    above, below = row_of(here, ROWS), row_of(there, ROWS)
    if below is None:
        return f"{here} imports {what}, which stands in no row", None
    if above is None or below > above:
        return None, None
    if below == above:
        return None, f"{here} imports {what} of its own row"
    return f"{here} imports {what}, which stands above it", None


def main() -> int:
    root = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).resolve().parent.parent
    layers = Layers(root).check()
    for note in layers.notes:
        print(f"note: {note}")
    for violation in layers.violations:
        print(f"error: {violation}", file=sys.stderr)
    verdict = f"{len(layers.violations)} against the layers" if layers.violations else "the layers hold"
    print(f"{layers.checked} imports and dependencies, {verdict}")
    return 1 if layers.violations else 0


if __name__ == "__main__":
    sys.exit(main())
