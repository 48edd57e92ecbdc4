"""Makes the files that the scenes here name: small meshes and images. Needs nothing but Python.

    python3 make.py
"""

import math
import struct
import zlib
from pathlib import Path

HERE = Path(__file__).resolve().parent / "parts"


def png(path, rows):
    """8-bit RGB rows of (r, g, b)."""

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    raw = b"".join(b"\0" + bytes(x for pixel in row for x in pixel) for row in rows)
    header = struct.pack(">IIBBBBB", len(rows[0]), len(rows), 8, 2, 0, 0, 0)
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(raw)) + chunk(b"IEND", b""))


def pfm(path, rows):
    """Rows from the top."""
    data = b"".join(struct.pack("<3f", *pixel) for row in reversed(rows) for pixel in row)
    path.write_bytes(f"PF\n{len(rows[0])} {len(rows)}\n-1.0\n".encode() + data)


def lump(u, v):
    """A lumpy closed surface: no symmetry that could hide a mistake. v from the south pole to the north."""
    phi, theta = 2 * math.pi * u, math.pi * v
    r = 1 + 0.15 * math.sin(3 * phi) * math.sin(theta) ** 3 + 0.1 * math.cos(theta)
    p = (r * math.sin(theta) * math.cos(phi), r * math.sin(theta) * math.sin(phi), -r * math.cos(theta))
    return tuple(round(x, 6) + 0.0 for x in p)


def surface(n, m):
    """Vertices, texture coordinates and triangles, counter-clockwise from outside; none without area at the poles, whose normals
    (Mitsuba's are not numbers) would have a share in those of their corners."""
    points = [lump(i / n, j / m) for j in range(m + 1) for i in range(n + 1)]
    uvs = [(i / n, j / m) for j in range(m + 1) for i in range(n + 1)]
    at = lambda i, j: j * (n + 1) + i
    faces = [(at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)) for j in range(m) for i in range(n)]
    triangles = [t for f in faces for t in ((f[0], f[1], f[2]), (f[0], f[2], f[3]))]
    return points, uvs, [t for t in triangles if len({points[i] for i in t}) == 3]


def unit(v):
    length = math.sqrt(sum(x * x for x in v)) or 1
    return tuple(x / length for x in v)


def normals(points):
    """Not the surface's own, but smooth and its own look: what a file says counts."""
    return [unit((p[0], p[1], 0.8 * p[2])) for p in points]


def obj(path, with_normals):
    points, uvs, triangles = surface(24, 12)
    lines = ["# a lump"] + ["v %.6f %.6f %.6f" % p for p in points] + ["vt %.6f %.6f" % t for t in uvs]
    if with_normals:
        lines += ["vn %.6f %.6f %.6f" % n for n in normals(points)]
    corner = (lambda i: f"{i + 1}/{i + 1}/{i + 1}") if with_normals else (lambda i: f"{i + 1}/{i + 1}")
    lines += ["f " + " ".join(map(corner, t)) for t in triangles]
    path.write_text("\n".join(lines) + "\n")


def ply(path, with_normals, attributes=False):
    """Attributes are a colour and a number of vertices, and a colour of faces."""
    points, uvs, triangles = surface(24, 12)
    columns = ["x", "y", "z"] + (["nx", "ny", "nz"] if with_normals else []) + ["u", "v"] + (["r", "g", "b", "rough_x"] if attributes else [])
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(points)}"]
    header += [f"property float {c}" for c in columns]
    header += [f"element face {len(triangles)}", "property list uchar int vertex_indices"]
    header += [f"property float tone_{c}" for c in "rgb" if attributes] + ["end_header", ""]
    data = "\n".join(header).encode()
    wave = lambda x: 0.5 + 0.4 * math.sin(x)
    for p, n, t in zip(points, normals(points), uvs):
        row = p + (n if with_normals else ()) + t
        row += (wave(3 * p[0]), wave(2 * p[1] + 1), wave(4 * p[2]), wave(2 * p[0] - 3 * p[2])) if attributes else ()
        data += struct.pack(f"<{len(row)}f", *row)
    for i, t in enumerate(triangles):
        data += struct.pack("<B3i", 3, *t)
        data += struct.pack("<3f", wave(i), wave(1.7 * i), wave(i // 48)) if attributes else b""
    path.write_bytes(data)


def serialized(path):
    """Two meshes: the lump without normals in double precision, and a pyramid in single precision."""
    points, uvs, triangles = surface(24, 12)
    base = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0), (0, 0, 1.5)]
    sides = [(0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4), (0, 2, 1), (0, 3, 2)]
    out, places = b"", []
    for flags, real, vertices, texcoords, indices in [
        (0x2002, "d", points, uvs, triangles),
        (0x1000, "f", base, [], sides),
    ]:
        places.append(len(out))
        data = struct.pack("<I", flags) + b"a mesh\0" + struct.pack("<QQ", len(vertices), len(indices))
        for row in list(vertices) + list(texcoords):
            data += struct.pack(f"<{len(row)}{real}", *row)
        for t in indices:
            data += struct.pack("<3I", *t)
        out += struct.pack("<HH", 0x041C, 4) + zlib.compress(data)
    path.write_bytes(out + b"".join(struct.pack("<Q", p) for p in places) + struct.pack("<I", len(places)))


