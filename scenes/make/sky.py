"""Makes sky.hdr: a clear sky with a low sun over pale ground, as an equirectangular Radiance image of our own design.

    python3 sky.py ../sky.hdr
"""

import math
import sys

WIDTH, HEIGHT = 256, 128
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
    # The disk of the sun, softened over a tenth of its radius by averaging within the texel (see main).
    return [s + c for s, c in zip(sky, (620, 540, 430))] if angle < SUN_RADIUS else sky


def texel(i, j):
    n = 8
    total = [0.0] * 3
    for k in range(n * n):
        theta = (j + (k // n + 0.5) / n) / HEIGHT * math.pi
        phi = ((i + (k % n + 0.5) / n) / WIDTH - 0.5) * 2 * math.pi
        d = (math.sin(theta) * math.sin(phi), math.cos(theta), -math.sin(theta) * math.cos(phi))
        total = [t + r / (n * n) for t, r in zip(total, radiance(d))]
    return total


def rgbe(c):
    m = max(c)
    e = math.frexp(m)[1]
    scale = 256.0 / 2.0**e
    return [min(255, int(x * scale)) for x in c] + [e + 128]


def run_lengths(row):
    """New-style RLE of one channel: literal runs and repeats."""
    out, at = bytearray(), 0
    while at < len(row):
        run = 1
        while at + run < len(row) and run < 127 and row[at + run] == row[at]:
            run += 1
        if run > 2:
            out += bytes((128 + run, row[at]))
            at += run
            continue
        start = at
        while at < len(row) and at - start < 128 and not (at + 2 < len(row) and row[at] == row[at + 1] == row[at + 2]):
            at += 1
        out += bytes((at - start, *row[start:at]))
    return out


def main():
    with open(sys.argv[1], "wb") as out:
        out.write(f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {HEIGHT} +X {WIDTH}\n".encode())
        for j in range(HEIGHT):
            texels = [rgbe(texel(i, j)) for i in range(WIDTH)]
            out.write(bytes((2, 2, WIDTH >> 8, WIDTH & 255)))
            for channel in range(4):
                out.write(run_lengths([t[channel] for t in texels]))


main()
