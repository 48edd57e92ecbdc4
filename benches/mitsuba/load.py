"""How long does it take to open a large mesh, and how much memory?

    python3 load.py [--triangles 5000000] [--rounds 3] [--variant llvm_ad_rgb]

Makes a PLY file of hills, and a Mitsuba scene that shows it, and lets both programs open that scene in turns: rebond by `info`, Mitsuba by `load_file`,
each in a process of its own. Time is from before the file is opened to a scene that can be traced (Mitsuba: its scene has been
loaded and one ray traced); memory is the process's peak.
"""

import argparse
import json
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import rebond

SCENE = """<scene version="3.0.0"><integrator type="path"/><sensor type="perspective"><transform name="to_world">
<lookat origin="0, -2, 2" target="0, 0, 0" up="0, 0, 1"/></transform></sensor><emitter type="constant"/>
<shape type="ply"><string name="filename" value="hills.ply"/><boolean name="face_normals" value="true"/></shape></scene>"""


def hills(path, triangles):
    n = round((triangles / 2) ** 0.5)
    x, y = np.meshgrid(np.linspace(-1, 1, n + 1), np.linspace(-1, 1, n + 1))
    z = 0.1 * np.sin(9 * x) * np.cos(7 * y) + 0.01 * np.sin(90 * x + 40 * y)
    i = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    faces = np.concatenate([np.stack([i, i + 1, i + n + 2], 1), np.stack([i, i + n + 2, i + n + 1], 1)])
    rows = np.zeros(len(faces), [("n", "u1"), ("v", "<i4", 3)])
    rows["n"], rows["v"] = 3, faces
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {(n + 1) ** 2}\nproperty float x\nproperty float y\n"
    header += f"property float z\nelement face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    points = np.stack([x.ravel(), y.ravel(), z.ravel()], 1).astype("<f4")
    path.write_bytes(header.encode() + points.tobytes() + rows.tobytes())
    return len(faces)


def mitsuba_once(path, variant):
    """In a process of its own: prints seconds and bytes."""
    import mitsuba as mi

    mi.set_variant(variant)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    start = time.perf_counter()
    scene = mi.load_file(path)
    scene.ray_test(mi.Ray3f([0, 0, 1], [0, 0, -1]))
    if "llvm" in variant:
        import drjit

        drjit.sync_thread()
    seconds = time.perf_counter() - start
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    print(json.dumps({"seconds": seconds, "bytes": peak * 1024, "before": before * 1024}))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--triangles", type=int, default=5_000_000)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--variant", default="llvm_ad_rgb")
    parser.add_argument("--once", help=argparse.SUPPRESS)
    rebond.add_arguments(parser)
    args = parser.parse_args()
    if args.once:
        return mitsuba_once(args.once, args.variant)
    with tempfile.TemporaryDirectory() as folder:
        scene = Path(folder, "scene.xml")
        scene.write_text(SCENE)
        count = hills(Path(folder, "hills.ply"), args.triangles)
        print(f"{count} triangles, {Path(folder, 'hills.ply').stat().st_size / 1e6:.0f} MB")
        ours, theirs = [], []
        for _ in range(args.rounds):
            out = subprocess.run([args.rebond, "info", scene, "--json"], check=True, stdout=subprocess.PIPE, text=True).stdout
            answer = json.loads(out)
            ours.append((answer["load_and_build_seconds"], answer["peak_memory_bytes"]))
            again = [sys.executable, __file__, "--once", str(scene), "--variant", args.variant]
            answer = json.loads(subprocess.run(again, check=True, stdout=subprocess.PIPE, text=True).stdout.splitlines()[-1])
            theirs.append((answer["seconds"], answer["bytes"]))
    for name, runs in (("rebond", ours), (f"mitsuba {args.variant}", theirs)):
        seconds, memory = (statistics.median(column) for column in zip(*runs))
        print(f"{name:<22} {seconds:8.2f} s {memory / 1e6:8.0f} MB")


if __name__ == "__main__":
    sys.exit(main())
