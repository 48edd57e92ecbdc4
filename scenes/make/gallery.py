"""Makes what the scene material-gallery stands on and shows: a turned ball with a groove on a foot (ball.ply), a backdrop
(backdrop.ply), and images of our own design: hammered.png (normals), weave.png (heights), holes.png (opacity).

    python3 gallery.py ..
"""

import math
import os
import random
import struct
import sys

from images import write_png

SEGMENTS = 48


def write_ply(path, vertices, faces):
    """Binary PLY; a vertex is position, normal and texture coordinates."""
    names = ("x", "y", "z", "nx", "ny", "nz", "u", "v")
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\n"
    header += "".join(f"property float {name}\n" for name in names)
    header += f"element face {len(faces)}\nproperty list uchar ushort vertex_indices\nend_header\n"
    with open(path, "wb") as out:
        out.write(header.encode())
        out.write(b"".join(struct.pack("<8f", *v) for v in vertices))
        out.write(b"".join(struct.pack(f"<B{len(f)}H", len(f), *f) for f in faces))


def ball_profile():
    """(radius, height) from the bottom to the top, by Chaikin's corner cutting."""
    on_sphere = lambda degrees, r=1.0: (r * math.cos(math.radians(degrees)), 1.12 + r * math.sin(math.radians(degrees)))
    points = [(0, 0), (0.6, 0), (0.66, 0.0), (0.66, 0.1), (0.6, 0.12), (0.5, 0.13), (0.45, 0.18)]
    points += [on_sphere(a) for a in range(-60, 19, 6)] + [on_sphere(20), on_sphere(20.5)]
    points += [on_sphere(22.5, 0.9), on_sphere(26, 0.9), on_sphere(28, 0.9), on_sphere(30, 1.0), on_sphere(30.5), on_sphere(32)]
    points += [on_sphere(a) for a in range(38, 87, 6)] + [(0.06, 2.12), (0, 2.12)]
    for _ in range(2):
        cut = [points[0]]
        for (x0, y0), (x1, y1) in zip(points, points[1:]):
            cut += [(0.75 * x0 + 0.25 * x1, 0.75 * y0 + 0.25 * y1), (0.25 * x0 + 0.75 * x1, 0.25 * y0 + 0.75 * y1)]
        points = cut + [points[-1]]
    # What is straight needs no points between.
    kept = [points[0]]
    for before, here, after in zip(points, points[1:], points[2:]):
        a, b = ([q - p for p, q in zip(*pair)] for pair in ((kept[-1], here), (here, after)))
        turn = abs(math.atan2(a[0] * b[1] - a[1] * b[0], a[0] * b[0] + a[1] * b[1]))
        if turn > math.radians(5) or math.hypot(*a) > 0.15:
            kept.append(here)
    return kept + [points[-1]]


def ball():
    profile = ball_profile()
    lengths = [0.0]
    for p, q in zip(profile, profile[1:]):
        lengths.append(lengths[-1] + math.dist(p, q))
    vertices, faces = [], []
    for i, (r, y) in enumerate(profile):
        (r0, y0), (r1, y1) = profile[max(i - 1, 0)], profile[min(i + 1, len(profile) - 1)]
        normal = (y1 - y0, r0 - r1)
        # At the ends the profile meets its mirror image.
        normal = (0.0, -1.0) if i == 0 else (0.0, 1.0) if i == len(profile) - 1 else [x / math.hypot(*normal) for x in normal]
        for k in range(SEGMENTS + 1):
            phi = 2 * math.pi * k / SEGMENTS
            c, s = math.cos(phi), math.sin(phi)
            uv = (k / SEGMENTS, lengths[i] / lengths[-1])
            vertices.append((r * c, y, -r * s, normal[0] * c, normal[1], -normal[0] * s, *uv))
    row = SEGMENTS + 1
    for i in range(len(profile) - 1):
        for k in range(SEGMENTS):
            a, b, c, d = i * row + k, i * row + k + 1, (i + 1) * row + k + 1, (i + 1) * row + k
            faces.append((a, b, c) if i == len(profile) - 2 else (a, c, d) if i == 0 else (a, b, c, d))
    return vertices, faces


