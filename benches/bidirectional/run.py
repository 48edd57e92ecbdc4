#!/usr/bin/env python3
"""Bidirectional path tracing beside path tracing, and beside other programs.

    python3 run.py figure [--size WxH] [--save NAME]            path, 56 samples, and bidirectional, 25, of veach-bidir
    python3 run.py referee SCENE ... [--integrator bidirectional] does it render what Mitsuba's path tracer does?
    python3 run.py speed [SCENE ...] [--rounds 3] [--save NAME] samples per second and 1 / (relMSE x time), beside Mitsuba's
                                                                path tracer and LuxCore's BIDIRCPU

README.md says how errors are measured. `figure` needs numpy and mitsuba (which reads EXR), `speed` pyluxcore as well.
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
sys.path[:0] = [str(HERE.parent), str(HERE.parent / "mitsuba")]

import scene as scenes  # noqa: E402
from machine import machine  # noqa: E402
from rebond import PROGRAM, layers  # noqa: E402
from speed import rel_mse  # noqa: E402

REFERENCE_SEED = 9001


# ---- rebond ----


def rebond(program, description, integrator, spp, seed, threads=2):
    """The run's statistics and its picture."""
    with tempfile.TemporaryDirectory() as folder:
        file, picture = Path(folder, "scene.toml"), Path(folder, "picture.exr")
        file.write_text(scenes.dump(description))
        command = [program, "render", file, "-i", integrator, "--spp", spp, "--seed", seed, "--threads", threads]
        command += ["--json", "--quiet", "-o", picture]
        run = subprocess.run([str(c) for c in command], stdout=subprocess.PIPE, check=True, text=True)
        return json.loads(run.stdout), layers(picture)[""]


def mse(image, reference):
    return float(((image - reference) ** 2).mean())


# ---- path beside bidirectional ----


def figure(args):
    import mitsuba as mi

    mi.set_variant("scalar_rgb")
    description, _ = scenes.comparable(scenes.read(args.scene), *(args.size or (512, 384)))
    settings = f"max_depth={args.max_depth}"
    runs = []
    for i in range(args.reference_runs):
        run, image = rebond(args.rebond, description, f"bidirectional:{settings}", args.reference_spp, REFERENCE_SEED + i)
        runs.append(image)
        print(f"  reference {i + 1} of {args.reference_runs}: {run['render_seconds']:.0f} s", file=sys.stderr)
    reference = sum(runs) / len(runs)
    apart = mse(sum(runs[::2]) / len(runs[::2]), sum(runs[1::2]) / len(runs[1::2])) / 4 if len(runs) > 1 else None
    rows, pictures = {}, []
    for integrator, spp in (("path", 56), ("bidirectional", 25)):
        found = {"seconds": [], "mse": [], "rel_mse": []}
        for seed in range(args.rounds):
            run, image = rebond(args.rebond, description, f"{integrator}:{settings}", spp, 10 + seed)
            for key, value in (("seconds", run["render_seconds"]), ("mse", mse(image, reference)), ("rel_mse", rel_mse(image, reference))):
                found[key].append(value)
        pictures.append(image)
        middle = {key: statistics.median(values) for key, values in found.items()}
        rows[f"{integrator}, {spp} spp"] = {"raw": found, **middle}
        print(f"{integrator:<14}{spp:>4} spp  {middle['seconds']:7.3f} s   MSE {middle['mse']:.4g}   relMSE {middle['rel_mse']:.4g}")
    path, both = rows.values()
    ratios = {key: path[key] * path["seconds"] / (both[key] * both["seconds"]) for key in ("mse", "rel_mse")}
    print(f"at equal time, path's over bidirectional's: MSE {ratios['mse']:.1f}, relMSE {ratios['rel_mse']:.1f}")
    if args.picture:
        stops = 2.0**args.exposure
        row = np.concatenate([p * stops for p in (*pictures, reference)], axis=1)
        mi.util.write_bitmap(str(args.picture), row.astype(np.float32))
    return {"rows": rows, "equal_time": ratios, "reference_mse": apart}


# ---- beside Mitsuba's images ----


