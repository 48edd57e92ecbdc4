"""Makes the glTF files here, and the meshes and images that the TOML files name, those of ../obj too.

Each NAME.toml says by hand what NAME.gltf means by the specification (Khronos, glTF 2.0, 2021, and its extensions);
tests/gltf.rs compares their pictures. Needs nothing but Python: `python3 make.py`.
"""

import base64
import json
import math
import struct
import zlib
from pathlib import Path

HERE = Path(__file__).parent
BYTE, UBYTE, SHORT, USHORT, UINT, FLOAT = 5120, 5121, 5122, 5123, 5125, 5126
LETTER = {BYTE: "b", UBYTE: "B", SHORT: "h", USHORT: "H", UINT: "I", FLOAT: "f"}
WIDTH = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


def flat(rows):
    return [x for row in rows for x in (row if isinstance(row, (list, tuple)) else [row])]


class File:
    """A file that is added to piece by piece; its first accessors may be those of a ball."""

    def __init__(self, ball=False, quantized=False, **more):
        self.quantized, self.apart = quantized, 0
        self.json = {"asset": {"version": "2.0", "generator": "make.py"}, "scene": 0, "scenes": [{"nodes": []}],
                     "nodes": [], "accessors": [], "bufferViews": [], **more}
        self.bytes = b""
        if ball:
            self.primitive(POINTS, POINTS, indices=flat(FACETS))
            self.apart = len(self.bytes)

    def view(self, data, stride=None):
        self.bytes += b"\0" * (-len(self.bytes) % 4)
        view = {"buffer": 0, "byteOffset": len(self.bytes), "byteLength": len(data)}
        if stride:
            view["byteStride"] = stride
        self.bytes += data
        return self.add("bufferViews", view)

    def add(self, where, what):
        self.json.setdefault(where, []).append(what)
        return len(self.json[where]) - 1

    def rows(self, rows, kind="VEC3", type=FLOAT, **more):
        """An accessor with a view of its own, tightly packed."""
        view = self.view(struct.pack(f"<{len(flat(rows))}{LETTER[type]}", *flat(rows)))
        bounds = {}
        if kind == "VEC3" and type == FLOAT:
            bounds = {"min": [min(r[i] for r in rows) for i in range(3)], "max": [max(r[i] for r in rows) for i in range(3)]}
        return self.add("accessors", {"bufferView": view, "componentType": type, "count": len(rows), "type": kind, **bounds, **more})

    def primitive(self, positions, normals=None, uvs=None, indices=None, material=None, index=USHORT, **more):
        attributes = {"POSITION": self.rows(positions)}
        if normals:
            attributes["NORMAL"] = self.rows(normals)
        if uvs:
            attributes["TEXCOORD_0"] = self.rows(uvs, "VEC2")
        out = {"attributes": attributes, **more}
        if indices:
            out["indices"] = self.rows(indices, "SCALAR", index)
        if material is not None:
            out["material"] = material
        return out

    def mesh(self, *primitives, name=None):
        return self.add("meshes", {**({"name": name} if name else {}), "primitives": list(primitives)})

    def node(self, root=True, **node):
        number = self.add("nodes", node)
        if root:
            self.json["scenes"][0]["nodes"].append(number)
        return number

    def material(self, color=(0.8, 0.8, 0.8), metallic=0, roughness=1, pbr={}, **more):
        return self.add("materials", {"pbrMetallicRoughness": {
            "baseColorFactor": [*color, 1] if len(color) == 3 else list(color), "metallicFactor": metallic,
            "roughnessFactor": roughness, **pbr}, **more})

    def camera(self, place, yfov=0.6, aspect=1.5, **more):
        camera = self.add("cameras", {"type": "perspective", "perspective": {"yfov": yfov, "aspectRatio": aspect, "znear": 0.01, **more}})
        return self.node(camera=camera, translation=list(place))

    def light(self, root=True, translation=None, rotation=None, **light):
        lights = self.json.setdefault("extensions", {}).setdefault("KHR_lights_punctual", {"lights": []})["lights"]
        lights.append(light)
        place = {k: v for k, v in [("translation", translation), ("rotation", rotation)] if v}
        return self.node(root, extensions={"KHR_lights_punctual": {"light": len(lights) - 1}}, **place)

    def write(self, name):
        used = sorted(set(extensions(self.json)) | ({"KHR_mesh_quantization"} if self.quantized else set()))
        if used:
            self.json["extensionsUsed"] = used
        if self.quantized:
            self.json["extensionsRequired"] = ["KHR_mesh_quantization"]
        # A ball is in a file that several share, the rest is in place, or in the binary chunk.
        buffers, rest = [], self.bytes[self.apart:]
        if self.apart:
            (HERE / "ball.bin").write_bytes(self.bytes[:self.apart])
            buffers.append({"byteLength": self.apart, "uri": "ball.bin"})
        if rest:
            place = {} if name.endswith(".glb") else {"uri": data(rest, "application/octet-stream")}
            buffers.append({"byteLength": len(rest), **place})
        for view in self.json["bufferViews"]:
            if view["byteOffset"] >= self.apart > 0:
                view["buffer"], view["byteOffset"] = 1, view["byteOffset"] - self.apart
        self.json["buffers"] = buffers
        kept = {k: v for k, v in self.json.items() if v != []}
        text = json.dumps(kept, indent=1)
        if not name.endswith(".glb"):
            (HERE / name).write_text(text + "\n")
            return
        text = text.encode()
        text += b" " * (-len(text) % 4)
        self.bytes += b"\0" * (-len(self.bytes) % 4)
        chunks = struct.pack("<I", len(text)) + b"JSON" + text + struct.pack("<I", len(self.bytes)) + b"BIN\0" + self.bytes
        (HERE / name).write_bytes(b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks)


