#!/usr/bin/env python3
"""rebond beside smallpt, Kevin Beason's path tracer in 99 lines, on smallpt's own scene.

    python3 run.py --smallpt PATH/smallpt.cpp [--integrator path] [--size 256x192] [--seconds 4] [--rounds 5] [--reference 60] [--save NAME]

Compiles the program whose source is given (-O3, OpenMP), renders its scene with both in turns for about the same time, and
prints samples per second, relMSE and 1 / (relMSE x time). README.md says what is changed in a copy of the source, and how
errors are measured. Needs numpy, a C++ compiler and `cargo build --release`.
"""

import argparse
import datetime
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
sys.path.insert(0, str(HERE.parent))

from machine import machine  # noqa: E402
from pfm import read_pfm  # noqa: E402

TRIMMED = 0.001  # share of the worst pixels that relMSE leaves out
REFERENCE_SEED = 9001

# What is changed in the copy: (old, new).
CHANGES = [
    ("int w=1024, h=768", "int w=WIDTH, h=HEIGHT"),
    ("Xi[3]={0,0,y*y*y}", "Xi[3]={(unsigned short)(SEED*7919),(unsigned short)SEED,(unsigned short)(y*y*y)}"),
    # A box filter in the place of two tents per axis, the same for both programs.
    ("dx=r1<1 ? sqrt(r1)-1: 1-sqrt(2-r1)", "dx=(r1-1)/2"),
    ("dy=r2<1 ? sqrt(r2)-1: 1-sqrt(2-r2)", "dy=(r2-1)/2"),
    # Linear values, not clamped, in the place of a PPM file.
    ("Vec(clamp(r.x),clamp(r.y),clamp(r.z))*.25", "r*.25"),
]
PICTURE = 'FILE *f = fopen("image.ppm"'
WRITE = """FILE *f = fopen(argv[2], "wb");
  for (int i=0; i<w*h; i++) { float p[3]={(float)c[i].x,(float)c[i].y,(float)c[i].z}; fwrite(p, 4, 3, f); }
  fclose(f);
}
"""
ROWS = "  for (int y=0; y<h; y++){"
PRAGMA = "#pragma omp parallel for schedule(dynamic, 1) private(r)\n"


def adapted(source):
    """The program with those changes; each must fit exactly once."""
    for old, new in [*CHANGES, ("argc==2", "argc>2")]:
        if source.count(old) != 1:
            raise SystemExit(f"this is not smallpt as it was published: {old!r} stands in it {source.count(old)} times")
        source = source.replace(old, new)
    if "#pragma omp parallel" not in source:
        source = source.replace(ROWS, PRAGMA + ROWS)
    return source[: source.index(PICTURE)] + WRITE


def compile_smallpt(source, folder, size, seed, flags):
    program = folder / f"smallpt-{seed}"
    (folder / "smallpt.cpp").write_text(adapted(source))
    macros = [f"-DWIDTH={size[0]}", f"-DHEIGHT={size[1]}", f"-DSEED={seed}"]
    subprocess.run(["c++", *flags.split(), *macros, "-o", program, folder / "smallpt.cpp"], check=True)
    return program


def run_smallpt(program, spp, size, threads, folder):
    """Seconds and the picture; samples are a multiple of four."""
    picture = folder / "smallpt.raw"
    start = time.perf_counter()
    environment = {**os.environ, "OMP_NUM_THREADS": str(threads)}
    subprocess.run([program, str(spp), picture], check=True, stderr=subprocess.DEVNULL, env=environment)
    seconds = time.perf_counter() - start
    return seconds, np.fromfile(picture, "<f4").reshape(size[1], size[0], 3).astype(float)


def run_rebond(args, seed, folder, spp=None, seconds=None):
    """Seconds, samples per pixel and the picture."""
    scene = (ROOT / "scenes" / "smallpt.toml").read_text().replace('{ type = "tent", radius = 0.8 }', '{ type = "box" }')
    file, picture = folder / "scene.toml", folder / "rebond.pfm"
    file.write_text(scene)
    command = [args.rebond, "render", file, "--size", f"{args.size[0]}x{args.size[1]}", "--seed", seed]
    command += ["--spp", spp] if spp else ["--time", f"{seconds}s"]
    command += ["-i", args.integrator, "--threads", args.threads, "--json", "--quiet", "-o", picture]
    out = subprocess.run([str(c) for c in command], check=True, stdout=subprocess.PIPE, text=True).stdout
    found = json.loads(out)
    image = read_pfm(picture)[::-1]
    return found["render_seconds"], found["samples"] / (args.size[0] * args.size[1]), image


