"""What radiosity costs, and how far it is from path tracing.

    python3 run.py times | memory | rays | convergence | bake [--rebond PROGRAM] [--save]

times        seconds for form factors, inverse, solutions and relighting of the Cornell box, for 1 000, 5 000 and 10 000 patches
memory       peak memory against patches, by Gauss-Seidel and hierarchically
rays         how far the sums of the rows of F in a closed room with a block are from 1, against rays between two patches
convergence  relMSE of views of the Cornell box against a path-traced reference, for growing numbers of patches
bake         opens a baked mesh in trimesh and compares its colours with the solution (needs trimesh and safetensors)

relMSE is mean((x - ref)^2 / (ref^2 + 0.01)). Needs numpy and `cargo build --release`; convergence draws with matplotlib if
--plot FILE is given.
"""

import argparse
import datetime
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

from machine import commit, machine  # noqa: E402
from pfm import read_pfm  # noqa: E402


def call(args, *command):
    run = subprocess.run([args.rebond, *command, "--quiet", "--json"], check=True, stdout=subprocess.PIPE)
    return json.loads(run.stdout)


def solve(args, scene, patches, solver, *more):
    return call(args, "radiosity", scene, "--patches", str(patches), "--solver", solver, *more)


def times(args):
    rows = []
    for patches in args.patches or [1000, 5000, 10000]:
        inverse = solve(args, "cornell-box", patches, "inverse", "--relight", "0=10,10,10")
        # Every patch shines: all of the inverse is needed.
        everything = [w for n in range(6) for w in ("--relight", f"{n}=1")]
        whole = solve(args, "cornell-box", patches, "inverse", *everything) if args.whole else None
        others = {s: solve(args, "cornell-box", patches, s) for s in ("jacobi", "gauss-seidel", "hierarchical")}
        before = inverse["form_factor_seconds"] + inverse["inverse_seconds"]
        row = {
            "patches": inverse["patches"],
            "form_factors": inverse["form_factor_seconds"],
            "inverse": inverse["inverse_seconds"],
            "relight": inverse["relight_seconds"],
            "relight_all": whole and whole["relight_seconds"],
            "gain": before / inverse["relight_seconds"],
            "peak": inverse["peak_memory_bytes"],
            "rays": inverse["rays"],
            **{s: r["solve_seconds"] for s, r in others.items()},
            "links": others["hierarchical"]["form_factor_seconds"],
        }
        print(json.dumps(row), flush=True)
        rows.append(row)
    return rows


def memory(args):
    rows = []
    for solver, counts in (
        ("gauss-seidel", [1000, 5000, 10000, 20000]),
        ("hierarchical", [1000, 5000, 20000, 50000, 200000]),
    ):
        for patches in args.patches or counts:
            r = solve(args, "cornell-box", patches, solver)
            keys = ("patches", "peak_memory_bytes", "solver_bytes", "links", "form_factor_seconds", "solve_seconds", "mesh_seconds", "rays")
            row = {"solver": solver, **{k: r[k] for k in keys}, "row_sums": r["row_sums"]["mean"]}
            print(json.dumps(row), flush=True)
            rows.append(row)
    return rows


def rays(args):
    rows = []
    for n in (1, 4, 16, 64):
        sums = [solve(args, str(HERE / "room.toml"), 1000, "gauss-seidel", "--rays", str(n), "--seed", str(s))["row_sums"] for s in range(4)]
        row = {"rays": n, "least": min(s["least"] for s in sums), "most": max(s["most"] for s in sums), "mean": float(np.mean([s["mean"] for s in sums]))}
        print(json.dumps(row), flush=True)
        rows.append(row)
    return rows


def view(args, integrator, spp):
    with tempfile.TemporaryDirectory() as folder:
        file = str(Path(folder, "picture.pfm"))
        r = call(args, "render", "cornell-box", "-i", integrator, "--size", "256x256", "--spp", str(spp), "-o", file)
        return read_pfm(file), r["render_seconds"]


