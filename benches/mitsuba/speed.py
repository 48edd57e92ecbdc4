"""Speed of rebond and of Mitsuba 3 on the same scenes.

    python3 speed.py [SCENE ...] [--mesh FILE.ply] [--rounds 5] [--spp 64] [--threads 2] [--save NAME]

Renders each scene (default: cornell-box and dragon) by path tracing at the same size, depth, filter and number of
threads with rebond, with Mitsuba's `llvm_ad_rgb` and with its `scalar_rgb`, both with the `multijitter` sampler. The three
take turns, one at a time, and every round has seeds of its own; loading, building and compiling kernels are not counted.

Prints samples per second (medians), relMSE = mean((x - ref)^2 / (ref^2 + 0.01)) without the worst 0.1 % of pixels, and
1 / (relMSE x time), which is what matters, both as they are and as ratios to `llvm_ad_rgb`; and CPU time, which tells how
far to trust the rest (a quiet machine gives seconds x threads). The reference is the mean of a long rendering by each of
the two programs.
"""

import argparse
import datetime
import hashlib
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import rebond
from scene import HERE, comparable, dump, load, read, size

sys.path.insert(0, str(HERE.parent))

from machine import machine  # noqa: E402

CACHE = HERE / ".cache"
VARIANTS = ("llvm_ad_rgb", "scalar_rgb")
BASE = VARIANTS[0]
TRIMMED = 0.001  # share of the worst pixels that relMSE leaves out
REFERENCE_RUN = 256  # samples per pixel of one of Mitsuba's runs for the reference
REFERENCE_SEED = 1_000_003


# ---- Mitsuba, in processes of its own ----


def serve(variant, scene_file, settings):
    """Loads a scene, warms up, then renders once per line of stdin (seed, spp, file), and answers in seconds."""
    import drjit as dr
    import mitsuba as mi

    mi.set_variant(variant)
    dr.set_thread_count(settings["threads"])
    with open(scene_file) as f:
        scene = load(json.load(f), max_depth=settings["max_depth"], sampler="multijitter", spp=settings["spp"])

    def render(seed, spp):
        start, cpu_start = time.perf_counter(), time.process_time()
        image = mi.render(scene, seed=seed, spp=spp)
        dr.eval(image)
        dr.sync_thread()
        return time.perf_counter() - start, time.process_time() - cpu_start, image

    # Twice: kernels are compiled in the first, memory is at hand after the second. A spp of its own is a kernel of its own.
    for seed in (0, 1):
        render(seed, settings["spp"])
    print(json.dumps({"mitsuba": mi.__version__, "drjit": dr.__version__, "llvm": llvm()}), flush=True)
    for line in sys.stdin:
        seed, spp, path = json.loads(line)
        seconds, cpu_seconds, image = render(seed, spp)
        np.save(path, np.array(image))
        print(json.dumps([seconds, cpu_seconds]), flush=True)


def llvm():
    """The LLVM library that this process has loaded, as far as the system tells."""
    maps = Path("/proc/self/maps")
    names = (Path(line.split()[-1]).name for line in maps.read_text().splitlines()) if maps.is_file() else ()
    return next((name for name in names if "LLVM" in name), None)


class Worker:
    """A process that holds a scene in one of Mitsuba's variants."""

    def __init__(self, variant, scene, folder, settings):
        scene_file = folder / "scene.json"
        scene_file.write_text(json.dumps(scene))
        self.picture = folder / f"{variant}.npy"
        command = [sys.executable, __file__, "--serve", variant, str(scene_file), json.dumps(settings)]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self.versions = self._answer()

    def _answer(self):
        line = self.process.stdout.readline()
        if not line:
            raise SystemExit(f"mitsuba ended with exit code {self.process.wait()}")
        return json.loads(line)

    def render(self, seed, spp):
        """Seconds, seconds of CPU time, and the picture."""
        self.process.stdin.write(json.dumps([seed, spp, str(self.picture)]) + "\n")
        self.process.stdin.flush()
        seconds, cpu_seconds = self._answer()
        return seconds, cpu_seconds, np.load(self.picture).astype(np.float64)

    def close(self):
        self.process.stdin.close()
        self.process.wait()


# ---- error ----


def rel_mse(image, reference):
    """Mean relative squared error over channels and pixels, without the worst pixels."""
    error = ((image - reference) ** 2 / (reference**2 + 0.01)).mean(axis=2).ravel()
    kept = len(error) - int(round(TRIMMED * len(error)))
    return float(np.partition(error, kept - 1)[:kept].mean())


