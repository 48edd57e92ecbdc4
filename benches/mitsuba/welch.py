"""Do two noisy pictures have the same expectation? Means, and Welch's t-test per block of pixels."""

from dataclasses import dataclass

import numpy as np
from scipy import stats

BLOCK = 8
OUTLIER = 0.01  # p-values below this are counted as outliers
CONFIDENCE = 0.999  # of the count of outliers, and of the worst block
MEAN_TOLERANCE = 0.002
# Relative rounding error of a pixel in f32 that two correct programs may differ by.
ROUNDING = 2e-6


@dataclass
class Estimate:
    """A picture: per pixel and channel the mean, the variance of that mean, and its degrees of freedom."""

    mean: np.ndarray
    variance: np.ndarray
    freedom: float

    @staticmethod
    def of_runs(pictures):
        """From several independent renderings."""
        pictures = np.asarray(pictures, dtype=np.float64)
        k = len(pictures)
        return Estimate(pictures.mean(axis=0), pictures.var(axis=0, ddof=1) / k, k - 1)

    def total(self):
        """Mean over all pixels and its standard error, per channel."""
        n = self.mean.shape[0] * self.mean.shape[1]
        return self.mean.mean(axis=(0, 1)), np.sqrt(self.variance.sum(axis=(0, 1))) / n

    def blocks(self):
        """Per block of pixels: mean, variance of the mean, Welch-Satterthwaite degrees of freedom."""
        n = _block_sums(np.ones_like(self.mean))
        variance = _block_sums(self.variance)
        squares = _block_sums(self.variance**2)
        with np.errstate(divide="ignore", invalid="ignore"):
            freedom = np.where(squares > 0, self.freedom * variance**2 / squares, np.inf)
        return _block_sums(self.mean) / n, variance / n**2, freedom


def _block_sums(a):
    rows = np.add.reduceat(a, np.arange(0, a.shape[0], BLOCK), axis=0)
    return np.add.reduceat(rows, np.arange(0, a.shape[1], BLOCK), axis=1)


def test_blocks(a, b):
    """Welch's t and its two-sided p-value for each block and channel."""
    (ma, va, fa), (mb, vb, fb) = a.blocks(), b.blocks()
    floor = (ROUNDING * np.maximum(np.abs(ma), np.abs(mb))) ** 2
    both = va + vb
    with np.errstate(divide="ignore", invalid="ignore"):
        freedom = np.where(both > 0, both**2 / (va**2 / fa + vb**2 / fb), np.inf)
        t = np.where(ma == mb, 0.0, (ma - mb) / np.sqrt(both + floor))
    freedom = np.where(np.isfinite(freedom) & (freedom > 0), freedom, 1e12)
    return t, 2 * stats.t.sf(np.abs(t), freedom)


@dataclass
class Verdict:
    """What a comparison found, and the report of it."""

    agree: bool
    resolved: bool
    lines: list
    t: np.ndarray

    def word(self):
        return "DISAGREE" if not self.agree else "AGREE" if self.resolved else "UNDECIDED: take more samples"

    def exit_code(self):
        return 1 if not self.agree else 0 if self.resolved else 3


def compare(a, b, names=("rebond", "mitsuba")):
    """The verdict on two estimates: means within the tolerance, no more outliers than chance allows, and no single block
    that chance does not."""
    if not (np.isfinite(a.mean).all() and np.isfinite(b.mean).all()):
        return Verdict(False, True, ["a picture has pixels that are not finite"], np.zeros((1, 1, 3)))
    lines, agree, resolved = [], True, True
    (ma, ea), (mb, eb) = a.total(), b.total()
    lines.append(f"{'mean radiance':<22}{names[0]:>12}{names[1]:>12}{'ratio':>11}{'± (1 σ)':>11}{'σ from 1':>10}")
    for c, channel in enumerate("RGB"):
        ratio = ma[c] / mb[c]
        error = abs(ratio) * np.hypot(ea[c] / ma[c], eb[c] / mb[c])
        off = (ratio - 1) / error if error > 0 else 0.0
        beyond = abs(ratio - 1) > MEAN_TOLERANCE and abs(off) >= 3
        # Resolved: three standard errors do not reach across the tolerance.
        sharp = 3 * error <= MEAN_TOLERANCE
        agree &= not beyond
        resolved &= sharp
        note = f"  beyond {MEAN_TOLERANCE:.1%}" if beyond else "" if sharp else "  not resolved"
        lines.append(f"  {channel:<20}{ma[c]:>12.6f}{mb[c]:>12.6f}{ratio:>11.6f}{error:>11.6f}{off:>10.2f}{note}")
    t, p = test_blocks(a, b)
    count = p.shape[0] * p.shape[1]
    allowed = int(stats.binom.ppf(CONFIDENCE, count, OUTLIER))
    lines.append(f"{'Welch t-test':<22}{f'{count} blocks of {BLOCK}x{BLOCK}':>24}{'p < 1 %':>11}{'allowed':>11}{'worst, after Šidák':>22}")
    for c, channel in enumerate("RGB"):
        outliers = int((p[..., c] < OUTLIER).sum())
        y, x = np.unravel_index(p[..., c].argmin(), p.shape[:2])
        worst = -np.expm1(count * np.log1p(-min(p[y, x, c], 1 - 1e-16)))
        good = outliers <= allowed and worst >= 1 - CONFIDENCE
        agree &= good
        place = f"t = {t[y, x, c]:+.2f} at ({x * BLOCK}, {y * BLOCK})"
        note = "" if good else "  beyond chance"
        lines.append(f"  {channel:<44}{outliers:>11}{allowed:>11}{worst:>22.4g}  {place}{note}")
    return Verdict(agree, resolved, lines, t)