def bsdf(path, alpha, thetas, phis):
    """Measurements in RGL's format: facets of GGX, and for colours waves that no symmetry has. The same direction of the viewer's azimuth
    for all if there is one phi."""
    n, (ax, ay) = 12, alpha
    square = [(x / (n - 1), y / (n - 1)) for y in range(n) for x in range(n)]
    polar = lambda t, p: (math.sin(t) * math.cos(p), math.sin(t) * math.sin(p), math.cos(t))
    facet = lambda u: polar(u[0] ** 2 * math.pi / 2, (2 * u[1] - 1) * math.pi)
    d = lambda m: 1 / (math.pi * ax * ay * ((m[0] / ax) ** 2 + (m[1] / ay) ** 2 + m[2] ** 2) ** 2)
    sigma = lambda w: 0.5 * (w[2] + math.sqrt(w[2] ** 2 + (ax * w[0]) ** 2 + (ay * w[1]) ** 2))
    seen = lambda w, m: d(m) * max(0, sum(map(float.__mul__, w, m))) * math.sqrt(m[0] ** 2 + m[1] ** 2)
    vndf, rgb, luminance = [], [], []
    for phi in phis:
        for theta in thetas:
            w = polar(theta, phi)
            vndf += [seen(w, facet(u)) * u[0] + 1e-3 for u in square]
            wave = lambda k, u: 0.45 + 0.4 * math.sin((3 + k) * u[0] + 5 * u[1] + theta - phi + k)
            colors = [[wave(k, u) for u in square] for k in range(3)]
            rgb += sum(colors, [])
            luminance += [0.2126 * r + 0.7152 * g + 0.0722 * b for r, g, b in zip(*colors)]
    count = (len(phis), len(thetas))
    fields = [
        ("theta_i", (len(thetas),), thetas), ("phi_i", (len(phis),), phis),
        ("ndf", (n, n), [d(facet(u)) for u in square]), ("sigma", (n, n), [sigma(facet(u)) for u in square]),
        ("vndf", (*count, n, n), vndf), ("luminance", (*count, n, n), luminance), ("rgb", (*count, 3, n, n), rgb),
        ("jacobian", (1,), b"\1"), ("description", (5,), b"waves"),
    ]
    head = b"tensor_file\0\1\0" + struct.pack("<I", len(fields))
    size = len(head) + sum(13 + len(name) + 8 * len(shape) for name, shape, _ in fields)
    body = b""
    for name, shape, data in fields:
        is_bytes = isinstance(data, bytes)
        head += struct.pack("<H", len(name)) + name.encode() + struct.pack("<HBQ", len(shape), 1 if is_bytes else 10, size + len(body))
        head += struct.pack(f"<{len(shape)}Q", *shape)
        body += data if is_bytes else struct.pack(f"<{len(data)}f", *data)
    path.write_bytes(head + body)


def main():
    HERE.mkdir(exist_ok=True)
    # Coloured quarters with a light corner: which way up, and which way round, shows at once.
    quarter = [[(230, 60, 50), (60, 200, 70)], [(50, 80, 230), (220, 210, 60)]]
    rows = [[quarter[y // 4][x // 4] for x in range(8)] for y in range(8)]
    rows[0][0] = (255, 255, 255)
    png(HERE / "quarters.png", rows)
    png(HERE / "holes.png", [[(255,) * 3 if (x - 3.5) ** 2 + (y - 3) ** 2 > 5 else (0,) * 3 for x in range(8)] for y in range(8)])
    slope = lambda x, y: (0.3 * math.sin(2 * math.pi * x / 16), 0.2 * math.cos(2 * math.pi * y / 16))
    small = [[(0.04, 0.2, 0.1), (0.16, 0.06, 0.12)], [(0.1, 0.12, 0.2), (0.2, 0.05, 0.02)]]
    pfm(HERE / "small.pfm", [[small[y // 2][x // 2] for x in range(4)] for y in range(4)])
    png(HERE / "dim.png", [[tuple(round(600 * x) for x in small[y // 2][x // 2]) for x in range(4)] for y in range(4)])
    normal = lambda x, y: unit((slope(x, y)[0], slope(x, y)[1], 1))
    code = lambda x: round(255 * (x + 1) / 2)
    png(HERE / "normals.png", [[tuple(map(code, normal(x, y))) for x in range(16)] for y in range(16)])
    height = lambda x, y: round(127 + 120 * math.sin(2 * math.pi * x / 16) * math.cos(4 * math.pi * y / 16))
    png(HERE / "heights.png", [[(height(x, y),) * 3 for x in range(16)] for y in range(16)])
    sky = [[(0.2 + 0.1 * y, 0.4, 0.9 - 0.1 * y) for x in range(12)] for y in range(6)]
    sky[1][3] = (12.0, 10.0, 6.0)
    sky[4][8] = (0.5, 4.0, 0.5)
    pfm(HERE / "sky.pfm", sky)
    (HERE / "leaf.spd").write_text("# a green\n400 0.05\n480 0.08\n520 0.35\n560 0.4\n600 0.1\n700 0.3\n")
    obj(HERE / "lump.obj", False)
    obj(HERE / "lump-normals.obj", True)
    ply(HERE / "lump.ply", False)
    ply(HERE / "lump-normals.ply", True)
    ply(HERE / "painted.ply", False, True)
    serialized(HERE / "two.serialized")
    bsdf(HERE / "waves.bsdf", (0.3, 0.3), [0.0, 0.3, 0.7, 1.1, 1.5], [0.0])
    bsdf(HERE / "brushed-waves.bsdf", (0.5, 0.2), [0.0, 0.6, 1.4], [-math.pi, -2.0, -0.9, 0.0])


if __name__ == "__main__":
    main()
