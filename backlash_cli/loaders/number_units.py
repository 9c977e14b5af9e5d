"""What stamps that are numbers count: told from their size, their steps and the name of the column."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .names import plain
from .options import ReadOptions

FIRST = 1000  # numbers that tell how far apart they are


def unit_of_numbers(known: NDArray[np.float64], name: str, options: ReadOptions) -> tuple[str, str]:
    """Return the unit of numeric stamps, all of them finite, and their pattern where they are written as digits."""
    if options.time_format is not None:
        return options.time_format, ""
    return _unit_of(known, name), _written_digits(known)


def _written_digits(known: NDArray[np.float64]) -> str:
    """Return the pattern of stamps written as one number, 20260317080000 or 202603170800, "" when they are none."""
    for pattern, low, high in (("ymdhms", 1.9e13, 2.2e13), ("ymdhm", 1.9e11, 2.2e11)):
        if known.min() < low or known.max() >= high or np.any(known % 1):
            continue
        rest = known if pattern == "ymdhms" else known * 100
        fits = (rest % 100 < 60) & (rest // 100 % 100 < 60) & (rest // 1e4 % 100 < 24)
        day, month = rest // 1e6 % 100, rest // 1e8 % 100
        fits &= (day >= 1) & (day <= 31) & (month >= 1) & (month <= 12)
        if fits.all():
            return pattern
    return ""


def _unit_of(known: NDArray[np.float64], name: str) -> str:
    middle = float(np.median(np.abs(known)))
    if 1.2e17 < middle < 1.5e17:
        return "filetime"
    for low, high, unit in ((1e17, 1e19, "epoch_ns"), (1e14, 1e17, "epoch_us"), (1e11, 1e14, "epoch_ms"),
                            (3.4e9, 4.2e9, "labview"), (1e8, 3.4e9, "epoch_s")):  # fmt: skip
        if low <= middle < high:
            return unit
    word = plain(name)
    steps = np.diff(known[:FIRST])
    step = float(np.median(np.abs(steps[steps != 0]))) if np.any(steps != 0) else 1.0
    if 20_000 < middle < 80_000 and step < 0.5 and np.any(known % 1 != 0):
        return "excel"
    bracket = name.lower().rstrip(")] ").replace("[", "(").rpartition("(")[2].strip()
    if word.endswith("ms") or bracket in ("ms", "msec"):
        return "millis"
    if word.endswith(("min", "minutes")) or bracket in ("min", "minutes"):
        return "minutes"
    if word.endswith(("hours", "timeh")) or bracket in ("h", "hours"):
        return "hours"
    return "seconds"
