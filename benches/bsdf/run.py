#!/usr/bin/env python3
"""Times every model of `rebond::bsdf` and saves what was printed under results/. Arguments: names of models."""

import datetime
import os
import pathlib
import platform
import subprocess
import sys

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parent.parent


def processor() -> str:
    """Its name, as far as the system says."""
    for line in pathlib.Path("/proc/cpuinfo").read_text().splitlines():
        if line.startswith("model name"):
            return line.split(":", 1)[1].strip()
    return platform.processor()


def main() -> None:
    """Builds, runs, shows, saves."""
    cargo = ["cargo", "--quiet"]
    subprocess.run([*cargo, "build", "--release", "-p", "rebond", "--example", "bsdf_cost"], cwd=ROOT, check=True)
    commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, capture_output=True, text=True)
    load = ", ".join(f"{x:.2f}" for x in os.getloadavg())
    heading = f"{datetime.date.today()}, {processor()}, commit {commit.stdout.strip()}, load before {load}\n\n"
    command = [*cargo, "run", "--release", "-p", "rebond", "--example", "bsdf_cost", "--", *sys.argv[1:]]
    out = subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True).stdout
    print(heading + out)
    name = datetime.datetime.now().strftime("%Y-%m-%d-%H%M") + ".txt"
    (HERE / "results").mkdir(exist_ok=True)
    (HERE / "results" / name).write_text(heading + out)


if __name__ == "__main__":
    main()
