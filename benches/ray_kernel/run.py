#!/usr/bin/env python3
"""Times rebond's ray queries next to Embree 4 and saves what was printed under results/.

Embree's shared library comes from the PyPI package `embreex`, installed into a virtual environment of its own; the
benchmark alone loads it. Needs Linux on x86-64, a Rust toolchain and a quiet machine. Further arguments go to the
program: `--scene NAME`, `--repeat N`, `--side PIXELS`, `--curve`, `--ours`, `--preset NAME`.

`--builds` times building instead, of the land or of `--scene NAME`, `--repeat N` times: every build in a process of its
own, which keeps to its number of threads and reuses nothing of builds before it, in turns.
"""

import datetime
import pathlib
import statistics
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


def run(*arguments: str) -> str:
    """What the program prints."""
    command = ["cargo", "run", "--release", "--quiet", "-p", "rebond-bvh", "--example", "ray_kernel", "--"]
    command += ["--embree", str(embree()), *arguments]
    return subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True).stdout


def builds(scene: str, repeat: int) -> str:
    """A table of build times: medians and least, by the clock and of the processor."""
    if scene not in ("cornell", "bunny", "dragon", "land") or repeat < 1:
        raise SystemExit("run.py --builds: give --scene cornell, bunny, dragon or land, and --repeat at least 1")
    names = ("embree medium", "fast", "default", "embree high", "quality")
    seconds = {f"{name} {threads}": [] for threads in (1, 2) for name in names}
    for _ in range(repeat):
        for name, found in seconds.items():
            words = run("--scene", scene, "--build", "--repeat", "1", "--preset", name).split()
            found.append((float(words[-4]), float(words[-2])))
    text = f"\n{scene}, {repeat} builds of each in processes of their own; seconds, median and least\n"
    for name, found in seconds.items():
        clock, cpu = ((statistics.median(of), min(of)) for of in zip(*found, strict=True))
        text += f"  {name:16} clock {clock[0]:7.3f} {clock[1]:7.3f}   processor {cpu[0]:7.3f} {cpu[1]:7.3f}\n"
    return text


def main() -> None:
    """Builds, runs, shows, saves."""
    arguments = sys.argv[1:]
    heading = f"{datetime.date.today()}, {processor()}, commit {commit()}, {' '.join(arguments)}\n"
    if "--builds" in arguments:
        given = dict(zip(arguments, arguments[1:], strict=False))
        out = builds(given.get("--scene", "land"), int(given.get("--repeat", 7)))
    else:
        out = run(*arguments)
    print(heading + out)
    name = datetime.datetime.now().strftime("%Y-%m-%d-%H%M") + ".txt"
    (HERE / "results").mkdir(exist_ok=True)
    (HERE / "results" / name).write_text(heading + out)


if __name__ == "__main__":
    main()