def digest(*parts):
    h = hashlib.sha256()
    for part in parts:
        h.update(part if isinstance(part, bytes) else str(part).encode())
    return h.hexdigest()[:20]


def files_of(node):
    """The files that a scene names."""
    if isinstance(node, dict):
        for key, value in node.items():
            if key in ("file", "image") and isinstance(value, str):
                yield value
            else:
                yield from files_of(value)
    elif isinstance(node, list):
        for value in node:
            yield from files_of(value)


def reference(scene, args, worker, run_rebond):
    """The mean of long renderings by both, and how far these are apart (relMSE)."""
    parts = [dump(scene), args.max_depth, args.reference_spp, *(Path(f).read_bytes() for f in sorted(files_of(scene)))]
    pictures = []
    for name, version in (("rebond", Path(args.rebond).read_bytes()), ("mitsuba", worker.versions["mitsuba"])):
        path = CACHE / f"{name}-{digest(name, version, *parts)}.npy"
        if not path.is_file():
            print(f"  reference by {name}: {args.reference_spp} spp ...", file=sys.stderr)
            if name == "rebond":
                picture = run_rebond(REFERENCE_SEED, args.reference_spp)[-1]
            else:
                runs = args.reference_spp // REFERENCE_RUN
                spp = args.reference_spp // runs
                picture = sum(worker.render(REFERENCE_SEED + i, spp)[-1] for i in range(runs)) / runs
            CACHE.mkdir(exist_ok=True)
            np.save(path, picture.astype(np.float32))
        pictures.append(np.load(path).astype(np.float64))
    mean = sum(pictures) / 2
    return mean, rel_mse(pictures[0], pictures[1])


# ---- the measurement ----


def measure(name, scene, args):
    """All rounds of one scene: raw seconds and relMSE by program."""
    settings = {"threads": args.threads, "max_depth": args.max_depth, "spp": args.spp}

    def run_rebond(seed, spp):
        options = {"threads": args.threads, "program": args.rebond, "engine": args.engine}
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        run, layers = rebond.render(scene, spp, seed, max_depth=args.max_depth, **options)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        # CPU time includes loading, building and writing: there is no other way to have it from outside.
        cpu_seconds = after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime
        return run["render_seconds"], cpu_seconds, layers[""]

    with tempfile.TemporaryDirectory() as folder:
        workers = {v: Worker(v, scene, Path(folder), settings) for v in args.variants}
        renderers = {"rebond": run_rebond} | {f"mitsuba {v}": w.render for v, w in workers.items()}
        ref, apart = reference(scene, args, workers[BASE], run_rebond)
        run_rebond(0, args.spp)
        raw = {program: {"seconds": [], "cpu_seconds": [], "rel_mse": []} for program in renderers}
        for i in range(args.rounds):
            # Every round begins with another program.
            order = list(renderers)
            order = order[i % len(order) :] + order[: i % len(order)]
            for program in order:
                seconds, cpu_seconds, image = renderers[program](10 + i, args.spp)
                figures = {"seconds": seconds, "cpu_seconds": cpu_seconds, "rel_mse": rel_mse(image, ref)}
                for key, value in figures.items():
                    raw[program][key].append(value)
            print(f"  {name}: round {i + 1} of {args.rounds}", file=sys.stderr)
        versions = workers[BASE].versions
        for worker in workers.values():
            worker.close()
    return {"programs": raw, "reference_rel_mse": apart / 4, "versions": versions}


def summary(raw, samples):
    """Figures per program."""
    rows = {}
    for program, figures in raw.items():
        seconds = statistics.median(figures["seconds"])
        error = statistics.fmean(figures["rel_mse"])
        rows[program] = {"seconds": seconds, "samples_per_second": samples / seconds, "rel_mse": error}
        rows[program]["efficiency"] = 1 / (error * seconds)
        rows[program]["cpu_seconds"] = statistics.median(figures["cpu_seconds"])
    base = rows[f"mitsuba {BASE}"]
    for row in rows.values():
        row["speed_ratio"] = row["samples_per_second"] / base["samples_per_second"]
        row["efficiency_ratio"] = row["efficiency"] / base["efficiency"]
    return rows


