#!/usr/bin/env python3
"""Times every model of `rebond::bsdf` and saves what was printed under results/. Arguments: names of models."""

import datetime
import os
import pathlib
import subprocess
import sys

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parent.parent
sys.path.insert(0, str(HERE.parent))

from machine import commit, processor  # noqa: E402


def main() -> None:
    """Builds, runs, shows, saves."""
    cargo = ["cargo", "--quiet"]
    subprocess.run([*cargo, "build", "--release", "-p", "rebond", "--example", "bsdf_cost"], cwd=ROOT, check=True)
    load = ", ".join(f"{x:.2f}" for x in os.getloadavg())
    heading = f"{datetime.date.today()}, {processor()}, commit {commit()}, load before {load}\n\n"
    command = [*cargo, "run", "--release", "-p", "rebond", "--example", "bsdf_cost", "--", *sys.argv[1:]]
    out = subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True).stdout
    print(heading + out)
    name = datetime.datetime.now().strftime("%Y-%m-%d-%H%M") + ".txt"
    (HERE / "results").mkdir(exist_ok=True)
    (HERE / "results" / name).write_text(heading + out)


if __name__ == "__main__":
    main()