def referee(name, args):
    """Welch's test of blocks of 8x8 pixels over runs of other seeds: light from one path ties pixels together, blocks of
    other runs it does not."""
    import mitsuba as mi
    import welch

    welch.BLOCK = 1
    mi.set_variant("llvm_ad_rgb")
    description, notes = scenes.comparable(scenes.read(name), *(args.size or (128, 128)), sampler="independent")
    for note in notes:
        print(f"note: {note}")
    blocks = lambda image: image.reshape(image.shape[0] // 8, 8, image.shape[1] // 8, 8, 3).mean(axis=(1, 3))
    depth = f"max_depth={args.max_depth}"
    ours = [rebond(args.rebond, description, f"{args.integrator}:{depth}", args.spp, 100 + i)[1] for i in range(16)]
    loaded = scenes.load(description, max_depth=args.max_depth, sampler="independent", spp=4 * args.spp)
    theirs = [np.array(mi.render(loaded, spp=4 * args.spp, seed=200 + i), float) for i in range(16)]
    a, b = (welch.Estimate.of_runs([blocks(image) for image in images]) for images in (ours, theirs))
    verdict = welch.compare(a, b)
    print(f"{name}: {args.integrator} beside Mitsuba {mi.__version__}, {depth}, 16 runs of {args.spp} and {4 * args.spp} spp")
    print("\n".join(verdict.lines).replace("8x8", "pixels").replace("1x1", "8x8") + f"\nverdict: {verdict.word()}\n", flush=True)
    return verdict.exit_code()


# ---- LuxCore ----


def corners(shape, matrix):
    """Positions, normals (or None) and triangles of a shape, in the world."""
    kind, normals = shape["type"], None
    if kind == "rectangle":
        points, faces = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2], [0, 2, 3]]
    elif kind == "cube":
        points = [[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)]
        quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
        faces = [t for a, b, c, d in quads for t in ([a, b, c], [a, c, d])]
    elif kind == "mesh":
        points = shape["positions"]
        faces = [t for f in shape["faces"] for t in ([f] if len(f) == 3 else [f[:3], [f[0], f[2], f[3]]])]
    elif kind == "sphere":
        rings, sides = 96, 192
        theta, phi = np.meshgrid(np.pi * np.arange(rings + 1) / rings, 2 * np.pi * np.arange(sides) / sides, indexing="ij")
        normals = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=2).reshape(-1, 3)
        points = np.asarray(shape.get("center", [0, 0, 0])) + shape.get("radius", 1) * normals
        at = lambda i, j: i * sides + j % sides
        faces = [t for i in range(rings) for j in range(sides) for t in ([at(i, j), at(i + 1, j), at(i + 1, j + 1)], [at(i, j), at(i + 1, j + 1), at(i, j + 1)])]
        faces = [f for f in faces if len({tuple(np.round(points[v], 9)) for v in f}) == 3]
    elif kind == "ply":
        import mitsuba as mi

        mesh = mi.load_dict({"type": "ply", "filename": shape["file"]})
        params = mi.traverse(mesh)
        points = np.array(params["vertex_positions"]).reshape(-1, 3)
        faces = np.array(params["faces"]).reshape(-1, 3)
        if len(params["vertex_normals"]):
            normals = np.array(params["vertex_normals"]).reshape(-1, 3)
    else:
        raise scenes.Unsupported(f"a shape of type {kind!r}")
    points = np.asarray(points, float) @ matrix[:3, :3].T + matrix[:3, 3]
    if normals is not None:
        normals = np.asarray(normals, float) @ np.linalg.inv(matrix[:3, :3])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    faces = np.asarray(faces, int)
    if (np.linalg.det(matrix[:3, :3]) < 0) != bool(shape.get("flip_normals")):
        faces = faces[:, ::-1]
    return points, normals, faces


