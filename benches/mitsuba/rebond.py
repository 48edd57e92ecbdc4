"""Runs the `rebond` program and reads its pictures."""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from scene import ROOT, dump

PROGRAM = ROOT / "target" / "release" / "rebond"


def add_arguments(parser):
    parser.add_argument("--rebond", type=Path, default=PROGRAM, help="the program (default: target/release/rebond)")
    parser.add_argument("--engine", help="rebond's engine, if not its default")


def render(scene, spp, seed, max_depth=8, rr_depth=5, threads=None, program=PROGRAM, engine=None):
    """Renders a scene; returns the run's statistics and the layers of its picture as arrays by name, "" the picture."""
    if not Path(program).is_file():
        raise SystemExit(f"{program} is not there; build it with `cargo build --release`")
    with tempfile.TemporaryDirectory() as folder:
        scene_file, picture = Path(folder, "scene.toml"), Path(folder, "picture.exr")
        scene_file.write_text(dump(scene))
        command = [program, "render", scene_file, "-i", f"path:max_depth={max_depth},rr_depth={rr_depth}"]
        command += ["--spp", str(spp), "--seed", str(seed), "--json", "--quiet", "-o", picture]
        command += ["--threads", str(threads)] if threads else []
        command += ["--engine", engine] if engine else []
        run = subprocess.run([str(c) for c in command], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        if run.returncode:
            sys.stderr.write(run.stderr)
            raise SystemExit(f"rebond failed with exit code {run.returncode}")
        return json.loads(run.stdout), layers(picture)


def layers(path):
    """The layers of an EXR file as arrays of height x width x channels (red, green, blue)."""
    import mitsuba as mi

    return {"" if name == "<root>" else name: np.array(b, dtype=np.float64) for name, b in mi.Bitmap(str(path)).split()}
