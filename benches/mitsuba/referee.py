"""Does rebond render what Mitsuba 3 renders?

    python3 referee.py SCENE [--spp 256] [--runs 16] [--size WxH] [--sampler independent] [--variant llvm_ad_rgb] [-o DIR]

Renders a scene with both (path tracing, same depth, box filter) and compares: the mean radiance per channel, to be
within 0.2 %, and Welch's t-test per block of 8x8 pixels, to find no more outliers than its significance allows. Mitsuba's
variance is measured over independent runs. So is rebond's, unless its sampler is `independent`: then the variance that it
writes beside its picture is right, and one run is enough.

Exit code: 0 they agree, 1 they do not, 3 too few samples to say.
"""

import argparse
import sys
import time
from pathlib import Path

import numpy as np

import rebond
from scene import comparable, load, read, size
from welch import Estimate, compare


def mitsuba_estimate(scene, spp, runs, seed, max_depth, rr_depth):
    import mitsuba as mi

    loaded = load(scene, max_depth=max_depth, rr_depth=rr_depth, sampler="independent", spp=spp // runs)
    pictures = [np.array(mi.render(loaded, spp=spp // runs, seed=seed + i)) for i in range(runs)]
    return Estimate.of_runs(pictures)


def rebond_estimate(scene, spp, runs, seed, **settings):
    if scene.get("sampler", {}).get("type") == "independent":
        statistics, layers = rebond.render(scene, spp, seed, **settings)
        samples = layers["samples"]
        if not (samples == spp).all():
            raise SystemExit(f"rebond's pixels have {samples.min():g} to {samples.max():g} samples, not {spp}")
        return statistics, Estimate(layers[""], layers["variance"], spp - 1)
    all_runs = [rebond.render(scene, spp // runs, seed + i, **settings) for i in range(runs)]
    return all_runs[0][0], Estimate.of_runs([layers[""] for _, layers in all_runs])


def write_pictures(folder, a, b, t):
    import mitsuba as mi

    folder.mkdir(parents=True, exist_ok=True)
    for name, image in (("rebond", a.mean), ("mitsuba", b.mean)):
        bitmap = mi.Bitmap(image.astype(np.float32))
        bitmap.write(str(folder / f"{name}.exr"))
        mi.util.write_bitmap(str(folder / f"{name}.png"), bitmap)
    # Green where rebond is brighter, red where it is darker; full at five standard errors. A block is eight pixels wide.
    worst = np.take_along_axis(t, np.abs(t).argmax(axis=2)[..., None], axis=2)[..., 0] / 5
    map_ = np.stack([np.clip(-worst, 0, 1), np.clip(worst, 0, 1), 0 * worst], axis=2)
    map_ = np.kron(map_, np.ones((8, 8, 1)))[: a.mean.shape[0], : a.mean.shape[1]]
    mi.Bitmap((255 * map_).astype(np.uint8)).write(str(folder / "t.png"))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene", help="a TOML file or the name of a built-in scene")
    parser.add_argument("--spp", type=int, default=256, help="samples per pixel of each, in all (default 256)")
    parser.add_argument("--runs", type=int, default=16, help="runs over which they are spread (default 16)")
    parser.add_argument("--size", type=size, default=(None, None), metavar="WxH")
    parser.add_argument("--max-depth", type=int, default=8)
    parser.add_argument("--rr-depth", type=int, default=5)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--sampler", choices=["independent", "lattice", "sobol", "stratified"], default="independent", help="rebond's")
    parser.add_argument("--variant", default="llvm_ad_rgb", help="Mitsuba's: llvm_ad_rgb or scalar_rgb")
    parser.add_argument("-o", "--output", type=Path, help="write both pictures and a map of t to this folder")
    rebond.add_arguments(parser)
    args = parser.parse_args()
    if args.runs < 2 or args.spp % args.runs:
        parser.error("--spp has to be a multiple of --runs, which has to be 2 or more")

    import mitsuba

    mitsuba.set_variant(args.variant)
    scene, notes = comparable(read(args.scene), *args.size, sampler=args.sampler)
    for note in notes:
        print(f"note: {note}")
    depths = {"max_depth": args.max_depth, "rr_depth": args.rr_depth}
    start = time.perf_counter()
    statistics, ours = rebond_estimate(scene, args.spp, args.runs, args.seed, program=args.rebond, engine=args.engine, **depths)
    middle = time.perf_counter()
    theirs = mitsuba_estimate(scene, args.spp, args.runs, args.seed, **depths)
    end = time.perf_counter()
    if ours.mean.shape != theirs.mean.shape:
        sys.exit(f"rebond's picture is {ours.mean.shape}, Mitsuba's {theirs.mean.shape}")

    film = scene["film"]
    print(f"{args.scene}: {film['width']}x{film['height']}, {args.spp} spp, max depth {args.max_depth}, box filter; ", end="")
    print(f"rebond {args.sampler} ({middle - start:.1f} s), mitsuba {mitsuba.__version__} {args.variant} ({end - middle:.1f} s)")
    if statistics.get("dropped_samples"):
        print(f"note: rebond dropped {statistics['dropped_samples']} samples that were not finite")
    verdict = compare(ours, theirs)
    print("\n".join(verdict.lines))
    if args.output:
        write_pictures(args.output, ours, theirs, verdict.t)
    print(f"verdict: {verdict.word()}")
    return verdict.exit_code()


if __name__ == "__main__":
    sys.exit(main())