def luxcore(description, spp, seed, threads, depth):
    """Seconds and the picture, by LuxCore's BIDIRCPU; in this process."""
    import pyluxcore as lux

    lux.Init(lambda _: None)
    scene, properties = lux.Scene(), lux.Properties()
    film, camera = description["film"], description["camera"]
    m = scenes.matrix(camera["to_world"])
    origin, target, up = m[:3, 3], m[:3, 3] + m[:3, 2], m[:3, 1]
    set_ = lambda key, value: properties.Set(lux.Property(key, value))
    set_("scene.camera.type", "perspective")
    set_("scene.camera.lookat.orig", list(map(float, origin)))
    set_("scene.camera.lookat.target", list(map(float, target)))
    set_("scene.camera.up", list(map(float, up)))
    # LuxCore's is that of the shorter side.
    wide = np.tan(np.radians(camera.get("fov", 45)) / 2) * min(1.0, film["height"] / film["width"])
    set_("scene.camera.fieldofview", float(np.degrees(2 * np.arctan(wide))))
    set_("scene.camera.autofocus.enable", False)

    def material(value):
        return description["materials"][value] if isinstance(value, str) else value

    for i, shape in enumerate(description["shapes"]):
        kind = material(shape.get("material", {"type": "diffuse"}))
        if kind["type"] == "two-sided":
            kind = material(kind["front"])
        name, color = f"m{i}", lambda key, default: [float(x) for x in np.broadcast_to(kind.get(key, default), 3)]
        if kind["type"] == "diffuse":
            set_(f"scene.materials.{name}.type", "matte")
            set_(f"scene.materials.{name}.kd", color("reflectance", 0.5))
        elif kind["type"] == "mirror":
            set_(f"scene.materials.{name}.type", "mirror")
            set_(f"scene.materials.{name}.kr", color("reflectance", 1))
        elif kind["type"] == "dielectric" and "alpha" not in kind:
            set_(f"scene.materials.{name}.type", "glass")
            for key in ("kr", "kt"):
                set_(f"scene.materials.{name}.{key}", [1.0, 1.0, 1.0])
            set_(f"scene.materials.{name}.interiorior", float(kind.get("int_ior", 1.5)))
        else:
            raise scenes.Unsupported(f"a material of type {kind['type']!r}")
        if "emission" in shape:
            set_(f"scene.materials.{name}.emission", [float(x) for x in np.broadcast_to(shape["emission"], 3)])
            set_(f"scene.materials.{name}.emission.gain", [1.0, 1.0, 1.0])
            set_(f"scene.materials.{name}.emission.normalizebycolor", False)
        points, normals, faces = corners(shape, scenes.matrix(shape.get("to_world", [])))
        as_list = lambda rows: [tuple(map(float, r)) for r in rows]
        triangles = [tuple(map(int, f)) for f in faces]
        scene.DefineMesh(f"mesh{i}", as_list(points), triangles, as_list(normals) if normals is not None else None, None, None, None)
        set_(f"scene.objects.o{i}.shape", f"mesh{i}")
        set_(f"scene.objects.o{i}.material", name)
    scene.Parse(properties)

    config = lux.Properties()
    put = lambda key, value: config.Set(lux.Property(key, value))
    put("renderengine.type", "BIDIRCPU")
    put("renderengine.seed", int(seed))
    put("sampler.type", "SOBOL")
    put("native.threads.count", int(threads))
    put("film.width", int(film["width"]))
    put("film.height", int(film["height"]))
    put("film.filter.type", "BOX")
    put("film.filter.xwidth", 0.5)
    put("film.filter.ywidth", 0.5)
    put("film.imagepipelines.0.0.type", "NOP")
    put("film.imagepipelines.0.radiancescales.0.enabled", True)
    put("batch.haltspp", int(spp))
    for walk in ("path", "light"):
        put(f"{walk}.maxdepth", int(depth))
        # With roulette on its mean is too high.
        put(f"{walk}.russianroulette.depth", int(depth))
        put(f"{walk}.russianroulette.cap", 1.0)
    session = lux.RenderSession(lux.RenderConfig(config, scene))
    start = time.perf_counter()
    session.Start()
    while not session.HasDone():
        time.sleep(0.02)
        session.UpdateStats()
    seconds = time.perf_counter() - start
    passes = session.GetStats().Get("stats.renderengine.pass").GetInt()
    session.Stop()
    buffer = np.zeros(film["width"] * film["height"] * 3, np.float32)
    session.GetFilm().GetOutputFloat(lux.FilmOutputType.RGB_IMAGEPIPELINE, buffer, 0)
    # From the bottom; and it looks the other way.
    image = buffer.reshape(film["height"], film["width"], 3)[::-1]
    return seconds, passes, image


# ---- speed ----