def rel_mse(image, reference):
    """mean((x - ref)^2 / (ref^2 + 0.01)) over channels and pixels, without the worst pixels."""
    error = ((image - reference) ** 2 / (reference**2 + 0.01)).mean(axis=2).ravel()
    kept = len(error) - int(round(TRIMMED * len(error)))
    return float(np.partition(error, kept - 1)[:kept].mean())


def size(text):
    w, h = text.split("x")
    return int(w), int(h)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--smallpt", type=Path, required=True, help="smallpt.cpp, as it was published")
    parser.add_argument("--integrator", default="path", help="what rebond renders with (default path)")
    parser.add_argument("--size", type=size, default=(256, 192), metavar="WxH")
    parser.add_argument("--seconds", type=float, default=4, help="what each rendering takes, about (default 4)")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--reference", type=float, default=60, help="seconds for the reference of each (default 60)")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--flags", default="-O3 -march=native -fopenmp", help="of the compiler")
    parser.add_argument("--rebond", type=Path, default=ROOT / "target" / "release" / "rebond")
    parser.add_argument("--save", metavar="NAME", help="keep the figures as results/DATE-NAME.json")
    args = parser.parse_args()
    source = args.smallpt.read_text()
    load = os.getloadavg()
    pixels = args.size[0] * args.size[1]
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        build = lambda seed: compile_smallpt(source, folder, args.size, seed, args.flags)
        program = build(1)
        seconds, _ = run_smallpt(program, 32, args.size, args.threads, folder)
        per_second = 32 / seconds

        def samples(seconds):
            return max(4, 4 * round(per_second * seconds / 4))

        reference_spp = samples(args.reference)
        _, theirs = run_smallpt(build(REFERENCE_SEED), reference_spp, args.size, args.threads, folder)
        _, our_spp, ours = run_rebond(args, REFERENCE_SEED, folder, seconds=args.reference)
        rounds = []
        for i in range(args.rounds):
            program, spp = build(i + 1), samples(args.seconds)
            s, picture = run_smallpt(program, spp, args.size, args.threads, folder)
            r, rebond_spp, image = run_rebond(args, i + 1, folder, seconds=args.seconds)
            rounds.append(
                {
                    "smallpt": {"seconds": s, "spp": spp, "rel_mse": rel_mse(picture, theirs), "to_rebond": rel_mse(picture, ours)},
                    "rebond": {"seconds": r, "spp": rebond_spp, "rel_mse": rel_mse(image, ours), "to_smallpt": rel_mse(image, theirs)},
                }
            )
    median = lambda name, f: statistics.median(f(r[name]) for r in rounds)
    rate = {n: median(n, lambda x: x["spp"] * pixels / x["seconds"] / 1e6) for n in ("smallpt", "rebond")}
    error = {n: median(n, lambda x: x["rel_mse"]) for n in rate}
    other = {"smallpt": median("smallpt", lambda x: x["to_rebond"]), "rebond": median("rebond", lambda x: x["to_smallpt"])}
    value = {n: median(n, lambda x: 1 / (x["rel_mse"] * x["seconds"])) for n in rate}
    between = rel_mse(theirs, ours)
    mean = [float(x) for x in theirs.mean(axis=(0, 1)) / ours.mean(axis=(0, 1)) - 1]
    print(f"{args.integrator}: {args.size[0]}x{args.size[1]}, {args.threads} threads, {args.rounds} rounds, medians; load before: {load[0]:.2f}")
    print(f"{'':10}{'M samples/s':>13}{'relMSE':>12}{'to the other':>14}{'1/(relMSE s)':>14}")
    for n in ("rebond", "smallpt"):
        print(f"{n:10}{rate[n]:13.3f}{error[n]:12.3e}{other[n]:14.3e}{value[n]:14.2f}")
    print(f"ratio     {rate['rebond'] / rate['smallpt']:13.2f}{'':26}{value['rebond'] / value['smallpt']:14.2f}")
    print(f"between the references ({our_spp:.0f} and {reference_spp} spp): relMSE {between:.2e}, ", end="")
    print("mean of smallpt's over rebond's, less 1: " + ", ".join(f"{x:+.4f}" for x in mean))
    if args.save:
        raw = {"date": str(datetime.date.today()), **machine(), "load_before": load, "flags": args.flags, "size": args.size}
        raw |= {"integrator": args.integrator}
        raw |= {"threads": args.threads, "reference_spp": {"rebond": our_spp, "smallpt": reference_spp}}
        raw |= {"between_references": between, "mean_ratio_less_1": mean, "rounds": rounds}
        path = HERE / "results" / f"{datetime.date.today()}-{args.save}.json"
        path.write_text(json.dumps(raw, indent=1) + "\n")


if __name__ == "__main__":
    main()