def convergence(args):
    reference, _ = view(args, "path", args.reference)
    rows = []
    for name, settings, spp in (
        ("smooth", "", 16),
        ("flat", ",smooth=false", 16),
        ("adaptive", ",adaptive=true", 16),
        ("gather", ",gather=16", 32),
    ):
        for patches in args.patches or [300, 1000, 2500, 5000, 10000]:
            image, seconds = view(args, f"radiosity:patches={patches}{settings}", spp)
            error = ((image - reference) ** 2 / (reference**2 + 0.01)).mean()
            mean = image.mean(axis=(0, 1)) / reference.mean(axis=(0, 1)) - 1
            row = {"view": name, "patches": patches, "relmse": error, "mean": mean.tolist(), "seconds": seconds}
            print(json.dumps(row), flush=True)
            rows.append(row)
    if args.plot:
        plot(rows, args.plot)
    return rows


def plot(rows, file):
    import matplotlib

    matplotlib.use("svg" if file.endswith("svg") else "agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(6, 4), layout="constrained")
    for name, marker in (("flat", "s"), ("smooth", "o"), ("adaptive", "^"), ("gather", "D")):
        of = [r for r in rows if r["view"] == name]
        axes.loglog([r["patches"] for r in of], [r["relmse"] for r in of], marker=marker, label=name)
    axes.set(xlabel="patches", ylabel="relMSE against path tracing", title="Cornell box by radiosity")
    axes.grid(True, which="both", alpha=0.3)
    axes.legend()
    figure.savefig(file, dpi=150)


def bake(args):
    import trimesh
    from safetensors.numpy import load_file

    with tempfile.TemporaryDirectory() as folder:
        saved, baked = str(Path(folder, "a.safetensors")), str(Path(folder, "a.glb"))
        solve(args, "cornell-box", 2000, "gauss-seidel", "-o", saved, "--bake", baked, "--flat")
        solution, mesh = load_file(saved), trimesh.load(baked, force="mesh", process=False, skip_materials=True)
    radiance = solution["radiance"]
    # One triangle a patch, in order; trimesh keeps colours as bytes, other attributes as they are.
    colors = mesh.visual.vertex_colors[mesh.faces[:, 0], :3] / 255.0
    whole = mesh.vertex_attributes["_RADIANCE"][mesh.faces[:, 0]]
    corners = mesh.vertices[mesh.faces]
    expected = solution["vertices"][solution["triangles"]]
    row = {
        "triangles": len(mesh.faces),
        "largest_difference_of_colours": float(np.abs(colors - np.clip(radiance, 0, 1)).max()),
        "largest_difference_of_radiance": float(np.abs(whole - radiance).max() / radiance.max()),
        "largest_difference_of_corners": float(np.abs(corners - expected).max()),
        "reader": f"trimesh {trimesh.__version__}",
    }
    print(json.dumps(row))
    assert len(mesh.faces) == len(radiance)
    assert row["largest_difference_of_radiance"] < 1e-6 and row["largest_difference_of_colours"] < 1.01 / 255
    assert row["largest_difference_of_corners"] < 1e-3
    return [row]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = {f.__name__: f for f in (times, memory, rays, convergence, bake)}
    parser.add_argument("what", choices=commands)
    parser.add_argument("--patches", type=int, nargs="+", help="in place of the usual numbers")
    parser.add_argument("--whole", action="store_true", help="also time relighting of all surfaces at once")
    parser.add_argument("--reference", type=int, default=2048, help="samples per pixel of the reference")
    parser.add_argument("--plot", help="file for the plot of convergence")
    parser.add_argument("--rebond", default=str(HERE.parents[1] / "target" / "release" / "rebond"), help="the program")
    parser.add_argument("--save", action="store_true", help="keep the raw figures in results/")
    args = parser.parse_args()
    results = commands[args.what](args)
    if args.save:
        today = datetime.date.today().isoformat()
        report = {"date": today, "machine": machine(), "commit": commit(), "results": results}
        (HERE / "results" / f"{today}-{args.what}.json").write_text(json.dumps(report, indent=1) + "\n")


if __name__ == "__main__":
    main()