def measure(name, args):
    import speed as mitsuba_speed

    description, notes = scenes.comparable(scenes.read(name), *(args.size or (512, 512)))
    for note in notes:
        print(f"note: {note}")
    depth = f"max_depth={args.max_depth}"
    raw = {}

    def record(program, spp, seconds, image):
        row = raw.setdefault(program, {"spp": spp, "seconds": [], "rel_mse": [], "mse": [], "mean": []})
        row["seconds"].append(seconds)
        row["rel_mse"].append(rel_mse(image, reference))
        row["mse"].append(mse(image, reference))
        row["mean"].append(float(image.mean()))

    runs = [rebond(args.rebond, description, f"bidirectional:{depth}", args.reference_spp, REFERENCE_SEED + i)[1] for i in range(2)]
    reference, apart = sum(runs) / 2, rel_mse(*runs) / 4
    with tempfile.TemporaryDirectory() as folder:
        settings = {"threads": args.threads, "max_depth": args.max_depth, "spp": args.spp}
        worker = mitsuba_speed.Worker("llvm_ad_rgb", description, Path(folder), settings)
        for i in range(args.rounds):
            for integrator, spp in (("path", args.spp), ("bidirectional", args.spp // 2)):
                run, image = rebond(args.rebond, description, f"{integrator}:{depth}", spp, 10 + i, args.threads)
                record(f"rebond {integrator}", spp, run["render_seconds"], image)
            seconds, _, image = worker.render(10 + i, args.spp)
            record("mitsuba path", args.spp, seconds, image)
            if args.luxcore:
                file = Path(folder, "scene.json")
                file.write_text(json.dumps(description))
                out = Path(folder, "luxcore.npy")
                command = [sys.executable, __file__, "--luxcore", file, args.luxcore_spp, 10 + i, args.threads, args.max_depth, out]
                found = subprocess.run([str(c) for c in command], stdout=subprocess.PIPE, text=True)
                if found.returncode:
                    raise SystemExit(f"luxcore ended with exit code {found.returncode}")
                seconds, passes = json.loads(found.stdout.strip().splitlines()[-1])
                record("luxcore BIDIRCPU", passes, seconds, np.load(out).astype(float))
            print(f"  {name}: round {i + 1} of {args.rounds}", file=sys.stderr)
        versions = worker.versions
        worker.close()
    pixels = description["film"]["width"] * description["film"]["height"]
    print(f"\n{name:<18}{'spp':>5}{'seconds':>9}{'M samples/s':>13}{'mean':>9}{'relMSE':>11}{'1/(relMSE·s)':>14}")
    for program, row in raw.items():
        seconds, error = statistics.median(row["seconds"]), statistics.fmean(row["rel_mse"])
        row["samples_per_second"], row["efficiency"] = pixels * row["spp"] / seconds, 1 / (error * seconds)
        print(f"{program:<18}{row['spp']:>5}{seconds:>9.2f}{row['samples_per_second'] / 1e6:>13.3f}{statistics.fmean(row['mean']):>9.4f}{error:>11.3e}{row['efficiency']:>14.1f}")
    print(f"(the reference: mean {reference.mean():.4f}, its own relMSE about {apart:.1e})", flush=True)
    return {"programs": raw, "reference_rel_mse": apart, "reference_mean": float(reference.mean()), "versions": versions}


def main():
    if sys.argv[1:2] == ["--luxcore"]:
        file, spp, seed, threads, depth, out = sys.argv[2:]
        seconds, passes, image = luxcore(json.loads(Path(file).read_text()), int(spp), int(seed), int(threads), int(depth))
        np.save(out, image)
        print(json.dumps([seconds, passes]), flush=True)
        # Its libraries do not end well beside others.
        os._exit(0)
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=["figure", "referee", "speed"])
    parser.add_argument("scenes", nargs="*")
    parser.add_argument("--size", type=scenes.size, metavar="WxH")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--spp", type=int, default=64, help="of path tracing, a square number; bidirectional has half")
    parser.add_argument("--max-depth", type=int, default=8)
    parser.add_argument("--integrator", default="bidirectional", help="what the referee judges")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--reference-spp", type=int, default=1024)
    parser.add_argument("--reference-runs", type=int, default=2)
    parser.add_argument("--luxcore", action="store_true", help="LuxCore's BIDIRCPU too")
    parser.add_argument("--luxcore-spp", type=int, default=8)
    parser.add_argument("--picture", type=Path, help="where the figure goes, a PNG")
    parser.add_argument("--exposure", type=float, default=0.0, help="stops by which the figure is brightened")
    parser.add_argument("--rebond", type=Path, default=PROGRAM)
    parser.add_argument("--save", metavar="NAME", help="write the raw figures to results/DATE-NAME.json")
    args = parser.parse_args()
    import mitsuba

    mitsuba.set_variant("scalar_rgb")
    version = subprocess.run([args.rebond, "--version"], capture_output=True, text=True).stdout.strip()
    keys = ("rounds", "spp", "size", "max_depth", "threads", "reference_spp", "reference_runs", "luxcore_spp")
    settings = {k: getattr(args, k) for k in keys}
    result = {"date": datetime.date.today().isoformat(), "machine": machine(), "rebond": version, "settings": settings}
    if args.what == "referee":
        return max(referee(name, args) for name in args.scenes)
    if args.what == "figure":
        args.scene = args.scenes[0] if args.scenes else "veach-bidir"
        result |= {"scene": args.scene, **figure(args)}
    else:
        result["scenes"] = {name: measure(name, args) for name in args.scenes or ["cornell-box", "cornell-spheres", "indirect-room"]}
    if args.save:
        path = HERE / "results" / f"{result['date']}-{args.save}.json"
        path.write_text(json.dumps(result, indent=1) + "\n")
        print(f"written: {path}")
    return None


if __name__ == "__main__":
    sys.exit(main())
