"""What is asked of every signal of a loop, compiled: is it complete, how far does it reach, does it stand still?

Numbers are compared by their bits, as whole numbers, which the processor does several at once.
"""

from __future__ import annotations

from struct import pack, unpack
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .compiled import compiled

FINITE, ENDLESS, UNKNOWN = 0, 1, 2  # all numbers finite; one is infinite; one is nan: these are added
_MOST = np.int64(0x7FFF_FFFF_FFFF_FFFF)
_ENDLESS = np.int64(0x7FF0_0000_0000_0000)
_ROOM = 512  # numbers that stay in the nearest cache


@compiled
def _holds(bits: Any) -> Any:
    endless, unknown = np.int64(0), np.int64(0)
    for k in range(len(bits)):
        size = bits[k] & _MOST
        endless |= np.int64(size == _ENDLESS)
        unknown |= np.int64(size > _ENDLESS)
    return ENDLESS * endless + UNKNOWN * unknown


@compiled
def _scale(values: Any, low: float, factor: float, out: Any, bits: Any) -> Any:
    lowest, highest, strange = _MOST, ~_MOST, np.int64(0)
    for first in range(0, len(values), _ROOM):
        some, scaled, written = values[first : first + _ROOM], out[first : first + _ROOM], bits[first : first + _ROOM]
        for k in range(len(some)):
            scaled[k] = (some[k] - low) * factor
        for k in range(len(written)):
            number = written[k]
            strange |= np.int64((number & _ENDLESS) == _ENDLESS)
            key = number ^ ((number >> 63) & _MOST)  # in the order of the numbers
            lowest, highest = min(lowest, key), max(highest, key)
    return lowest, highest, strange == 0


@compiled
def _still(values: Any) -> bool:
    for k in range(0, len(values) - 5, 5):
        if (values[k] == values[k + 1] and values[k + 1] == values[k + 2] and values[k + 2] == values[k + 3]
                and values[k + 3] == values[k + 4] and values[k + 4] == values[k + 5]):
            return True
    return False


@compiled
def _outside(values: Any, low: float, high: float, least: int, out: Any) -> bool:
    found, run = False, 0
    for first in range(0, len(values), _ROOM):
        some, beyond = values[first : first + _ROOM], False
        for k in range(len(some)):
            beyond |= (some[k] <= low) | (some[k] >= high)
        if not beyond:
            run = 0
            continue
        for k in range(len(some)):
            run = run + 1 if some[k] <= low or some[k] >= high else 0
            if run == least:
                found = True
                for back in range(least):
                    out[first + k - back] = True
            elif run > least:
                out[first + k] = True
    return found


def _read_only(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """The same numbers in the one form for which the functions above are compiled."""
    view = np.ascontiguousarray(values).view()
    view.flags.writeable = False
    return view


def holds(values: NDArray[np.float64]) -> int:
    """Say what numbers there are: FINITE only, or else ENDLESS, UNKNOWN or both, added."""
    return int(_holds(_read_only(values).view(np.int64)))


def scale(
    values: NDArray[np.float64], low: float, factor: float
) -> tuple[NDArray[np.float64], float, float, bool]:
    """Return ((values - low) * factor, the lowest and the highest of these, whether all are finite).

    The lowest and the highest mean something only where all are finite.
    """
    out = np.empty(len(values))
    *keys, finite = _scale(_read_only(values), low, factor, out, out.view(np.int64))
    ends = (key ^ ((key >> 63) & 0x7FFF_FFFF_FFFF_FFFF) for key in keys)
    lowest, highest = unpack("=dd", pack("=qq", *ends))
    return out, lowest, highest, finite


def stays_outside(
    values: NDArray[np.float64], low: float, high: float, least: int
) -> NDArray[np.bool_] | None:
    """(samples,) True where a signal is at most `low` or at least `high` for `least` samples or more; None if it never
    is."""
    out = np.zeros(len(values), bool)
    return out if _outside(_read_only(values), low, high, least, out) else None


def stands_still(values: NDArray[np.float64]) -> bool:
    """Are there five repeats in a row that start at a multiple of five? Every run of nine repeats holds such five."""
    return bool(_still(_read_only(values)))
