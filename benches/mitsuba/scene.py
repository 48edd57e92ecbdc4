"""Translates a rebond scene (TOML) to Mitsuba 3.

    python3 scene.py SCENE [-o preview.png] [--spp 64] [--size 512x512]

SCENE is a TOML file or the name of a built-in scene. As a program this renders a preview with Mitsuba.

Both programs mean the same by almost every parameter, since rebond took Mitsuba's names. Where they do not:

- Transforms are multiplied out here, in double precision, and handed over as one matrix.
- Mitsuba's environment map has its centre towards +z and puts the first and the last row on the poles; rebond's has its
  centre towards -z and rows at the centres of equal bands. Hence a half-turn about y, and an image with a row at every
  knot of rebond's interpolation: the two then are the same function (`python3 test_mitsuba.py` measures it).
- Mitsuba's textures have v = 0 at their top, rebond's at their bottom.
- Mitsuba has no motion, and no Phong or Blinn-Phong lobe: `comparable()` gives the nearest scene that both can render.
"""

import argparse
import copy
import math
import sys
import tempfile
import tomllib
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
SCENES = ROOT / "scenes"

# As in crates/rebond/src/scene/build.rs.
METALS = {
    "silver": ([0.155, 0.117, 0.138], [4.828, 3.122, 2.147]),
    "aluminium": ([1.657, 0.880, 0.521], [9.224, 6.270, 4.837]),
    "gold": ([0.143, 0.375, 1.442], [3.983, 2.386, 1.603]),
    "copper": ([0.200, 0.924, 1.102], [3.912, 2.452, 2.142]),
}
SMOOTH = 1e-3  # roughness below which rebond takes a surface for smooth


class Unsupported(Exception):
    """Something of the scene that Mitsuba does not have."""


# ---- reading and writing ----


def find(name):
    """The file of a scene, given by its path or as the name of a built-in one."""
    for path in (Path(name), SCENES / f"{name}.toml"):
        if path.is_file():
            return path.resolve()
    known = ", ".join(sorted(p.stem for p in SCENES.glob("*.toml")))
    raise SystemExit(f"no scene {name!r}; built-in ones are: {known}")


def read(name):
    """A scene as rebond describes it, file names made absolute."""
    path = find(name)
    with path.open("rb") as f:
        scene = tomllib.load(f)

    def absolute(node):
        if isinstance(node, dict):
            for key, value in node.items():
                if key in ("file", "image") and isinstance(value, str):
                    node[key] = str((path.parent / value).resolve())
                else:
                    absolute(value)
        elif isinstance(node, list):
            for value in node:
                absolute(value)

    absolute(scene)
    return scene


def dump(scene):
    """The scene as TOML."""

    def inline(v):
        if isinstance(v, bool):
            return "true" if v else "false"
        if isinstance(v, str):
            return '"' + v.replace("\\", "\\\\").replace('"', '\\"') + '"'
        if isinstance(v, (int, float)):
            return repr(v)
        if isinstance(v, list):
            return "[" + ", ".join(map(inline, v)) + "]"
        return "{ " + ", ".join(f"{inline(k)} = {inline(x)}" for k, x in v.items()) + " }"

    return "".join(f"{inline(k)} = {inline(v)}\n" for k, v in scene.items())


