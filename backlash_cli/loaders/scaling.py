"""Engineering values to 0..1 of their spans, and what is done when the spans are not given."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import LoopError
from ..record import LoopSettings, Note
from .loop_settings import Settings

SLACK = 0.05  # of the span: noise around the end of a range


@dataclass(frozen=True)
class Spans:
    """pv_range, op_range: values that map to 0 and 1. settings: with gains on normalised signals. notes: guesses."""

    pv_range: tuple[float, float]
    op_range: tuple[float, float]
    settings: LoopSettings
    notes: tuple[Note, ...]


def spans_of(
    settings: Settings, pv: NDArray[np.float64], sp: NDArray[np.float64] | None, op: NDArray[np.float64] | None
) -> Spans:
    """Decide the spans of one loop after the contract. pv, sp, op: raw values, nan where missing.

    Raises LoopError (missing_range) when a gain is given but the spans it refers to are not known.
    """
    notes: list[Note] = []
    source = dict(settings.loop.source)
    gain_given = settings.loop.K is not None
    guessed = []
    pv_range = settings.pv_range
    if pv_range is None:
        low, high = _bounds(pv, sp)
        if low >= -SLACK and high <= 1.0 + SLACK:
            pv_range = (0.0, 1.0)
        else:
            pv_range = _round_range(low, high)
            guessed.append("pv_range")
        source["pv_range"] = "data"
    op_range = settings.op_range
    if op_range is None:
        op_range = (0.0, 1.0)
        if op is not None:
            low, high = _bounds(op, None)
            if low >= -SLACK and high <= 1.0 + SLACK:
                pass
            elif low >= -5.0 and high <= 105.0 and np.nanquantile(op, 0.05) >= -SLACK:
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


def normalise(values: NDArray[np.float64], span: tuple[float, float]) -> NDArray[np.float64]:
    """Map a range to 0..1; always a new array."""
    low, high = span
    out = values - low
    out *= 1.0 / (high - low)
    return out


def _bounds(a: NDArray[np.float64], b: NDArray[np.float64] | None) -> tuple[float, float]:
    """Lowest and highest value, without the outermost thousandth and without spikes far from all others."""
    known = a[np.isfinite(a)]
    if b is not None:
        known = np.concatenate([known, b[np.isfinite(b)]])
    if not len(known):
        return 0.0, 1.0
    known.sort()  # takes a third of the time of numpy's quantiles
    low, first, third, high = (_quantile(known, share) for share in (0.001, 0.25, 0.75, 0.999))
    reach = 20.0 * max(third - first, 1e-9 * max(abs(third), abs(first)))
    if low < first - reach or high > third + reach:
        inside = known[np.searchsorted(known, first - reach) : np.searchsorted(known, third + reach, "right")]
        if len(inside):
            low, high = _quantile(inside, 0.001), _quantile(inside, 0.999)
    return low, high


def _quantile(ordered: NDArray[np.float64], share: float) -> float:
    """Quantile of values in order, straight between neighbours."""
    at = share * (len(ordered) - 1)
    low = int(at)
    return float(ordered[low] + (at - low) * (ordered[min(low + 1, len(ordered) - 1)] - ordered[low]))


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