def table(name, rows, reference_error):
    width = max(map(len, rows))
    head = f"{name:<{width}}{'seconds':>10}{'CPU s':>8}{'M samples/s':>13}{'ratio':>8}{'relMSE':>12}{'1/(relMSE·s)':>14}{'ratio':>8}"
    lines = [head, "-" * len(head)]
    for program, r in rows.items():
        lines.append(
            f"{program:<{width}}{r['seconds']:>10.3f}{r['cpu_seconds']:>8.2f}{r['samples_per_second'] / 1e6:>13.2f}{r['speed_ratio']:>8.2f}"
            f"{r['rel_mse']:>12.3e}{r['efficiency']:>14.1f}{r['efficiency_ratio']:>8.2f}"
        )
    lines.append(f"(the reference's own relMSE is about {reference_error:.1e}; ratios are to mitsuba {BASE})")
    return "\n".join(lines)


def with_mesh(path):
    """The dragon's scene with another mesh in the dragon's place."""
    import mitsuba as mi

    mi.set_variant("scalar_rgb")
    scene = read("dragon")
    (dragon,) = (s for s in scene["shapes"] if s["type"] == "ply")

    def box(file):
        bounds = mi.load_dict({"type": "ply", "filename": file}).bbox()
        return np.array(bounds.min, float), np.array(bounds.max, float)

    (low, high), (a, b) = box(dragon["file"]), box(path)
    scale = np.linalg.norm(high - low) / np.linalg.norm(b - a)
    move = (low + high) / 2 - scale * (a + b) / 2
    move[1] = low[1] - scale * a[1]
    dragon["file"] = str(Path(path).resolve())
    dragon["to_world"] = [{"scale": float(scale)}, {"translate": [float(x) for x in move]}]
    return scene


def main():
    if sys.argv[1:2] == ["--serve"]:
        return serve(sys.argv[2], sys.argv[3], json.loads(sys.argv[4]))
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", nargs="*", help="TOML files or names of built-in scenes (default: cornell-box dragon)")
    parser.add_argument("--mesh", metavar="FILE.ply", help="also this mesh, in the dragon's place")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--spp", type=int, default=64)
    parser.add_argument("--size", type=size, default=(512, 512), metavar="WxH")
    parser.add_argument("--max-depth", type=int, default=8)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--reference-spp", type=int, default=2048, help="of each of the two references (default 2048)")
    parser.add_argument("--no-scalar", action="store_true", help="leave out Mitsuba's slow variant")
    parser.add_argument("--save", metavar="NAME", help="write the raw figures to results/DATE-NAME.json")
    rebond.add_arguments(parser)
    args = parser.parse_args()
    if args.reference_spp < REFERENCE_RUN or args.reference_spp % REFERENCE_RUN:
        parser.error(f"--reference-spp: give a multiple of {REFERENCE_RUN}, which is what one of Mitsuba's runs takes")
    args.variants = VARIANTS[:1] if args.no_scalar else VARIANTS

    # Reads EXR files.
    import mitsuba

    mitsuba.set_variant("scalar_rgb")
    scenes = {name: read(name) for name in args.scenes or ([] if args.mesh else ["cornell-box", "dragon"])}
    if args.mesh:
        scenes[Path(args.mesh).stem] = with_mesh(args.mesh)
    here = machine()
    if here["load_average"] > 0.3:
        print(f"note: the machine is not idle (load average {here['load_average']:.1f}); expect noise", file=sys.stderr)
    version = subprocess.run([args.rebond, "--version"], capture_output=True, text=True).stdout.strip()
    settings = {k: getattr(args, k) for k in ("rounds", "spp", "size", "max_depth", "threads", "reference_spp")}
    result = {"date": datetime.date.today().isoformat(), "machine": here, "rebond": version, "settings": settings, "scenes": {}}
    print(f"{here['cpu']}, {args.threads} threads, {args.size[0]}x{args.size[1]}, {args.spp} spp, max depth {args.max_depth}, box filter")
    for name, scene in scenes.items():
        scene, notes = comparable(scene, *args.size)
        for note in notes:
            print(f"note: {note}")
        measured = measure(Path(name).stem, scene, args)
        result["versions"] = measured.pop("versions")
        rows = summary(measured["programs"], args.size[0] * args.size[1] * args.spp)
        result["scenes"][Path(name).stem] = measured | {"summary": rows}
        print("\n" + table(Path(name).stem, rows, measured["reference_rel_mse"]), flush=True)
    if args.save:
        path = HERE / "results" / f"{result['date']}-{args.save}.json"
        path.parent.mkdir(exist_ok=True)
        path.write_text(json.dumps(result, indent=1) + "\n")
        print(f"\nwritten: {path}")


if __name__ == "__main__":
    sys.exit(main())
