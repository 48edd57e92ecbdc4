"""Makes checker.png: two by two texels, dark and light.

    python3 checker.py ../checker.png
"""

import struct
import sys
import zlib


def chunk(kind, data):
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


dark, light = bytes((92, 88, 84)), bytes((202, 198, 190))
rows = b"".join(b"\0" + a + b for a, b in ((dark, light), (light, dark)))
with open(sys.argv[1], "wb") as out:
    out.write(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">2I5B", 2, 2, 8, 2, 0, 0, 0)))
    out.write(chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))
