"""Writers of the images that the other scripts make."""

import math
import struct
import zlib


def write_png(path, width, channels, rows):
    """8-bit PNG of 1 (grey) or 3 channels; a row is bytes."""

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">2I5B", width, len(rows), 8, 0 if channels == 1 else 2, 0, 0, 0)
    with open(path, "wb") as out:
        out.write(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header))
        out.write(chunk(b"IDAT", zlib.compress(b"".join(b"\0" + row for row in rows))) + chunk(b"IEND", b""))


def rgbe(c):
    m = max(c)
    if m <= 0:
        return [0, 0, 0, 0]
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


def write_equirectangular(path, width, height, radiance, samples=8):
    """Radiance HDR around the scene, of `radiance(direction)`, each texel the mean over a grid of samples."""

    def texel(i, j):
        n, total = samples, [0.0] * 3
        for k in range(n * n):
            theta = (j + (k // n + 0.5) / n) / height * math.pi
            phi = ((i + (k % n + 0.5) / n) / width - 0.5) * 2 * math.pi
            d = (math.sin(theta) * math.sin(phi), math.cos(theta), -math.sin(theta) * math.cos(phi))
            total = [t + r / (n * n) for t, r in zip(total, radiance(d))]
        return total

    with open(path, "wb") as out:
        out.write(f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {height} +X {width}\n".encode())
        for j in range(height):
            texels = [rgbe(texel(i, j)) for i in range(width)]
            out.write(bytes((2, 2, width >> 8, width & 255)))
            for channel in range(4):
                out.write(run_lengths([t[channel] for t in texels]))
