"""The half periods of a report as text, column by column: a plant has hundreds of thousands of them."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence

import numpy as np

from ..record import FloatArray
from ..results import Estimate
from ..results.scan import Estimates

NO_DATE = 2.5e11  # seconds from 1970 beyond which a time is no date (year 9892)
PLAIN = 1e9  # below it, and above its inverse, ten digits are what the shortest form of the number has as well
NUMBERS = ("dt_s", "dy", "e_max", "d")


def shown(value: float) -> float:
    """A finite number to the ten digits that reports show."""
    return float(f"{value:.10g}")


def numbers(values: FloatArray, missing: str = "null") -> list[str]:
    """Numbers to ten digits as JSON writes them; `missing` for what is none.

    >>> numbers(np.array([0.1, 1.0, 1e-7 / 3.0, np.nan]))
    ['0.1', '1.0', '3.333333333e-08', 'null']
    """
    return [_number(v) if abs(v) < np.inf else missing for v in values.tolist()]


def _number(value: float) -> str:
    text = f"{value:.10g}"
    if not 1.0 / PLAIN < abs(value) < PLAIN:
        return repr(float(text))
    return text if "." in text or "e" in text else text + ".0"


def times(epoch: FloatArray) -> list[str | None]:
    """UTC epoch seconds as ISO 8601 text, with a fraction only where there is one; None for what is no date.

    >>> times(np.array([0.0, 1.5, np.nan]))
    ['1970-01-01T00:00:00Z', '1970-01-01T00:00:01.500Z', None]
    """
    known = np.abs(epoch) < NO_DATE
    milliseconds = np.rint(1000.0 * np.where(known, epoch, 0.0)).astype("datetime64[ms]")
    stamps = np.datetime_as_string(milliseconds, unit="ms").tolist()
    return [stamp.replace(".000", "") + "Z" if there else None
            for stamp, there in zip(stamps, known.tolist(), strict=True)]


def as_columns(found: Sequence[Estimate]) -> Estimates:
    """The same half periods as arrays."""
    if isinstance(found, Estimates):
        return found
    codes = tuple(sorted({e.why for e in found}))
    begin, dt_s, dy, e_max, d = (np.array([getattr(e, name) for e in found], dtype=np.float64)
                                 for name in ("start", *NUMBERS))
    return Estimates(0.0, begin, dt_s, dy, e_max, d, np.array([e.direction for e in found], dtype=np.int8),
                     np.array([codes.index(e.why) for e in found], dtype=np.uint8), codes)


def estimates_json(found: Sequence[Estimate]) -> str:
    """A JSON array of objects, one per half period, with the fields of the contract."""
    e = as_columns(found)
    if not len(e):
        return "[]"
    accepted = [f'"accepted": {"true" if code == "ok" else "false"}, "why": {json.dumps(code)}' for code in e.codes]
    stamps = (_quoted(times(t)) for t in (e.origin + e.begin, e.origin + (e.begin + e.dt_s)))
    sizes = (numbers(getattr(e, n)) for n in NUMBERS)
    rows = zip(*stamps, *sizes, e.direction.tolist(), e.why.tolist(), strict=True)
    return "[" + ", ".join([
        f'{{"start": {a}, "end": {b}, "dt_s": {dt}, "dy": {dy}, "e_max": {peak}, "d": {d}, "direction": {sign}, '
        f"{accepted[why]}}}" for a, b, dt, dy, peak, d, sign, why in rows
    ]) + "]"


def _quoted(stamps: Iterable[str | None]) -> list[str]:
    return ["null" if stamp is None else f'"{stamp}"' for stamp in stamps]
