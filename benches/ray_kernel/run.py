#!/usr/bin/env python3
"""Times rebond's ray queries next to Embree 4 and saves what was printed under results/.

Embree's shared library comes from the PyPI package `embreex`, installed into a virtual environment of its own; the
benchmark alone loads it. Needs Linux on x86-64, a Rust toolchain and a quiet machine. Further arguments go to the
program: `--scene NAME`, `--repeat N`, `--side PIXELS`, `--curve`, `--ours`, `--preset NAME`.
"""

import datetime
import pathlib
import subprocess
import sys
import venv

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parent.parent
sys.path.insert(0, str(HERE.parent))

from machine import commit, processor  # noqa: E402
ENVIRONMENT = ROOT / "target" / "embree"


def embree() -> pathlib.Path:
    """The shared library, fetched if it is not there yet."""
    if not ENVIRONMENT.exists():
        venv.create(ENVIRONMENT, with_pip=True)
    found = sorted(ENVIRONMENT.glob("lib/python*/site-packages/embreex.libs/libembree4*"))
    if not found:
        subprocess.run([ENVIRONMENT / "bin" / "pip", "install", "--quiet", "embreex==4.4.0.post1"], check=True)
        found = sorted(ENVIRONMENT.glob("lib/python*/site-packages/embreex.libs/libembree4*"))
    return found[0]


def main() -> None:
    """Builds, runs, shows, saves."""
    command = ["cargo", "run", "--release", "--quiet", "-p", "rebond-bvh", "--example", "ray_kernel", "--"]
    command += ["--embree", str(embree()), *sys.argv[1:]]
    heading = f"{datetime.date.today()}, {processor()}, commit {commit()}, {' '.join(sys.argv[1:])}\n"
    out = subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True).stdout
    print(heading + out)
    name = datetime.datetime.now().strftime("%Y-%m-%d-%H%M") + ".txt"
    (HERE / "results").mkdir(exist_ok=True)
    (HERE / "results" / name).write_text(heading + out)


if __name__ == "__main__":
    main()