def comparable(scene, width=None, height=None, sampler=None):
    """The scene with a box filter, in another size if asked for, and without what Mitsuba lacks; and notes on what went."""
    scene, notes = copy.deepcopy(scene), []
    film = scene.setdefault("film", {})
    film["filter"] = {"type": "box"}
    film["width"] = width or film.get("width", 512)
    film["height"] = height or film.get("height", 512)
    if sampler:
        scene["sampler"] = {"type": sampler}
    replaced, masked = set(), set()

    def walk(node):
        if isinstance(node, list):
            return [walk(x) for x in node]
        if not isinstance(node, dict):
            return node
        kind = node.get("type")
        if kind in ("phong", "blinn-phong"):
            replaced.add(kind)
            return {"type": "diffuse", "reflectance": walk(node.get("reflectance", 0.5))}
        if kind in ("conductor", "dielectric") and not node.get("compensate") and {"alpha", "alpha_u", "alpha_v"} & node.keys():
            node = {**node, "masking": "separable"}
            masked.add(kind)
        return {k: walk(v) for k, v in node.items()}

    for key in ("materials", "groups", "shapes"):
        if key in scene:
            scene[key] = walk(scene[key])
    notes += [f"{kind} is replaced by diffuse" for kind in sorted(replaced)]
    if masked:
        notes.append("rough facets hide each other separately, as in Mitsuba")

    def rest(node):
        if isinstance(node, list):
            return [y for x in node for y in rest_step(x)]
        if isinstance(node, dict):
            return {k: rest(v) for k, v in node.items()}
        return node

    def rest_step(x):
        if isinstance(x, dict) and "keyframes" in x:
            steps = x["keyframes"][0].get("to_world", [])
            return steps if isinstance(steps, list) else [steps]
        return [rest(x)]

    # A lone step becomes a list, so that it can be replaced by several.
    def listed(node):
        if isinstance(node, list):
            return [listed(x) for x in node]
        if isinstance(node, dict):
            wrap = lambda k, v: [v] if k == "to_world" and isinstance(v, dict) and "keyframes" in v else listed(v)
            return {k: wrap(k, v) for k, v in node.items()}
        return node

    if "keyframes" in str(scene):
        notes.append("what moves stands where it is at its first keyframe")
        scene = rest(listed(scene))
    camera = scene.get("camera", {})
    camera.pop("shutter_open", None)
    camera.pop("shutter_close", None)
    return scene, notes


# ---- transforms ----


def matrix(steps):
    """Steps of a transform, the first applied first, as a 4x4 matrix."""
    m = np.eye(4)
    for step in steps if isinstance(steps, list) else [steps]:
        ((kind, value),) = step.items()
        m = _step(kind, value) @ m
    return m


def _step(kind, value):
    m = np.eye(4)
    if kind == "translate":
        m[:3, 3] = value
    elif kind == "scale":
        m[:3, :3] = np.diag(np.broadcast_to(np.asarray(value, float), 3))
    elif kind == "rotate":
        axis = np.asarray(value["axis"], float)
        x, y, z = axis / np.linalg.norm(axis)
        a = math.radians(value["angle"])
        k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        m[:3, :3] = np.eye(3) + math.sin(a) * k + (1 - math.cos(a)) * k @ k
    elif kind == "look_at":
        origin, target, up = (np.asarray(value[k], float) for k in ("origin", "target", "up"))
        z = (target - origin) / np.linalg.norm(target - origin)
        x = np.cross(up, z)
        x /= np.linalg.norm(x)
        m[:3, :] = np.stack([x, np.cross(z, x), z, origin], axis=1)
    elif kind == "matrix":
        m[:3] = np.asarray(value, float)[:3]
    else:
        raise Unsupported(f"a transform step {kind!r}")
    return m


# ---- translation ----


def to_mitsuba(scene, folder, max_depth=8, rr_depth=5, sampler="independent", spp=64):
    """The scene as a dictionary for `mitsuba.load_dict`. Meshes given in place are written to `folder`, and have to stay
    there until the scene is loaded. A variant has to be set."""
    return _Translation(scene, Path(folder)).scene(max_depth, rr_depth, sampler, spp)