def extensions(value):
    """All extensions that are used anywhere."""
    if isinstance(value, dict):
        for key, inner in value.items():
            if key == "extensions":
                yield from inner
            yield from extensions(inner)
    if isinstance(value, list):
        for inner in value:
            yield from extensions(inner)


def data(content, kind):
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"


def png(pixels, width):
    """8 bits, as many channels as a pixel has: 1, 3 or 4."""
    kind = {1: 0, 3: 2, 4: 6}[len(pixels[0])]
    rows = [b"\0" + bytes(flat(pixels[i:i + width])) for i in range(0, len(pixels), width)]
    chunk = lambda name, body: struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))
    head = struct.pack(">IIBBBBB", width, len(rows), 8, kind, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(b"".join(rows), 9)) + chunk(b"IEND", b"")


def turn(axis, degrees):
    """A quaternion x, y, z, w."""
    length = math.sqrt(sum(x * x for x in axis))
    half = math.radians(degrees) / 2
    return [x / length * math.sin(half) for x in axis] + [math.cos(half)]


def square(scale=1, z=0):
    """Seen from +z; (0, 0) of an image is its upper left corner."""
    corners = [[-scale, -scale, z], [scale, -scale, z], [scale, scale, z], [-scale, scale, z]]
    return {"positions": corners, "normals": [[0, 0, 1]] * 4, "uvs": [[0, 1], [1, 1], [1, 0], [0, 0]], "indices": [0, 1, 2, 0, 2, 3]}


