"""Makes the files that the scenes here name. Needs nothing but Python.

    python3 make.py

The meshes and the second image of the sky are for the scenes in rebond's format: they are what pbrt's book says a `loopsubdiv`, a
`cylinder`, a `bilinearmesh` and a square environment are, worked out here once more.
"""

import gzip
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


def ply(points, triangles, normals=None, uvs=None):
    columns = ["x", "y", "z"] + (["nx", "ny", "nz"] if normals else []) + (["u", "v"] if uvs else [])
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(points)}"]
    header += [f"property float {c}" for c in columns]
    header += [f"element face {len(triangles)}", "property list uchar int vertex_indices", "end_header", ""]
    data = "\n".join(header).encode()
    for i, p in enumerate(points):
        row = tuple(p) + (tuple(normals[i]) if normals else ()) + (tuple(uvs[i]) if uvs else ())
        data += struct.pack(f"<{len(row)}f", *row)
    for t in triangles:
        data += struct.pack("<B3i", 3, *t)
    return data


def unit(v):
    length = math.sqrt(sum(x * x for x in v)) or 1
    return tuple(x / length for x in v)


def cross(a, b):
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def add(*terms):
    """Of (factor, vector)."""
    return tuple(sum(f * v[k] for f, v in terms) for k in range(3))


def grid(n, m, at):
    """A surface over the unit square, cut into n by m."""
    points = [at(i / n, j / m) for j in range(m + 1) for i in range(n + 1)]
    uvs = [(i / n, j / m) for j in range(m + 1) for i in range(n + 1)]
    place = lambda i, j: j * (n + 1) + i
    cells = [(place(i, j), place(i + 1, j), place(i + 1, j + 1), place(i, j + 1)) for j in range(m) for i in range(n)]
    return points, uvs, [t for a, b, c, d in cells for t in ((a, b, c), (a, c, d))]


def lump(u, v):
    """A lumpy closed surface: no symmetry that could hide a mistake. v from the south pole to the north."""
    phi, theta = 2 * math.pi * u, math.pi * v
    r = 1 + 0.15 * math.sin(3 * phi) * math.sin(theta) ** 3 + 0.1 * math.cos(theta)
    return (r * math.sin(theta) * math.cos(phi), r * math.sin(theta) * math.sin(phi), -r * math.cos(theta))


def ball(u, v):
    phi, theta = 2 * math.pi * u, math.pi * v
    return (math.sin(theta) * math.cos(phi), math.sin(theta) * math.sin(phi), -math.cos(theta))


def loop(points, triangles, levels):
    """Loop's subdivision of a closed mesh, its points and normals those of the limit. Neighbours in order, counter-clockwise."""

    def rings(triangles, count):
        after = [{} for _ in range(count)]
        for t in triangles:
            for k in range(3):
                after[t[k]][t[(k + 1) % 3]] = t[(k + 2) % 3]
        out = []
        for steps in after:
            ring = [min(steps)]
            while steps[ring[-1]] != ring[0]:
                ring.append(steps[ring[-1]])
            out.append(ring)
        return out

    weight = lambda n: 3 / 16 if n == 3 else 3 / (8 * n)
    for _ in range(levels):
        around = rings(triangles, len(points))
        even = [
            add((1 - len(r) * weight(len(r)), p), *((weight(len(r)), points[j]) for j in r)) for p, r in zip(points, around)
        ]
        middles, finer = {}, []

        def middle(a, b):
            key = (min(a, b), max(a, b))
            if key not in middles:
                left, right = (r[(r.index(b) + s) % len(r)] for r in [around[a]] for s in (1, -1))
                middles[key] = len(even)
                even.append(add((3 / 8, points[a]), (3 / 8, points[b]), (1 / 8, points[left]), (1 / 8, points[right])))
            return middles[key]

        for a, b, c in triangles:
            x, y, z = middle(a, b), middle(b, c), middle(c, a)
            finer += [(a, x, z), (x, b, y), (z, y, c), (x, y, z)]
        points, triangles = even, finer
    around = rings(triangles, len(points))
    gamma = lambda n: 1 / (n + 3 / (8 * weight(n)))
    points = [add((1 - len(r) * gamma(len(r)), p), *((gamma(len(r)), points[j]) for j in r)) for p, r in zip(points, around)]
    normals = []
    for r in around:
        turn = 2 * math.pi / len(r)
        s = add(*((math.cos(turn * k), points[j]) for k, j in enumerate(r)))
        t = add(*((math.sin(turn * k), points[j]) for k, j in enumerate(r)))
        normals.append(unit(cross(s, t)))
    return points, triangles, normals


def from_square(u, v):
    """The direction at a place of a square in which all have the same area (Clarberg 2008): the inner diamond is z > 0."""
    u, v = 2 * u - 1, 2 * v - 1
    d = 1 - (abs(u) + abs(v))
    r = 1 - abs(d)
    phi = (1 if r == 0 else (abs(v) - abs(u)) / r + 1) * math.pi / 4
    z = math.copysign(1 - r * r, d)
    size = r * math.sqrt(2 - r * r)
    return (math.copysign(math.cos(phi), u) * size, math.copysign(math.sin(phi), v) * size, z)


