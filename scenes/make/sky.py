"""Makes sky.hdr: a clear sky with a low sun over pale ground, as an equirectangular Radiance image of our own design.

    python3 sky.py ../sky.hdr
"""

import math
import sys

from images import write_equirectangular

SUN = (math.radians(35), math.radians(-50))  # height over the horizon, azimuth from the centre of the image
SUN_RADIUS = math.radians(1.5)


def mix(a, b, t):
    return [x + (y - x) * t for x, y in zip(a, b)]


def radiance(direction):
    x, y, z = direction
    h, a = SUN
    sun = (math.cos(h) * math.sin(a), math.sin(h), -math.cos(h) * math.cos(a))
    angle = math.acos(max(-1.0, min(1.0, sum(p * q for p, q in zip(direction, sun)))))
    if y < 0:
        return mix([0.32, 0.31, 0.29], [0.14, 0.13, 0.12], min(1.0, -4 * y))
    sky = mix([0.85, 0.95, 1.05], [0.16, 0.32, 0.75], math.sqrt(y))
    glow = math.exp(-angle / 0.22)
    sky = [s + g * glow for s, g in zip(sky, (1.3, 0.95, 0.6))]
    # The disk of the sun, softened over a tenth of its radius by averaging within the texel.
    return [s + c for s, c in zip(sky, (620, 540, 430))] if angle < SUN_RADIUS else sky


write_equirectangular(sys.argv[1], 256, 128, radiance)