FLOOR = {"positions": [[-4, -1, 4], [4, -1, 4], [4, -1, -4], [-4, -1, -4]], "indices": [0, 1, 2, 0, 2, 3]}
# A corner of a cube, each face a triangle of its own, without normals: flat.
WEDGE = [[0, 0, 0], [0, 1, 0], [1, 0, 0], [0, 0, 0], [1, 0, 0], [0, 0, 1], [0, 0, 0], [0, 0, 1], [0, 1, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]


def ball(rings=12, sides=24):
    """A unit ball of facets with a sphere's normals."""
    points, triangles = [], []
    for ring in range(rings + 1):
        for side in range(sides):
            theta, phi = math.pi * ring / rings, 2 * math.pi * side / sides
            p = [math.sin(theta) * math.sin(phi), math.cos(theta), math.sin(theta) * math.cos(phi)]
            points.append([round(x, 6) + 0.0 for x in p])
            a, b = ring * sides + side, ring * sides + (side + 1) % sides
            if 0 < ring < rings:
                triangles.append([a, a + sides, b])
            if ring < rings - 1:
                triangles.append([b, a + sides, b + sides])
    return points, triangles


POINTS, FACETS = ball()
(HERE / "ball.obj").write_text("".join(f"v {x} {y} {z}\nvn {x} {y} {z}\n" for x, y, z in POINTS)
                               + "".join("f " + " ".join(f"{i + 1}//{i + 1}" for i in t) + "\n" for t in FACETS))


def balls():
    """A file with a ball, and its primitive of any material."""
    return File(ball=True), lambda material: {"attributes": {"POSITION": 0, "NORMAL": 1}, "indices": 2, "material": material}



# ---- nodes: a hierarchy of matrices, quaternions and scales, one of them mirrored ----
f = File()
paint = [f.material(c) for c in [(0.8, 0.3, 0.2), (0.2, 0.7, 0.3), (0.3, 0.4, 0.9)]]
meshes = [f.mesh(f.primitive(WEDGE, material=m)) for m in paint]
c, s = math.cos(math.radians(30)), math.sin(math.radians(30))
leaf = f.node(False, mesh=meshes[2], scale=[-0.8, 0.8, 0.8], rotation=turn([1, 1, 0], 45), translation=[0.3, -1.4, 0.4])
inner = f.node(False, mesh=meshes[1], children=[leaf], scale=[1, 1.5, 0.7], rotation=turn([0, 1, 0], 60), translation=[1, 0.5, 0])
# Columns: turned about z by 30 degrees after a scaling by (1.2, 0.8, 1), then moved.
f.node(mesh=meshes[0], children=[inner], matrix=[1.2 * c, 1.2 * s, 0, 0, -0.8 * s, 0.8 * c, 0, 0, 0, 0, 1, 0, -1, 0.2, 0, 1])
f.camera([0, 0, 7])
f.light(type="directional", intensity=3, rotation=turn([1, 0, 0], -50))
f.light(type="directional", intensity=1.5, color=[1, 0.8, 0.6], rotation=turn([0, 1, 0], 40))
f.write("nodes.gltf")

# ---- perspective: a camera below a turned node; what is nearer than znear is not seen ----
f = File()
wall, near = f.material((0.7, 0.6, 0.5)), f.material((0.9, 0.1, 0.1), doubleSided=True)
f.node(mesh=f.mesh(f.primitive(WEDGE, material=wall)), rotation=turn([0, 1, 0], 30))
f.node(mesh=f.mesh(f.primitive(**square(0.2), material=near)), translation=[-2.3, 1.2, 2.6])
f.node(mesh=f.mesh(f.primitive(**FLOOR, material=wall)))
lens = f.node(False, camera=f.add("cameras", {"type": "perspective", "perspective": {"yfov": 0.5, "aspectRatio": 1.25, "znear": 1.5}}), rotation=turn([1, 0, 0], -20), translation=[0, 1.6, 4.5])
f.node(children=[lens], rotation=turn([0, 1, 0], -40), scale=[1.1, 1.1, 1.1])
f.light(type="directional", intensity=3, rotation=turn([1, 0.5, 0], -60))
f.write("perspective.gltf")

# ---- orthographic ----
f = File()
paint = f.material((0.3, 0.6, 0.8))
f.node(mesh=f.mesh(f.primitive(WEDGE, material=paint)), scale=[1.2, 1.2, 1.2])
f.node(mesh=f.mesh(f.primitive(**FLOOR, material=f.material((0.6, 0.6, 0.6)))))
f.node(camera=f.add("cameras", {"type": "orthographic", "orthographic": {"xmag": 2, "ymag": 1.6, "znear": 0, "zfar": 100}}), rotation=turn([1, 0, 0], -35), translation=[0.2, 3, 4])
f.light(type="directional", intensity=2.5, rotation=turn([1, 0.3, 0.1], -50))
f.write("orthographic.gltf")

# ---- lights: a point, a spot, a beam, each of its own colour, one below a scaled node ----
f, round_ = balls()
grey = f.material((0.7, 0.7, 0.7))
f.node(mesh=f.mesh(round_(grey), f.primitive(**FLOOR, material=grey)))
f.light(type="point", color=[1, 0.3, 0.2], intensity=6, translation=[-2, 1, 1])
spot = f.light(False, type="spot", color=[0.2, 1, 0.3], intensity=30, rotation=turn([1, 0, 0], -50), spot={"innerConeAngle": 0.2, "outerConeAngle": 0.35})
f.node(children=[spot], translation=[1.6, 3, 3], scale=[2, 2, 2])
f.light(type="directional", color=[0.3, 0.4, 1], intensity=1, rotation=turn([0, 1, 0], 70))
f.camera([0, 0.5, 8])
f.write("lights.gltf")

# ---- emission: lamps are stronger than 1, shine to one side; beside them one that does not shine ----
f, round_ = balls()
lamp = f.material((0, 0, 0), emissiveFactor=[1, 0.8, 0.5], extensions={"KHR_materials_emissive_strength": {"emissiveStrength": 12}})
dim = f.material((0.2, 0.2, 0.2), emissiveFactor=[0.1, 0.2, 0.6])
grey = f.material((0.7, 0.7, 0.7))
f.node(mesh=f.mesh(round_(grey)))
f.node(mesh=f.mesh(f.primitive(**FLOOR, material=grey)))
f.node(mesh=f.mesh(f.primitive(**square(), material=lamp)), rotation=turn([1, 0, 0], 90), translation=[0, 3, 0.5], scale=[0.7, 0.7, 0.7])
f.node(mesh=f.mesh(f.primitive(**square(), material=dim)), translation=[-1.8, 0, 0])
f.camera([0, 1, 9])
f.write("emission.gltf")


def studio(name, materials, light=True):
    """Three balls on a floor, under a lamp, or in the even sky of scenes without light."""
    f, round_ = balls()
    for x, material in zip([-2.2, 0, 2.2], materials):
        f.node(mesh=f.mesh(round_(f.material(**material))), translation=[x, 0, 0])
    f.node(mesh=f.mesh(f.primitive(**FLOOR, material=f.material((0.6, 0.5, 0.4)))))
    lamp = f.material((0, 0, 0), emissiveFactor=[1, 1, 1], extensions={"KHR_materials_emissive_strength": {"emissiveStrength": 8}})
    panel = f.primitive(**square(), material=lamp)
    if light:
        f.node(mesh=f.mesh(panel), rotation=turn([1, 0, 0], 60), translation=[0, 4, 3], scale=[3, 1.5, 1])
    f.camera([0, 0.5, 8])
    return f


# ---- metals: metal, half a metal, plastic ----
studio("metals", [
    {"color": (0.9, 0.6, 0.3), "metallic": 1, "roughness": 0.4}, {"color": (0.3, 0.7, 0.5), "metallic": 0.5, "roughness": 0.6},
    {"color": (0.7, 0.2, 0.2), "metallic": 0, "roughness": 0.3}]).write("metals.gltf")

# ---- coats: clearcoat, specular and index, sheen ----
studio("coats", [
    {"color": (0.7, 0.1, 0.1), "roughness": 0.8, "extensions": {"KHR_materials_clearcoat": {"clearcoatFactor": 0.9, "clearcoatRoughnessFactor": 0.3}}},
    {"color": (0.1, 0.3, 0.5), "roughness": 0.35, "extensions": {"KHR_materials_specular": {"specularFactor": 0.6}, "KHR_materials_ior": {"ior": 1.9}}},
    {"color": (0.3, 0.1, 0.4), "roughness": 0.9, "extensions": {"KHR_materials_sheen": {"sheenColorFactor": [0.8, 0.8, 0.8]}}}]).write("coats.gltf")

# ---- glass: solid and smooth, solid and rough, and a thin pane; no light is an even sky ----
glass = lambda roughness, ior, volume, color=(1, 1, 1): {"color": color, "roughness": roughness, "extensions": {
    "KHR_materials_transmission": {"transmissionFactor": 1}, "KHR_materials_ior": {"ior": ior},
    **({"KHR_materials_volume": {"thicknessFactor": 1}} if volume else {})}}
f = studio("glass", [glass(0, 1.33, True), glass(0.5, 1.6, True, (0.6, 0.9, 0.7)), {"color": (0.8, 0.3, 0.2)}], light=False)
pane = f.material(**glass(0, 1.5, False, (0.8, 0.8, 1)))
f.node(mesh=f.mesh({"attributes": {"POSITION": f.json["meshes"][3]["primitives"][0]["attributes"]["POSITION"]},
                    "indices": f.json["meshes"][3]["primitives"][0]["indices"], "material": pane}),
       rotation=turn([1, 0, 0], 80), scale=[0.3, 1, 0.3], translation=[2.2, 1, 1.6])
f.write("glass.gltf")

# ---- textures: wraps, filters, transforms, a factor; every quad lies in the plane z = 0 ----
QUARTERS = [[255, 255, 255], [220, 40, 40], [40, 200, 60], [50, 70, 230]]
f = File()
image = f.add("images", {"uri": data(png(QUARTERS, 2), "image/png")})
REPEAT, CLAMP, MIRROR, NEAREST, LINEAR = 10497, 33071, 33648, 9728, 9729
texture = lambda **sampler: f.add("textures", {"source": image, **({"sampler": f.add("samplers", sampler)} if sampler else {})})
shown = lambda texture, transform=None, color=(1, 1, 1): f.material(color, pbr={"baseColorTexture": {"index": texture, **(
    {"extensions": {"KHR_texture_transform": transform}} if transform else {})}})
tiles = [
    shown(texture()),
    shown(texture(magFilter=NEAREST)),
    shown(texture(magFilter=LINEAR, wrapS=CLAMP, wrapT=CLAMP), {"scale": [2, 2], "offset": [-0.5, -0.5]}),
    shown(texture(magFilter=NEAREST, wrapS=MIRROR, wrapT=MIRROR), {"scale": [3, 3]}),
    shown(texture(magFilter=NEAREST, wrapS=REPEAT, wrapT=REPEAT), {"rotation": 0.5, "scale": [1.5, 1], "offset": [0.3, 0.1]}),
    shown(texture(wrapS=CLAMP, wrapT=CLAMP), color=(0.5, 0.8, 0.3)),
]
for i, material in enumerate(tiles):
    f.node(mesh=f.mesh(f.primitive(**square(0.9), material=material)), translation=[2 * (i % 3) - 2, 1 - 2 * (i // 3), 0])
# Otherwise along u than along v; over the second set of coordinates.
mixed = shown(texture(magFilter=NEAREST, wrapS=MIRROR, wrapT=CLAMP), {"scale": [3, 3], "offset": [-1, -1]})
f.node(mesh=f.mesh(f.primitive(**square(0.9), material=mixed)), translation=[4, 1, 0])
second = f.primitive(**square(0.9), material=f.material((1, 1, 1), pbr={"baseColorTexture": {"index": texture(magFilter=NEAREST), "texCoord": 1}}))
second["attributes"]["TEXCOORD_1"] = f.rows([[0, 0], [0, 1], [1, 1], [1, 0]], "VEC2")
f.node(mesh=f.mesh(second), translation=[4, -1, 0])
f.camera([1, 0, 9.5], yfov=0.55)
f.light(type="directional", intensity=3)
f.write("textures.gltf")
linear = lambda x: x / 255 / 12.92 if x <= 0.04045 * 255 else ((x / 255 + 0.055) / 1.055) ** 2.4
(HERE / "quarters.png").write_bytes(png(QUARTERS, 2))
factored = [[linear(x) * k for x, k in zip(p, (0.5, 0.8, 0.3))] for p in QUARTERS]
# Rows from the bottom up.
(HERE / "factored.pfm").write_bytes(b"PF\n2 2\n-1.0\n" + struct.pack("<12f", *flat(factored[2:] + factored[:2])))

# ---- rough: green is roughness and blue is metal, as the file has them, times factors, and one of them alone ----
f = File()
image = f.add("images", {"uri": data(png(QUARTERS, 2), "image/png")})
worn = lambda sampler, metallic, roughness, color: f.material(color, metallic, roughness, pbr={"metallicRoughnessTexture": {"index": texture(**sampler)}})
tiles = [
    worn({"magFilter": NEAREST}, 1, 1, (0.9, 0.6, 0.3)), worn({}, 1, 1, (0.5, 0.7, 0.9)),
    worn({"wrapS": CLAMP, "wrapT": CLAMP}, 0.8, 0.6, (0.9, 0.9, 0.4)), worn({"magFilter": NEAREST}, 0, 1, (0.6, 0.3, 0.5)),
]
for i, material in enumerate(tiles):
    f.node(mesh=f.mesh(f.primitive(**square(0.9), material=material)), translation=[2 * (i % 2) - 1, 1 - 2 * (i // 2), 0])
f.camera([0, 0, 8], yfov=0.55)
f.light(type="directional", intensity=3, rotation=turn([1, 0, 0], -15))
f.light(type="directional", intensity=2, color=[0.4, 0.6, 1], rotation=turn([0, 1, 0], 50))
f.write("rough.gltf")
scaled = [[0, p[1] / 255 * 0.6, p[2] / 255 * 0.8] for p in QUARTERS]
(HERE / "scaled.pfm").write_bytes(b"PF\n2 2\n-1.0\n" + struct.pack("<12f", *flat(scaled[2:] + scaled[:2])))

# ---- colors: of vertices, by floats and by bytes whose alpha means nothing, times a factor and an image; one mesh twice ----
f = File()
image = f.add("images", {"uri": data(png(QUARTERS, 2), "image/png")})
painted = f.material((1, 1, 1), pbr={"baseColorTexture": {"index": texture(magFilter=NEAREST)}})
plain, dimmed = f.material((1, 1, 1)), f.material((0.5, 0.8, 0.3))
floats = f.rows([[0.9, 0.1, 0.2], [0.2, 0.8, 0.1], [0.1, 0.3, 0.9], [0.7, 0.7, 0.6]])
bytes_ = f.rows([[255, 51, 0, 0], [0, 204, 102, 255], [51, 0, 255, 9], [255, 255, 255, 77]], "VEC4", UBYTE, normalized=True)
for i, (material, colors) in enumerate([(plain, floats), (dimmed, bytes_), (painted, floats), (plain, None)]):
    shown = f.primitive(**square(0.9), material=material)
    shown["attributes"].update({} if colors is None else {"COLOR_0": colors})
    f.node(mesh=f.mesh(shown), translation=[2 * (i % 2) - 1, 1 - 2 * (i // 2), 0])
f.camera([0, 0, 8], yfov=0.55)
f.light(type="directional", intensity=3)
f.write("colors.gltf")

# ---- alpha: cut, blended by a factor and by an image, opaque in spite of it; sides ----
VEIL = [[230, 120, 40, a] for a in (255, 128, 100, 20, 200, 127, 60, 255, 0, 180, 90, 240, 140, 30, 210, 110)]
f = File()
image = f.add("images", {"uri": data(png(VEIL, 4), "image/png")})
texture = f.add("textures", {"source": image, "sampler": f.add("samplers", {"magFilter": NEAREST, "wrapS": CLAMP, "wrapT": CLAMP})})
veil = lambda alpha, mode, **more: f.material((1, 1, 1, alpha), pbr={"baseColorTexture": {"index": texture}}, alphaMode=mode, **more)
behind = f.material((0.2, 0.5, 0.7))
tiles = [
    veil(1, "MASK"), veil(0.8, "MASK", alphaCutoff=0.3), veil(0.5, "BLEND"), veil(0.5, "OPAQUE"),
    f.material((0.9, 0.8, 0.2, 0.4), alphaMode="BLEND", doubleSided=True), f.material((0.9, 0.2, 0.3), doubleSided=True), f.material((0.9, 0.2, 0.3)),
]
for i, material in enumerate(tiles):
    # The last three are seen from behind.
    f.node(mesh=f.mesh(f.primitive(**square(0.8), material=material)), translation=[2 * (i % 4) - 3, 1 - 2 * (i // 4), 0],
           **({"rotation": turn([0, 1, 0], 180)} if i > 3 else {}))
f.node(mesh=f.mesh(f.primitive(**square(5, -1), material=behind)))
f.camera([0, 0, 10], yfov=0.55)
f.light(type="directional", intensity=3, rotation=turn([1, 0, 0], -20))
f.write("alpha.gltf")
(HERE / "veil.png").write_bytes(png([p[:3] for p in VEIL], 4))
alphas = [p[3] / 255 for p in VEIL]
for name, opacity in [("cut", [x >= 0.5 for x in alphas]), ("cut-lower", [0.8 * x >= 0.3 for x in alphas]), ("blend", [0.5 * x for x in alphas])]:
    rows = [opacity[i:i + 4] for i in range(0, 16, 4)]
    (HERE / f"{name}.pfm").write_bytes(b"Pf\n4 4\n-1.0\n" + struct.pack("<16f", *flat(rows[::-1])))

# ---- numbers: quantised and normalised, strided, sparse ----
f = File(quantized=True)
red, green, blue = f.material((0.8, 0.3, 0.2)), f.material((0.3, 0.8, 0.2)), f.material((0.2, 0.3, 0.8))
image = f.add("images", {"uri": data(png(QUARTERS, 2), "image/png")})
texture = f.add("textures", {"source": image, "sampler": f.add("samplers", {"magFilter": NEAREST})})
painted = f.material((1, 1, 1), pbr={"baseColorTexture": {"index": texture}})
# Shorts that the node brings back to size; a stride of 8.
corners = [[-1000, -1000, 0], [1000, -1000, 0], [1000, 1000, 0], [-1000, 1000, 200]]
view = f.view(b"".join(struct.pack("<3hh", *p, 0) for p in corners), 8)
shorts = f.add("accessors", {"bufferView": view, "componentType": SHORT, "count": 4, "type": "VEC3"})
order = f.rows([0, 1, 2, 0, 2, 3], "SCALAR", UBYTE)
f.node(mesh=f.mesh({"attributes": {"POSITION": shorts}, "indices": order, "material": red}), scale=[0.0008] * 3, translation=[-2, 0, 0])
# Normalised bytes, positions and normals beside each other; texture coordinates of normalised 16 bits.
def corner(x, y, nx, ny, nz):
    return struct.pack("<3bx3bx", x, y, 0, nx, ny, nz)
view = f.view(corner(-127, -127, -60, 0, 112) + corner(127, -127, 60, 0, 112) + corner(127, 127, 60, 0, 112) + corner(-127, 127, -60, 0, 112), 8)
place = f.add("accessors", {"bufferView": view, "componentType": BYTE, "normalized": True, "count": 4, "type": "VEC3"})
normal = f.add("accessors", {"bufferView": view, "byteOffset": 4, "componentType": BYTE, "normalized": True, "count": 4, "type": "VEC3"})
uv = f.rows([[0, 65535], [65535, 65535], [65535, 0], [0, 0]], "VEC2", USHORT, normalized=True)
f.node(mesh=f.mesh({"attributes": {"POSITION": place, "NORMAL": normal, "TEXCOORD_0": uv}, "indices": order, "material": painted}), scale=[0.8] * 3)
# A sparse accessor that moves two corners of a square, and one of zeros that is nothing but its sparse rows.
base = f.rows([[-0.8, -0.8, 0], [0.8, -0.8, 0], [0.8, 0.8, 0], [-0.8, 0.8, 0]])
f.json["accessors"][base]["sparse"] = {"count": 2, "indices": {"bufferView": f.view(struct.pack("<2H", 1, 3)), "componentType": USHORT},
                                       "values": {"bufferView": f.view(struct.pack("<6f", 0.4, -0.8, 0.2, -0.8, 0.4, 0.3))}}
f.node(mesh=f.mesh({"attributes": {"POSITION": base}, "indices": order, "material": green}), translation=[2, 0, 0])
zeros = f.add("accessors", {"componentType": FLOAT, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [0.7, 0.6, 0], "sparse": {
    "count": 2, "indices": {"bufferView": f.view(bytes([1, 2])), "componentType": UBYTE}, "values": {"bufferView": f.view(struct.pack("<6f", 0.7, 0, 0, 0, 0.6, 0))}}})
f.node(mesh=f.mesh({"attributes": {"POSITION": zeros}, "material": blue}), translation=[1.2, 0.6, 0.6])
f.camera([0, 0, 11], yfov=0.4)
f.light(type="directional", intensity=3, rotation=turn([1, 1, 0], -25))
f.write("numbers.gltf")

# ---- strips: strips, fans, triangles without indices, indices of 8, 16 and 32 bits ----
f = File()
paint = [f.material(c) for c in [(0.8, 0.3, 0.2), (0.3, 0.7, 0.2), (0.3, 0.4, 0.9), (0.8, 0.7, 0.2)]]
ribbon = [[0.4 * i - 1, 0.3 * (-1) ** i, 0.2 * (i % 3)] for i in range(6)]
fan = [[0, 0, 0.3]] + [[0.8 * math.cos(i * 0.9), 0.8 * math.sin(i * 0.9), 0] for i in range(6)]
f.node(mesh=f.mesh(f.primitive(ribbon, material=paint[0], mode=5)), translation=[-1.2, 1, 0])
f.node(mesh=f.mesh(f.primitive(ribbon, material=paint[1], mode=5, indices=[5, 4, 3, 2, 1, 0], index=UBYTE)), translation=[1.2, 1, 0])
f.node(mesh=f.mesh(f.primitive(fan, material=paint[2], mode=6, indices=list(range(7)), index=UINT)), translation=[-1.2, -1, 0])
f.node(mesh=f.mesh(f.primitive(fan[:3] + [fan[0], fan[2], fan[3]], material=paint[3])), translation=[1.2, -1, 0])
f.camera([0, 0, 7])
f.light(type="directional", intensity=3, rotation=turn([1, 1, 0], -20))
f.write("strips.gltf")

# ---- binary: an image within the file ----
f = File()
image = f.add("images", {"bufferView": f.view(png(QUARTERS, 2)), "mimeType": "image/png"})
painted = f.material((1, 1, 1), pbr={"baseColorTexture": {"index": f.add("textures", {"source": image})}})
f.node(mesh=f.mesh(f.primitive(**square(), material=painted)), rotation=turn([0, 1, 0], 30))
f.camera([0, 0, 5])
f.light(type="directional", intensity=3)
f.write("binary.glb")

# ---- instances: one mesh of two primitives, there four times, one of them mirrored ----
f, round_ = balls()
shell, plate = f.material((0.8, 0.5, 0.2), roughness=0.5), f.material((0.2, 0.4, 0.6))
mesh = f.mesh(round_(shell), f.primitive(**square(1.2, -0.5), material=plate))
for i, scale in enumerate([[0.6, 0.6, 0.6], [0.3, 0.9, 0.5], [-0.6, 0.6, 0.9], [0.7, 0.7, 0.1]]):
    f.node(mesh=mesh, scale=scale, rotation=turn([0, 1, 0.3], 25 * i - 30), translation=[2 * (i % 2) - 1, 1 - 2 * (i // 2), 0])
f.camera([0, 0, 8])
f.light(type="directional", intensity=3, rotation=turn([1, 1, 0], -25))
f.write("instances.gltf")

# ---- relief: a map of normals, tilted more than it says ----
f = File()
NORMALS = [[128, 128, 255], [200, 128, 230], [128, 200, 230], [60, 128, 230]]
image = f.add("images", {"uri": data(png(NORMALS, 2), "image/png")})
texture = f.add("textures", {"source": image, "sampler": f.add("samplers", {"magFilter": NEAREST})})
bumpy = f.material((0.7, 0.7, 0.7), normalTexture={"index": texture, "scale": 0.7})
f.node(mesh=f.mesh(f.primitive(**square(), material=bumpy)), rotation=turn([0, 0, 1], 20))
f.camera([0, 0, 5])
f.light(type="directional", intensity=3, rotation=turn([1, 1, 0], -35))
f.write("relief.gltf")
(HERE / "normals.png").write_bytes(png(NORMALS, 2))

# ---- plain: no light, no camera, no material ----
f = File()
f.node(mesh=f.mesh(f.primitive(WEDGE)))
f.write("plain.gltf")

# ---- glow: a lamp in the colours of an image, which several primitives' worth of plain lamps can stand for ----
f, round_ = balls()
image = f.add("images", {"uri": data(png(QUARTERS, 2), "image/png")})
texture = f.add("textures", {"source": image, "sampler": f.add("samplers", {"magFilter": NEAREST})})
lamp = f.material((0, 0, 0), emissiveFactor=[1, 0.5, 1], emissiveTexture={"index": texture}, extensions={"KHR_materials_emissive_strength": {"emissiveStrength": 6}})
f.node(mesh=f.mesh(round_(f.material((0.7, 0.7, 0.7)))))
f.node(mesh=f.mesh(f.primitive(**FLOOR, material=f.material((0.6, 0.6, 0.6)))))
f.node(mesh=f.mesh(f.primitive(**square(), material=lamp)), rotation=turn([1, 0, 0], 60), translation=[-0.5, 2.2, 1.5], scale=[1.5, 1, 1])
f.camera([0, 0.5, 8])
f.write("glow.gltf")

# ---- ../obj: what its OBJ file names, and the same times Kd and the opacity ----
OBJ = HERE.parent / "obj"
HOLES = [255, 0, 90, 255, 30, 200, 255, 0, 140]
(OBJ / "quarters.png").write_bytes(png(QUARTERS, 2))
(OBJ / "holes.png").write_bytes(png([[x] for x in HOLES], 3))
factored = [[linear(x) * k for x, k in zip(p, (0.9, 0.6, 0.9))] for p in QUARTERS]
(OBJ / "wall.pfm").write_bytes(b"PF\n2 2\n-1.0\n" + struct.pack("<12f", *flat(factored[2:] + factored[:2])))
rows = [[0.8 * x / 255 for x in HOLES[i:i + 3]] for i in range(0, 9, 3)]
(OBJ / "holes.pfm").write_bytes(b"Pf\n3 3\n-1.0\n" + struct.pack("<9f", *flat(rows[::-1])))
