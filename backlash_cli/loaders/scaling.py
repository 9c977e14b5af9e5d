"""Engineering values to 0..1 of their spans, and what is done when the spans are not given."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ..errors import LoopError
from ..record import LoopSettings, Note
from .loop_settings import Settings

SLACK = 0.05  # of the span: noise around the end of a range
ASKED = (0.001, 0.05, 0.25, 0.75, 0.999)  # quantiles from which spans are guessed


@dataclass(frozen=True)
class Spans:
    """pv_range, op_range: values that map to 0 and 1. settings: with gains on normalised signals. notes: guesses."""

    pv_range: tuple[float, float]
    op_range: tuple[float, float]
    settings: LoopSettings
    notes: tuple[Note, ...]


class Values(Protocol):
    """Finite values of a signal, however many."""

    @property
    def ends(self) -> tuple[float, float] | None:
        """Least and greatest, None if there are none."""

    def quantiles(self, shares: list[float]) -> list[float]:
        """Return quantiles, between two values on a straight line."""

    def within(self, low: float, high: float) -> Values:
        """Return the values between two bounds."""


class ArrayValues:
    """Values in memory; cells without a number do not count."""

    def __init__(self, *parts: NDArray[np.float64] | None) -> None:
        self._parts = [part for part in parts if part is not None]
        self._ordered = False

    @cached_property
    def known(self) -> NDArray[np.float64]:
        """The finite values; most loops have spans, and nobody asks for them."""
        return np.concatenate([part[np.isfinite(part)] for part in self._parts])

    @property
    def ends(self) -> tuple[float, float] | None:
        return (float(self.known.min()), float(self.known.max())) if len(self.known) else None

    def quantiles(self, shares: list[float]) -> list[float]:
        if not self._ordered:
            self.known.sort()  # takes a third of the time of numpy's quantiles
            self._ordered = True
        return [quantile(lambda rank: float(self.known[rank]), len(self.known), share) for share in shares]

    def within(self, low: float, high: float) -> ArrayValues:
        return ArrayValues(self.known[(self.known >= low) & (self.known <= high)])


def quantile(at: Callable[[int], float], count: int, share: float) -> float:
    """Quantile of so many values, straight between neighbours. at: gives the value of a rank, counted from 0."""
    place = share * (count - 1)
    low = int(place)
    return at(low) + (place - low) * (at(min(low + 1, count - 1)) - at(low))


def spans_of(settings: Settings, measured: Values, output: Values | None) -> Spans:
    """Decide the spans of one loop after the contract. measured: PV and SP. output: None if not recorded.

    Raises LoopError (missing_range) when a gain is given but the spans it refers to are not known.
    """
    notes: list[Note] = []
    source = dict(settings.loop.source)
    gain_given = settings.loop.K is not None
    guessed = []
    pv_range = settings.pv_range
    if pv_range is None:
        low, high = _bounds(measured)
        if low >= -SLACK and high <= 1.0 + SLACK:
            pv_range = (0.0, 1.0)
        else:
            pv_range = _round_range(low, high)
            guessed.append("pv_range")
        source["pv_range"] = "data"
    op_range = settings.op_range
    if op_range is None:
        op_range = (0.0, 1.0)
        if output is not None:
            low, high = _bounds(output)
            if low >= -SLACK and high <= 1.0 + SLACK:
                pass
            elif low >= -5.0 and high <= 105.0 and output.quantiles([0.05])[0] >= -SLACK:
                op_range = (0.0, 100.0)
                notes.append(Note("op_percent", "op_range is not given: output within 0..100 is taken as percent"))
            else:
                op_range = _round_range(low, high)
                guessed.append("op_range")
        source["op_range"] = "data"
    if guessed and gain_given and not settings.engineering:
        names = " and ".join(guessed)
        raise LoopError(
            f"K is given but {names} is not, and the values are not within 0..1: K has no meaning without its span",
            remedy=f'add {names} = [low, high] to loops.toml, or units = "engineering" if K is in output units per '
            "measurement unit",
            code="missing_range",
        )
    for name in guessed:
        low, high = pv_range if name == "pv_range" else op_range
        notes.append(
            Note(
                f"guessed_{name}",
                f"{name} is not given: scaled by {low:g}..{high:g}, a guess from the data",
                {"low": low, "high": high},
            )
        )
    loop = replace(settings.loop, pv_range=pv_range, op_range=op_range, source=source)
    if settings.engineering:
        ratio = (pv_range[1] - pv_range[0]) / (op_range[1] - op_range[0])
        loop = replace(
            loop,
            K=None if loop.K is None else loop.K * ratio,
            Kp=None if loop.Kp is None else loop.Kp / ratio,
        )
    return Spans(pv_range, op_range, loop, tuple(notes))


class Normalised(NamedTuple):
    """A signal on 0..1 of its span. values: (samples,) nan where missing. low, high: lowest and highest value, where
    all are finite (complete)."""

    values: NDArray[np.float64]
    low: float
    high: float
    complete: bool


def normalised(values: NDArray[np.float64], span: tuple[float, float]) -> Normalised:
    """Map a range to 0..1, and look at the result on the way; always a new array."""
    from .signal_kernel import scale

    low, high = span
    return Normalised(*scale(values, low, 1.0 / (high - low)))


def _bounds(values: Values) -> tuple[float, float]:
    """Lowest and highest value, without the outermost thousandth and without spikes far from all others."""
    ends = values.ends
    if ends is None:
        return 0.0, 1.0
    if ends[0] >= -SLACK and ends[1] <= 1.0 + SLACK:
        return ends  # normalised: nobody asks further
    # a setpoint that stands still is half of all values: quartiles would say no more than where it stands
    low, first, last, high = values.quantiles([0.001, 0.05, 0.95, 0.999])
    reach = 8.0 * max(last - first, 1e-9 * max(abs(last), abs(first)))
    if low < first - reach or high > last + reach:
        inside = values.within(first - reach, last + reach)
        if inside.ends is not None:
            low, high = inside.quantiles([0.001, 0.999])
    return low, high


def _round_range(low: float, high: float) -> tuple[float, float]:
    """A round range that holds the values: from zero when they do not come near it, else round at both ends."""
    if low >= 0.0:
        return 0.0, _round_up(high * 1.05 or 1.0)
    if high <= 0.0:
        return -_round_up(-low * 1.05), 0.0
    return -_round_up(-low * 1.05), _round_up(high * 1.05)


def _round_up(value: float) -> float:
    power = 10.0 ** np.floor(np.log10(value))
    for factor in (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0):
        if factor * power >= value * (1 - 1e-12):
            return float(factor * power)
    return float(10.0 * power)
