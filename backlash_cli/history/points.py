"""What the nights of a loop say about its dead band, as points of a line.

How each kind of night is used:
- a size (backlash, suspected): a point, with less weight when its interval is wide or the verdict only suspected;
- no_backlash with a limit of detection: the dead band is somewhere between 0 and that limit, with half weight;
- anything else (cannot_tell, oscillating, insufficient_data, error, no limit of detection): a gap, named, not a zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..record import FloatArray
from ..results import Verdict
from ..results.history import Night
from .robust_line import ENOUGH, robust_line

SUSPECTED_WEIGHT = 0.5
BELOW_WEIGHT = 0.5
LIGHTEST = 0.1
MOST = 400  # points of one line


@dataclass(frozen=True, eq=False)
class Points:
    """Nights that say something, (nights,) arrays in time order: epoch seconds, bounds [span], weight, half-width."""

    time: FloatArray
    low: FloatArray
    high: FloatArray
    weight: FloatArray
    width: FloatArray

    def __len__(self) -> int:
        return len(self.time)

    def select(self, mask: object) -> Points:
        return Points(*(getattr(self, name)[mask] for name in ("time", "low", "high", "weight", "width")))


def main_source(nights: Sequence[Night]) -> str:
    """Return which estimate stands for the loop: the one that most nights have, so that two are never mixed."""
    sized = [n for n in nights if n.measured]
    confirmed = sum(n.source == "confirmation" for n in sized)
    return "confirmation" if 2 * confirmed >= len(sized) else "cluster"


def size_by(night: Night, source: str) -> tuple[float, tuple[float, float] | None] | None:
    """Return a night's dead band and interval from `source`, None where it has none."""
    if night.d is None:
        return None
    if night.source == source:
        return night.d, night.ci95
    other = night.details.get(source)
    size = other.get("d") if isinstance(other, dict) else None
    return None if size is None else (float(size), None)


def points_of(nights: Sequence[Night], source: str) -> tuple[Points, list[tuple[str, str]]]:
    """Return the nights that say something, and the others as (day, code of the reason)."""
    rows: list[tuple[float, float, float, float, float]] = []
    gaps: list[tuple[str, str]] = []
    for night in nights:
        size = size_by(night, source)
        if size is not None:
            d, ci95 = size
            half = 0.5 * (ci95[1] - ci95[0]) if ci95 else np.nan
            rows.append((night.time, d, d, SUSPECTED_WEIGHT if night.verdict is Verdict.SUSPECTED else 1.0, half))
        elif night.below_detection and night.limit_of_detection is not None:
            rows.append((night.time, 0.0, night.limit_of_detection, BELOW_WEIGHT, np.nan))
        else:
            code = "no_size" if night.measured else night.reasons[0].code if night.reasons else str(night.verdict)
            gaps.append((night.date.isoformat(), code))
    table = np.array(rows, dtype=float).reshape(-1, 5)
    return Points(*table.T), gaps


def pooled(part: Points) -> Points:
    """Return at most MOST points: neighbours together as their medians, because the pairs grow with the square."""
    group = -(-len(part) // MOST)
    if group <= 1:
        return part
    cuts = range(0, len(part), group)
    time, low, high, width = (np.array([np.median(getattr(part, name)[k : k + group]) for k in cuts])
                              for name in ("time", "low", "high", "width"))
    return Points(time, low, high, np.add.reduceat(part.weight, list(cuts)), width)


def precision(part: Points, days: FloatArray) -> FloatArray:
    """Weight of each night by the width of its interval.

    The usual width at that time (a robust line through the widths, because a larger dead band has a wider interval)
    and the night's own width against the usual one both count; not the night's own dead band, which would pull low.
    """
    known = np.isfinite(part.width) & (part.width > 0)
    if known.sum() < ENOUGH:
        return np.ones(len(part))
    width = part.width[known]
    middle = float(np.median(width))
    line = robust_line(days[known], width, width, np.ones(int(known.sum())))
    usual = np.clip(line.level + line.slope * (days - line.centre), middle / 3.0, 3.0 * middle)
    own = np.where(known, np.maximum(part.width, usual), usual)
    weight = (middle / usual) ** 2 * np.clip((usual / own) ** 2, LIGHTEST, 1.0)
    return weight / weight.max()
