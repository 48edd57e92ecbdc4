"""Makes the lanterns of many-lights: six-sided hoods that shine on the inside, on the ground in a spiral of seeds (Vogel
1979) and in the air, one PLY file a colour.

    python3 many_lights.py ../
"""

import math
import struct
import sys
from pathlib import Path

COLOURS = ["amber", "rose", "violet", "azure", "jade", "ivory"]
ON_GROUND, IN_THE_AIR = 2000, 300
INNER, OUTER = 0.6, 8.0  # metres
GOLDEN = math.pi * (3 - math.sqrt(5))
CAMERA = (1.6, 2.0, 4.4)
PLASTIC = 1.2207440846  # x^4 = x + 1
SIDES = 6


def lanterns():
    """Arm of the spiral, whose colour it has; centre of the rim; radius; direction of a corner."""
    for i in range(ON_GROUND):
        share = (i + 0.5) / ON_GROUND
        r = INNER + (OUTER - INNER) * share**0.62
        angle = i * GOLDEN
        size = 0.008 + 0.003 * r / OUTER
        yield angle / math.tau + 0.9 * math.log(r / INNER), (r * math.cos(angle), 8 * size, r * math.sin(angle)), size, angle
    for i in range(IN_THE_AIR):
        # An additive recurrence spreads them evenly (Roberts 2018).
        x, y, z = ((0.5 + (i + 1) * PLASTIC**-k) % 1 for k in (1, 2, 3))
        r, angle = 0.1 + 2.6 * x, math.tau * y
        center = (r * math.cos(angle), 0.95 + 0.45 * z, r * math.sin(angle))
        if math.dist(center, CAMERA) > 2.4:
            yield y + 0.9 * math.log(max(r, INNER) / INNER), center, 0.01, angle


def write(path, members):
    header = (
        "ply\nformat binary_little_endian 1.0\n"
        f"element vertex {(SIDES + 1) * len(members)}\nproperty float x\nproperty float y\nproperty float z\n"
        f"element face {SIDES * len(members)}\nproperty list uchar ushort vertex_indices\nend_header\n"
    )
    with open(path, "wb") as f:
        f.write(header.encode())
        for (x, y, z), size, turn in members:
            f.write(struct.pack("<3f", x, y + 1.2 * size, z))
            for k in range(SIDES):
                a = turn + math.tau * k / SIDES
                f.write(struct.pack("<3f", x + size * math.cos(a), y, z + size * math.sin(a)))
        for i in range(len(members)):
            for k in range(SIDES):
                face = (0, 1 + k, 1 + (k + 1) % SIDES)  # facing down
                f.write(struct.pack("<B3H", 3, *((SIDES + 1) * i + v for v in face)))


def main():
    groups = [[] for _ in COLOURS]
    for arm, *lantern in lanterns():
        groups[int(arm * len(COLOURS)) % len(COLOURS)].append(lantern)
    for name, members in zip(COLOURS, groups):
        write(Path(sys.argv[1], f"lanterns-{name}.ply"), members)


if __name__ == "__main__":
    main()
