"""Engineering values to 0..1 of their spans, and what is done when the spans are not given."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..errors import LoopError
from ..record import LoopSettings, Note
from ..settings import Settings

SLACK = 0.05  # of the span: noise around the end of a range


@dataclass(frozen=True)
class Spans:
    """pv_range, op_range: values that map to 0 and 1. settings: with gains on normalised signals. notes: guesses."""

    pv_range: tuple[float, float]
    op_range: tuple[float, float]
    settings: LoopSettings
    notes: tuple[Note, ...]


def spans_of(settings: Settings, measured: NDArray[np.float64], output: NDArray[np.float64] | None) -> Spans:
    """Decide the spans of one loop after the contract. measured: finite values of PV and SP; output: of OP, None if not
    recorded.

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
            elif low >= -5.0 and high <= 105.0 and float(np.quantile(output, 0.05)) >= -SLACK:
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


def normalised(values: NDArray[np.float64], span: tuple[float, float]) -> NDArray[np.float64]:
    """Map a range to 0..1; always a new array."""
    low, high = span
    with np.errstate(over="ignore", invalid="ignore"):
        return (values - low) * (1.0 / (high - low))


def _bounds(values: NDArray[np.float64]) -> tuple[float, float]:
    """Lowest and highest value, without the outermost thousandth and without spikes far from all others.

    values: finite.
    """
    if not len(values):
        return 0.0, 1.0
    ends = float(values.min()), float(values.max())
    if ends[0] >= -SLACK and ends[1] <= 1.0 + SLACK:
        return ends  # normalised: nobody asks further
    # a setpoint that stands still is half of all values: quartiles would say no more than where it stands
    low, first, last, high = np.quantile(values, [0.001, 0.05, 0.95, 0.999]).tolist()
    reach = 8.0 * max(last - first, 1e-9 * max(abs(last), abs(first)))
    if low < first - reach or high > last + reach:
        near = values[(values >= first - reach) & (values <= last + reach)]
        if len(near):
            low, high = np.quantile(near, [0.001, 0.999]).tolist()
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
