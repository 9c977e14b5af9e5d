"""How many half periods of a loop were taken and refused, and the list of estimates that goes into its report."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..results import Estimates
from .haegglund import HalfPeriods
from .rule import INCOMPLETE, OK, TOO_SHORT, WHY


@dataclass(frozen=True)
class Tally:
    """counts: how often each of WHY occurs among the half periods kept. left_out: others, too short to be kept."""

    counts: tuple[int, ...]
    left_out: int

    @property
    def accepted(self) -> int:
        """Half periods that pass the published gates."""
        return self.counts[OK]

    @property
    def long(self) -> int:
        """Half periods that are complete and long enough for an estimate."""
        return sum(self.counts) - self.counts[TOO_SHORT] - self.counts[INCOMPLETE]

    @property
    def rejected(self) -> dict[str, int]:
        """How often each gate refused one, by name."""
        found = {WHY[code]: n for code, n in enumerate(self.counts) if n and code != OK}
        if self.left_out:
            found["too_short"] = found.get("too_short", 0) + self.left_out
        return dict(sorted(found.items()))

    def of_report(self, h: HalfPeriods, start: float, seconds: float) -> dict[str, object]:
        """Counts and estimates by their names in a LoopReport. start: of the record. seconds: of it that were used."""
        everything = sum(self.counts) + self.left_out
        return {
            "half_periods": everything,
            "long_half_periods": self.long,
            "detections": self.accepted,
            "detection_rate": self.accepted / max(everything, 1),
            "detections_per_hour": self.accepted / max(seconds / 3600.0, 1e-12),
            "rejected": self.rejected,
            "estimates": _listed(h, start, self.counts),
        }


def tally_of(h: HalfPeriods, left_out: int) -> Tally:
    """Count half periods by what refused them."""
    return Tally(tuple(np.bincount(h.refused, minlength=len(WHY)).tolist()), left_out)


def _listed(h: HalfPeriods, start: float, counts: tuple[int, ...]) -> Estimates:
    """The estimates of all half periods but those that are too short."""
    codes = tuple(sorted(WHY[code] for code, n in enumerate(counts) if n))
    places = np.array([codes.index(code) if code in codes else 0 for code in WHY], dtype=np.uint8)
    listed = np.flatnonzero(h.refused != TOO_SHORT) if counts[TOO_SHORT] else slice(None)
    return Estimates(start, h.begin[listed], h.duration[listed], h.dy[listed], h.e_max[listed], h.d[listed],
                     h.direction[listed].astype(np.int8), places[h.refused[listed]], codes)
