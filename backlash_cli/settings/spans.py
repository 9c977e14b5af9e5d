"""The engineering spans of a loop: given, or guessed from its data."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ..errors import LoopError
from ..record import FloatArray, LoopSettings, Note, quantile
from ..words import explained, noted
from .schema import Settings

SLACK = 0.05  # of a span: noise around the end of a range
MOST_MA, MA = 30.0, (3.8, 20.5)  # of an output in milliamperes, where it may be one without saying so
TINY = 0.01  # of a span: no valve is throttled there, but shares of 1 are where per cent are expected


def spans_of(settings: Settings, pv: list[FloatArray], op: list[FloatArray],
             told: Mapping[str, tuple[float, float] | None]) -> tuple[LoopSettings, list[Note]]:
    """Decide the spans of one loop after the contract; return its settings on normalised signals, and what was guessed.
    pv: (samples,) measurement, and setpoint if there is one; op: output, if recorded; told: by their units, as 4 to 20
    of mA. Raises LoopError (missing_range) for a gain whose spans are not known."""
    notes: list[Note] = []
    loop, guessed = settings.loop, []
    for name, given, signals in (("pv_range", settings.pv_range, pv), ("op_range", settings.op_range, op)):
        if given is not None:
            loop = loop.with_values(loop.source[name], **{name: given})
            if name == "op_range" and signals:
                low, high = np.fmin.reduce(signals[0]), np.fmax.reduce(signals[0])
                tiny = given[0] <= low < high <= given[0] + TINY * (given[1] - given[0])
                wrong = "op_milliamps" if told.get(name) == (4.0, 20.0) and high < MOST_MA < given[1] else (
                    "op_tiny" if tiny else "op_outside" if low > given[1] or high < given[0] else "")
                if wrong:
                    notes.append(noted(wrong, {"effect": "blocks"} if wrong == "op_milliamps" else {}, share=TINY,
                                       low=low, high=high, end=given[1]))
            continue
        values = np.concatenate([part[np.isfinite(part)] for part in (*signals, np.zeros(0))])
        (low, high), (begin, end) = _bounds(values), told.get(name) or (0.0, 0.0)
        if begin < end and 2 * np.sum(np.abs(2 * values - begin - end) <= (1 + SLACK) * (end - begin)) > len(values):
            span = begin, end
            notes.append(noted("span_told", name=name, begin=begin, end=end))
        elif low >= -SLACK and high <= 1.0 + SLACK:
            span = 0.0, 1.0
            notes += [noted("op_share")] * (name == "op_range" and len(values) > 0)
        elif name == "op_range" and low >= -5.0 and high <= 105.0 and quantile(values, 0.05) >= -SLACK:
            span, amps = (0.0, 100.0), low >= MA[0] and high <= MA[1]
            notes.append(noted("op_percent:current", {"effect": "limits"}) if amps else noted("op_percent"))
        else:
            # from zero where the values do not come near it, else round at both ends
            span = (-_round_up(-low * 1.05) if low < 0.0 else 0.0,
                    _round_up(high * 1.05 or 1.0) if high > 0.0 or low >= 0.0 else 0.0)
            guessed.append((name, *span))
        loop = loop.with_values("data", **{name: span})
    if guessed and settings.loop.K is not None and not settings.engineering:
        raise LoopError(**explained("missing_range", names=" and ".join(name for name, *_ in guessed)))
    for name, low, high in guessed:
        limits = {"effect": "limits"} if name == "op_range" else {}  # a size is in parts of this span
        notes.append(noted(f"guessed_{name}", {"low": low, "high": high, **limits}))
    if settings.engineering:
        ratio = (loop.pv_range[1] - loop.pv_range[0]) / (loop.op_range[1] - loop.op_range[0])
        loop = replace(loop, K=None if loop.K is None else loop.K * ratio, Kp=None if loop.Kp is None
                       else loop.Kp / ratio)
    return loop, notes


def _bounds(values: FloatArray) -> tuple[float, float]:
    """Lowest and highest of finite values, without the outermost thousandth and spikes far from all others."""
    if not len(values):
        return 0.0, 1.0
    ends = float(values.min()), float(values.max())
    if ends[0] >= -SLACK and ends[1] <= 1.0 + SLACK:
        return ends  # normalised: nobody asks further
    # a setpoint that stands still is half of all values: quartiles would say no more than where it stands
    low, first, last, high = (quantile(values, share) for share in (0.001, 0.05, 0.95, 0.999))
    reach = 8.0 * max(last - first, 1e-9 * max(abs(last), abs(first)))
    if low < first - reach or high > last + reach:
        near = values[(values >= first - reach) & (values <= last + reach)]  # never none: first to last lie in it
        low, high = quantile(near, 0.001), quantile(near, 0.999)
    return low, high


def _round_up(value: float) -> float:
    with np.errstate(over="ignore", invalid="ignore"):
        steps = 10.0 ** np.floor(np.log10(value)) * np.array([1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0])
    return float(steps[np.argmax(steps >= value * (1 - 1e-12))])


def normalised(values: FloatArray, span: tuple[float, float]) -> FloatArray:
    """Map a range to 0..1; always a new array."""
    low, high = span
    with np.errstate(over="ignore", invalid="ignore"):
        return (values - low if low else values) * (1.0 / (high - low))
