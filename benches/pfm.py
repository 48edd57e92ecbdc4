"""Pictures that rebond wrote as PFM."""

import numpy as np


def read_pfm(path):
    """The colours, (height, width, 3), the lowest row first."""
    with open(path, "rb") as f:
        assert f.readline() == b"PF\n"
        width, height = map(int, f.readline().split())
        order = "<" if float(f.readline()) < 0 else ">"
        return np.frombuffer(f.read(), order + "f4").reshape(height, width, 3).astype(np.float64)