def backdrop(half_width=40.0, front=30.0, back=-5.2, radius=3.0, height=24.0):
    """A floor that bends up into a wall."""
    path = [(front, 0.0, 0.0)]
    path += [(back - radius * math.sin(a), radius * (1 - math.cos(a)), a) for a in (math.pi / 2 * i / 24 for i in range(25))]
    path.append((back - radius, height, math.pi / 2))
    vertices = []
    for z, y, a in path:
        for side in (-1, 1):
            vertices.append((side * half_width, y, z, 0, math.cos(a), math.sin(a), (side + 1) / 2, 0.0))
    return vertices, [(2 * i, 2 * i + 1, 2 * i + 3, 2 * i + 2) for i in range(len(path) - 1)]


def hammered(size=128, dimples=26):
    """Normals of a tile that dimples of a hammer cover."""
    rng = random.Random(5)
    centres = []
    while len(centres) < dimples:
        tries = [(rng.random(), rng.random()) for _ in range(20)]
        apart = lambda p: min((torus(p, c) for c in centres), default=1.0)
        centres.append(max(tries, key=apart))

    def height(x, y):
        near = sorted(torus((x, y), c) for c in centres)[:4]
        # The lowest of the paraboloids around the centres, with soft ridges between.
        return -math.log(sum(math.exp(-60 * 6 * d * d) for d in near)) / 60

    rows = []
    for j in range(size):
        row = bytearray()
        for i in range(size):
            x, y, e = (i + 0.5) / size, 1 - (j + 0.5) / size, 0.5 / size
            n = (-(height(x + e, y) - height(x - e, y)) / (2 * e), -(height(x, y + e) - height(x, y - e)) / (2 * e), 1.0)
            row += bytes(round(255 * (0.5 + 0.5 * c / math.hypot(*n))) for c in n)
        rows.append(bytes(row))
    return rows


def torus(p, q):
    return math.hypot(*(abs((a - b + 0.5) % 1 - 0.5) for a, b in zip(p, q)))


def weave(size=64):
    """Heights of a plain weave: two threads each way, over and under."""

    def height(x, y):
        def thread(across, along):
            number, place = math.floor(2 * across), 2 * across % 1 - 0.5
            wave = math.cos(2 * math.pi * along + math.pi * number)
            return math.sqrt(max(0.0, 1 - (place / 0.48) ** 2)) * (0.55 + 0.45 * wave)

        return max(thread(x, y), thread(y, x + 0.5))

    place = lambda i: (i + 0.5) / size
    return [bytes(round(255 * height(place(i), 1 - place(j))) for i in range(size)) for j in range(size)]


def holes(size=64):
    """Opacity of a sheet with round holes in a hexagonal lattice; a tile is one by √3."""
    height = round(size * math.sqrt(3))

    def opacity(i, j):
        total, n = 0, 4
        for k in range(n * n):
            x, y = (i + (k % n + 0.5) / n) / size, (j + (k // n + 0.5) / n) / height * math.sqrt(3)
            lattice = [(cx, cy) for cx in (0, 1) for cy in (0, math.sqrt(3))] + [(0.5, math.sqrt(3) / 2)]
            total += min(math.dist((x, y), c) for c in lattice) > 0.36
        return round(255 * total / (n * n))

    return [bytes(opacity(i, j) for i in range(size)) for j in range(height)]


def main():
    folder = sys.argv[1]
    write_ply(os.path.join(folder, "ball.ply"), *ball())
    write_ply(os.path.join(folder, "backdrop.ply"), *backdrop())
    for name, channels, rows in (("hammered", 3, hammered()), ("weave", 1, weave()), ("holes", 1, holes())):
        write_png(os.path.join(folder, f"{name}.png"), len(rows[0]) // channels, channels, rows)


main()
