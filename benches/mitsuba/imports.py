"""Does rebond open Mitsuba's scenes as Mitsuba does?

    python3 imports.py [SCENE.xml ...] [--spp 256] [--runs 16] [--variant llvm_ad_rgb] [-o DIR]

Renders each scene by both programs, from the same file, and compares as `referee.py` does. Without scenes it takes all of
crates/rebond-io/tests/data/mitsuba. Their filter has to be `box` and their sampler `independent`.

Exit code: 0 all agree, 1 some do not, 3 too few samples to say.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

import rebond
from referee import write_pictures
from scene import ROOT
from welch import Estimate, compare

SCENES = ROOT / "crates" / "rebond-io" / "tests" / "data" / "mitsuba"


def ours(path, spp, seed, program):
    with tempfile.TemporaryDirectory() as folder:
        picture = Path(folder, "picture.exr")
        command = [program, "render", path, "--spp", str(spp), "--seed", str(seed), "--json", "--lenient", "-o", picture]
        run = subprocess.run([str(c) for c in command], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        if run.returncode:
            raise SystemExit(f"rebond failed with exit code {run.returncode}:\n{run.stderr}")
        warnings = [line for line in run.stderr.splitlines() if line.startswith("warning")]
        return json.loads(run.stdout), warnings, rebond.layers(picture)


def theirs(path, spp, runs, seed):
    import mitsuba as mi

    loaded = mi.load_file(str(path), spp=str(spp // runs))
    pictures = [np.array(mi.render(loaded, spp=spp // runs, seed=seed + i))[..., :3] for i in range(runs)]
    return Estimate.of_runs(pictures)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", nargs="*", type=Path)
    parser.add_argument("--spp", type=int, default=256, help="samples per pixel of each, in all (default 256)")
    parser.add_argument("--runs", type=int, default=16, help="Mitsuba's runs over which they are spread (default 16)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--variant", default="llvm_ad_rgb", help="Mitsuba's: llvm_ad_rgb or scalar_rgb")
    parser.add_argument("-o", "--output", type=Path, help="write both pictures and a map of t to folders here")
    parser.add_argument("--quiet", action="store_true", help="a line for each scene only")
    rebond.add_arguments(parser)
    args = parser.parse_args()

    import mitsuba

    mitsuba.set_variant(args.variant)
    worst = 0
    for path in args.scenes or sorted(SCENES.glob("*.xml")):
        statistics, warnings, layers = ours(path, args.spp, args.seed, args.rebond)
        if "samples" in layers and (layers["samples"] == args.spp).all():
            a = Estimate(layers[""], layers["variance"], args.spp - 1)
        # Splats of one path are not independent of each other: several films tell by how much they vary.
        if statistics["integrator"] in ("light", "bidirectional"):
            runs = [ours(path, args.spp // args.runs, args.seed + i, args.rebond)[2][""] for i in range(args.runs)]
            a = Estimate.of_runs(runs)
        b = theirs(path, args.spp, args.runs, args.seed)
        verdict = compare(a, b)
        ratios = ", ".join(f"{r:.4f}" for r in a.total()[0] / b.total()[0])
        print(f"{path.stem:<18} {verdict.word():<32} mean ratios {ratios}", flush=True)
        if not args.quiet:
            print("\n".join(f"  {line}" for line in warnings + verdict.lines))
        if args.output:
            write_pictures(args.output / path.stem, a, b, verdict.t)
        code = verdict.exit_code()
        worst = 1 if 1 in (code, worst) else max(code, worst)
    return worst


if __name__ == "__main__":
    sys.exit(main())