class _Translation:
    def __init__(self, scene, folder):
        import mitsuba

        self.mi, self.description, self.folder = mitsuba, scene, folder

    def transform(self, m):
        return self.mi.ScalarTransform4f(m)

    def scene(self, max_depth, rr_depth, sampler, spp):
        d = self.description
        result = {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": max_depth, "rr_depth": rr_depth},
            "sensor": self.sensor(d.get("camera", {"type": "perspective"}), d.get("film", {}), sampler, spp),
        }
        for name, shapes in d.get("groups", {}).items():
            group = {"type": "shapegroup"}
            for i, shape in enumerate(shapes):
                group[f"shape_{i}"] = self.shape(shape, f"{name}_{i}")
            result[f"group_{name}"] = group
        for i, shape in enumerate(d.get("shapes", [])):
            result[f"shape_{i}"] = self.shape(shape, str(i), result)
        for i, emitter in enumerate(d.get("emitters", [])):
            result[f"emitter_{i}"] = self.emitter(emitter)
        return result

    def sensor(self, camera, film, sampler, spp):
        if "keyframes" in str(camera):
            raise Unsupported("a moving camera")
        kind = camera["type"]
        result = {
            "type": {"perspective": "perspective", "thin-lens": "thinlens", "orthographic": "orthographic"}[kind],
            "to_world": self.transform(matrix(camera.get("to_world", []))),
            "film": {
                "type": "hdrfilm",
                "width": film.get("width", 512),
                "height": film.get("height", 512),
                "rfilter": {"type": "box"},
                "pixel_format": "rgb",
                "component_format": "float32",
            },
            "sampler": {"type": sampler, "sample_count": spp},
        }
        if kind != "orthographic":
            result["fov"] = float(camera.get("fov", 45))
            result["fov_axis"] = camera.get("fov_axis", "x")
            if "near_clip" in camera:
                result["near_clip"] = float(camera["near_clip"])
        if kind == "thin-lens":
            if camera.get("aperture_blades", 0):
                raise Unsupported("blades of an iris")
            result["aperture_radius"] = float(camera["aperture_radius"])
            result["focus_distance"] = float(camera["focus_distance"])
        return result

    # ---- surfaces ----

    def shape(self, shape, name, result=None):
        kind = shape["type"]
        m = matrix(shape.get("to_world", []))
        if kind == "instance":
            group = {"type": "ref", "id": f"group_{shape['group']}"}
            return {"type": "instance", "group": group, "to_world": self.transform(m)}
        if kind == "sphere":
            out = self.sphere(shape, m, name, result)
        elif kind in ("rectangle", "disk", "cube"):
            out = {"type": kind, "to_world": self.transform(m), "flip_normals": shape.get("flip_normals", False)}
        elif kind == "mesh":
            out = {"type": "ply", **self.mesh(shape, m, name)}
        elif kind in ("ply", "obj"):
            smooth = not shape.get("face_normals", False) and _has_normals(Path(shape["file"]))
            out = {"type": kind, "filename": shape["file"], "face_normals": not smooth, "to_world": self.transform(m)}
            out["flip_tex_coords"] = False
        else:
            raise Unsupported(f"a shape of type {kind!r}")
        target = out if out["type"] != "instance" else result[f"apart_{name}"]["shape"]
        target["bsdf"] = self.material(shape.get("material", {"type": "diffuse", "reflectance": 0.5}))
        if "emission" in shape:
            target["emitter"] = {"type": "area", "radiance": self.rgb(shape["emission"])}
        return out

    def sphere(self, shape, m, name, result):
        out = {
            "type": "sphere",
            "center": [float(x) for x in shape.get("center", [0, 0, 0])],
            "radius": float(shape.get("radius", 1)),
            "flip_normals": shape.get("flip_normals", False),
        }
        gram = m[:3, :3].T @ m[:3, :3]
        if np.allclose(gram, gram[0, 0] * np.eye(3), rtol=1e-6, atol=1e-6 * gram[0, 0]):
            return {**out, "to_world": self.transform(m)}
        # An ellipsoid is an instance of a sphere.
        if result is None:
            raise Unsupported("an ellipsoid in a group")
        result[f"apart_{name}"] = {"type": "shapegroup", "shape": out}
        group = {"type": "ref", "id": f"apart_{name}"}
        return {"type": "instance", "group": group, "to_world": self.transform(m)}

    def mesh(self, shape, m, name):
        positions = np.asarray(shape["positions"], float) @ m[:3, :3].T + m[:3, 3]
        faces = []
        for face in shape["faces"]:
            faces += [face] if len(face) == 3 else [face[:3], [face[0], face[2], face[3]]]
        faces = np.asarray(faces, np.int32)
        if np.linalg.det(m[:3, :3]) < 0:
            faces = faces[:, [0, 2, 1]]
        columns, header = [positions], ["x", "y", "z"]
        if "normals" in shape:
            normals = np.asarray(shape["normals"], float) @ np.linalg.inv(m[:3, :3])
            columns.append(normals / np.linalg.norm(normals, axis=1, keepdims=True))
            header += ["nx", "ny", "nz"]
        if "uvs" in shape:
            columns.append(np.asarray(shape["uvs"], float))
            header += ["u", "v"]
        path = self.folder / f"mesh_{name}.ply"
        with path.open("wb") as f:
            lines = ["ply", "format binary_little_endian 1.0", f"element vertex {len(positions)}"]
            lines += [f"property float {c}" for c in header]
            lines += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header", ""]
            f.write("\n".join(lines).encode())
            f.write(np.concatenate(columns, axis=1).astype("<f4").tobytes())
            rows = np.zeros(len(faces), [("n", "u1"), ("v", "<i4", 3)])
            rows["n"], rows["v"] = 3, faces
            f.write(rows.tobytes())
        return {"filename": str(path), "face_normals": "normals" not in shape}

    # ---- materials ----

    def rgb(self, value):
        return {"type": "rgb", "value": [float(x) for x in np.broadcast_to(np.asarray(value, float), 3)]}

    def texture(self, value):
        if not isinstance(value, dict):
            return self.rgb(value)
        u, v = value.get("repeat", [1, 1])
        return {
            "type": "bitmap",
            "filename": value["image"],
            "raw": value.get("encoding", "auto") == "linear",
            "filter_type": value.get("filter", "bilinear"),
            "wrap_mode": value.get("wrap", "repeat"),
            "to_uv": self.mi.ScalarTransform3f(np.array([[u, 0, 0], [0, -v, 1], [0, 0, 1]], float)),
        }

    def material(self, m):
        if isinstance(m, str):
            m = self.description["materials"][m]
        kind = m["type"]
        if kind == "diffuse":
            return {"type": "diffuse", "reflectance": self.texture(m.get("reflectance", 0.5))}
        if kind == "mirror":
            return {"type": "conductor", "material": "none", "specular_reflectance": self.texture(m.get("reflectance", 1))}
        if kind == "dielectric":
            ior = {"int_ior": float(m.get("int_ior", 1.5)), "ext_ior": float(m.get("ext_ior", 1))}
            tint = self.texture(m.get("tint", 1))
            tint = {"specular_reflectance": tint, "specular_transmittance": tint}
            alpha = self.roughness(m)
            return {"type": "roughdielectric", **ior, **alpha, **tint} if alpha else {"type": "dielectric", **ior, **tint}
        if kind == "conductor":
            eta, k = (m["eta"], m["k"]) if "eta" in m else METALS[m.get("metal", "aluminium")]
            tint = {"specular_reflectance": self.texture(m.get("tint", 1))}
            alpha = self.roughness(m)
            index = {"eta": self.rgb(eta), "k": self.rgb(k)}
            return {"type": "roughconductor" if alpha else "conductor", **index, **alpha, **tint}
        if kind == "mix":
            parts = {"bsdf_a": self.material(m["a"]), "bsdf_b": self.material(m["b"])}
            return {"type": "blendbsdf", "weight": float(m["weight"]), **parts}
        if kind == "two-sided":
            sides = {"bsdf_front": self.material(m["front"])}
            if "back" in m:
                sides["bsdf_rear"] = self.material(m["back"])
            return {"type": "twosided", **sides}
        raise Unsupported(f"a material of type {kind!r}")

    def roughness(self, m):
        alpha = m.get("alpha", 0)
        u, v = m.get("alpha_u", alpha), m.get("alpha_v", alpha)
        if max(u, v) < SMOOTH:
            return {}
        return {"distribution": m.get("distribution", "ggx"), "alpha_u": max(float(u), SMOOTH), "alpha_v": max(float(v), SMOOTH)}

    # ---- lights ----

    def emitter(self, e):
        kind = e["type"]
        if kind == "point":
            position = matrix(e.get("to_world", [])) @ [*e["position"], 1]
            return {"type": "point", "position": [float(x) for x in position[:3]], "intensity": self.rgb(e["intensity"])}
        if kind == "spot":
            cutoff = float(e.get("cutoff_angle", 20))
            angles = {"cutoff_angle": cutoff, "beam_width": float(e.get("beam_width", 0.75 * cutoff))}
            return {"type": "spot", "to_world": self.transform(matrix(e["to_world"])), "intensity": self.rgb(e["intensity"]), **angles}
        if kind == "directional":
            direction = [float(x) for x in e["direction"]]
            return {"type": "directional", "direction": direction, "irradiance": self.rgb(e["irradiance"])}
        if kind == "constant":
            return {"type": "constant", "radiance": self.rgb(e["radiance"])}
        if kind == "envmap":
            bitmap = self.mi.Bitmap(e["file"]).convert(self.mi.Bitmap.PixelFormat.RGB, self.mi.Struct.Type.Float32, False)
            axes = matrix(e.get("to_world", []))
            axes[:3, 3] = 0
            axes[:3, :3] /= np.linalg.norm(axes[:3, :3], axis=0)
            return self.envmap(np.array(bitmap) * np.float32(e.get("scale", 1)), axes)
        raise Unsupported(f"an emitter of type {kind!r}")

    def envmap(self, texels, axes):
        """An environment with `texels`, row by row from the top, and local `axes`, as rebond reads it."""
        # Rebond interpolates between rows at (i + 1/2) / h, and keeps the outermost rows up to the poles: linear between
        # the multiples of 1/2h, where Mitsuba gets its rows.
        h = len(texels)
        at = np.clip(np.arange(2 * h + 1) / 2 - 0.5, 0, h - 1)
        above = np.floor(at).astype(int)
        below = np.minimum(above + 1, h - 1)
        share = (at - above)[:, None, None]
        rows = (texels[above] * (1 - share) + texels[below] * share).astype(np.float32)
        half_turn = np.diag([-1.0, 1.0, -1.0, 1.0])
        return {"type": "envmap", "bitmap": self.mi.Bitmap(rows), "to_world": self.transform(axes @ half_turn)}