def equirectangular(square, rows, fine):
    """The same sky by latitude and longitude, its centre towards −z and its top towards +y of (y, z, x): each texel of the square is
    spread, in `fine` by `fine` points of the same solid angle, over where they lie."""
    n = len(square)
    total = [[[0.0, 0.0, 0.0, 0] for _ in range(2 * rows)] for _ in range(rows)]
    for a in range(n * fine):
        for b in range(n * fine):
            z, x, y = from_square((a + 0.5) / (n * fine), (b + 0.5) / (n * fine))
            theta, phi = math.acos(max(-1, min(1, y))), math.atan2(x, -z)
            cell = total[min(int(theta / math.pi * rows), rows - 1)][int((phi / (2 * math.pi) + 0.5) * 2 * rows) % (2 * rows)]
            for k in range(3):
                cell[k] += square[b // fine][a // fine][k]
            cell[3] += 1
    return [[tuple(c[k] / c[3] for k in range(3)) for c in row] for row in total]


def main():
    HERE.mkdir(exist_ok=True)
    # Coloured quarters with a light corner: which way up, and which way round, shows at once.
    quarter = [[(230, 60, 50), (60, 200, 70)], [(50, 80, 230), (220, 210, 60)]]
    rows = [[quarter[y // 4][x // 4] for x in range(8)] for y in range(8)]
    rows[0][0] = (255, 255, 255)
    png(HERE / "quarters.png", rows)
    # What the scene "textures" makes of them: each number 1 − 0.8 x, and (x/255)^1.8 for that encoding.
    decode = lambda x: x / 255 / 12.92 if x <= 10 else ((x / 255 + 0.055) / 1.055) ** 2.4
    pfm(HERE / "inverted.pfm", [[tuple(1 - 0.8 * decode(x) for x in pixel) for pixel in row] for row in rows])
    pfm(HERE / "gamma.pfm", [[tuple((x / 255) ** 1.8 for x in pixel) for pixel in row] for row in rows])
    pfm(HERE / "tinted.pfm", [[tuple(0.75 * decode(x) + 0.25 * c for x, c in zip(pixel, (0.9, 0.1, 0.4))) for pixel in row] for row in rows])
    hole = lambda x, y: (255, 255, 255) if (x - 3.5) ** 2 + (y - 3) ** 2 > 5 else (0, 0, 0)
    png(HERE / "holes.png", [[hole(x, y) for x in range(8)] for y in range(8)])
    points, uvs, triangles = grid(24, 12, lump)
    # No triangles without area at the poles.
    triangles = [t for t in triangles if len({tuple(round(x, 9) for x in points[i]) for i in t}) == 3]
    (HERE / "lump.ply").write_bytes(ply(points, triangles, uvs=uvs))
    (HERE / "lump.ply.gz").write_bytes(gzip.compress((HERE / "lump.ply").read_bytes(), mtime=0))
    tube = lambda u, v: (math.cos(2 * math.pi * u), math.sin(2 * math.pi * u), v)
    points, uvs, triangles = grid(192, 1, tube)
    (HERE / "tube.ply").write_bytes(ply(points, triangles, [(x, y, 0) for x, y, _ in points], uvs))
    patch = lambda u, v: (u, v, u * v)
    points, uvs, triangles = grid(16, 16, patch)
    (HERE / "patch.ply").write_bytes(ply(points, triangles, [unit((-y, -x, 1)) for x, y, _ in points], uvs))
    solid = [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)]
    faces = [(0, 2, 4), (2, 1, 4), (1, 3, 4), (3, 0, 4), (2, 0, 5), (1, 2, 5), (3, 1, 5), (0, 3, 5)]
    points, triangles, around = loop(solid, faces, 3)
    (HERE / "loop.ply").write_bytes(ply(points, triangles, around))
    # The part of a ball with z from −1 to 1/2 and φ from 0 to 270°.
    points, uvs, triangles = grid(48, 24, lambda u, v: ball(0.75 * u, 2 / 3 * v))
    triangles = [t for t in triangles if len({tuple(round(x, 9) for x in points[i]) for i in t}) == 3]
    (HERE / "bowl.ply").write_bytes(ply(points, triangles, points, uvs))
    points, uvs, triangles = grid(80, 40, ball)
    triangles = [t for t in triangles if len({tuple(round(x, 9) for x in points[i]) for i in t}) == 3]
    (HERE / "egg.ply").write_bytes(ply(points, triangles))
    # Rings have v = 0 at the rim. What is left out of the whole disk's centre is a thousandth of its radius.
    ring = lambda whole, inner: lambda u, v: (
        (1 - v + v * inner) * math.cos(2 * math.pi * whole * u), (1 - v + v * inner) * math.sin(2 * math.pi * whole * u), 0,
    )
    points, uvs, triangles = grid(144, 1, ring(0.75, 0.5))
    (HERE / "ring.ply").write_bytes(ply(points, triangles, uvs=uvs))
    points, uvs, triangles = grid(192, 1, ring(1, 0.001))
    (HERE / "annulus.ply").write_bytes(ply(points, triangles, uvs=uvs))
    points, uvs, triangles = grid(96, 1, lambda u, v: tube(u / 2, v))
    (HERE / "half-tube.ply").write_bytes(ply(points, triangles, [(x, y, 0) for x, y, _ in points], uvs))
    pfm(HERE / "board.pfm", [[(0.8, 0.7, 0.2) if (x + y) % 2 else (0.1, 0.2, 0.3) for x in range(8)] for y in range(8)])
    sky = [[(0.1 + 0.3 * (x * 3 % 4), 0.2 + 0.2 * (y * 2 % 3), 0.3 + 0.25 * ((x + 2 * y) % 4)) for x in range(4)] for y in range(4)]
    pfm(HERE / "sky.pfm", sky)
    by_angles = equirectangular(sky, 64, 800)
    pfm(HERE / "sky-by-angles.pfm", by_angles)
    pfm(HERE / "grey-by-angles.pfm", [[(sum(texel) / 3,) * 3 for texel in row] for row in by_angles])


if __name__ == "__main__":
    main()
