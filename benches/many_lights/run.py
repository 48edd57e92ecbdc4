"""What a tree of lights gains over choosing emitters by power alone, on scenes of few and of many lights.

    python3 run.py [SCENE ...] [--size 768x512] [--spp 64] [--rounds 5] [--save]

Renders each scene (default: many-lights, veach-mis) with `--light-choice power` and `tree`, in turns, with the
same number of samples and a seed of its own for each round. Prints per choice the medians of processor time and of

    relMSE = mean((x - ref)^2 / (ref^2 + 0.01))

without the worst 0.1 % of pixels and with them, and the ratio of error x time. No reference is rendered: both choices are
unbiased (`rebond-io`'s test `light_choices_agree` holds them to the same picture), so the squared error is half the squared
difference of two rounds, taken over all pairs; ref is the mean of the tree's rounds, and serves as the measure only.
"""

import argparse
import datetime
import itertools
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

from machine import commit, machine  # noqa: E402
from pfm import read_pfm  # noqa: E402

CHOICES = ("power", "tree")
TRIMMED = 0.001


def render(args, scene, choice, spp, seed):
    """A picture and the processor time of its rendering."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "picture.pfm")
        command = [args.rebond, "render", scene, "-i", f"path:max_depth={args.max_depth}", "--light-choice", choice]
        command += ["--size", args.size, "--spp", str(spp), "--seed", str(seed), "--threads", str(args.threads)]
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        run = subprocess.run([*command, "--quiet", "--json", "-o", str(file)], check=True, stdout=subprocess.PIPE)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        answer = json.loads(run.stdout)
        cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        # Loading and building are not part of the question; they run on one thread.
        cpu -= answer["load_seconds"] + answer["build_seconds"]
        return read_pfm(file), cpu, answer["render_seconds"]


def errors(a, b, reference):
    """Of either of two independent pictures with the same expectation."""
    e = np.sort((0.5 * (a - b) ** 2 / (reference**2 + 0.01)).mean(axis=2), axis=None)
    return {"trimmed": e[: len(e) - int(TRIMMED * len(e))].mean(), "whole": e.mean()}


def measure(args, scene):
    runs, images = ({choice: [] for choice in CHOICES} for _ in range(2))
    for round_ in range(args.rounds):
        for i, choice in enumerate(CHOICES if round_ % 2 else reversed(CHOICES)):
            image, cpu, wall = render(args, scene, choice, args.spp, 2 * round_ + i)
            runs[choice].append({"cpu": cpu, "wall": wall})
            images[choice].append(image)
    reference = np.mean(images["tree"], axis=0)
    pairs = {c: [errors(a, b, reference) for a, b in itertools.combinations(images[c], 2)] for c in CHOICES}
    rows = {c: (runs[c], pairs[c]) for c in CHOICES}
    median = {c: {k: statistics.median(r[k] for r in rs) for rs in rows[c] for k in rs[0]} for c in CHOICES}
    for choice in CHOICES:
        m = median[choice]
        print(f"{scene:12} {choice:6} cpu {m['cpu']:7.2f} s  relMSE {m['trimmed']:.3e} (all pixels {m['whole']:.3e})")
    a, b = (median[c] for c in CHOICES)
    ratio = {key: a[key] * a["cpu"] / (b[key] * b["cpu"]) for key in ("trimmed", "whole")}
    time = b["cpu"] / a["cpu"]
    print(f"{scene:12} error x time: {ratio['trimmed']:.2f} times less (all pixels {ratio['whole']:.2f}), time x {time:.2f}")
    return {"scene": scene, "runs": runs, "pairs": pairs, "medians": median, "gain": ratio, "load": os.getloadavg()}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", nargs="*", default=["many-lights", "veach-mis"])
    parser.add_argument("--size", default="768x512")
    parser.add_argument("--spp", type=int, default=64)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--max-depth", type=int, default=6)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--rebond", default=str(HERE.parents[1] / "target" / "release" / "rebond"), help="the program")
    parser.add_argument("--save", action="store_true", help="keep the raw figures in results/")
    args = parser.parse_args()
    results = [measure(args, scene) for scene in args.scenes]
    if args.save:
        today = datetime.date.today().isoformat()
        settings = {k: v for k, v in vars(args).items() if k not in ("rebond", "scenes", "save")}
        report = {"date": today, "machine": machine(), "commit": commit(), "settings": settings}
        (HERE / "results").mkdir(exist_ok=True)
        (HERE / "results" / f"{today}.json").write_text(json.dumps({**report, "results": results}, indent=1) + "\n")


if __name__ == "__main__":
    main()