def _has_normals(path):
    """Whether a PLY or OBJ file has normals."""
    with path.open("rb") as f:
        if path.suffix.lower() == ".ply":
            for line in f:
                if line.split()[:1] == [b"end_header"]:
                    return False
                if line.split()[-1:] == [b"nx"]:
                    return True
            return False
        return any(line.startswith(b"vn ") for line in f)


def load(scene, **settings):
    """The scene, loaded by Mitsuba; settings as of `to_mitsuba`."""
    import mitsuba

    with tempfile.TemporaryDirectory() as folder:
        return mitsuba.load_dict(to_mitsuba(scene, folder, **settings))


def size(text):
    """WxH."""
    w, _, h = text.partition("x")
    return int(w), int(h)


def main():
    parser = argparse.ArgumentParser(description="Render a rebond scene with Mitsuba, as a preview.")
    parser.add_argument("scene")
    parser.add_argument("-o", "--output", default="preview.png")
    parser.add_argument("--spp", type=int, default=64)
    parser.add_argument("--size", type=size, default=(None, None), metavar="WxH")
    parser.add_argument("--max-depth", type=int, default=8)
    parser.add_argument("--variant", default="llvm_ad_rgb")
    args = parser.parse_args()
    import mitsuba

    mitsuba.set_variant(args.variant)
    scene, notes = comparable(read(args.scene), *args.size)
    for note in notes:
        print(note, file=sys.stderr)
    image = mitsuba.render(load(scene, max_depth=args.max_depth, sampler="multijitter", spp=args.spp), spp=args.spp)
    mitsuba.util.write_bitmap(args.output, image)
    print(args.output)


if __name__ == "__main__":
    main()
