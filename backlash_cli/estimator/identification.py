"""The settings read from a record, with intervals that hold what the record cannot settle."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..record import FloatArray, LoopSettings, Note
from .control_law import DERIVATIVE, SETPOINT, LawFit, LawRows

NOISE_UNSEEN = 0.125  # h / Ti above which the record misses what the controller saw between samples
WIDE = 2.0  # ratio of the ends of an interval that is worth a note
COARSEST = 1.0  # rows per Ti below which the P part is not seen any more
T95 = (np.inf, np.inf, 12.71, 4.30, 3.18, 2.78, 2.57, 2.45, 2.36, 2.31, 2.26, 2.23, 2.2, 2.18, 2.16, 2.14, 2.13, 2.12)
DIGITS = 6  # of identified settings


@dataclass(frozen=True)
class Identified:
    """A value read from the data, with its 95 % interval."""

    value: float
    ci95: tuple[float, float]


@dataclass(frozen=True)
class Identification:
    """Settings read from the data: K [output span / measurement span of this record], Ti and Td [s], ratio K/Ti [1/s].

    b: weight of the setpoint in the P part, None when the setpoint stands still. Td is 0 unless the data show it.
    Tf: measurement filter [s] (3) that fits best. r2: share of the output's motion that is explained.
    n: rows of data used, `interval` seconds apart. form: "ideal PI" or "ideal PID". notes: what limits the result.
    """

    K: Identified
    Ti: Identified
    Td: Identified
    ratio: Identified
    b: Identified | None
    Tf: float
    r2: float
    n: int
    interval: float
    form: str
    notes: tuple[Note, ...] = ()

    @property
    def separate(self) -> bool:
        """Whether K and Ti are each known to a factor of two or so, and not only their quotient."""
        return not self.notes or all(note.code == "one_frequency" for note in self.notes)

    def settings(self, base: LoopSettings) -> LoopSettings:
        """Return `base` with the values it lacks filled in from the data and named as identified.

        Rounded to what can be known, so that the last digits of a sum do not go into everything that follows.
        """
        missing = {n: getattr(self, n).value for n in ("K", "Ti") if getattr(base, n) is None}
        if missing and base.Td == 0.0 and self.Td.value > 0.0:
            missing["Td"] = self.Td.value
        return base.with_values("identified", **{n: float(f"{value:.{DIGITS}g}") for n, value in missing.items()})


def summarise(rows: LawRows, fits: list[LawFit], averaged: bool, notes: tuple[Note, ...] = ()) -> Identification:
    """Values of the first fit; intervals from its scatter, from the other fits, and from what sampling hides."""
    best = fits[0]
    # Not in the scatter: which part of the newest error the output already contains, and at coarse rates the
    # noise between the samples, which the controller saw and the record did not.
    coarse = 0.0 if averaged else rows.interval / best.reset_time
    systematic = 0.01 + 0.1 * coarse
    attenuation = best.attenuation if coarse > NOISE_UNSEEN else 1.0

    def interval_of(quantity: Callable[[FloatArray], FloatArray], blur: float, stretch: float = 1.0) -> Identified:
        low, high = np.inf, -np.inf
        for fit in fits:
            with np.errstate(divide="ignore", invalid="ignore"):
                value, scatter = float(quantity(fit.values)), quantity(fit.scatter)
                groups = len(scatter)
                error = float(np.sqrt((groups - 1) / groups * np.sum((scatter - scatter.mean()) ** 2)))
            reach = T95[min(groups, len(T95) - 1)] * error + blur * abs(value)
            if not np.isfinite(reach):  # a part of the record without any integral action: nothing is known
                return Identified(float(quantity(best.values)), (-np.inf, np.inf))
            low = min(low, value - reach, value * stretch - reach)
            high = max(high, value + reach, value * stretch + reach)
        return Identified(float(quantity(best.values)), (low, high))

    terms = best.form.terms
    zero = Identified(0.0, (0.0, 0.0))
    has_d = DERIVATIVE in terms
    weighs = SETPOINT in terms and coarse < NOISE_UNSEEN
    gain = interval_of(lambda v: v[..., 0], systematic + 0.15 * coarse, 1.0 / attenuation)
    ends = sorted(abs(x) for x in gain.ci95)
    if gain.ci95[0] * gain.ci95[1] <= 0 or ends[1] > WIDE * ends[0]:
        message = f"K is known to {gain.ci95[0]:.3g}..{gain.ci95[1]:.3g} only (Ti likewise); K/Ti is known better"
        notes = (*notes, Note("gain_uncertain", message, {"low": gain.ci95[0], "high": gain.ci95[1]}))
    if coarse > 1.0 / COARSEST:
        message = (
            f"the samples are {rows.interval:g} s apart and Ti is about {best.reset_time:.2g} s: "
            "too few to tell K and Ti apart; only K/Ti is known"
        )
        notes = (*notes, Note("sampling_too_coarse", message, {"interval": rows.interval, "Ti": best.reset_time}))
    return Identification(
        K=gain,
        Ti=interval_of(lambda v: v[..., 0] / v[..., 1], systematic + 0.15 * coarse, 1.0 / attenuation),
        Td=interval_of(lambda v: v[..., terms.index(DERIVATIVE)] / v[..., 0], systematic) if has_d else zero,
        ratio=interval_of(lambda v: v[..., 1], systematic),
        b=interval_of(lambda v: v[..., terms.index(SETPOINT)] / v[..., 0], systematic) if weighs else None,
        Tf=best.filter_time,
        r2=1.0 - best.unexplained,
        n=len(rows.index),
        interval=rows.interval,
        form="ideal PID" if has_d else "ideal PI",
        notes=notes,
    )
