"""Photon mapping and vertex connection and merging: speed, error against photons, and caustics in a mirror.

    python3 run.py [speed] [error] [caustic] [figures] [--rounds 3] [--seconds 20] [--reference 1024] [--save]

speed    on cornell-spheres: walks and stored photons per second, estimates per second for the 50 and the 500 nearest of 500 000
         emitted photons, seconds per progressive iteration of 262 144 photons, samples per second of vcm and bidirectional.
error    relMSE on cornell-box against a path-traced reference as photons grow, written to error.svg; and of the direct view and
         the final gather at equal time. Without the worst 5 % of pixels: the lamp's edge is noisy whatever lights the rest.
caustic  relMSE x processor time on caustic-mirror of path, bidirectional and vcm, means over the rounds, against a mean of two long
         vcm renders of other seeds; and how much of it is light that only the eye's walk finds, through mirrors and glass.
figures  the pictures of docs/images.

    relMSE = mean((x - ref)^2 / (ref^2 + 0.01))        without the worst 0.1 % of pixels, unless said otherwise
"""

import argparse
import datetime
import json
import math
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

TRIMMED = 0.001
TRIMMED_LAMP = 0.05


def render(args, scene, integrator, size, *more, seed=0):
    """A picture and the run's statistics."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "picture.pfm")
        command = [args.rebond, "render", scene, "-i", integrator, "--size", size, "--seed", str(seed)]
        command += ["--threads", str(args.threads), *more, "--quiet", "--json", "-o", str(file)]
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        run = subprocess.run(command, check=True, stdout=subprocess.PIPE)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        processor = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        return read_pfm(file), {**json.loads(run.stdout), "processor_seconds": processor}


def rel_mse(picture, reference, trimmed=TRIMMED):
    e = np.sort(((picture - reference) ** 2 / (reference**2 + 0.01)).mean(axis=2), axis=None)
    return float(e[: len(e) - int(trimmed * len(e))].mean())


def speed(args):
    def seconds(integrator, size, spp):
        runs = [render(args, "cornell-spheres", integrator, size, "--spp", str(spp))[1] for _ in range(args.rounds)]
        return statistics.median(r["render_seconds"] for r in runs), runs[-1]

    result = {}
    fill, run = seconds("photon:photons=500000,nearest=2", "1x1", 1)
    stored = run["counts"]["photons_stored"]
    result["map"] = {"seconds": fill, "walks_per_second": 500_000 / fill, "stored_per_second": stored / fill}
    for nearest in (50, 500):
        whole, run = seconds(f"photon:photons=500000,nearest={nearest}", "256x256", 4)
        result[f"estimates_{nearest}"] = run["samples"] / (whole - fill)
    for name, integrator, spp in (
        ("progressive", "photon:progressive=true,photons=262144", 4),
        ("vcm", "vcm", 16),
        ("vcm of 8 segments", "vcm:max_depth=8", 16),
        ("bidirectional", "bidirectional", 16),
    ):
        whole, run = seconds(integrator, "512x512", spp)
        result[name] = {"seconds_per_sample": whole / spp, "samples_per_second": run["samples"] / whole}
    print(json.dumps(result, indent=1))
    return result


def error(args):
    size, scene = "96x96", "cornell-box"
    reference, _ = render(args, scene, "path", size, "--spp", "4096", seed=99)
    rows = []
    for photons, nearest in ((2_000, 12), (8_000, 25), (32_000, 50), (128_000, 100), (512_000, 200), (2_048_000, 400)):
        row = {"photons": photons, "nearest": nearest}
        for name, more in (("direct", ""), ("gather", ",gather=16,precompute=true")):
            picture, run = render(args, scene, f"photon:photons={photons},nearest={nearest}{more}", size, "--spp", "16")
            row[name] = {"relMSE": rel_mse(picture, reference, TRIMMED_LAMP), "seconds": run["render_seconds"]}
        rows.append(row)
        print(row)
    plot(HERE / "error.svg", rows)
    equal = {}
    for name, integrator in (
        ("direct", "photon:photons=500000,nearest=200"),
        ("gather", "photon:photons=500000,nearest=200,gather=16,precompute=true"),
    ):
        picture, run = render(args, scene, integrator, size, "--time", f"{args.seconds}s")
        equal[name] = {"relMSE": rel_mse(picture, reference, TRIMMED_LAMP), "seconds": run["render_seconds"]}
    print(equal)
    return {"rows": rows, "equal_time": equal}


def plot(path, rows):
    """relMSE against photons, both as logarithms."""
    width, height, left, bottom = 520, 340, 60, 40
    xs = [math.log10(r["photons"]) for r in rows]
    series = {name: [math.log10(r[name]["relMSE"]) for r in rows] for name in ("direct", "gather")}
    low, high = (f(f(s) for s in series.values()) for f in (min, max))
    low, high = math.floor(low), math.ceil(high)
    at_x = lambda x: left + (x - xs[0]) / (xs[-1] - xs[0]) * (width - left - 20)  # noqa: E731
    at_y = lambda y: 15 + (high - y) / (high - low) * (height - bottom - 15)  # noqa: E731
    out = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" font-family="sans-serif" font-size="12">']
    out.append(f'<rect width="{width}" height="{height}" fill="white"/>')
    for e in range(low, high + 1):
        out.append(f'<path d="M{left} {at_y(e):.1f}H{width - 20}" stroke="#ddd"/>')
        out.append(f'<text x="{left - 6}" y="{at_y(e) + 4:.1f}" text-anchor="end">10<tspan dy="-4" font-size="9">{e}</tspan></text>')
    for row, x in zip(rows, xs):
        label = f"{row['photons'] // 1000} k"
        out.append(f'<text x="{at_x(x):.1f}" y="{height - bottom + 18}" text-anchor="middle">{label}</text>')
    for (name, ys), colour, words in zip(series.items(), ("#1f5fa8", "#c2571a"), ("the map itself", "final gather, 16 directions")):
        points = " ".join(f"{at_x(x):.1f},{at_y(y):.1f}" for x, y in zip(xs, ys))
        out.append(f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="2"/>')
        out += [f'<circle cx="{at_x(x):.1f}" cy="{at_y(y):.1f}" r="3" fill="{colour}"/>' for x, y in zip(xs, ys)]
        out.append(f'<text x="{at_x(xs[0]) + 8:.1f}" y="{at_y(ys[0]) - 8:.1f}" fill="{colour}">{words}</text>')
    out.append(f'<text x="{(width + left) / 2}" y="{height - 6}" text-anchor="middle">photons emitted</text>')
    out.append(f'<text x="14" y="{(height - bottom) / 2}" transform="rotate(-90 14 {(height - bottom) / 2})" text-anchor="middle">relMSE</text></svg>')
    path.write_text("\n".join(out) + "\n")


def caustic(args):
    size, scene = "256x192", "caustic-mirror"
    references = [render(args, scene, "vcm", size, "--spp", f"{args.reference}", seed=100 + i) for i in range(2)]
    both = [picture for picture, _ in references]
    reference = np.mean(both, axis=0)
    pixels = reference[..., 0].size
    own = {kind: rel_mse(*both, trimmed) / 4 for kind, trimmed in (("trimmed", TRIMMED), ("whole", 0))}
    result = {"reference": {"spp": sum(run["samples"] for _, run in references) / pixels, **own}}
    # Light that met mirrors and glass only is found by the eye's walk alone, whatever else there is: its share of the error, by the
    # spread of renders of nothing else.
    spp = 128
    alone = [render(args, scene, "path:paths=L(S|T)*E", size, "--spp", f"{spp}", seed=200 + i)[0] for i in range(16)]
    per_sample = (spp * np.var(alone, axis=0, ddof=1) / (reference**2 + 0.01)).mean(axis=2)
    result["eye_alone"] = {"of_a_sample": float(per_sample.mean())}
    result["eye_alone"]["worst_50_pixels"] = float(np.sort(per_sample, axis=None)[-50:].sum() / per_sample.sum())
    for name, spp in (("path", 512), ("bidirectional", 64), ("vcm", 64), ("vcm:radius=0.016", 64)):
        rows = []
        for seed in range(1, 1 + args.rounds):
            picture, run = render(args, scene, name, size, "--spp", f"{spp}", seed=seed)
            seconds = run["processor_seconds"]
            row = {"spp": spp, "seconds": seconds, "eye_alone": float(per_sample.mean()) / spp * seconds}
            for kind, trimmed in (("trimmed", TRIMMED), ("whole", 0)):
                row[kind] = rel_mse(picture, reference, trimmed) * seconds
            rows.append(row)
        result[name] = {key: statistics.mean(row[key] for row in rows) for key in rows[0]} | {"rounds": rows}
    print(json.dumps(result, indent=1))
    return result


def figures(args):
    images = HERE.parents[1] / "docs" / "images"
    for name, scene, integrator, more in (
        ("photon-map.png", "cornell-spheres", "photon:photons=500000,nearest=500", ["--spp", "16"]),
        (
            "photon-gather.png",
            "cornell-spheres",
            "photon:photons=500000,nearest=500,gather=16,precompute=true",
            ["--spp", "4"],
        ),
        ("caustic-mirror-path.png", "caustic-mirror", "path", ["--time", f"{args.seconds}s"]),
        ("caustic-mirror-vcm.png", "caustic-mirror", "vcm", ["--time", f"{args.seconds}s"]),
    ):
        size = "400x400" if scene == "cornell-spheres" else "400x300"
        command = [args.rebond, "render", scene, "-i", integrator, "--size", size, *more, "--quiet", "--json"]
        subprocess.run([*command, "--threads", str(args.threads), "-o", str(images / name)], check=True)
    return {}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parts = {"speed": speed, "error": error, "caustic": caustic, "figures": figures}
    parser.add_argument("parts", nargs="*", default=["speed", "error", "caustic"], metavar="PART", help=", ".join(parts))
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=20.0, help="time of a render of equal time and of the pictures of `caustic`")
    parser.add_argument("--reference", type=int, default=1024, help="samples of each of the two references of `caustic`")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--rebond", default=str(HERE.parents[1] / "target" / "release" / "rebond"), help="the program")
    parser.add_argument("--save", action="store_true", help="keep the raw figures in results/")
    args = parser.parse_args()
    results = {part: parts[part](args) for part in args.parts}
    if args.save:
        today = datetime.date.today().isoformat()
        settings = {k: v for k, v in vars(args).items() if k not in ("rebond", "save")}
        report = {"date": today, "machine": machine(), "commit": commit(), "settings": settings, "load": os.getloadavg()}
        (HERE / "results").mkdir(exist_ok=True)
        name = f"{today}-{'-'.join(args.parts)}.json"
        (HERE / "results" / name).write_text(json.dumps({**report, **results}, indent=1) + "\n")


if __name__ == "__main__":
    main()
