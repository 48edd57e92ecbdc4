#!/usr/bin/env python3
"""pot.ply: a pot with a lid, a spout's worth of belly and a knob, as a surface of revolution; standing on y = 0, of radius 1.

    python3 pot.py OUT.ply
"""

import math
import struct
import sys
from pathlib import Path

AROUND = 96
# Corners of the outline, (radius, height), from the middle of the foot to the middle of the knob; curves run between them.
OUTLINE = [(0, 0), (0.62, 0), (0.7, 0.06), (0.95, 0.42), (1, 0.72), (0.88, 1.06), (0.66, 1.24), (0.7, 1.3)]
OUTLINE += [(0.55, 1.4), (0.2, 1.5), (0.1, 1.56), (0.17, 1.66), (0.12, 1.76), (0, 1.79)]
BETWEEN = 6


def curve():
    """Points of a Catmull-Rom curve through the outline, flat where it begins and ends."""
    points = []
    for i in range(len(OUTLINE) - 1):
        a, b = OUTLINE[max(i - 1, 0)], OUTLINE[i]
        c, d = OUTLINE[i + 1], OUTLINE[min(i + 2, len(OUTLINE) - 1)]
        for k in range(BETWEEN):
            t = k / BETWEEN
            f = (-t / 2 + t**2 - t**3 / 2, 1 - 2.5 * t**2 + 1.5 * t**3, t / 2 + 2 * t**2 - 1.5 * t**3, t**3 / 2 - t**2 / 2)
            x, y = (sum(w * p[j] for w, p in zip(f, (a, b, c, d))) for j in (0, 1))
            points.append((max(x, 0.0), max(y, 0.0)))
    return [*points, OUTLINE[-1]]


def main():
    outline = curve()
    vertices = []
    for i, (r, y) in enumerate(outline):
        before, after = outline[max(i - 1, 0)], outline[min(i + 1, len(outline) - 1)]
        dr, dy = after[0] - before[0], after[1] - before[1]
        length = math.hypot(dr, dy)
        nr, ny = dy / length, -dr / length
        if i == 0 or i == len(outline) - 1:
            nr, ny = 0.0, -1.0 if i == 0 else 1.0
        for j in range(AROUND):
            c, s = math.cos(2 * math.pi * j / AROUND), math.sin(2 * math.pi * j / AROUND)
            vertices.append((r * c, y, r * s, nr * c, ny, nr * s))
    faces = []
    for i in range(len(outline) - 1):
        for j in range(AROUND):
            a, b = i * AROUND + j, i * AROUND + (j + 1) % AROUND
            if i > 0:
                faces.append((a, a + AROUND, b))
            if i < len(outline) - 2:
                faces.append((b, a + AROUND, b + AROUND))
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}"]
    header += [f"property float {name}" for name in ("x", "y", "z", "nx", "ny", "nz")]
    header += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header", ""]
    data = b"".join(struct.pack("<6f", *v) for v in vertices) + b"".join(struct.pack("<B3i", 3, *f) for f in faces)
    Path(sys.argv[1]).write_bytes("\n".join(header).encode() + data)
    print(f"{len(vertices)} vertices, {len(faces)} triangles")


if __name__ == "__main__":
    main()
