"""Makes checker.png: two by two texels, dark and light.

    python3 checker.py ../checker.png
"""

import sys

from images import write_png

dark, light = bytes((92, 88, 84)), bytes((202, 198, 190))
write_png(sys.argv[1], 2, 3, [a + b for a, b in ((dark, light), (light, dark))])
