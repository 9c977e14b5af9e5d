"""Describing function of backlash (1): gain and phase that a gap gives to a sine of amplitude a.

With r = d/a, for a >= d/2 (a smaller sine does not move the valve at all):
Re N = 1/pi [ pi/2 + asin(1 - r) + (1 - r) sqrt(r (2 - r)) ],  Im N = -1/pi r (2 - r).
N depends on d/a only. Source: Haegglund (2007), eq. 1.
"""

from __future__ import annotations

import numpy as np

from ..errors import UsageError
from .process import ComplexArray


def describing_function(ratio: object) -> ComplexArray:
    """Return N(d/a), complex, for the ratio of dead band to input amplitude, each 0..2.

    Raises UsageError outside 0..2: below half a gap of amplitude the valve does not move.
    """
    r = np.asarray(ratio, dtype=np.float64)
    if np.any(r < 0.0) or np.any(r > 2.0):
        raise UsageError("d/a must lie in 0..2", remedy="the amplitude must be at least half the dead band")
    rest = 1.0 - r
    square = r * (2.0 - r)
    real = 0.5 * np.pi + np.arcsin(rest) + rest * np.sqrt(square)
    return np.asarray((real - 1j * square) / np.pi, dtype=np.complex128)


def negative_inverse(ratio: object) -> ComplexArray:
    """Return -1/N(d/a), the curve that the loop's Nyquist plot must cross for a limit cycle (Fig. 3)."""
    return -1.0 / describing_function(ratio)
