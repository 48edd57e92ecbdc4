"""Makes window.hdr: a dim room of our own design, lit through a window of four panes and by a lamp behind.

    python3 window.py ../window.hdr
"""

import math
import sys

from images import write_equirectangular


def through(direction, centre, half_width, half_height):
    """Where a direction meets the plane around `centre` (azimuth from −z, height), in units of the halves; or None."""
    a, h = map(math.radians, centre)
    n = (math.sin(a) * math.cos(h), math.sin(h), -math.cos(a) * math.cos(h))
    right = (math.cos(a), 0.0, math.sin(a))
    up = (-math.sin(a) * math.sin(h), math.cos(h), math.cos(a) * math.sin(h))
    dot = lambda u: sum(p * q for p, q in zip(direction, u))
    if dot(n) <= 0.05:
        return None
    return dot(right) / dot(n) / half_width, dot(up) / dot(n) / half_height


def radiance(direction):
    y = direction[1]
    wall = [0.10, 0.095, 0.09] if y > 0 else [0.07, 0.06, 0.05]
    wall = [w * (1 + 0.5 * y) for w in wall]
    at = through(direction, (-125, 28), 0.42, 0.55)
    if at and max(map(abs, at)) < 1:
        # The cross between the panes.
        return [0.03] * 3 if min(map(abs, at)) < 0.07 else [9.0, 10.5, 13.0]
    at = through(direction, (130, 42), 0.2, 0.2)
    if at and math.hypot(*at) < 1:
        return [16.0, 10.0, 5.0]
    return wall


write_equirectangular(sys.argv[1], 256, 128, radiance, 4)
